"""What statements on where a track is do to the weights of its joint hypotheses.

A pair of the track weighs its kinematic likelihood times the mean of mu over the state that the
detection would make of it, no detection 1 - P_d times the mean of mu over the predicted state
(Mahler 2011, (46), (86) to (89)): so the statement decides which detection the track gets. Both are
of the track with its classes; see :mod:`gda_tracker.attributes.statement_states`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gda_tracker.association.weightings import JointWeights
from gda_tracker.attributes.statement_meaning import Meaning
from gda_tracker.attributes.statement_states import Rows, component_rows, hear, region_meanings
from gda_tracker.kinematics.pair_updates import updated_pairs
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array, IntArray
from gda_tracker.vocabulary.beliefs import AttributeScores
from gda_tracker.vocabulary.hypotheses import Predictions
from gda_tracker.vocabulary.scans import Scan

Meanings = list[tuple[int, Meaning]]


@dataclass(frozen=True, slots=True)
class StatementFactors:
    """Log factors: ``log_pair`` (P,) of the pairs, ``log_idle`` (H,) of no detection."""

    log_pair: FloatArray
    log_idle: FloatArray

    def of(self, weights: JointWeights) -> JointWeights:
        """Return a weighting with the factors."""
        idle = weights.log_idle.copy()
        idle[: len(self.log_idle)] += self.log_idle
        return replace(weights, log_pair=weights.log_pair + self.log_pair, log_idle=idle)


def statement_factors(
    scan: Scan,
    predictions: Predictions,
    scores: AttributeScores | None,
    hypothesis: Int32Array,
    detection: Int32Array,
) -> StatementFactors | None:
    """Log factors of the statements about tracks; ``None`` where none says where a track is.

    Parameters
    ----------
    scan
        With its statements.
    predictions
        H hypotheses.
    scores
        Of the P pairs; ``None``, or of the term ``none``: parts on classes have no effect.
    hypothesis, detection
        Rows of the P gated pairs.
    """
    with_classes = scores is not None and scores.attribute_term != "none"
    class_names = scores.class_names if scores is not None and with_classes else ()
    meanings = [
        (track, meaning)
        for track, meaning in region_meanings(scan.statements, class_names)
        if (predictions.track_id == track).any()
    ]
    if not meanings:
        return None
    about = np.isin(predictions.track_id, [track for track, _ in meanings])
    log_idle, log_pair = np.zeros(len(predictions)), np.zeros(len(hypothesis))
    rows = np.flatnonzero(about)
    classes = max(len(class_names), 1)
    known = with_classes and predictions.class_names == class_names
    prior = (
        predictions.class_probability[rows]
        if known
        else np.full((len(rows), classes), 1.0 / classes)
    )
    idle, divisors = _predicted(meanings, predictions, rows, prior)
    log_idle[rows] = np.log(idle)
    place = np.full(len(predictions), -1)
    place[rows] = np.arange(len(rows))
    chosen = np.flatnonzero(about[hypothesis])
    if len(chosen):
        if with_classes:
            assert scores is not None
            weight = scores.class_probability[chosen]
        else:
            weight = np.ones((len(chosen), 1))
        own = place[hypothesis[chosen]]
        factor = _updated(
            meanings,
            scan,
            predictions,
            hypothesis[chosen],
            detection[chosen],
            weight,
            [d[own] for d in divisors],
        )
        log_pair[chosen] = log_idle[hypothesis[chosen]] + np.log(factor)
    return StatementFactors(log_pair, log_idle)


def _predicted(
    meanings: Meanings, predictions: Predictions, hypotheses: IntArray, prior: FloatArray
) -> tuple[FloatArray, list[FloatArray]]:
    """Mean of mu (R,) over the predicted hypotheses, and per statement by class (R, C)."""
    owner, component = component_rows(predictions.component_start, hypotheses)
    share = predictions.component_weight[component]
    rows = Rows(
        predictions.component_mean[component],
        predictions.component_covariance[component],
        prior[owner],
    )
    track = predictions.track_id[hypotheses][owner]
    divisors = []
    for about, meaning in meanings:
        rows, value = hear(meaning, rows, track == about)
        divisors.append(_sum_by_owner(owner, len(hypotheses), share[:, None] * value))
    total = share * rows.class_weight.sum(axis=1)
    return _sum_by_owner(owner, len(hypotheses), total), divisors


def _updated(
    meanings: Meanings,
    scan: Scan,
    predictions: Predictions,
    hypothesis: Int32Array,
    detection: Int32Array,
    weight: FloatArray,
    divisors: list[FloatArray],
) -> FloatArray:
    """Mean of mu (Q,) over what the detections of Q pairs make of the hypotheses.

    It is relative to the mean over the prediction. Every component is updated by the detection and
    weighs with its likelihood.
    """
    owner, component = component_rows(predictions.component_start, hypothesis.astype(np.int64))
    mean, covariance = (
        predictions.component_mean[component],
        predictions.component_covariance[component],
    )
    mean, covariance, log_share = updated_pairs(scan, mean, covariance, detection[owner])
    top = np.full(len(hypothesis), -np.inf)
    np.maximum.at(top, owner, log_share)
    share = predictions.component_weight[component] * np.exp(log_share - top[owner])
    share /= _sum_by_owner(owner, len(hypothesis), share)[owner]
    rows = Rows(mean, covariance, weight[owner])
    track = predictions.track_id[hypothesis][owner]
    for (about, meaning), divisor in zip(meanings, divisors, strict=True):
        rows, _ = hear(meaning, rows, track == about, divisor[owner])
    return _sum_by_owner(owner, len(hypothesis), share * rows.class_weight.sum(axis=1))


def _sum_by_owner(owner: IntArray, count: int, values: FloatArray) -> FloatArray:
    total = np.zeros((count, *values.shape[1:]))
    np.add.at(total, owner, values)
    return total
