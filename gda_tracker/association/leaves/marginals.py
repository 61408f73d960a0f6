"""Marginals of the leaves of clusters: in one beam, and with prices where that is too narrow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gda_tracker.association.leaves.limits import (
    DYNAMIC_PROGRAMMING,
    ENGINES,
    PRICED_DYNAMIC_PROGRAMMING,
    SearchLimits,
)
from gda_tracker.association.leaves.prices import price, with_prices
from gda_tracker.association.leaves.problem import LeafProblem
from gda_tracker.association.leaves.stages import (
    Stages,
    batches,
    make_layout,
    make_stages,
)
from gda_tracker.association.leaves.sums import Sums, collapsed, sum_products
from gda_tracker.vocabulary.arrays import FloatArray, IntArray

NOTHING_LOST = 1e-12
"""Largest share of the weight that an exact answer may leave out."""

WORTH_PRICES = 1e-9
"""Share left out, as the answer says, from which on prices are tried for a better one."""


@dataclass(frozen=True, slots=True)
class Marginals:
    """Of M leaves in G clusters: ``probability`` (M,); ``log_partition``, ``share`` and ``engine``.

    The last three (G,); ``engine`` is an index into ``ENGINES``. Clusters that were not asked for
    have zeros.
    """

    probability: FloatArray
    log_partition: FloatArray
    share: FloatArray
    engine: IntArray


def marginals(
    problem: LeafProblem, clusters: IntArray, chosen: IntArray, limits: SearchLimits
) -> Marginals:
    """Marginals of the leaves of some clusters (C,), ascending.

    Parameters
    ----------
    problem : LeafProblem
    clusters : (C,)
    chosen : (T,)
        Leaf of each track in the best hypothesis.
    limits : SearchLimits
    """
    found = Marginals(
        np.zeros(len(problem.owner)),
        np.zeros(problem.n_clusters),
        np.zeros(problem.n_clusters),
        np.zeros(problem.n_clusters, dtype=np.int64),
    )
    layout = make_layout(problem)
    for batch in batches(layout, clusters):
        stages = make_stages(problem, batch, layout)
        _batch_marginals(problem, stages, chosen, limits, found)
    return found


def _batch_marginals(
    problem: LeafProblem,
    stages: Stages,
    chosen: IntArray,
    limits: SearchLimits,
    found: Marginals,
) -> None:
    united, union_of = collapsed(stages)
    place = np.full(len(problem.owner), -1)
    place[stages.leaf] = union_of
    inside = stages.tracks >= 0
    leaf = chosen[stages.tracks]
    path = np.where(inside, place[leaf], -1)
    log_best = problem.log_score[leaf].sum(axis=1, where=inside)
    sums = sum_products(united, path, log_best, limits.transitions)
    found.log_partition[stages.clusters] = sums.log_partition
    found.share[stages.clusters] = sums.share
    found.engine[stages.clusters] = ENGINES.index(DYNAMIC_PROGRAMMING)
    probability = sums.probability
    for slot in (sums.share < 1.0 - WORTH_PRICES).nonzero()[0].tolist():
        single, own = united.part(np.array([slot]))
        position = np.full(len(united.leaf), -1)
        position[own] = np.arange(len(own))
        again = _priced(
            problem, single, position[path[slot, : single.n_steps]], float(log_best[slot]), limits
        )
        if again.share[0] > sums.share[slot]:
            cluster = stages.clusters[slot]
            found.log_partition[cluster] = again.log_partition[0]
            found.share[cluster] = again.share[0]
            found.engine[cluster] = ENGINES.index(PRICED_DYNAMIC_PROGRAMMING)
            probability[own] = again.probability
    within = np.exp(stages.log_score - united.log_score[union_of])
    found.probability[stages.leaf] = probability[union_of] * within


def _priced(
    problem: LeafProblem, stages: Stages, path: IntArray, log_best: float, limits: SearchLimits
) -> Sums:
    """Sums of one cluster with prices on its detections: bounds are tighter, less is left out."""
    prices, _ = price(stages, problem, log_best, limits.price_rounds)
    priced = with_prices(stages, problem, prices, np.inf)
    position = np.empty(len(priced.order), dtype=np.int64)
    position[priced.order] = np.arange(len(priced.order))
    total = float(prices.sum())
    sums = sum_products(
        priced.stages,
        position[path][None],
        np.array([log_best - total]),
        limits.transitions,
        priced.closing,
    )
    return Sums(sums.probability[position], sums.log_partition + total, sums.share)
