"""Gating: which detections may belong to which hypothesis.

Attribute fusion and association call the same function on the same messages, so both work on the
same list of pairs. (Tchamova et al. 2004, (14.1))
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from gda_tracker.kinematics.sensor_models import (
    PolarMeasurements,
    innovations,
    polar_measurements,
    wrap_angle,
)
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array
from gda_tracker.vocabulary.hypotheses import Predictions
from gda_tracker.vocabulary.scans import Scan

LOG_TWO_PI = math.log(2.0 * math.pi)
MEASUREMENT_DIMENSION = 2


@dataclass(slots=True)
class GatedPairs:
    """P gated pairs, row-major by hypothesis, then detection.

    ``mahalanobis_squared`` (P,) is that of the closest component; ``log_likelihood`` (P,) is
    log g_ij [log 1/(m rad)], summed over the components of the hypothesis by their weights.
    """

    hypothesis: Int32Array
    detection: Int32Array
    mahalanobis_squared: FloatArray
    log_likelihood: FloatArray

    def __len__(self) -> int:
        return len(self.hypothesis)


def gate_threshold(gate_probability: float, dimension: int = MEASUREMENT_DIMENSION) -> float:
    """Threshold gamma on the squared Mahalanobis distance: the chi-square quantile (14.1)."""
    return float(chdtri(dimension, 1.0 - gate_probability))


def gate(scan: Scan, predictions: Predictions) -> GatedPairs:
    """Return the pairs whose squared Mahalanobis distance is at most the gate threshold."""
    measurements = polar_measurements(scan)
    threshold = gate_threshold(predictions.settings.gate_probability)
    mean, covariance = predictions.component_mean, predictions.component_covariance
    component, detection = _candidates(measurements, mean, covariance, threshold)
    squared, log_density = _densities(measurements, mean, covariance, component, detection)
    inside = squared <= threshold
    component, detection = component[inside], detection[inside]
    squared, log_density = squared[inside], log_density[inside]
    if len(mean) == len(predictions):
        return GatedPairs(component, detection, squared, log_density)
    return _merge_components(measurements, predictions, component, detection)


def _candidates(
    measurements: PolarMeasurements, mean: FloatArray, covariance: FloatArray, threshold: float
) -> tuple[Int32Array, Int32Array]:
    """Pairs that pass a box around the gate; with time offsets every pair."""
    states, n = len(mean), len(measurements)
    if measurements.time_offset_s is not None or states == 0 or n == 0:
        first, second = np.divmod(np.arange(states * n), max(n, 1))
        return first.astype(np.int32), second.astype(np.int32)
    dx = mean[:, 0] - measurements.sensor_xy_m[0]
    dy = mean[:, 1] - measurements.sensor_xy_m[1]
    squared_distance = np.maximum(dx * dx + dy * dy, 1e-18)
    p_xx, p_xy, p_yy = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    range_variance = (dx * dx * p_xx + 2 * dx * dy * p_xy + dy * dy * p_yy) / squared_distance
    azimuth_variance = (dy * dy * p_xx - 2 * dx * dy * p_xy + dx * dx * p_yy) / squared_distance**2
    # A hair wider than the ellipse, so that rounding never cuts what the exact test would keep.
    slack = threshold * (1.0 + 1e-9)
    range_gap = measurements.range_m - np.sqrt(squared_distance)[:, None]
    near = range_gap * range_gap <= slack * (
        range_variance[:, None] + measurements.covariance[:, 0, 0]
    )
    azimuth_gap = wrap_angle(measurements.azimuth_rad - np.arctan2(dy, dx)[:, None])
    near &= azimuth_gap * azimuth_gap <= slack * (
        azimuth_variance[:, None] + measurements.covariance[:, 1, 1]
    )
    component, detection = np.nonzero(near)
    return component.astype(np.int32), detection.astype(np.int32)


def _densities(
    measurements: PolarMeasurements,
    mean: FloatArray,
    covariance: FloatArray,
    component: Int32Array,
    detection: Int32Array,
) -> tuple[FloatArray, FloatArray]:
    """Squared Mahalanobis distance and log innovation density g_ij of pairs (P,)."""
    pair = innovations(measurements, mean[component], covariance[component], detection)
    squared, determinant = pair.mahalanobis_squared()
    return squared, -0.5 * (squared + np.log(determinant)) - LOG_TWO_PI


def _merge_components(
    measurements: PolarMeasurements,
    predictions: Predictions,
    component: Int32Array,
    detection: Int32Array,
) -> GatedPairs:
    """Pairs of hypotheses: gated if one component is, with the density of the mixture."""
    n = len(measurements)
    start = predictions.component_start
    owner = np.repeat(np.arange(len(predictions)), np.diff(start))
    pair = np.unique(owner[component] * np.int64(max(n, 1)) + detection)
    hypothesis = (pair // max(n, 1)).astype(np.int32)
    column = (pair % max(n, 1)).astype(np.int32)
    count = np.diff(start)[hypothesis]
    first = np.concatenate([[0], np.cumsum(count)])
    row = np.repeat(np.arange(len(pair)), count)
    each = (np.arange(first[-1]) - first[row] + start[hypothesis][row]).astype(np.int32)
    squared, log_density = _densities(
        measurements,
        predictions.component_mean,
        predictions.component_covariance,
        each,
        column[row],
    )
    with np.errstate(divide="ignore"):
        weighted = log_density + np.log(predictions.component_weight[each])
    if not len(pair):
        return GatedPairs(hypothesis, column, squared, weighted)
    peak = np.maximum.reduceat(weighted, first[:-1])
    total = np.add.reduceat(np.exp(weighted - peak[row]), first[:-1])
    return GatedPairs(
        hypothesis, column, np.minimum.reduceat(squared, first[:-1]), peak + np.log(total)
    )
