"""What a scan makes of the extents and rates: one cell each, or several by their probabilities."""

from __future__ import annotations

import numpy as np

from gda_tracker.association.extended.hypotheses import new_object_log_weight
from gda_tracker.kinematics.extended.detection_rate import update_rate
from gda_tracker.kinematics.extended.mixtures import merge_extents, merge_rates
from gda_tracker.kinematics.extended.random_matrix import Cells, ExtendedStates, feldmann_update
from gda_tracker.kinematics.sensor_models import cartesian_positions, polar_measurements
from gda_tracker.tracking.extended.cells import new_extents, sensor_of
from gda_tracker.tracking.extended.columns import (
    COLUMNS,
    Extents,
    extents_of,
    prior_extents,
    turned,
    turns,
)
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.jpda_update import missed_probability
from gda_tracker.tracking.parameter_groups.extended import NONE
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array, IntArray
from gda_tracker.vocabulary.hypotheses import Associations
from gda_tracker.vocabulary.scans import Scan


def update_extents(
    table: HypothesisTable,
    predicted: HypothesisTable,
    scan: Scan,
    assigned: Int32Array,
    parameters: TrackManagerParameters,
) -> None:
    """Update extent and rate of each hypothesis by the cell it is assigned.

    Parameters
    ----------
    table
        Its states are those after the scan; its extents are replaced.
    predicted
        The same rows, predicted to the scan.
    scan
        With cells.
    assigned
        (H,) row of the scan, or -1: extent and rate stay as they were predicted. (Were a miss to
        lower the rate it would come to explain every further miss, and a lost track would live on.)
    parameters
        Those of the scan.
    """
    table.cell_members = members_of(scan)
    rows = np.flatnonzero(assigned >= 0)
    known = _turned(table, predicted, parameters)
    new = _updated(known.select(rows), predicted.select(rows), scan, assigned[rows], parameters)
    columns = known.packed()
    columns[rows] = new.packed()
    table.extended = columns


def update_extents_by_marginals(
    table: HypothesisTable,
    predicted: HypothesisTable,
    scan: Scan,
    associations: Associations,
    parameters: TrackManagerParameters,
) -> None:
    """Update extent and rate of each hypothesis by all its cells, each as far as it is probable.

    The mixture of the updates, and of the prediction as far as it was missed, is taken by its
    moments; arguments as for :func:`update_extents`.
    """
    table.cell_members = members_of(scan)
    known = _turned(table, predicted, parameters)
    pair, h = associations.hypothesis, len(table)
    each = _updated(
        known.select(pair), predicted.select(pair), scan, associations.detection, parameters
    )
    marginal = associations.joint_marginal
    share = np.concatenate([missed_probability(h, pair, marginal), marginal])
    row = np.concatenate([np.arange(h), pair])
    # An engine may approximate: shares sum to one exactly.
    share = share / np.bincount(row, share, minlength=h)[row]
    extent, weight = merge_extents(
        share,
        row,
        np.concatenate([known.extent, each.extent]),
        np.concatenate([known.weight, each.weight]),
        h,
    )
    shape, rate = merge_rates(
        share,
        row,
        np.concatenate([known.rate_shape, each.rate_shape]),
        np.concatenate([known.rate_rate, each.rate_rate]),
        h,
    )
    table.extended = Extents(extent, weight, shape, rate).packed()


def begin_extents(
    born: HypothesisTable,
    scan: Scan,
    detection: IntArray,
    clutter_density: float,
    parameters: TrackManagerParameters,
) -> None:
    """Give new tracks the extents of their cells, or, of scans without cells, the prior ones.

    What the cell says for an object, and against false detections, is added to the odds of the
    track.

    Parameters
    ----------
    born
        N tracks that start, completed here.
    scan, detection
        The scan, and the rows (N,) in it.
    clutter_density
        Of single false alarms [1/(m rad)].
    parameters
        Those of the scan.
    """
    p = parameters
    if p.extended_objects == NONE:
        return
    extents = prior_extents(len(detection), p)
    if scan.cells is not None:
        seen = cells_at(scan, detection)
        extents.extent, extents.weight = new_extents(seen, p)
        extents.rate_shape, extents.rate_rate = update_rate(
            extents.rate_shape, extents.rate_rate, seen.count
        )
        sensor = sensor_of(clutter_density, p)
        odds = new_object_log_weight(seen, sensor) - np.log(sensor.birth_density)
        odds = odds - scan.cells.log_false[detection]
        born.log_prior_odds = born.log_prior_odds + odds
        if born.detection_numbers.shape[1]:
            born.log_score = born.log_score + odds
    born.extended = extents.packed()


def cells_at(scan: Scan, rows: IntArray | Int32Array) -> Cells:
    """Cells (P,) of the given rows of a scan, in the tracking plane."""
    assert scan.cells is not None
    centroid, _ = cartesian_positions(polar_measurements(scan))
    seen = scan.cells
    return Cells(
        seen.count[rows].astype(np.int64), centroid[rows], seen.scatter[rows], seen.noise[rows]
    )


def members_of(scan: Scan) -> Int32Array:
    """Rows (m, 2) of the source: by which each cell is called, and each of its detections."""
    assert scan.cells is not None
    called = np.repeat(scan.source_index, scan.cells.count)
    return np.stack([called, scan.cells.member], axis=1).astype(np.int32)


def _turned(
    table: HypothesisTable, predicted: HypothesisTable, parameters: TrackManagerParameters
) -> Extents:
    """Predicted extents, turned as the scan has turned the course."""
    if predicted.extended.shape[1] != COLUMNS:
        return prior_extents(len(predicted), parameters)
    known = extents_of(predicted)
    if parameters.extent_turns_with_course:
        known.extent = turned(known.extent, turns(predicted, table))
    return known


def _updated(
    known: Extents,
    predicted: HypothesisTable,
    scan: Scan,
    detection: Int32Array,
    parameters: TrackManagerParameters,
) -> Extents:
    """Extents (P,) of pairs after their cells."""
    cells = cells_at(scan, detection)
    mean, covariance = predicted.mean, predicted.covariance
    if scan.time_offset_s is not None:
        tau = scan.time_offset_s[detection]
        mean, covariance = _moved(mean, covariance, tau)
    states = ExtendedStates(mean, covariance, known.extent, known.weight)
    new, _ = feldmann_update(states, cells, parameters.extent_spread)
    shape, rate = update_rate(known.rate_shape, known.rate_rate, cells.count)
    return Extents(new.extent, new.weight, shape, rate)


def _moved(
    mean: FloatArray, covariance: FloatArray, tau: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """States (P, 4) at the times of their detections, ``tau`` (P,) [s] after the scan's."""
    step = np.tile(np.eye(4), (len(mean), 1, 1))
    step[:, 0, 2] = step[:, 1, 3] = tau
    return (step @ mean[:, :, None])[:, :, 0], step @ covariance @ step.transpose(0, 2, 1)
