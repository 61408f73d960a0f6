"""What a scan tells of each formation: the detections in its gate, and how likely they are."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gda_tracker.association.unresolved import resolution_covariance
from gda_tracker.events.detector import LARGEST_NUMBER
from gda_tracker.formations.likelihood import log_number_ratios
from gda_tracker.formations.parameters import FormationParameters
from gda_tracker.formations.resolution import detection_counts, group_probabilities
from gda_tracker.kinematics.measurement_models import locates
from gda_tracker.kinematics.sensor_models import (
    SMALLEST_RANGE_M,
    cartesian_positions,
    polar_measurements,
)
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray
from gda_tracker.vocabulary.hypotheses import Predictions
from gda_tracker.vocabulary.scans import Scan

# Share of an object's detections that lie in the gate; what is left out is not worth a parameter.
GATE_PROBABILITY = 0.999
# Of two dimensions the quantile of the chi-square distribution is -2 log(1 - p).
GATE_EDGE = math.sqrt(-2.0 * math.log1p(-GATE_PROBABILITY))
# Objects beside the tracks are looked for within so many standard deviations.
SPREAD_EDGE = 2.0
# Where the sensor sees next to nothing, or all, a scan would be as good as certain.
LEAST_DETECTION, MOST_DETECTION = 0.01, 0.9999


@dataclass(frozen=True, slots=True)
class Places:
    """Where tracks of formations are expected: K Gaussian places (components of their mixtures).

    ``formation`` (K,) is the row of the formation, ``weight`` (K,) sums to one over each formation;
    ``position`` (K, 2) [m], ``covariance`` (K, 2, 2).
    """

    formation: IntArray
    weight: FloatArray
    position: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, slots=True)
class NumberEvidence:
    """Of B formations: ``observed`` (B,) whether the scan tells anything, ``log_ratio`` (B, N)."""

    observed: BoolArray
    log_ratio: FloatArray


def places_of(
    predictions: Predictions, track_id: IntArray, formation: IntArray, count: int
) -> tuple[Places, FloatArray, BoolArray]:
    """Return places, P_D (B,) and whether it can be counted (B,) of B formations.

    It cannot if none of its tracks was predicted, or a place is no number.

    Parameters
    ----------
    predictions
        Of the scan. Each track of a formation weighs the same, whatever hypotheses it has.
    track_id, formation
        (T,) tracks by rising id, and the formation of each.
    count
        B.
    """
    slot = np.searchsorted(track_id, predictions.track_id)
    slot = np.minimum(slot, max(len(track_id) - 1, 0))
    known = np.zeros(len(predictions), dtype=bool)
    if len(track_id):
        known = track_id[slot] == predictions.track_id
    rows = np.flatnonzero(known)
    branches = np.bincount(slot[rows], minlength=len(track_id))
    present = branches > 0
    tracks = np.bincount(formation[present], minlength=count)
    there = tracks > 0
    of_row = formation[slot[rows]]
    share = 1.0 / (branches[slot[rows]] * tracks[of_row])
    seen = np.bincount(of_row, share * predictions.detection_probability[rows], count)
    weight_of_row = np.zeros(len(predictions))
    weight_of_row[rows] = share
    owner = np.repeat(np.arange(len(predictions)), np.diff(predictions.component_start))
    component = np.flatnonzero(known[owner])
    row = formation[slot[owner[component]]]
    position = predictions.component_mean[component, :2]
    covariance = predictions.component_covariance[component, :2, :2]
    usable = _usable(position, covariance)
    there[row[~usable]] = False
    places = Places(
        row,
        weight_of_row[owner[component]] * predictions.component_weight[component],
        np.where(usable[:, None], position, 0.0),
        np.where(usable[:, None, None], covariance, np.eye(2)),
    )
    return places, np.asarray(seen, dtype=np.float64), there


def _usable(position: FloatArray, covariance: FloatArray) -> BoolArray:
    """Which places (K,) are numbers, with a covariance that is one."""
    numbers = np.concatenate([position, covariance.reshape(len(position), 4)], axis=1)
    finite = np.asarray((np.abs(numbers) < LARGEST_NUMBER).all(axis=1), dtype=bool)
    safe = np.where(finite[:, None, None], covariance, np.eye(2))
    trace, determinant = np.trace(safe, axis1=1, axis2=2), np.linalg.det(safe)
    definite = (trace > 0.0) & (determinant > 1e-12 * trace**2)
    return finite & np.asarray(definite, dtype=bool)


def number_evidence(
    scan: Scan,
    places: Places,
    detection_probability: FloatArray,
    there: BoolArray,
    foreign: BoolArray,
    clutter_density: float,
    parameters: FormationParameters,
) -> NumberEvidence:
    """Log likelihood ratios of 1..N objects against none, of one scan and B formations.

    Parameters
    ----------
    scan
        Of a sensor that measures places; else nothing is observed.
    places, detection_probability, there
        From :func:`places_of`.
    foreign
        (B, n) detections that a track of another formation took.
    clutter_density
        rho [1/(m rad)].
    parameters
        The table.

    Notes
    -----
    The gate is an ellipse about the centroid that holds the gate of each place and what is within
    two standard deviations of ``spread_std_m`` of it. An object is at one of the places, all alike,
    or, with ``uniform_share``, anywhere in the gate.
    """
    b = len(there)
    nothing = NumberEvidence(np.zeros(b, dtype=bool), np.zeros((b, parameters.largest_number)))
    if not b or not locates(scan) or not clutter_density > 0.0:
        return nothing
    measured = polar_measurements(scan)
    position, noise = cartesian_positions(measured)
    seen = np.clip(detection_probability * GATE_PROBABILITY, 0.0, MOST_DETECTION)
    observed = there & (seen >= LEAST_DETECTION)
    centre, spread, error = _moments(places, b)
    offset = centre - scan.sensor_position_m[:2]
    turned, polar_noise = _local_noise(offset, measured.covariance, scan)
    objects = spread + parameters.spread_std_m**2 * np.eye(2)
    local = turned @ polar_noise @ turned.swapaxes(1, 2)
    gate = _gate_ellipse(places, centre, spread + error, error + local, parameters.spread_std_m)
    area = math.pi * np.sqrt(np.linalg.det(gate))
    away = position[None] - centre[:, None]
    squared = np.einsum("bni,bij,bnj->bn", away, np.linalg.inv(gate), away)
    inside = (squared <= 1.0) & ~foreign
    density = _place_density(places, position, noise, b)
    share = parameters.uniform_share
    mixed = (1.0 - share) * density + share / area[:, None]
    # A density over range and azimuth is one over the plane, divided by the range.
    range_m = np.maximum(measured.range_m, SMALLEST_RANGE_M)
    with np.errstate(divide="ignore"):
        log_ratio = np.where(inside, np.log(mixed * range_m / clutter_density), -np.inf)
    kept = inside.any(axis=0)
    ratio = np.full((b, 2), np.inf)
    if parameters.limited_resolution:
        cell = resolution_covariance(
            np.array([parameters.resolution_range_m, parameters.resolution_azimuth_rad])
        )
        cells = turned @ cell @ turned.swapaxes(1, 2)
        eigenvalues = np.linalg.eigvals(np.linalg.solve(cells, objects)).real
        ratio = np.maximum(eigenvalues, 0.0)
    groups = group_probabilities(ratio, parameters.largest_number)
    ratios = log_number_ratios(detection_counts(seen, groups), log_ratio[:, kept])
    return NumberEvidence(observed, np.where(observed[:, None], ratios, 0.0))


def _moments(places: Places, count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Centroid (B, 2), spread about it (B, 2, 2) and mean error (B, 2, 2) of the places."""

    def total(values: FloatArray) -> FloatArray:
        flat = values.reshape(len(values), -1)
        summed = np.zeros((count, flat.shape[1]))
        np.add.at(summed, places.formation, places.weight[:, None] * flat)
        return summed.reshape(count, *values.shape[1:])

    centre = total(places.position)
    out = places.position - centre[places.formation]
    return centre, total(out[:, :, None] * out[:, None, :]), total(places.covariance)


def _gate_ellipse(
    places: Places, centre: FloatArray, shape: FloatArray, error: FloatArray, spread_std_m: float
) -> FloatArray:
    """Matrices (B, 2, 2) Q of the gates {x: (x - centre)' Q^-1 (x - centre) <= 1}.

    The sum of three ellipses: about all places, in the metric of ``shape`` (B, 2, 2); of objects
    beside the tracks; of the errors of a detection, ``error`` (B, 2, 2). The ellipse of least trace
    around a sum of Q_i is sum_i sqrt(tr Q_i) sum_i Q_i / sqrt(tr Q_i).
    """
    out = places.position - centre[places.formation]
    inverse = np.linalg.inv(shape)[places.formation]
    reach = np.zeros(len(centre))
    np.maximum.at(reach, places.formation, np.einsum("ki,kij,kj->k", out, inverse, out))
    terms = np.stack(
        [
            reach[:, None, None] * shape,
            np.broadcast_to((SPREAD_EDGE * spread_std_m) ** 2 * np.eye(2), shape.shape),
            GATE_EDGE**2 * error,
        ]
    )
    size = np.sqrt(np.trace(terms, axis1=2, axis2=3))
    share = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0)
    gate: FloatArray = size.sum(axis=0)[:, None, None] * (share[..., None, None] * terms).sum(
        axis=0
    )
    return gate


def _local_noise(
    offset: FloatArray, covariance: FloatArray, scan: Scan
) -> tuple[FloatArray, FloatArray]:
    """Jacobian (B, 2, 2) of polar to plane at each centroid, and the scan's median noise (2, 2).

    Without a detection there is no noise to know; the gate is then empty, however wide.
    """
    range_m = np.maximum(np.hypot(offset[:, 0], offset[:, 1]), SMALLEST_RANGE_M)
    along = offset / range_m[:, None]
    across = np.stack([-along[:, 1], along[:, 0]], axis=1) * range_m[:, None]
    noise = np.median(covariance, axis=0) if len(scan) else np.zeros((2, 2))
    return np.stack([along, across], axis=2), noise


def _place_density(
    places: Places, position: FloatArray, noise: FloatArray, count: int
) -> FloatArray:
    """Density (B, n) [1/m2] of the mixture of each formation's places at each detection."""
    total = places.covariance[:, None] + noise[None]
    gap = position[None] - places.position[:, None]
    a, b, d = total[..., 0, 0], total[..., 0, 1], total[..., 1, 1]
    determinant = a * d - b * b
    x, y = gap[..., 0], gap[..., 1]
    squared = (d * x * x - 2.0 * b * x * y + a * y * y) / determinant
    value = np.exp(-0.5 * squared) / (2.0 * math.pi * np.sqrt(determinant))
    density = np.zeros((count, len(position)))
    np.add.at(density, places.formation, places.weight[:, None] * value)
    return density
