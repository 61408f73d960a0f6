"""Consistency of the errors with the covariances that the tracker states.

NEES, the normalised estimation error squared e' P^-1 e of a state, and NIS, the normalised
innovation squared v' S^-1 v of a measurement, are chi-square distributed with as many degrees of
freedom as e and v have components, if the filter's model is right (Bar-Shalom, Li and Kirubarajan
2001, section 5.4; "track consistency" in Koch 2014, sections 1.3.3 and 3.1). Values above the
bounds mean that the tracker is too sure of itself, values below that it is too cautious.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtr, chdtrc, chdtri, ndtri

from gda_tracker.evaluation.matching import Matches
from gda_tracker.kinematics.gating import MEASUREMENT_DIMENSION, gate_threshold
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array, IntArray
from gda_tracker.vocabulary.hypotheses import Associations, Predictions
from gda_tracker.vocabulary.scans import ScanTruth
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks

CONFIDENCE = 0.95


@dataclass(frozen=True)
class NormalisedErrors:
    """Normalised squared errors (M,) of a run and the scans (M,) at which they were made.

    ``dimension`` is the number of degrees of freedom. ``threshold`` bounds the values from above:
    innovations are gated, estimates are not (infinity).
    """

    squared: FloatArray
    scan: IntArray
    dimension: int
    threshold: float = math.inf


def normalised_squared(error: FloatArray, covariance: FloatArray) -> FloatArray:
    """Squared errors over their covariances, e' C^-1 e, for ``error`` (M, d), C (M, d, d).

    Raises
    ------
    numpy.linalg.LinAlgError
        If a covariance is singular.
    """
    solved = np.linalg.solve(covariance, error[:, :, None])[:, :, 0]
    return (error * solved).sum(axis=1)


def chi_square_bounds(
    dimension: int, samples: IntArray | int, confidence: float = CONFIDENCE
) -> tuple[FloatArray, FloatArray]:
    """Bounds of the mean of independent chi-square variables, equal tails on both sides.

    Parameters
    ----------
    dimension
        Degrees of freedom of each, >= 1.
    samples
        Number of variables of the mean, >= 1 each.
    confidence
        Chance that the mean lies between the bounds, in (0, 1).

    Raises
    ------
    ValueError
        If an argument is not allowed.
    """
    count = np.asarray(samples)
    _check(dimension, count, confidence)
    tail = 0.5 * (1.0 - confidence)
    freedom = count * dimension
    return chdtri(freedom, 1.0 - tail) / count, chdtri(freedom, tail) / count


def gated_moments(dimension: int, threshold: float) -> tuple[float, float]:
    """Mean and variance of a chi-square variable that is known to be at most ``threshold``.

    With F_d the distribution function, E[x | x <= g] = d F_{d+2}(g) / F_d(g) and
    E[x^2 | x <= g] = d (d + 2) F_{d+4}(g) / F_d(g).
    """
    if not threshold > 0.0:
        raise ValueError(f"threshold = {threshold}: allowed is > 0")
    if math.isinf(threshold):
        return float(dimension), 2.0 * dimension
    inside = chdtr(dimension, threshold)
    mean = dimension * chdtr(dimension + 2, threshold) / inside
    square = dimension * (dimension + 2) * chdtr(dimension + 4, threshold) / inside
    return float(mean), float(square - mean * mean)


def gated_bounds(
    dimension: int,
    samples: IntArray | int,
    threshold: float,
    confidence: float = CONFIDENCE,
) -> tuple[FloatArray, FloatArray]:
    """Bounds of the mean of independent gated chi-square variables, by the normal approximation.

    Without a gate (``threshold`` infinite) they are those of :func:`chi_square_bounds`, exactly.
    """
    if math.isinf(threshold):
        return chi_square_bounds(dimension, samples, confidence)
    count = np.asarray(samples)
    _check(dimension, count, confidence)
    mean, variance = gated_moments(dimension, threshold)
    half = ndtri(0.5 * (1.0 + confidence)) * np.sqrt(variance / count)
    return mean - half, mean + half


def score_nees(
    tracks: Sequence[Tracks], truth: Sequence[ScanTruth], found: Matches
) -> NormalisedErrors:
    """NEES of the matched tracks of a run.

    Of position and velocity where the truth knows the velocity of every matched target, else of
    the position alone. A match is never farther than the match distance, which cuts off the largest
    errors: it must be well beyond the tracks' own standard deviations.

    Parameters
    ----------
    tracks, truth
        One entry per scan.
    found
        From :func:`~gda_tracker.evaluation.matching.match_run` with the same tracks and truth.
    """
    if not len(found.scan):
        return NormalisedErrors(np.zeros(0), np.zeros(0, dtype=np.int64), 4)
    rows = list(zip(found.scan, found.track_row, found.target_row, strict=True))
    states = np.stack([truth[scan].target_state[row] for scan, _, row in rows])
    mean = np.stack([tracks[scan].mean[row] for scan, row, _ in rows])
    covariance = np.stack([tracks[scan].covariance[row] for scan, row, _ in rows])
    # The state is all positions, then all velocities.
    second = mean.shape[1] // 2
    columns = np.array([0, 1, second, second + 1])
    dimension = 4 if np.isfinite(states).all() else 2
    columns = columns[:dimension]
    return NormalisedErrors(
        normalised_squared(
            mean[:, columns] - states[:, :dimension],
            covariance[:, columns[:, None], columns],
        ),
        found.scan,
        dimension,
    )


def score_nis(
    tracks: Sequence[Tracks],
    predictions: Sequence[Predictions],
    associations: Sequence[Associations],
    assigned: Sequence[Int32Array | None],
    dimensions: Sequence[int] | None = None,
) -> NormalisedErrors:
    """NIS of the detections that confirmed tracks were given; needs no truth.

    Wrong associations count as well, and nothing beyond the gate: compare with
    :func:`gated_bounds`. All scans must have the gate probability of the first one.

    Under ``mht`` the innovation is that of the leaf which speaks for the track after the scan, from
    the prediction of its own parent. Which leaf that is the detection has helped to choose: where
    several leaves are near each other the values are a little too small.

    Parameters
    ----------
    tracks, predictions, associations
        One entry per scan; the tracks are those after the scan.
    assigned
        ``RingResult.assigned`` of each scan; ``None``: what the associations have chosen.
    dimensions
        Measured quantities of each scan; ``None``: two. Values of another number are told as those
        of two quantities that are as probable, so that all sensors have one measure.

    Raises
    ------
    ValueError
        If the gate probability changes.
    """
    gates = {p.settings.gate_probability for p in predictions}
    if len(gates) > 1:
        raise ValueError(f"gate_probability = {sorted(gates)}: allowed is one value for all scans")
    squared, scans = [np.zeros(0)], [np.zeros(0, dtype=np.int64)]
    for scan, (live, expected, decided, given) in enumerate(
        zip(tracks, predictions, associations, assigned, strict=True)
    ):
        confirmed = live.track_id[live.status == CONFIRMED]
        chosen = decided.chosen if given is None else given[decided.hypothesis] == decided.detection
        chosen = chosen & np.isin(expected.track_id[decided.hypothesis], confirmed)
        values = decided.mahalanobis_squared[chosen]
        if dimensions is not None and dimensions[scan] != MEASUREMENT_DIMENSION:
            values = chdtri(MEASUREMENT_DIMENSION, chdtrc(dimensions[scan], values))
        squared.append(values)
        scans.append(np.full(int(chosen.sum()), scan))
    return NormalisedErrors(
        np.concatenate(squared),
        np.concatenate(scans),
        MEASUREMENT_DIMENSION,
        gate_threshold(gates.pop()) if gates else math.inf,
    )


def _check(dimension: int, count: IntArray | FloatArray, confidence: float) -> None:
    if dimension < 1:
        raise ValueError(f"dimension = {dimension}: allowed is >= 1")
    if not np.all(count >= 1):
        raise ValueError(f"samples = {count.min()}: allowed is >= 1")
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"confidence = {confidence}: allowed is > 0 and < 1")
