"""The Doppler blind zone in the ring (:mod:`gda_tracker.kinematics.blind_zone`).

Per component k of a hypothesis, with weight w_k and mean detection probability P_k over its density
(a motion model, a part of a Gaussian sum):

- the predictions say P = sum w_k P_k, and as weights w_k P_k / P, those of a hypothesis that is
  detected, so that its detection has the likelihood sum w_k P_k N_k(z) in the association, in the
  tree's scores and in the sequential test, and a miss 1 - P: the sum over both is one;
- a miss turns the weights to w_k (1 - P_k), a hit by the visible share of what it has updated, and
  the components to the moments of their sums;
- ``blind_scans`` counts how much of the misses in a row the zone explains, sum of 1 - P / P_d:
  misses that were to be expected do not end a track under ``m_of_n``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gda_tracker.kinematics.blind_zone import BlindZone, after_hit, after_miss, notched_share
from gda_tracker.kinematics.model_sets import HEAD, follow_head
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.manager_state import OpenScan
from gda_tracker.tracking.model_states import set_models
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray
from gda_tracker.vocabulary.hypotheses import Predictions
from gda_tracker.vocabulary.scans import Scan

# Sensors of range rate, or of range and azimuth, by echoes of their own.
MONOSTATIC = ("", "range_doppler", "doppler", "doppler_rotated")


def zone_of(scan: Scan, parameters: TrackManagerParameters) -> BlindZone | None:
    """The zone of a scan's sensor; ``None`` without, and for sensors that are no such radars.

    ``parameters`` are those of the sensor. Bearings, bistatic ranges and differences have none.
    """
    if not parameters.blind_speed_mps or scan.sensor_model not in MONOSTATIC:
        return None
    return BlindZone(
        parameters.blind_speed_mps, parameters.detection_probability, scan.sensor_position_m[:2]
    )


def tell_zone(
    predictions: Predictions, scan: Scan, parameters: TrackManagerParameters
) -> Predictions:
    """Return predictions with the detection probability of each hypothesis."""
    zone = zone_of(scan, parameters)
    if zone is None or not len(predictions):
        return predictions
    p = predictions
    share = notched_share(p.component_mean, p.component_covariance, zone)
    visible = p.component_weight * (1.0 - share)
    first = p.component_start[:-1]
    total = np.add.reduceat(visible, first)
    each = np.repeat(np.arange(len(p)), np.diff(p.component_start))
    known = total[each] > 0.0
    weight = np.where(known, visible / np.where(known, total[each], 1.0), p.component_weight)
    # Weights that sum to one but for rounding must not make a probability exceed its bound.
    seen = zone.detection_probability * np.minimum(total, 1.0)
    return replace(p, detection_probability=seen, component_weight=weight)


def apply_zone(
    table: HypothesisTable,
    opened: OpenScan,
    parent: IntArray,
    hit: BoolArray,
    parameters: TrackManagerParameters,
) -> None:
    """Apply what the zone says of hypotheses that have been updated, or missed.

    Parameters
    ----------
    table
        (H,) hypotheses after the scan; those without a detection as they were predicted.
    opened
        The scan and its predictions.
    parent
        (H,) row of each in the predictions.
    hit
        (H,) whether it has a detection.
    parameters
        Those of the sensor.
    """
    zone = zone_of(opened.scan, parameters)
    if zone is not None:
        reweight(table, np.flatnonzero(~hit), zone, detected=False)
        reweight(table, np.flatnonzero(hit), zone, detected=True)
    count_blind(table, opened, parent, hit, zone)


def count_blind(
    table: HypothesisTable,
    opened: OpenScan,
    parent: IntArray,
    hit: BoolArray,
    zone: BlindZone | None,
) -> None:
    """Count the misses that the zone explains; arguments as of :func:`apply_zone`.

    Under a sensor without a zone a miss is one.
    """
    if zone is not None and zone.detection_probability > 0.0:
        seen = opened.predictions.detection_probability[parent] / zone.detection_probability
        table.blind_scans = np.where(hit, 0.0, table.blind_scans + 1.0 - seen)
    elif np.count_nonzero(table.blind_scans):
        table.blind_scans = np.where(hit, 0.0, table.blind_scans)


def outlived(
    table: HypothesisTable, stamp_ns: int, parameters: TrackManagerParameters
) -> BoolArray | None:
    """Which tracks (H,) the zone has hidden for longer than any stop lasts; ``None`` for none.

    ``stamp_ns`` is the time of the scan.
    """
    if not parameters.blind_speed_mps or not parameters.blind_longest_s:
        return None
    unseen_ns = stamp_ns - table.last_detection_ns
    # It explains nothing of the silence of tracks that it does not hide.
    long: BoolArray = (unseen_ns > parameters.blind_longest_s * 1e9) & (table.blind_scans > 0.0)
    return long


def reweight(
    table: HypothesisTable, rows: IntArray, zone: BlindZone | None, *, detected: bool
) -> None:
    """Give rows (R,) what a hit, or a miss, says of their range rates; nothing without a zone."""
    if zone is None or not len(rows):
        return
    if not table.model_weight.shape[1]:
        mean, covariance = table.mean.copy(), table.covariance.copy()
        _, mean[rows], covariance[rows] = _moved(mean[rows], covariance[rows], zone, detected)
        table.mean, table.covariance = mean, covariance
        return
    count, size = table.model_mean.shape[1:]
    own_mean = table.model_mean[rows].reshape(-1, size)
    own_covariance = table.model_covariance[rows].reshape(-1, size, size)
    factor, *head = _moved(own_mean[:, :HEAD], own_covariance[:, :HEAD, :HEAD], zone, detected)
    new_mean, new_covariance = head
    if size > HEAD:
        new_mean, new_covariance = follow_head(own_mean, own_covariance, new_mean, new_covariance)
    weight = table.model_weight.copy()
    mean, covariance = table.model_mean.copy(), table.model_covariance.copy()
    scaled = table.model_weight[rows] * factor.reshape(-1, count)
    total = scaled.sum(axis=1, keepdims=True)
    # What could not happen under any component says nothing about which of them it is.
    weight[rows] = np.where(
        total > 0.0, scaled / np.where(total > 0.0, total, 1.0), table.model_weight[rows]
    )
    mean[rows] = new_mean.reshape(-1, count, size)
    covariance[rows] = new_covariance.reshape(-1, count, size, size)
    set_models(table, weight, mean, covariance)


def _moved(
    mean: FloatArray, covariance: FloatArray, zone: BlindZone, detected: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    return after_hit(mean, covariance, zone) if detected else after_miss(mean, covariance, zone)
