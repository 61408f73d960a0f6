"""From detections to cells: which ones belong to one object, and what the object looks like.

Several partitions of the scan are weighed against the predicted tracks, their extents and the
numbers of detections that they give; the most probable one becomes the scan that goes round the
ring, with a row for each cell. Its position is the centroid of the cell. The centroid's noise is
that of the sensor and of where on the object the detections come from, (spread X + R) / n: X is the
extent that the track has to which the cell falls in the hypothesis taken, of other cells what a new
object would have.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from gda_tracker.association.extended.hypotheses import Explanation, ExtendedSensor
from gda_tracker.association.extended.regions import explain_by_region
from gda_tracker.kinematics.extended.partitions import distance_partitions
from gda_tracker.kinematics.extended.random_matrix import Cells, ExtendedStates, feldmann_update
from gda_tracker.kinematics.range_rate import range_rates
from gda_tracker.kinematics.sensor_models import (
    SMALLEST_RANGE_M,
    PolarMeasurements,
    cartesian_positions,
    polar_measurements,
    wrap_angle,
)
from gda_tracker.tracking.extended.columns import PRIOR_RATE_SHAPE, extents_of, prior_extents
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray
from gda_tracker.vocabulary.extents import ScanCells
from gda_tracker.vocabulary.scans import Scan

# An object is in view with less than certainty, and with some chance.
SMALLEST_PROBABILITY = 1e-6


def scan_of_cells(
    scan: Scan, table: HypothesisTable, clutter_density: float, parameters: TrackManagerParameters
) -> Scan:
    """Return the scan with its detections put together into cells.

    Parameters
    ----------
    scan
        As it was admitted, of a sensor that measures range and azimuth.
    table
        The hypotheses at its time, with extents.
    clutter_density
        Of single false alarms [1/(m rad)].
    parameters
        Those of the scan.

    Returns
    -------
    Scan
        A row for each cell. The sensor is level, elevation is taken out. Radar cross sections are
        the sums over the detections with one, further attributes and time offsets the means.
    """
    p, measurements = parameters, polar_measurements(scan)
    position, noise = cartesian_positions(measurements)
    # Per square metre there are fewer, the farther away.
    relative = 1.0 / np.maximum(measurements.range_m, SMALLEST_RANGE_M)
    leading = table.select(table.chosen)
    partitions = np.zeros((1, 0), dtype=np.int64)
    if len(scan):
        partitions = distance_partitions(
            position, p.cell_least_distance_m, p.cell_largest_distance_m, p.cell_partitions
        )
    known = extents_of(leading)
    explanation, probability = explain_by_region(
        ExtendedStates(leading.mean, leading.covariance, known.extent, known.weight),
        known.rate_shape,
        known.rate_rate,
        position,
        noise,
        partitions,
        sensor_of(clutter_density, p),
        relative,
    )
    order = np.argsort(explanation.label, kind="stable")
    cells = explanation.cells
    away = cells.centroid - measurements.sensor_xy_m
    reach = np.maximum(np.hypot(away[:, 0], away[:, 1]), SMALLEST_RANGE_M)
    extent = _expected_extents(explanation, known.extent, p)
    spread = (p.extent_spread * extent + cells.noise) / cells.count[:, None, None]
    found = ScanCells(
        count=cells.count.astype(np.int32),
        scatter=cells.scatter,
        noise=cells.noise,
        log_false=explanation.log_false - np.log(clutter_density / reach),
        member=scan.source_index[order],
        probability=probability,
    )
    return _of_cells(
        scan, measurements, explanation, _nearest(position, explanation), reach, away, spread, found
    )


def sensor_of(clutter_density: float, parameters: TrackManagerParameters) -> ExtendedSensor:
    """What the hypotheses over partitions are told, with densities a metre from the sensor."""
    p = parameters
    view = p.detection_probability
    return ExtendedSensor(
        detection_probability=min(max(view, SMALLEST_PROBABILITY), 1.0 - SMALLEST_PROBABILITY),
        clutter_density=clutter_density,
        birth_density=p.mht_new_target_ratio * clutter_density,
        ghost_density=p.false_group_ratio * clutter_density,
        spread=p.extent_spread,
        birth_rate_shape=PRIOR_RATE_SHAPE,
        birth_rate_rate=PRIOR_RATE_SHAPE / p.detections_per_object,
        birth_radius_m=p.extent_radius_m,
        birth_weight=p.extent_prior_weight,
    )


def new_extents(cells: Cells, parameters: TrackManagerParameters) -> tuple[FloatArray, FloatArray]:
    """Extents (C, 2, 2) and weights (C,) of new objects, each seen by its cell alone."""
    count = len(cells.count)
    prior = prior_extents(count, parameters)
    # Nothing was known of the centroid: of it the extent learns nothing.
    far = np.broadcast_to(np.eye(4), (count, 4, 4))
    mean = np.concatenate([cells.centroid, np.zeros((count, 2))], axis=1)
    states = ExtendedStates(mean, far, prior.extent, prior.weight)
    states, _ = feldmann_update(states, cells, parameters.extent_spread)
    # What it has learnt from the centroid is 0 at the weight of one detection: taken out.
    weight = states.weight - 1.0
    return states.extent * (states.weight / weight)[:, None, None], weight


def _expected_extents(
    explanation: Explanation, predicted: FloatArray, parameters: TrackManagerParameters
) -> FloatArray:
    """Extent (C, 2, 2) behind each cell: of its track, else of a new object."""
    extent, _ = new_extents(explanation.cells, parameters)
    seen = np.flatnonzero(explanation.cell_of >= 0)
    extent[explanation.cell_of[seen]] = predicted[seen]
    return extent


def _nearest(position: FloatArray, explanation: Explanation) -> IntArray:
    """Row (C,) of the detection that is nearest to the centroid of each cell."""
    gap = np.sum((position - explanation.cells.centroid[explanation.label]) ** 2, axis=1)
    order = np.lexsort((gap, explanation.label))
    _, first = np.unique(explanation.label[order], return_index=True)
    return order[first]


def _of_cells(
    scan: Scan,
    measurements: PolarMeasurements,
    explanation: Explanation,
    nearest: IntArray,
    reach: FloatArray,
    away: FloatArray,
    spread: FloatArray,
    cells: ScanCells,
) -> Scan:
    """Put the rows of the scan together."""
    count, label = len(reach), explanation.label
    n = cells.count.astype(np.float64)

    def sums(values: FloatArray, where: BoolArray | None = None) -> FloatArray:
        own = values if where is None else np.where(where, values, 0.0)
        return np.asarray(np.bincount(label, own, minlength=count), dtype=np.float64)

    # From the plane to range and azimuth.
    u = away / reach[:, None]
    slope = np.empty((count, 2, 2))
    slope[:, 0] = u
    slope[:, 1] = np.stack([-u[:, 1], u[:, 0]], axis=1) / reach[:, None]
    noise = slope @ spread @ slope.transpose(0, 2, 1)
    noise = 0.5 * (noise + noise.transpose(0, 2, 1))
    rates = range_rates(scan, measurements)
    rate = None
    if rates is not None:
        rate = sums(rates.value_mps) / n
        # Parts of an object move at rates of their own: the mean is as sure as they agree.
        varied = sums((rates.value_mps - rate[label]) ** 2) / np.maximum(n - 1.0, 1.0)
        whole = np.zeros((count, 3, 3))
        whole[:, :2, :2] = noise
        whole[:, 2, 2] = (sums(rates.covariance[:, 2]) / n + varied) / n
        noise = whole
    x, y, z, w = (float(value) for value in scan.sensor_orientation_xyzw)
    yaw = 2.0 * math.atan2(z, w)
    orientation = scan.sensor_orientation_xyzw
    if abs(x) > 1e-12 or abs(y) > 1e-12:
        yaw = math.atan2(2.0 * (x * y + z * w), 1.0 - 2.0 * (y * y + z * z))
        orientation = np.array([0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)])
    values = valid = None
    if scan.attribute_values is not None and scan.attribute_valid is not None:
        known = np.array([sums(one.astype(float)) for one in scan.attribute_valid])
        total = np.array(
            [
                sums(one, where)
                for one, where in zip(scan.attribute_values, scan.attribute_valid, strict=True)
            ]
        )
        shape = (len(scan.attribute_names), count)
        values = (total / np.maximum(known, 1.0)).reshape(shape)
        valid = (known > 0.0).reshape(shape)
    return replace(
        scan,
        sensor_orientation_xyzw=orientation,
        source_index=scan.source_index[nearest],
        range_m=reach,
        azimuth_rad=wrap_angle(np.arctan2(away[:, 1], away[:, 0]) - yaw),
        noise_covariance=noise,
        rcs_m2=sums(scan.rcs_m2, scan.rcs_valid),
        rcs_valid=sums(scan.rcs_valid.astype(float)) > 0.0,
        elevation_rad=None,
        range_rate_mps=rate,
        time_offset_s=None if scan.time_offset_s is None else sums(scan.time_offset_s) / n,
        attribute_values=values,
        attribute_valid=valid,
        cells=cells,
    )
