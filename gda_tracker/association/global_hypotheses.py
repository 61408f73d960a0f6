"""Global hypotheses of a track-oriented multiple hypothesis tracker.

Every track has a tree of association histories. A global hypothesis takes one leaf of every tree,
so that no detection of the last scans is used twice; its log weight is the sum of the log scores
(Koch 2014, 3.3; the weights (3.55)-(3.58) with several tracks). The best one is a weighted set
packing. It falls into clusters, the connected components of tracks over the detections that
several of them could use, and these are solved one by one:

- a cluster whose tracks' best leaves share no detection takes them;
- otherwise dynamic programming over the tracks, with the open detections as the state, in a beam
  that knows the best it left out: the answer is proven when it is no worse than that;
- what is not proven gets prices on the detections (Lagrangian relaxation), which leave few leaves
  and narrow the beam, and then, as the last resort, integer programming with a limit of nodes.

Nothing depends on time: the same input gives the same answer, proven or not.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from gda_tracker.association.errors import AssociationInputError
from gda_tracker.association.leaves.best import k_best_or_dropped
from gda_tracker.association.leaves.limits import ENGINES, SearchLimits
from gda_tracker.association.leaves.problem import (
    LeafProblem,
    check_leaves,
    usable_problem,
)
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray

LOG_VANISHING = -1e6
"""Log weight of dropping a track unless stated: as few are dropped as possible."""

__all__ = [
    "ClusterHypotheses",
    "GlobalHypothesis",
    "LOG_VANISHING",
    "SearchLimits",
    "best_global_hypothesis",
    "k_best_global_hypotheses",
]


@dataclass(frozen=True, slots=True)
class GlobalHypothesis:
    """The best global hypothesis of L leaves of T tracks in G clusters.

    ``chosen`` (L,) marks its leaves, ``log_weight`` is the sum of their log scores and of the
    weights of dropped tracks. ``track`` (T,) are the tracks' ids, ascending; ``leaf`` (T,) the
    chosen row of each, -1 where the track is dropped; ``cluster`` (T,) its cluster, numbered by
    first track. Per cluster: the name of the ``engine`` (G,) that answered; ``optimal`` (G,),
    whether the answer is proven; ``gap`` (G,), how much log weight a better one could have more,
    0 where proven.
    """

    chosen: BoolArray
    log_weight: float
    track: IntArray
    leaf: IntArray
    cluster: IntArray
    engine: tuple[str, ...]
    optimal: BoolArray
    gap: FloatArray

    @property
    def dropped(self) -> IntArray:
        """Ids of the dropped tracks."""
        ids: IntArray = self.track[self.leaf < 0]
        return ids


@dataclass(frozen=True, slots=True)
class ClusterHypotheses:
    """The best hypotheses of one cluster of n tracks.

    ``track`` (n,) are the tracks' ids, ascending; ``leaf`` (H, n) the row of each track's leaf in
    each hypothesis, -1 where it is dropped; ``log_weight`` (H,) falls. ``engine``, ``optimal`` and
    ``gap`` as in :class:`GlobalHypothesis`, for the last of the hypotheses; the gap is infinite
    where there may be more than were found.
    """

    track: IntArray
    leaf: IntArray
    log_weight: FloatArray
    engine: str
    optimal: bool
    gap: float


def best_global_hypothesis(
    log_score: ArrayLike,
    track: ArrayLike,
    used: ArrayLike,
    *,
    log_dropped: ArrayLike = LOG_VANISHING,
    limits: SearchLimits | None = None,
) -> GlobalHypothesis:
    """Choose one leaf of every track so that the sum of log scores is largest.

    No two chosen leaves share a detection. Only where a cluster has no such hypothesis, its tracks
    may be dropped: the answer is then the best with at most one leaf for each of its tracks.

    Parameters
    ----------
    log_score : (L,)
        Log score of each leaf; -inf forbids it.
    track : (L,) int
        Track of each leaf; any numbers, in any order.
    used : (L, N) int
        Detections that the leaf has used in the last N scans, -1 for none; numbers of different
        scans differ.
    log_dropped : float or (T,), optional
        Log weight of dropping a track, by ascending track id; -inf allows no dropping.
    limits : SearchLimits, optional
        Limits of work.

    Raises
    ------
    AssociationInputError
        For shapes that do not fit and values without meaning.
    NoFeasibleHypothesis
        If no hypothesis exists or was found, for log weights of dropping of -inf.

    Examples
    --------
    Both tracks would take detection 7; the second has the better alternative.

    >>> found = best_global_hypothesis([5.0, 1.0, 6.0, 4.0], [1, 1, 2, 2], [[7], [-1], [7], [8]])
    >>> found.leaf, found.log_weight
    (array([0, 3]), 9.0)
    """
    limits = limits or SearchLimits()
    leaves = check_leaves(log_score, track, used, log_dropped)
    problem = usable_problem(leaves)
    leaf, log_weight = _alone(problem)
    engine = np.zeros(problem.n_clusters, dtype=np.int64)
    gap = np.zeros(problem.n_clusters)
    clashing = _clashing(problem)
    if len(clashing):
        found = k_best_or_dropped(problem, clashing, 1, leaves.log_dropped, limits)
        engine, gap = found.engine, found.gap
        for cluster, rows, weight in found.parts:
            place = np.full(problem.n_clusters, -1)
            place[cluster] = np.arange(len(cluster))
            log_weight[cluster] = weight
            tracks = (place[problem.cluster] >= 0).nonzero()[0]
            leaf[tracks] = rows[place[problem.cluster[tracks]], found.rank[tracks]]
    chosen = np.zeros(len(leaves.log_score), dtype=np.bool_)
    chosen[leaf[leaf >= 0]] = True
    return GlobalHypothesis(
        chosen,
        float(log_weight.sum()),
        leaves.track_ids,
        leaf,
        problem.cluster,
        tuple(ENGINES[index] for index in engine.tolist()),
        gap <= 0.0,
        gap,
    )


def k_best_global_hypotheses(
    log_score: ArrayLike,
    track: ArrayLike,
    used: ArrayLike,
    k: int,
    *,
    log_dropped: ArrayLike = LOG_VANISHING,
    limits: SearchLimits | None = None,
) -> tuple[ClusterHypotheses, ...]:
    """Find the k best hypotheses of every cluster, fewer where there are fewer.

    Arguments and errors as in :func:`best_global_hypothesis`; clusters are independent, so that
    the weight of a global hypothesis is the sum over its clusters.

    Parameters
    ----------
    k : int
        At least 1.

    Returns
    -------
    One :class:`ClusterHypotheses` per cluster, in order of their first tracks.

    Examples
    --------
    >>> leaves = [5.0, 1.0, 6.0, 4.0], [1, 1, 2, 2], [[7], [-1], [7], [8]]
    >>> cluster, = k_best_global_hypotheses(*leaves, 2)
    >>> cluster.log_weight
    array([9., 7.])
    """
    if k < 1:
        raise AssociationInputError(f"k = {k}: allowed are integers >= 1")
    limits = limits or SearchLimits()
    leaves = check_leaves(log_score, track, used, log_dropped)
    problem = usable_problem(leaves)
    found = k_best_or_dropped(problem, np.arange(problem.n_clusters), k, leaves.log_dropped, limits)
    by_cluster: list[ClusterHypotheses | None] = [None] * problem.n_clusters
    order = problem.cluster.argsort(kind="stable")
    bounds = problem.cluster[order].searchsorted(np.arange(problem.n_clusters + 1)).tolist()
    for clusters, rows, weights in found.parts:
        begins = np.flatnonzero(np.diff(clusters, prepend=-1, append=-1)).tolist()
        for begin, end in pairwise(begins):
            cluster = int(clusters[begin])
            tracks = order[bounds[cluster] : bounds[cluster + 1]]
            by_cluster[cluster] = ClusterHypotheses(
                leaves.track_ids[tracks],
                rows[begin:end, found.rank[tracks]],
                weights[begin:end],
                ENGINES[found.engine[cluster]],
                bool(found.gap[cluster] <= 0.0),
                float(found.gap[cluster]),
            )
    return tuple(hypotheses for hypotheses in by_cluster if hypotheses is not None)


def _alone(problem: LeafProblem) -> tuple[IntArray, FloatArray]:
    """Row of the best leaf of each track (T,), and their log weight per cluster (G,)."""
    best = problem.best_leaf()
    log_weight = np.zeros(problem.n_clusters)
    np.add.at(log_weight, problem.cluster, problem.log_score[best])
    return problem.row[best], log_weight


def _clashing(problem: LeafProblem) -> IntArray:
    """Clusters whose tracks' best leaves share a detection, ascending."""
    best = problem.best_leaf()
    track, scan = (problem.contested[best] >= 0).nonzero()
    detection = problem.contested[best[track], scan]
    wanted = np.bincount(detection, minlength=problem.n_contested)
    clashes = np.zeros(problem.n_clusters, dtype=np.bool_)
    clashes[problem.cluster[track[wanted[detection] > 1]]] = True
    return clashes.nonzero()[0]
