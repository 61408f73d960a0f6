"""Generalised data association: the weightings of Tchamova et al. (2004), 14.4, and P_a.

Kinematics (14.4.1): w = P_d g, r = 1 - P_d, c = beta. Attribute (14.4.2): w = d_e, r = c = 1. The
joint likelihood: w = P_d g l, r = 1 - P_d, c = beta f(attribute | false alarm); with the clutter's
own likelihood the answer does not depend on the unit of the attribute.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from gda_tracker.association.assignment import LOG_VANISHING
from gda_tracker.association.choices import MISSED_TRACK_HYPOTHESES
from gda_tracker.association.clustering import Clusters
from gda_tracker.association.errors import AssociationInputError
from gda_tracker.association.weightings import JointWeights
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, Int32Array, IntArray


def kinematic_weights(
    hypothesis: Int32Array,
    log_likelihood: FloatArray,
    detection_probability: FloatArray,
    clutter_density: float,
    n_detections: int,
) -> JointWeights:
    """Weighting of P_k (14.4.1).

    Where no hypothesis has weight (P_d = 1 and a track without detection, or beta = 0 and more
    detections than tracks) the weights of zero are taken as the limit of vanishing ones.

    Parameters
    ----------
    hypothesis : (P,)
    log_likelihood : (P,)
        log g_ij [log 1/(m rad)].
    detection_probability : (H,)
        P_d of each hypothesis.
    clutter_density : float
        beta [1/(m rad)].
    n_detections : int
    """
    n_hypotheses = len(detection_probability)
    log_idle = np.zeros(n_hypotheses + n_detections + 1)
    with np.errstate(divide="ignore", invalid="ignore"):  # the engine refuses NaN
        log_pair = np.log(detection_probability)[hypothesis] + log_likelihood
        log_idle[:n_hypotheses] = np.log(1.0 - detection_probability)
        log_idle[n_hypotheses:-1] = np.log(clutter_density)
    return _with_vanishing_limit(log_pair, log_idle)


def joint_weights(
    kinematic: JointWeights, log_likelihood: FloatArray, clutter_log_likelihood: FloatArray
) -> JointWeights:
    """Weighting of the joint kinematic and attribute likelihood.

    Parameters
    ----------
    kinematic : JointWeights
        From :func:`kinematic_weights`.
    log_likelihood : (P,)
        log l_ij of the attribute.
    clutter_log_likelihood : (n,)
        log f(attribute | false alarm), in the same unit.
    """
    log_idle = kinematic.log_idle.copy()
    first = len(log_idle) - 1 - len(clutter_log_likelihood)
    log_idle[first:-1] += clutter_log_likelihood
    return _with_vanishing_limit(kinematic.log_pair + log_likelihood, log_idle)


def attribute_weights(
    clusters: Clusters,
    distance: FloatArray,
    informative: BoolArray,
    missed_track_hypotheses: str,
    n_hypotheses: int,
    n_detections: int,
) -> JointWeights:
    """Weighting of P'_a (14.4.2).

    A pair with an uninformative detection takes the mean distance of the informative pairs of its
    cluster: its own distance, 0, would beat every measured one.

    Parameters
    ----------
    clusters : Clusters
    distance : (P,)
        d_e(i, j) between history and candidate history.
    informative : (P,)
        False where the detection's attribute is unknown.
    missed_track_hypotheses : str
        ``zero``: a joint hypothesis weighs nothing if one with more pairs exists in the gate
        graph; where all of the fullest ones have weight zero they count the same. ``table_14_3``:
        only the empty hypothesis weighs nothing.
    n_hypotheses, n_detections : int
    """
    if missed_track_hypotheses not in MISSED_TRACK_HYPOTHESES:
        raise AssociationInputError(
            f"missed_track_hypotheses = {missed_track_hypotheses!r}: allowed is one of "
            + ", ".join(MISSED_TRACK_HYPOTHESES)
        )
    if not informative.all():
        mean = _informative_mean(clusters, distance, informative)
        distance = np.where(informative, distance, mean[clusters.pair_cluster])
    with np.errstate(divide="ignore", invalid="ignore"):  # the engine refuses NaN
        log_pair = np.log(distance)
    # A cluster of one pair is not asked about its distance, which may be zero.
    single = (clusters.pair_count == 1)[clusters.pair_cluster]
    log_pair[single & (distance == 0.0)] = 0.0
    log_idle = np.zeros(n_hypotheses + n_detections + 1)
    if missed_track_hypotheses == "table_14_3":
        once = np.ones(len(clusters), dtype=np.int64)
        return JointWeights(log_pair, log_idle, once)
    fullest = most_pairs(clusters)
    return JointWeights(
        log_pair,
        log_idle,
        fullest,
        lambda: JointWeights(np.zeros_like(log_pair), log_idle, fullest),
    )


def attribute_probability(
    clusters: Clusters, marginals: FloatArray, informative: BoolArray
) -> FloatArray:
    """P_a = 1 - P'_a of each pair (P,), 1 in clusters where the attribute says nothing.

    That is a cluster of one pair, for which P'_a is 1 whatever the distance, and a cluster without
    an informative pair.
    """
    p_attribute = 1.0 - marginals
    np.maximum(p_attribute, 0.0, out=p_attribute)  # a marginal may exceed 1 by rounding
    mute = clusters.pair_count == 1
    if not informative.all():
        heard = clusters.pair_cluster[informative]
        mute |= np.bincount(heard, minlength=len(clusters)) == 0
    p_attribute[mute[clusters.pair_cluster]] = 1.0
    return p_attribute


def most_pairs(clusters: Clusters) -> IntArray:
    """Number of pairs (G,) of the fullest joint hypotheses of each cluster."""
    # A connected cluster with a smaller side of 1 or 2 always serves all of it (Hall's condition).
    if all(group.shape[2] <= 2 for group in clusters.groups):
        return clusters.smaller
    sure = (clusters.smaller <= 2) | (clusters.pair_count == clusters.larger * clusters.smaller)
    if sure.all():
        return clusters.smaller
    most = clusters.smaller.copy()
    for group in clusters.groups:
        gate = group.dense(np.ones(len(clusters.pair_cluster)), 0.0)
        for slot in (~sure[group.clusters]).nonzero()[0]:
            matched = gate[slot][linear_sum_assignment(gate[slot], maximize=True)]
            most[group.clusters[slot]] = int(matched.sum())
    return most


def _informative_mean(
    clusters: Clusters, distance: FloatArray, informative: BoolArray
) -> FloatArray:
    """Mean distance (G,) of the informative pairs of each cluster, 1 where there is none."""
    cluster, count = clusters.pair_cluster[informative], len(clusters)
    number = np.bincount(cluster, minlength=count)
    total = np.bincount(cluster, weights=distance[informative], minlength=count)
    return np.where(number > 0, total / np.maximum(number, 1), 1.0)


def _with_vanishing_limit(log_pair: FloatArray, log_idle: FloatArray) -> JointWeights:
    return JointWeights(
        log_pair,
        log_idle,
        fallback=lambda: JointWeights(log_pair, np.maximum(log_idle, LOG_VANISHING)),
    )
