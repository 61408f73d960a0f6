"""Events of three tracks that were one group: which leaves together, and which detection.

Without them three targets in one cell would count as a pair and a third one that is resolved from
both and missed, on every scan: histories in which the tracks drift apart, out of the cell, would
outweigh the true one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gda_tracker.association.global_hypotheses import LOG_VANISHING
from gda_tracker.association.unresolved import LEAST_UNRESOLVED, resolution_covariance
from gda_tracker.kinematics.groups_of_three import three_log_likelihood, way_probabilities
from gda_tracker.kinematics.sensor_models import (
    PolarMeasurements,
    polar_measurements,
    predicted_measurements,
)
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.mht.compounds import compounds
from gda_tracker.tracking.mht.couplings import CoupledTracks
from gda_tracker.vocabulary.arrays import FloatArray, IntArray
from gda_tracker.vocabulary.hypotheses import Predictions
from gda_tracker.vocabulary.scans import Scan

MOST_PARENTS = 256
"""Joint leaves of three tracks that branch as one group, the heaviest ones."""
MOST_EVENTS_OF_THREE = 64
"""Events that become branches of three tracks, the most probable ones."""


@dataclass(frozen=True, slots=True)
class EventsOfThree:
    """T events: ``rows`` (T, 3) of the leaves, ``detection`` (T,) in the scan, -1 for none.

    ``score`` (T,) is the log likelihood ratio against false alarms, P_3 P_Du N / beta with a
    detection and P_3 (1 - P_Du) without; ``log_likelihood`` (T,) is log N, 0 without.
    """

    rows: IntArray
    detection: IntArray
    score: FloatArray
    log_likelihood: FloatArray

    def __len__(self) -> int:
        return len(self.rows)


def no_events_of_three() -> EventsOfThree:
    """Where no three tracks are coupled."""
    none = np.zeros(0)
    return EventsOfThree(np.zeros((0, 3), np.int64), np.zeros(0, np.int64), none, none)


def events_of_three(
    parts: Sequence[tuple[int, ...]],
    known: Sequence[CoupledTracks],
    near: Mapping[tuple[int, int], FloatArray],
    table: HypothesisTable,
    track: IntArray,
    predictions: Predictions,
    scan: Scan,
) -> EventsOfThree:
    """Find the events of coupled tracks.

    Parameters
    ----------
    parts
        Ranks of the tracks that hang together; those of three count.
    known
        Factors of the leaves of all their pairs before the scan.
    near
        P_u (a, b) of the leaves of all their pairs.
    table, predictions, scan
        The leaves, predicted to the time of the scan.
    track
        (H,) rank of each leaf's track.
    """
    found = [
        _of_three(part, known, near, table, track, predictions, scan)
        for part in parts
        if len(part) == 3
    ]
    if not found:
        return no_events_of_three()
    return EventsOfThree(
        np.concatenate([one.rows for one in found]),
        np.concatenate([one.detection for one in found]),
        np.concatenate([one.score for one in found]),
        np.concatenate([one.log_likelihood for one in found]),
    )


def _of_three(
    part: tuple[int, ...],
    known: Sequence[CoupledTracks],
    near: Mapping[tuple[int, int], FloatArray],
    table: HypothesisTable,
    track: IntArray,
    predictions: Predictions,
    scan: Scan,
) -> EventsOfThree:
    rows, weight = compounds(part, known, table.log_score, track, table.detection_numbers)
    place = rows - np.searchsorted(track, part)
    ends = ((0, 1), (0, 2), (1, 2))
    unresolved = np.stack(
        [near[part[i], part[j]][place[:, i], place[:, j]] for i, j in ends], axis=1
    )
    together = way_probabilities(unresolved).sum(axis=1)
    kept = np.flatnonzero(together > LEAST_UNRESOLVED)
    with np.errstate(divide="ignore"):
        weight = weight[kept] + np.log(together[kept])
    if len(kept) > MOST_PARENTS:
        best = np.sort(np.argpartition(-weight, MOST_PARENTS)[:MOST_PARENTS])
        kept, weight = kept[best], weight[best]
    rows, unresolved, log_together = rows[kept], unresolved[kept], np.log(together[kept])
    if not len(rows):
        return no_events_of_three()

    settings = predictions.settings
    resolution = resolution_covariance(
        np.array([settings.resolution_range_m, settings.resolution_azimuth_rad])
    )
    measurements = polar_measurements(scan)
    # The chi-square quantile of two degrees of freedom.
    threshold = -2.0 * np.log1p(-settings.gate_probability)
    parent, detection = _near_in_range(measurements, table, rows, threshold)
    squared, log_likelihood = three_log_likelihood(
        measurements,
        table.mean[rows[parent]],
        table.covariance[rows[parent]],
        unresolved[parent],
        resolution,
        detection,
    )
    inside = squared <= threshold
    parent = np.concatenate([np.arange(len(rows)), parent[inside]])
    detection = np.concatenate([np.full(len(rows), -1), detection[inside]])
    log_likelihood = np.concatenate([np.zeros(len(rows)), log_likelihood[inside]])
    detected = predictions.detection_probability[rows].mean(axis=1)[parent]
    if settings.unresolved_detection_probability > 0.0:
        detected = np.full(len(parent), settings.unresolved_detection_probability)
    with np.errstate(divide="ignore"):
        log_clutter = max(float(np.log(settings.clutter_density)), LOG_VANISHING)
        gain = np.where(
            detection >= 0,
            np.log(detected) + log_likelihood - log_clutter,
            np.maximum(np.log1p(-detected), LOG_VANISHING),
        )
    score = log_together[parent] + gain
    order = np.argsort(-(weight[parent] + gain), kind="stable")[:MOST_EVENTS_OF_THREE]
    order = np.sort(order)
    return EventsOfThree(rows[parent[order]], detection[order], score[order], log_likelihood[order])


def _near_in_range(
    measurements: PolarMeasurements, table: HypothesisTable, rows: IntArray, threshold: float
) -> tuple[IntArray, IntArray]:
    """Groups and detections (E,) that are near in range; all, where detections have own times."""
    near = np.ones((len(rows), len(measurements)), dtype=np.bool_)
    if measurements.time_offset_s is None and len(measurements):
        leaves, place = np.unique(rows, return_inverse=True)
        seen = predicted_measurements(
            table.mean[leaves, :2], table.covariance[leaves, :2, :2], measurements.sensor_xy_m
        )
        range_m = seen.range_m[place].reshape(rows.shape)
        variance = seen.covariance[place, 0, 0].reshape(rows.shape).sum(axis=1) / rows.shape[1] ** 2
        middle = range_m.mean(axis=1)
        # The links move the mean by less than the farthest member is away from it.
        most = np.abs(range_m - middle[:, None]).max(axis=1)
        total = variance[:, None] + measurements.covariance[:, 0, 0]
        gap = np.abs(measurements.range_m - middle[:, None]) - most[:, None]
        near = gap <= np.sqrt(threshold * total)
    parent, detection = np.nonzero(near)
    return parent, detection
