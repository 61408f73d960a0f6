"""Pairs of hypotheses that the sensor may not have resolved, and what their groups may have given.

Two targets are one group with the mean of P_u over their predicted distance in range and azimuth,
|2 pi R_u|^1/2 N(d; 0, H1 P1 H1' + H2 P2 H2' + R_u) (Koch 2014, section 2.3.3; Koch and van Keuk
1997). A group gives one detection at most. Groups of three and more are left to those of two.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gda_tracker.association.unresolved import (
    LEAST_UNRESOLVED,
    expected_unresolved_probability,
    resolution_covariance,
)
from gda_tracker.kinematics.gating import gate_threshold
from gda_tracker.kinematics.group_updates import group_innovations
from gda_tracker.kinematics.mixtures import moments
from gda_tracker.kinematics.sensor_models import (
    PolarMeasurements,
    polar_measurements,
    predicted_measurements,
    wrap_angle,
)
from gda_tracker.vocabulary.arrays import FloatArray, IntArray
from gda_tracker.vocabulary.hypotheses import Associations, Predictions
from gda_tracker.vocabulary.scans import Scan

MOST_UNRESOLVED = 1.0 - 1e-9


@dataclass(frozen=True, slots=True)
class GroupEvents:
    """L links of two hypotheses of different tracks, and E events of them.

    ``first``, ``second`` (L,) with first < second, ``unresolved`` (L,) the mean P_u. Per event:
    ``link`` (E,), ``detection`` (E,) the row in the scan, -1 for none (each link has that one, it
    comes first), ``log_likelihood`` (E,). ``detected`` is P_Du (L,).
    """

    first: IntArray
    second: IntArray
    unresolved: FloatArray
    detected: FloatArray
    link: IntArray
    detection: IntArray
    log_likelihood: FloatArray

    def fields(self) -> dict[str, Any]:
        """Fields of ``Associations``, nothing known of probabilities yet."""
        count = len(self.link)
        return {
            "group_first": self.first[self.link].astype(np.int32),
            "group_second": self.second[self.link].astype(np.int32),
            "group_detection": self.detection.astype(np.int32),
            "group_unresolved": self.unresolved[self.link],
            "group_log_likelihood": self.log_likelihood,
            "group_marginal": np.zeros(count),
            "group_chosen": np.zeros(count, dtype=np.bool_),
        }


def group_events(scan: Scan, predictions: Predictions) -> GroupEvents | None:
    """Find who may be one group, and which detections lie in the groups' gates.

    ``None`` where the sensor resolves all or nobody is near another. A sensor with a model of its
    own resolves all.
    """
    settings = predictions.settings
    if not settings.resolution_range_m > 0.0 or scan.sensor_model:
        return None
    rows = np.flatnonzero(predictions.group_candidate)
    if len(rows) < 2:
        return None
    mean, covariance = _moments(predictions, rows)
    measurements = polar_measurements(scan)
    resolution = resolution_covariance(
        np.array([settings.resolution_range_m, settings.resolution_azimuth_rad])
    )
    first, second, unresolved = _links(
        measurements, mean, covariance, predictions.track_id[rows], resolution
    )
    if not len(first):
        return None
    probability = settings.gate_probability
    link, detection = _near(measurements, mean, covariance, first, second, probability)
    pair = group_innovations(measurements, mean, covariance, first[link], second[link], detection)
    squared, log_likelihood = pair.given_unresolved(resolution)
    inside = squared <= gate_threshold(probability)
    link, detection = link[inside], detection[inside]
    count = len(first)
    link = np.concatenate([np.arange(count), link])
    detection = np.concatenate([np.full(count, -1), detection])
    log_likelihood = np.concatenate([np.zeros(count), log_likelihood[inside]])
    order = np.argsort(link, kind="stable")
    # A group is detected like a target, unless told otherwise.
    detected = 0.5 * (
        predictions.detection_probability[rows[first]]
        + predictions.detection_probability[rows[second]]
    )
    if settings.unresolved_detection_probability > 0.0:
        detected = np.full(count, settings.unresolved_detection_probability)
    return GroupEvents(
        rows[first],
        rows[second],
        unresolved,
        detected,
        link[order],
        detection[order],
        log_likelihood[order],
    )


def links_of(associations: Associations) -> IntArray:
    """Events (L,) of the associations that say that a group gave nothing: one for each link."""
    return np.flatnonzero(associations.group_detection < 0)


def _moments(predictions: Predictions, rows: IntArray) -> tuple[FloatArray, FloatArray]:
    """Mean (R, s) and covariance (R, s, s) of some hypotheses, over their components."""
    start = predictions.component_start.astype(np.int64)
    if len(predictions.component_mean) == len(predictions):
        return predictions.component_mean[rows], predictions.component_covariance[rows]
    count = np.diff(start)[rows]
    width = int(count.max())
    place = np.minimum(start[rows][:, None] + np.arange(width), start[-1] - 1)
    inside = np.arange(width) < count[:, None]
    weight = np.where(inside, predictions.component_weight[place], 0.0)
    weight /= weight.sum(axis=1, keepdims=True)
    return moments(
        weight, predictions.component_mean[place], predictions.component_covariance[place]
    )


def _links(
    measurements: PolarMeasurements,
    mean: FloatArray,
    covariance: FloatArray,
    track_id: IntArray,
    resolution: FloatArray,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Pairs (L,) of states of different tracks that are near enough, and their mean P_u."""
    seen = predicted_measurements(mean[:, :2], covariance[:, :2, :2], measurements.sensor_xy_m)
    # P_u <= exp(-gap^2 / (2 S_rr)) in range alone: those beyond are never looked at.
    order = np.argsort(seen.range_m, kind="stable")
    ranges = seen.range_m[order]
    widest = resolution[0, 0] + 2.0 * float(seen.covariance[:, 0, 0].max())
    reach = np.sqrt(-2.0 * np.log(LEAST_UNRESOLVED) * widest)
    end = np.searchsorted(ranges, ranges + reach, side="right")
    count = end - np.arange(len(order)) - 1
    one = np.repeat(np.arange(len(order)), count)
    two = np.arange(len(one)) - np.repeat(np.cumsum(count) - count, count) + one + 1
    one, two = order[one], order[two]
    first, second = np.minimum(one, two), np.maximum(one, two)
    other = track_id[first] != track_id[second]
    first, second = first[other], second[other]
    gap = np.empty((len(first), 2))
    gap[:, 0] = seen.range_m[first] - seen.range_m[second]
    gap[:, 1] = wrap_angle(seen.azimuth_rad[first] - seen.azimuth_rad[second])
    spread = seen.covariance[first] + seen.covariance[second]
    unresolved = expected_unresolved_probability(gap, spread, resolution)
    # Never sure: two targets at one place, perfectly known, may have been resolved.
    unresolved = np.minimum(unresolved, MOST_UNRESOLVED)
    kept = np.flatnonzero(unresolved > LEAST_UNRESOLVED)
    kept = kept[np.lexsort((second[kept], first[kept]))]
    return first[kept], second[kept], unresolved[kept]


def _near(
    measurements: PolarMeasurements,
    mean: FloatArray,
    covariance: FloatArray,
    first: IntArray,
    second: IntArray,
    gate_probability: float,
) -> tuple[IntArray, IntArray]:
    """Links and detections (K,) that are near in range; all, where detections have own times."""
    count, n = len(first), len(measurements)
    near = np.ones((count, n), dtype=np.bool_)
    if measurements.time_offset_s is None and n:
        seen = predicted_measurements(mean[:, :2], covariance[:, :2, :2], measurements.sensor_xy_m)
        middle = 0.5 * (seen.range_m[first] + seen.range_m[second])
        variance = 0.25 * (seen.covariance[first, 0, 0] + seen.covariance[second, 0, 0])
        # What P_u moves the mean by is less than half of the distance.
        half = 0.5 * np.abs(seen.range_m[first] - seen.range_m[second])
        threshold = gate_threshold(gate_probability)
        total = variance[:, None] + measurements.covariance[:, 0, 0]
        gap = np.abs(measurements.range_m - middle[:, None]) - half[:, None]
        near = gap <= np.sqrt(threshold * total)
    link, detection = np.nonzero(near)
    return link, detection
