"""Detection probability, estimated while tracking, by region of range and azimuth of each sensor.

Hits and misses of confirmed tracks are counted (:mod:`gda_tracker.tracking.looks`). Each track
counts as far as there is a target behind it *before* the scan: weights that know the outcome would
forget the misses. A hit is a detection inside the gate, so the estimate is divided by the
probability of that.

Only confirmed tracks count, and that is a bias: where targets are seldom seen, they are seldom
confirmed, and soon lost. Detections of others that a missed track takes count as hits.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gda_tracker.association.choices import JPDA
from gda_tracker.tracking.existence import existence_of_tracks
from gda_tracker.tracking.looks import DetectionMap, observe, probabilities
from gda_tracker.tracking.manager_state import OpenScan
from gda_tracker.tracking.parameter_groups.sensor import GIVEN
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array
from gda_tracker.vocabulary.hypotheses import Associations, Predictions
from gda_tracker.vocabulary.scans import Scan
from gda_tracker.vocabulary.tracks import CONFIRMED


def tell_detection_map(
    predictions: Predictions,
    known: DetectionMap,
    scan: Scan,
    mean: FloatArray,
    parameters: TrackManagerParameters,
) -> Predictions:
    """Give each hypothesis, with its predicted state (H, s), the probability of its place."""
    p = parameters
    if p.detection_probability_map == GIVEN:
        return predictions
    found = probabilities(
        known,
        scan.key.sensor_id,
        *_place(scan, mean),
        p.detection_probability,
        p.gate_probability,
    )
    return replace(predictions, detection_probability=found)


def detection_map_after(
    known: DetectionMap,
    opened: OpenScan,
    associations: Associations,
    assigned: Int32Array,
    parameters: TrackManagerParameters,
) -> DetectionMap:
    """Return the map after a scan; ``assigned`` (H,) are the rows that hypotheses were given."""
    if parameters.detection_probability_map == GIVEN:
        return known
    table, scan = opened.table, opened.scan
    rows = np.flatnonzero(table.chosen & (table.status == CONFIRMED))
    if associations.decision == JPDA:
        hit = np.minimum(_detected(associations, len(table))[rows], 1.0)
    else:
        # Of several leaves another one may lead now than did before the scan.
        hit = np.isin(table.track_id[rows], table.track_id[assigned >= 0]).astype(float)
    weight = existence_of_tracks(table)[rows]
    return observe(
        known,
        scan.key.sensor_id,
        *_place(scan, table.mean[rows]),
        weight * hit,
        weight * (1.0 - hit),
        parameters.detection_memory_scans,
    )


def _detected(associations: Associations, count: int) -> FloatArray:
    """Probability (H,) that each hypothesis has a detection, its own or a group's."""
    found = np.bincount(associations.hypothesis, associations.joint_marginal, minlength=count)
    shared = associations.group_detection >= 0
    for members in (associations.group_first, associations.group_second):
        share = associations.group_marginal[shared]
        found = found + np.bincount(members[shared], share, minlength=count)
    return np.asarray(found)


def _place(scan: Scan, mean: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Range and azimuth (P,) of states (P, s) around the scan's sensor."""
    gap = mean[:, :2] - scan.sensor_position_m[:2]
    return np.hypot(gap[:, 0], gap[:, 1]), np.arctan2(gap[:, 1], gap[:, 0])
