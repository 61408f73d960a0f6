"""Signal strength in the ring: a column of the hypotheses, predicted and updated with every scan.

A row of ``HypothesisTable.strength`` is the inverse Gamma density of 1 + x, x being the mean
strength of the target's signals (Swerling I; :mod:`gda_tracker.kinematics.signal_strength`). On
every scan that brings strengths

- it gives the hypothesis its detection probability, averaged over what is known of x;
- it gives each pair the ratio of :mod:`gda_tracker.kinematics.pair_strengths`;
- it is updated: exactly by the strength of the detection, or by the detection alone where its
  strength is unknown, and by moments after a miss or, under ``jpda``, the mixture of all.

A scan without the attribute is one of another kind of sensor: it says nothing about x. Leaves that
merge keep the strength of the best one, as they keep its state. Strengths are filtered, not
retrodicted: revised tracks have what was known of x at their time.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from gda_tracker.association.global_hypotheses import LOG_VANISHING
from gda_tracker.kinematics.pair_strengths import log_detected_ratio
from gda_tracker.kinematics.signal_strength import (
    Strengths,
    detection_probability,
    predict_strength,
    update_missed,
)
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.initiation import NewTracks
from gda_tracker.tracking.parameter_groups.strength import DECIBEL, NONE
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array, IntArray, empty_floats
from gda_tracker.vocabulary.hypotheses import Associations, Predictions
from gda_tracker.vocabulary.scans import Scan

COLUMNS = 2
# No receiver has a larger dynamic range: what exceeds it is an error of the source.
STRONGEST_SIGNAL = 1e12
LARGEST_DECIBEL = 120.0
DECIBEL_OF_E = 10.0 / np.log(10.0)


def with_strengths(
    table: HypothesisTable, dt_s: float, parameters: TrackManagerParameters
) -> HypothesisTable:
    """Return the hypotheses with their strengths ``dt_s`` [s] later, or without, as is asked for.

    Rows that have no strength yet get that of a new target.
    """
    p, columns = parameters, table.strength.shape[1]
    if p.signal_strength == NONE:
        if not columns:
            return table
        wanted = empty_floats(len(table), 0)
    elif not columns:
        wanted = _stacked(prior(len(table), p))
    elif dt_s == 0.0:
        return table
    else:
        wanted = _stacked(predict_strength(strengths_of(table), dt_s, p.signal_strength_memory_s))
    fitted = table.copy()
    fitted.strength = wanted
    return fitted


def with_signals(scan: Scan, parameters: TrackManagerParameters, counters: Counter[str]) -> Scan:
    """Return the scan with the strengths of its detections, if they are asked for and it has any.

    Strengths below the threshold, or beyond any receiver, are counted and taken as the nearest that
    is possible.
    """
    p = parameters
    if p.signal_strength == NONE or p.signal_strength_attribute not in scan.attribute_names:
        return scan
    assert scan.attribute_values is not None
    assert scan.attribute_valid is not None
    row = scan.attribute_names.index(p.signal_strength_attribute)
    values, known = scan.attribute_values[row], scan.attribute_valid[row]
    if p.signal_strength_unit == DECIBEL:
        values = 10.0 ** (np.minimum(values, LARGEST_DECIBEL + 1.0) / 10.0)
    wrong = known & ((values < p.signal_threshold) | (values > STRONGEST_SIGNAL))
    if wrong.any():
        counters["signal_strength_out_of_range"] += int(np.count_nonzero(wrong))
    signal = np.clip(values, p.signal_threshold, STRONGEST_SIGNAL)
    return replace(scan, signal_strength=np.where(known, signal, np.nan))


def strengths_of(table: HypothesisTable) -> Strengths:
    """What is known of the strength of each row (H,)."""
    return Strengths(table.strength[:, 0], table.strength[:, 1])


def prior(count: int, parameters: TrackManagerParameters) -> Strengths:
    """What is known of ``count`` new targets: 1 / theta has the mean 1 / (1 + x)."""
    shape = np.full(count, parameters.initial_signal_strength_shape)
    return Strengths(shape, shape * (1.0 + parameters.initial_signal_strength))


def counts_on(scan: Scan, table: HypothesisTable) -> bool:
    """Whether strengths play a part on the scan."""
    return scan.signal_strength is not None and table.strength.shape[1] == COLUMNS


def tell_strengths(
    predictions: Predictions, scan: Scan, table: HypothesisTable, parameters: TrackManagerParameters
) -> Predictions:
    """Tell the other stages what they need, if strengths play a part on the scan."""
    if not counts_on(scan, table):
        return predictions
    p, known = parameters, strengths_of(table)
    settings = replace(
        predictions.settings,
        signal_threshold=p.signal_threshold,
        clutter_strength=p.clutter_signal_strength,
    )
    return replace(
        predictions,
        settings=settings,
        detection_probability=detection_probability(known, p.signal_threshold),
        strength_shape=known.shape.copy(),
        strength_scale=known.scale.copy(),
    )


def update_strengths(
    table: HypothesisTable, scan: Scan, assigned: Int32Array, lambda_: float
) -> None:
    """Update each row by the detection that it is given, or by the miss.

    Parameters
    ----------
    table
        Rows predicted to the scan's time; the column is replaced.
    scan
        With its strengths; without, nothing happens.
    assigned
        (H,) row of the scan, -1 for a miss.
    lambda_
        Threshold of the scan.
    """
    if not counts_on(scan, table):
        return
    before = strengths_of(table)
    hit = assigned >= 0
    missed, seen = update_missed(before, lambda_), _seen(before, scan, assigned, lambda_)
    table.strength = _stacked(
        Strengths(np.where(hit, seen.shape, missed.shape), np.where(hit, seen.scale, missed.scale))
    )


def update_strengths_by_marginals(
    table: HypothesisTable,
    scan: Scan,
    associations: Associations,
    lambda_: float,
) -> None:
    """Update each row by the mixture of a miss and its detections, each as it is probable.

    The mixture becomes one inverse Gamma density by the first two moments of 1 / theta.
    """
    if not counts_on(scan, table):
        return
    before, count = strengths_of(table), len(table)
    hypothesis, marginal = associations.hypothesis, associations.joint_marginal
    rows = Strengths(before.shape[hypothesis], before.scale[hypothesis])
    seen, missed = (
        _seen(rows, scan, associations.detection, lambda_),
        update_missed(before, lambda_),
    )
    idle = np.maximum(1.0 - np.bincount(hypothesis, marginal, minlength=count), 0.0)
    total = idle + np.bincount(hypothesis, marginal, minlength=count)
    mean, square = (
        (idle * moment(missed) + np.bincount(hypothesis, marginal * moment(seen), minlength=count))
        / total
        for moment in (_first, _second)
    )
    spread = square - mean**2
    table.strength = _stacked(Strengths(mean**2 / spread, mean / spread))


def starts(
    new: NewTracks, scan: Scan, parameters: TrackManagerParameters
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What the detections that start tracks (N,) say by their strengths.

    Two detections that are not one target's need not both be false: either may be the only one of
    another target, and then it is strong. So what a target's strengths are compared with is here
    the mixture of false detections and of new targets, in the ratio ``mht_new_target_ratio``. Else
    one strong signal would vouch for any false detection that it is paired with.

    Returns
    -------
    strength
        (N, 2) columns for the new rows; (N, 0) where strengths play no part.
    log_ratio
        (N,) log likelihood ratio of the strengths, targets' against false detections'.
    log_seen
        (N,) by how much the logarithm of the chance to be missed between the two detections and
        then seen differs from that with the parameter ``detection_probability``.
    """
    p, count = parameters, len(new.detection)
    if p.signal_strength == NONE:
        return empty_floats(count, 0), np.zeros(count), np.zeros(count)
    known = prior(count, p)
    if scan.signal_strength is None:
        return _stacked(known), np.zeros(count), np.zeros(count)
    lambda_ = p.signal_threshold
    signal = scan.signal_strength[new.detection]
    log_ratio, log_seen = np.zeros(count), np.zeros(count)
    if not scan.sensor_model:  # else one detection starts a track
        log_ratio = _against_others(known, new.first_signal, p)
        known = _after(known, new.first_signal, lambda_)
        given = p.detection_probability
        for number in range(1, int(new.gap_scans.max(initial=0))):
            between = number < new.gap_scans
            miss = np.log1p(-detection_probability(known, lambda_))
            log_seen += np.where(between, miss - _vanishing(np.log1p, -given), 0.0)
            missed = update_missed(known, lambda_)
            known = Strengths(
                np.where(between, missed.shape, known.shape),
                np.where(between, missed.scale, known.scale),
            )
        log_seen += np.log(detection_probability(known, lambda_)) - _vanishing(np.log, given)
        log_ratio += _against_others(known, signal, p)
    else:
        log_ratio = log_detected_ratio(known, signal, lambda_, p.clutter_signal_strength)
    return _stacked(_after(known, signal, lambda_)), log_ratio, log_seen


def told_strengths(
    table: HypothesisTable, lambda_: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What tracks say of the strength of each row (H,); empty arrays if it plays no part.

    Returns
    -------
    strength
        exp E[log theta] - 1, 0 at least [mean noise powers].
    std_db
        Standard deviation of 10 log10 theta [dB].
    detection_probability
        Averaged over what is known of theta; ``lambda_`` is the threshold.
    """
    if table.strength.shape[1] != COLUMNS or not len(table):
        return empty_floats(), empty_floats(), empty_floats()
    known = strengths_of(table)
    mean, variance = known.log_moments()
    return (
        np.maximum(np.expm1(mean), 0.0),
        DECIBEL_OF_E * np.sqrt(variance),
        detection_probability(known, lambda_),
    )


def _against_others(
    known: Strengths, signal: FloatArray, parameters: TrackManagerParameters
) -> FloatArray:
    """Log ratio (N,) of the strengths, against detections that are false or a new target's."""
    p = parameters
    ratios = [
        log_detected_ratio(each, signal, p.signal_threshold, p.clutter_signal_strength)
        for each in (known, prior(len(signal), p))
    ]
    share = p.mht_new_target_ratio / (1.0 + p.mht_new_target_ratio)
    return ratios[0] - np.logaddexp(np.log1p(-share), np.log(share) + ratios[1])


def _after(known: Strengths, signal: FloatArray, lambda_: float) -> Strengths:
    """Posterior after detections of these strengths; of an unknown one it is known to exceed."""
    there = ~np.isnan(signal)
    return Strengths(known.shape + there, known.scale + np.where(there, signal, lambda_))


def _seen(
    before: Strengths, scan: Scan, detection: Int32Array | IntArray, lambda_: float
) -> Strengths:
    """Posterior of each row after its detection; rows of -1 are not meant to be used."""
    assert scan.signal_strength is not None
    return _after(before, np.append(scan.signal_strength, np.nan)[detection], lambda_)


def _stacked(strengths: Strengths) -> FloatArray:
    """Column (H, 2). As theta is 1 at least, the mean of 1 / theta is 1 at most."""
    return np.stack([strengths.shape, np.maximum(strengths.scale, strengths.shape)], axis=1)


def _first(strengths: Strengths) -> FloatArray:
    return strengths.shape / strengths.scale


def _second(strengths: Strengths) -> FloatArray:
    return strengths.shape * (strengths.shape + 1.0) / strengths.scale**2


def _vanishing(logarithm: Callable[[float], float], value: float) -> float:
    """Logarithm, but not that of zero."""
    with np.errstate(divide="ignore"):
        return max(float(logarithm(value)), LOG_VANISHING)
