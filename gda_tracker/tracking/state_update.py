"""What a scan does to the hypotheses it finds: predicted to its time, updated by its detections."""

from __future__ import annotations

import numpy as np

from gda_tracker.kinematics.gaussian_filters import predict, update
from gda_tracker.kinematics.motion_models import constant_velocity
from gda_tracker.kinematics.range_rate import range_rates, update_with_range_rate
from gda_tracker.kinematics.sensor_models import innovations, polar_measurements
from gda_tracker.tracking.gaussian_sums import parts_of, update_by_model, with_parts
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.model_states import (
    has_models,
    predict_models,
    update_models,
    without_models,
)
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.vocabulary.arrays import BoolArray, Int32Array, IntArray
from gda_tracker.vocabulary.beliefs import AttributeScores
from gda_tracker.vocabulary.scans import Scan


def predict_states(
    table: HypothesisTable, dt_s: float, parameters: TrackManagerParameters, stamp_ns: int = 0
) -> HypothesisTable:
    """Return the hypotheses ``dt_s`` [s] later; the table given stays as it is.

    Its rows get, or lose, the models of the filter that the parameters ask for. ``stamp_ns`` is the
    time predicted to, for those that have a plan.
    """
    if table.spread > 1:
        parts, weight = parts_of(table)
        parts.track_id = np.repeat(table.track_id, table.spread)
        predicted = table.copy()
        with_parts(predicted, predict_states(parts, dt_s, parameters, stamp_ns), weight)
        return predicted
    if has_models(parameters):
        return predict_models(table, dt_s, parameters, stamp_ns)
    if table.model_weight.shape[1]:
        table = without_models(table)
    if not len(table) or dt_s == 0.0:
        return table
    transition, noise = constant_velocity(dt_s, parameters.process_noise_std_mps2)
    predicted = table.copy()
    predicted.mean, predicted.covariance = predict(table.mean, table.covariance, transition, noise)
    return predicted


def update_states(
    table: HypothesisTable, scan: Scan, assigned: Int32Array, use_range_rate: bool = True
) -> None:
    """Update the state of each hypothesis with the detection it is assigned.

    ``assigned`` (H,) is a row of the scan, or -1 for a hypothesis that stays as it was predicted.
    With ``use_range_rate`` range rates count where the scan has any.
    """
    rows = np.flatnonzero(assigned >= 0)
    if not len(rows):
        return
    if scan.sensor_model:
        update_by_model(table, scan, rows, assigned[rows])
        return
    measurements = polar_measurements(scan)
    rates = range_rates(scan, measurements) if use_range_rate else None
    detection = assigned[rows]
    if table.model_weight.shape[1]:
        update_models(table, measurements, rates, rows, detection)
        return
    old_mean, old_covariance = table.mean[rows], table.covariance[rows]
    innovation = innovations(measurements, old_mean, old_covariance, detection)
    mean, covariance = table.mean.copy(), table.covariance.copy()
    if rates is None:
        mean[rows], covariance[rows] = update(old_mean, old_covariance, innovation)
    else:
        updated = update_with_range_rate(
            old_mean, old_covariance, innovation, measurements, rates, detection
        )
        mean[rows], covariance[rows] = updated.mean, updated.covariance
    table.mean, table.covariance = mean, covariance


def update_beliefs(table: HypothesisTable, scores: AttributeScores, chosen: BoolArray) -> None:
    """Give each hypothesis with a detection the candidate belief of its pair.

    ``chosen`` (P,) marks the pairs of the scores that were decided for.
    """
    pairs = np.flatnonzero(chosen)
    set_beliefs(table, scores, scores.hypothesis[pairs].astype(np.int64), pairs)


def set_beliefs(
    table: HypothesisTable, scores: AttributeScores, rows: IntArray, pairs: IntArray
) -> None:
    """Give hypotheses, ``rows`` (R,) of the table, the candidate beliefs of ``pairs`` (R,)."""
    if not len(pairs):
        return
    if scores.masses.shape[1]:
        table.use_focal(scores.focal)
        masses = table.masses.copy()
        masses[rows] = 0.0
        masses[rows, : len(scores.focal)] = scores.masses[pairs]
        table.masses = masses
    if scores.class_probability.shape[1]:
        beliefs = table.class_probability.copy()
        beliefs[rows] = scores.class_probability[pairs]
        table.class_probability = beliefs
    conflict = table.conflict.copy()
    conflict[rows] = scores.conflict[pairs]
    table.conflict = conflict


def count_detections(table: HypothesisTable, scan: Scan, assigned: Int32Array) -> None:
    """Count the scan as a hit or a miss of each hypothesis; ``assigned`` as above."""
    hit = assigned >= 0
    table.history = ((table.history << 1) & np.int64((1 << 60) - 1)) | hit
    table.age_scans = table.age_scans + 1
    table.hits = table.hits + hit
    table.misses = table.misses + ~hit
    table.coasted_scans = np.where(hit, 0, table.coasted_scans + 1)
    stamp_ns = np.int64(scan.key.stamp_ns)
    table.last_detection_ns = np.where(hit, stamp_ns, table.last_detection_ns)
    source = np.append(scan.source_index, -1).astype(np.int64)
    table.detection_index = source[assigned]
