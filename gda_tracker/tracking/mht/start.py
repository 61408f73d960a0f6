"""Trees of one leaf: what starts from detections, and what other decisions hand over."""

from __future__ import annotations

import numpy as np

from gda_tracker.association.global_hypotheses import LOG_VANISHING
from gda_tracker.kinematics.sensor_models import polar_measurements
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.initiation import NewTracks
from gda_tracker.tracking.measurement_clutter import log_ratio_of_starts
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.vocabulary.arrays import FloatArray, IntArray
from gda_tracker.vocabulary.scans import Scan


def start_scores(
    new: NewTracks, scan: Scan, clutter_density: float, parameters: TrackManagerParameters
) -> FloatArray:
    """Log likelihood ratio of new tracks (N,) against two false alarms.

    The first detection counts the ratio of new targets to false alarms, each scan without one
    1 - P_D, the second P_D p(z) / beta with z uniform where a target of the largest
    speed can be: the disc of radius v dt, divided by the range as the density is per m and rad.
    What the attributes say of the two is not counted. Of a track that starts from one detection of
    a sensor with a model of its own that is the ratio of new targets alone, over the scan's
    ``relative_clutter_density`` there.
    """
    p = parameters
    if scan.sensor_model:
        return log_ratio_of_starts(new, scan, p.mht_new_target_ratio)
    dt_s = (scan.key.stamp_ns - new.first_stamp_ns) / 1e9
    range_m = polar_measurements(scan).range_m[new.detection]
    spread = (range_m, np.pi * np.square(p.max_speed_mps * dt_s))
    with np.errstate(divide="ignore"):
        log_clutter = max(float(np.log(clutter_density)), LOG_VANISHING)
        log_missed = max(float(np.log1p(-p.detection_probability)), LOG_VANISHING)
        log_detected = max(float(np.log(p.detection_probability)), LOG_VANISHING)
        log_second = np.maximum(np.log(spread[0]) - np.log(spread[1]), LOG_VANISHING)
    return np.asarray(
        np.log(p.mht_new_target_ratio)
        + (new.gap_scans - 1) * log_missed
        + log_detected
        + log_second
        - log_clutter
    )


def start_numbers(new: NewTracks, first_number: int, width: int) -> IntArray:
    """Detections that new tracks (N,) have used on the last ``width`` scans, newest first."""
    numbers = np.full((len(new.detection), width), -1, dtype=np.int64)
    numbers[:, 0] = first_number + new.detection
    inside = np.flatnonzero(new.gap_scans < width)
    numbers[inside, new.gap_scans[inside]] = new.first_number[inside]
    return numbers


def fit(table: HypothesisTable, width: int) -> HypothesisTable:
    """Return the table with room for the detections of the last ``width`` scans.

    Without any the trees end: each track keeps its chosen leaf.
    """
    has = table.detection_numbers.shape[1]
    if has == width:
        return table
    if width == 0:
        table = table.select(table.chosen)
        table.log_score, table.log_room = np.zeros(len(table)), np.zeros(len(table))
        table.detection_numbers = np.zeros((len(table), 0), dtype=np.int64)
        return table
    fitted = table.copy()
    numbers = np.full((len(table), width), -1, dtype=np.int64)
    numbers[:, : min(has, width)] = table.detection_numbers[:, :width]
    fitted.detection_numbers = numbers
    return fitted
