"""JPDA: each hypothesis takes all detections in its gate, each as far as it is probable.

The posterior of hypothesis i is the mixture of its updates by the detections j with the marginal
probabilities beta_ij, and of the prediction with beta_i0 = 1 - sum over j of beta_ij. It is reduced
to a Gaussian by its moments (Koch 2014, (3.33)-(3.35)):

    x = sum over j of beta_ij x_ij,   P = sum over j of beta_ij [P_ij + (x_ij - x)(x_ij - x)'].

With one measurement noise for all detections this is the update of Fortmann, Bar-Shalom & Scheffe
(1983): x = x^- + W v, P = beta_0 P^- + (1 - beta_0)(P^- - W S W') + W (sum beta v v' - v v') W'.
With interacting models the mixture runs over detections and models, and is reduced to one Gaussian
for each model: p_m = sum over j of beta_ij p_ijm, with shares beta_ij p_ijm / p_m.
"""

from __future__ import annotations

import numpy as np

from gda_tracker.kinematics.blind_zone import BlindZone
from gda_tracker.tracking.blind_zone import reweight
from gda_tracker.tracking.group_update import SharedUpdates, shared_updates
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.model_states import set_models
from gda_tracker.tracking.state_update import update_states
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array
from gda_tracker.vocabulary.beliefs import AttributeScores
from gda_tracker.vocabulary.hypotheses import Associations
from gda_tracker.vocabulary.scans import Scan


def update_by_marginals(
    table: HypothesisTable,
    scan: Scan,
    scores: AttributeScores | None,
    associations: Associations,
    use_range_rate: bool = True,
    zone: BlindZone | None = None,
) -> None:
    """Update states and, with scores, beliefs by the joint marginals of the associations."""
    update_states_by_marginals(
        table,
        scan,
        associations.hypothesis,
        associations.detection,
        associations.joint_marginal,
        use_range_rate,
        shared_updates(table, scan, associations) if len(associations.group_first) else None,
        zone,
    )
    if scores is not None:
        update_beliefs_by_marginals(table, scores, associations.joint_marginal)


def update_states_by_marginals(
    table: HypothesisTable,
    scan: Scan,
    hypothesis: Int32Array,
    detection: Int32Array,
    marginal: FloatArray,
    use_range_rate: bool = True,
    shared: SharedUpdates | None = None,
    zone: BlindZone | None = None,
) -> None:
    """Update the state of each hypothesis with its detections, weighted by their probabilities.

    Parameters
    ----------
    table : HypothesisTable
        Predicted to the time of the scan; its states are replaced.
    scan : Scan
    hypothesis, detection : (P,)
        Rows of each gated pair.
    marginal : (P,)
        beta_ij; those of a hypothesis sum to 1 at most, up to rounding.
    use_range_rate : bool
        As for :func:`state_update.update_states`.
    shared : SharedUpdates, optional
        Updates by detections that hypotheses may share with others.
    zone : BlindZone, optional
        Of the sensor: a miss and a hit both say something about the range rate then. Does not go
        with shared detections.
    """
    if not len(marginal) and shared is None:
        reweight(table, np.arange(len(table)), zone, detected=False)
        return
    updated = table.select(hypothesis)
    update_states(updated, scan, detection, use_range_rate)
    if zone is not None:
        reweight(updated, np.arange(len(updated)), zone, detected=True)
        reweight(table, np.arange(len(table)), zone, detected=False)
    if shared is not None:
        hypothesis = np.concatenate([hypothesis, shared.rows])
        marginal = np.concatenate([marginal, shared.marginal])
        updated = updated.append(shared.updated)
    missed = missed_probability(len(table), hypothesis, marginal)
    if not table.model_weight.shape[1]:
        _, mean, covariance = _mixed(
            missed[:, None],
            table.mean[:, None],
            table.covariance[:, None],
            hypothesis,
            marginal[:, None],
            updated.mean[:, None],
            updated.covariance[:, None],
        )
        table.mean, table.covariance = mean[:, 0], covariance[:, 0]
        return
    mixture = _mixed(
        missed[:, None] * table.model_weight,
        table.model_mean,
        table.model_covariance,
        hypothesis,
        marginal[:, None] * updated.model_weight,
        updated.model_mean,
        updated.model_covariance,
    )
    set_models(table, *mixture)


def _mixed(
    prior_weight: FloatArray,
    prior_mean: FloatArray,
    prior_covariance: FloatArray,
    row: Int32Array,
    weight: FloatArray,
    mean: FloatArray,
    covariance: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Moments, for each of M models, of predictions (H, M, ...) and updates (P, M, ...).

    ``row`` (P,) is the hypothesis of each update. A model without weight keeps its prediction.

    Returns
    -------
    weight, mean, covariance
        (H, M), sums to 1; (H, M, s); (H, M, s, s).
    """
    total = prior_weight + _sums(weight, row, len(prior_weight))
    divisor = np.where(total > 0.0, total, 1.0)
    prior_share = np.where(total > 0.0, prior_weight / divisor, 1.0)[..., None]
    share = (weight / divisor[row])[..., None]
    # Relative to the prediction: no digits are lost on large coordinates.
    shift = mean - prior_mean[row]
    centre = _sums(share * shift, row, len(total))
    spread = shift - centre[row]
    mixed = prior_share[..., None] * (prior_covariance + centre[..., None] * centre[..., None, :])
    each = covariance + spread[..., None] * spread[..., None, :]
    mixed += _sums(share[..., None] * each, row, len(total))
    symmetric = np.ascontiguousarray(0.5 * (mixed + np.swapaxes(mixed, -1, -2)))
    return total / total.sum(axis=1, keepdims=True), prior_mean + centre, symmetric


def update_beliefs_by_marginals(
    table: HypothesisTable, scores: AttributeScores, marginal: FloatArray
) -> None:
    """Mix the candidate beliefs of each hypothesis, and its history as far as it was missed.

    ``marginal`` (P,) are the probabilities of the pairs of the scores. (A window of the history
    cannot hold a mixture: it takes the evidence of the chosen detections.)
    """
    if not len(marginal):
        return
    rows, count = scores.hypothesis, len(table)
    missed = missed_probability(count, rows, marginal)
    if scores.masses.shape[1]:
        table.use_focal(scores.focal)
        masses = missed[:, None] * table.masses
        masses[:, : len(scores.focal)] += _sums(marginal[:, None] * scores.masses, rows, count)
        table.masses = masses / masses.sum(axis=1, keepdims=True)
    if scores.class_probability.shape[1]:
        beliefs = missed[:, None] * table.class_probability
        beliefs += _sums(marginal[:, None] * scores.class_probability, rows, count)
        table.class_probability = beliefs / beliefs.sum(axis=1, keepdims=True)
    table.conflict = missed * table.conflict + _sums(marginal * scores.conflict, rows, count)


def missed_probability(count: int, hypothesis: Int32Array, marginal: FloatArray) -> FloatArray:
    """beta_i0 of each of ``count`` hypotheses; rounding below 0 is taken out."""
    return np.maximum(1.0 - np.bincount(hypothesis, marginal, minlength=count), 0.0)


def _sums(values: FloatArray, rows: Int32Array, count: int) -> FloatArray:
    """Sum values (P, ...) over the pairs of each of ``count`` rows."""
    total = np.zeros((count, *values.shape[1:]))
    np.add.at(total, rows, values)
    return total
