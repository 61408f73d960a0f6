"""Gating: which detections may belong to which hypothesis.

Attribute fusion and association call the same function on the same messages, so both work on the
same list of pairs. (Tchamova et al. 2004, (14.1))
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import chdtri

from gda_tracker.kinematics.extended.cell_ratios import log_cell_ratios
from gda_tracker.kinematics.measurement_models import observed
from gda_tracker.kinematics.model_gating import densities, gated_components
from gda_tracker.kinematics.pair_strengths import pair_log_ratio
from gda_tracker.kinematics.sensor_models import (
    Innovations,
    PolarMeasurements,
    innovations,
    polar_measurements,
    predicted_measurements,
)
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array
from gda_tracker.vocabulary.hypotheses import Predictions
from gda_tracker.vocabulary.scans import Scan

LOG_TWO_PI = math.log(2.0 * math.pi)
# Components times detections from which on detections are looked up by range.
MANY_PAIRS = 50_000
MEASUREMENT_DIMENSION = 2


@dataclass(slots=True)
class GatedPairs:
    """P gated pairs, row-major by hypothesis, then detection.

    ``mahalanobis_squared`` (P,) is that of the closest component; ``log_likelihood`` (P,) is
    log g_ij [log 1/(m rad)], summed over the components of the hypothesis by their weights; of a
    sensor with a model its unit is one over that of the measurement space. Where signal strength
    counts it has the ratio of :mod:`gda_tracker.kinematics.pair_strengths`, and where clutter is
    not the same everywhere it is less by the log of the scan's ``relative_clutter_density``.
    """

    hypothesis: Int32Array
    detection: Int32Array
    mahalanobis_squared: FloatArray
    log_likelihood: FloatArray

    def __len__(self) -> int:
        return len(self.hypothesis)


@lru_cache(maxsize=64)
def gate_threshold(gate_probability: float, dimension: int = MEASUREMENT_DIMENSION) -> float:
    """Threshold gamma on the squared Mahalanobis distance: the chi-square quantile (14.1)."""
    return float(chdtri(dimension, 1.0 - gate_probability))


def gate(scan: Scan, predictions: Predictions) -> GatedPairs:
    """Return the pairs whose squared Mahalanobis distance is at most the gate threshold.

    Of extended objects number and scatter of a cell's detections are in the log likelihood too.
    """
    pairs = _gate_positions(scan, predictions)
    if scan.cells is not None:
        pairs.log_likelihood = pairs.log_likelihood + log_cell_ratios(
            scan, predictions, pairs.hypothesis, pairs.detection
        )
    ratio = pair_log_ratio(scan, predictions, pairs.hypothesis, pairs.detection)
    if ratio is not None:
        pairs.log_likelihood = pairs.log_likelihood + ratio
    if scan.relative_clutter_density is not None:
        local = np.log(scan.relative_clutter_density[pairs.detection])
        pairs.log_likelihood = pairs.log_likelihood - local
    return pairs


def _gate_positions(scan: Scan, predictions: Predictions) -> GatedPairs:
    """Gated pairs with their kinematic densities."""
    if scan.sensor_model:
        return _gate_by_model(scan, predictions)
    measurements = polar_measurements(scan)
    threshold = gate_threshold(predictions.settings.gate_probability)
    if measurements.time_offset_s is None:
        found = _gate_at_once(measurements, predictions, threshold)
    else:
        found = _gate_with_offsets(measurements, predictions, threshold)
    if len(predictions.component_mean) == len(predictions):
        return found
    mean, covariance = predictions.component_mean, predictions.component_covariance
    return _merge_components(
        len(measurements),
        predictions,
        found.hypothesis,
        found.detection,
        lambda c, d: _density(innovations(measurements, mean[c], covariance[c], d)),
    )


def _gate_by_model(scan: Scan, predictions: Predictions) -> GatedPairs:
    """Gated pairs in the measurement space of the sensor's model."""
    seen = observed(scan)
    threshold = gate_threshold(predictions.settings.gate_probability, len(seen.model))
    of, component, detection, squared, log_density = gated_components(seen, predictions, threshold)
    if len(predictions.component_mean) == len(predictions):
        return GatedPairs(component, detection, squared, log_density)
    return _merge_components(
        len(scan),
        predictions,
        component,
        detection,
        lambda c, d: densities(of, seen, c, d),
    )


def _gate_at_once(
    measurements: PolarMeasurements, predictions: Predictions, threshold: float
) -> GatedPairs:
    """Gated pairs of components and detections where all detections have the time of the scan.

    What the states look like is worked out once per component. Every gated pair passes the test in
    range alone, v_r^2 <= gamma S_rr: of few it is asked of all pairs, of many only of detections
    that stand near in the order of ranges.
    """
    predicted = predicted_measurements(
        predictions.component_mean[:, :2],
        predictions.component_covariance[:, :2, :2],
        measurements.sensor_xy_m,
    )
    own, noise = predicted.covariance[:, 0, 0], measurements.covariance[:, 0, 0]
    if len(own) * len(noise) <= MANY_PAIRS:
        gap = measurements.range_m - predicted.range_m[:, None]
        pairs = _pairs(gap, own[:, None] + noise, threshold)
    else:
        pairs = _near_pairs(measurements.range_m, noise, predicted.range_m, own, threshold)
    return _inside(
        *pairs,
        lambda c, d: predicted.innovations(measurements, c, d),
        threshold,
    )


def _gate_with_offsets(
    measurements: PolarMeasurements, predictions: Predictions, threshold: float
) -> GatedPairs:
    """Gated pairs of components and detections where every detection has its own time.

    In the test in range the trace of the position's covariance, which is never less, stands in
    place of the variance along the line of sight.
    """
    mean, covariance = predictions.component_mean, predictions.component_covariance
    tau = measurements.time_offset_s
    assert tau is not None
    x, y = mean.shape[1] // 2, mean.shape[1] // 2 + 1  # components of the velocity
    dx = mean[:, 0] - measurements.sensor_xy_m[0]
    dy = mean[:, 1] - measurements.sensor_xy_m[1]
    distance = np.hypot(dx[:, None] + tau * mean[:, x, None], dy[:, None] + tau * mean[:, y, None])
    position_variance = covariance[:, 0, 0] + covariance[:, 1, 1]
    cross = covariance[:, 0, x] + covariance[:, 1, y]
    velocity_variance = covariance[:, x, x] + covariance[:, y, y]
    variance = position_variance[:, None] + tau * (
        2.0 * cross[:, None] + tau * velocity_variance[:, None]
    )
    return _inside(
        *_pairs(
            measurements.range_m - distance, variance + measurements.covariance[:, 0, 0], threshold
        ),
        lambda c, d: innovations(measurements, mean[c], covariance[c], d),
        threshold,
    )


def _pairs(
    gap: FloatArray, variance: FloatArray, threshold: float
) -> tuple[Int32Array, Int32Array]:
    """Components and detections (P,) whose ranges differ by little enough."""
    # A hair wider than the ellipse, so that rounding never cuts what the exact test would keep.
    near = gap * gap <= threshold * (1.0 + 1e-9) * variance
    component, detection = np.nonzero(near)
    return component.astype(np.int32), detection.astype(np.int32)


def _near_pairs(
    range_m: FloatArray,
    noise: FloatArray,
    predicted_m: FloatArray,
    variance: FloatArray,
    threshold: float,
) -> tuple[Int32Array, Int32Array]:
    """Components and detections (P,), by component, whose ranges may differ by little enough.

    Detections with ranges (D,) and variances ``noise`` (D,) are looked up within the reach of the
    largest noise around the predicted ranges (C,); at least the pairs of :func:`_pairs` are found.
    """
    order = np.argsort(range_m, kind="stable")
    ordered = range_m[order]
    reach = np.sqrt(threshold * (1.0 + 1e-8) * (variance + noise.max()))
    first = np.searchsorted(ordered, predicted_m - reach, side="left")
    count = np.searchsorted(ordered, predicted_m + reach, side="right") - first
    component = np.repeat(np.arange(len(count)), count)
    begin = np.cumsum(count) - count
    detection = order[np.arange(len(component)) + np.repeat(first - begin, count)]
    key = np.sort(component * np.int64(len(range_m)) + detection)
    component, detection = np.divmod(key, len(range_m))
    return component.astype(np.int32), detection.astype(np.int32)


def _inside(
    component: Int32Array,
    detection: Int32Array,
    compare: Callable[[Int32Array, Int32Array], Innovations],
    threshold: float,
) -> GatedPairs:
    """Those of the pairs that lie inside the gate."""
    squared, log_density = _density(compare(component, detection))
    inside = squared <= threshold
    return GatedPairs(component[inside], detection[inside], squared[inside], log_density[inside])


def _density(pair: Innovations) -> tuple[FloatArray, FloatArray]:
    """Squared Mahalanobis distance and log innovation density g_ij of pairs (P,)."""
    squared, determinant = pair.mahalanobis_squared()
    return squared, -0.5 * (squared + np.log(determinant)) - LOG_TWO_PI


def _merge_components(
    n: int,
    predictions: Predictions,
    component: Int32Array,
    detection: Int32Array,
    density: Callable[[Int32Array, Int32Array], tuple[FloatArray, FloatArray]],
) -> GatedPairs:
    """Pairs of hypotheses and n detections: gated if one component is, with the mixture's density.

    ``density`` gives squared distances and log densities of pairs of component and detection.
    """
    start = predictions.component_start
    owner = np.repeat(np.arange(len(predictions)), np.diff(start))
    pair = owner[component] * np.int64(max(n, 1)) + detection
    pair.sort()
    if len(pair):
        # Each once; np.unique takes longer about it.
        pair = pair[np.concatenate(([True], pair[1:] != pair[:-1]))]
    hypothesis, column = (part.astype(np.int32) for part in np.divmod(pair, max(n, 1)))
    count = np.diff(start)[hypothesis]
    first = np.concatenate([[0], np.cumsum(count)])
    row = np.repeat(np.arange(len(pair)), count)
    each = (np.arange(first[-1]) - first[row] + start[hypothesis][row]).astype(np.int32)
    squared, log_density = density(each, column[row])
    with np.errstate(divide="ignore"):
        weighted = log_density + np.log(predictions.component_weight[each])
    if not len(pair):
        return GatedPairs(hypothesis, column, squared, weighted)
    peak = np.maximum.reduceat(weighted, first[:-1])
    total = np.add.reduceat(np.exp(weighted - peak[row]), first[:-1])
    return GatedPairs(
        hypothesis, column, np.minimum.reduceat(squared, first[:-1]), peak + np.log(total)
    )
