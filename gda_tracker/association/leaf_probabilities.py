"""Probability of each leaf of hypothesis trees: its share of all global hypotheses, by weight.

The weight of a global hypothesis is exp of the sum of its log scores (Koch 2014, 3.3). Hypotheses
are not enumerated: within a cluster the sums run over the tracks, with the open detections as the
state. All is in logarithms, so that no spread of the scores overflows or underflows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gda_tracker.association.errors import AssociationInputError
from gda_tracker.association.global_hypotheses import (
    LOG_VANISHING,
    GlobalHypothesis,
    best_global_hypothesis,
)
from gda_tracker.association.leaves.limits import ENGINES, SearchLimits
from gda_tracker.association.leaves.marginals import NOTHING_LOST, marginals
from gda_tracker.association.leaves.problem import (
    DROPPED,
    LeafProblem,
    check_leaves,
    usable_problem,
)
from gda_tracker.association.leaves.sums import log_sums
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class LeafProbabilities:
    """Probabilities of L leaves of T tracks in G clusters.

    ``probability`` (L,); ``track`` (T,) the tracks' ids, ascending; ``dropped`` (T,) the
    probability that the track is dropped: with it, those of a track's leaves sum to one.
    ``cluster`` (T,) as in :class:`~gda_tracker.association.global_hypotheses.GlobalHypothesis`.
    Per cluster: the name of the ``engine`` (G,) that answered; ``share`` (G,), the least share of
    the weight of all hypotheses that was looked at; ``exact`` (G,), whether that is all;
    ``log_partition`` (G,), the log of the summed weight that was looked at.
    """

    probability: FloatArray
    track: IntArray
    dropped: FloatArray
    cluster: IntArray
    engine: tuple[str, ...]
    share: FloatArray
    exact: BoolArray
    log_partition: FloatArray


def leaf_probabilities(
    log_score: ArrayLike,
    track: ArrayLike,
    used: ArrayLike,
    *,
    best: GlobalHypothesis | None = None,
    log_dropped: ArrayLike = LOG_VANISHING,
    limits: SearchLimits | None = None,
) -> LeafProbabilities:
    """Marginal probability of each leaf over all global hypotheses.

    In clusters without a hypothesis that has one leaf of each track, tracks may be dropped, as in
    :func:`~gda_tracker.association.global_hypotheses.best_global_hypothesis`. A cluster with more
    states than the limits allow is summed over the heaviest ones, the best hypothesis among them,
    and its ``share`` says what that covers.

    Parameters
    ----------
    log_score, track, used, log_dropped, limits
        As for :func:`~gda_tracker.association.global_hypotheses.best_global_hypothesis`.
    best : GlobalHypothesis, optional
        Its answer for the same leaves, where it is known.

    Raises
    ------
    AssociationInputError
        For shapes that do not fit and values without meaning.
    NoFeasibleHypothesis
        If no hypothesis exists or was found, for log weights of dropping of -inf.

    Examples
    --------
    Three hypotheses: leaves 0 and 3, 1 and 2, 1 and 3.

    >>> found = leaf_probabilities(np.log([2, 1, 3, 1]), [1, 1, 2, 2], [[7], [-1], [7], [8]])
    >>> found.probability.round(3)
    array([0.333, 0.667, 0.5  , 0.5  ])
    """
    limits = limits or SearchLimits()
    leaves = check_leaves(log_score, track, used, log_dropped)
    if best is None:
        best = best_global_hypothesis(
            log_score, track, used, log_dropped=log_dropped, limits=limits
        )
    elif len(best.chosen) != len(leaves.log_score) or len(best.leaf) != len(leaves.track_ids):
        raise AssociationInputError(
            f"best is of {len(best.chosen)} leaves of {len(best.leaf)} tracks: allowed is the "
            f"answer for these {len(leaves.log_score)} of {len(leaves.track_ids)}"
        )
    problem = usable_problem(leaves)
    problem = _where_dropped(problem, best, leaves.log_dropped)
    size = np.bincount(problem.cluster, minlength=problem.n_clusters)
    several = marginals(problem, (size > 1).nonzero()[0], _chosen(problem, best), limits)
    probability, log_partition, share = several.probability, several.log_partition, several.share
    alone = size[problem.cluster] == 1
    log_sum = log_sums(problem.log_score, problem.start[:-1])
    log_partition[problem.cluster[alone]] = log_sum[alone]
    share[problem.cluster[alone]] = 1.0
    single = alone[problem.owner]
    probability[single] = np.exp(problem.log_score - log_sum[problem.owner])[single]

    of_row = np.zeros(len(leaves.log_score))
    real = problem.row != DROPPED
    of_row[problem.row[real]] = probability[real]
    dropped = np.zeros(problem.n_tracks)
    dropped[problem.owner[~real]] = probability[~real]
    return LeafProbabilities(
        of_row,
        leaves.track_ids,
        dropped,
        problem.cluster,
        tuple(ENGINES[index] for index in several.engine.tolist()),
        share,
        share >= 1.0 - NOTHING_LOST,
        log_partition,
    )


def _where_dropped(
    problem: LeafProblem, best: GlobalHypothesis, log_dropped: FloatArray
) -> LeafProblem:
    """Let the tracks of those clusters be dropped in which one had to be."""
    needed = np.zeros(problem.n_clusters, dtype=np.bool_)
    needed[problem.cluster[best.leaf < 0]] = True
    may = needed[problem.cluster]
    may[problem.owner[problem.row == DROPPED]] = False  # they have that leaf
    return problem.with_drops(may.nonzero()[0], log_dropped) if may.any() else problem


def _chosen(problem: LeafProblem, best: GlobalHypothesis) -> IntArray:
    """Leaf of each track (T,) in the best hypothesis, as index into the problem."""
    place = np.full(len(best.chosen), -1)
    real = problem.row != DROPPED
    place[problem.row[real]] = real.nonzero()[0]
    chosen = np.full(problem.n_tracks, -1)
    chosen[problem.owner[~real]] = (~real).nonzero()[0]
    kept = best.leaf >= 0
    chosen[kept] = place[best.leaf[kept]]
    return chosen
