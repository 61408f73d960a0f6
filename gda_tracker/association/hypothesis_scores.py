"""Scores of pairs for a track manager that branches: what the decision ``mht`` asks for.

Leaves of one track exclude each other, and which of them share detections is decided over several
scans where the hypotheses are kept. So nothing is chosen here. Published are the log likelihoods of
each pair, and its probability within its hypothesis as if there were no other: w_ij / (r_i + sum_j
w_ij) with the weights of :mod:`gda_tracker.association.generalised` divided by the false alarm's.
"""

from __future__ import annotations

import numpy as np

from gda_tracker.association.choices import EACH_HYPOTHESIS_ALONE
from gda_tracker.association.log_ratios import log_ratios
from gda_tracker.association.statements import StatementFactors
from gda_tracker.kinematics.gating import GatedPairs
from gda_tracker.vocabulary.arrays import FloatArray
from gda_tracker.vocabulary.beliefs import AttributeScores
from gda_tracker.vocabulary.hypotheses import Associations, Predictions
from gda_tracker.vocabulary.scans import Scan


def score_hypotheses(
    scan: Scan,
    predictions: Predictions,
    scores: AttributeScores | None,
    pairs: GatedPairs,
    said: StatementFactors | None = None,
) -> Associations:
    """Return the associations of decision ``mht``: likelihoods per pair, nothing chosen.

    What was ``said`` of where tracks are counts in the probabilities.
    """
    settings, n_hypotheses = predictions.settings, len(predictions)

    def alone(attribute: FloatArray | None, clutter: FloatArray | None) -> FloatArray:
        """Probability of each pair within its hypothesis."""
        pair, miss = log_ratios(
            pairs.hypothesis,
            pairs.detection,
            pairs.log_likelihood,
            attribute,
            clutter,
            predictions.detection_probability,
            settings.clutter_density,
        )
        if said is not None:
            pair, miss = pair + said.log_pair, miss + said.log_idle
        highest = miss.copy()
        np.maximum.at(highest, pairs.hypothesis, pair)
        weight = np.exp(pair - highest[pairs.hypothesis])
        total = np.exp(miss - highest)
        np.add.at(total, pairs.hypothesis, weight)
        return np.asarray(weight / total[pairs.hypothesis])

    p_kinematic = alone(None, None)
    joint = p_kinematic
    if scores is not None:
        joint = alone(scores.log_likelihood, scores.clutter_log_likelihood)
    count = len(pairs)
    # Every hypothesis with a pair is a cluster of its own.
    new = np.ones(count, dtype=np.bool_)
    new[1:] = pairs.hypothesis[1:] != pairs.hypothesis[:-1]
    n_clusters = int(np.count_nonzero(new))
    return Associations(
        key=scan.key,
        decision=settings.decision,
        attribute_term="none" if scores is None else settings.attribute_term,
        degraded=scores is None,
        hypothesis=pairs.hypothesis,
        detection=pairs.detection,
        mahalanobis_squared=pairs.mahalanobis_squared,
        kinematic_log_likelihood=pairs.log_likelihood,
        attribute_log_likelihood=np.zeros(count) if scores is None else scores.log_likelihood,
        p_kinematic=p_kinematic,
        p_attribute=np.ones(count),
        p_generalised=p_kinematic,
        joint_marginal=joint,
        chosen=np.zeros(count, dtype=np.bool_),
        cluster=(np.cumsum(new) - 1).astype(np.int32),
        assigned_detection=np.full(n_hypotheses, -1, dtype=np.int32),
        cluster_engine=np.zeros(n_clusters, dtype=np.int32),
        cluster_converged=np.ones(n_clusters, dtype=np.bool_),
        engine_names=(EACH_HYPOTHESIS_ALONE,),
    )
