"""The k best hypotheses of clusters: from the cheapest engine to the one that proves the answer."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gda_tracker.association.errors import NoFeasibleHypothesis
from gda_tracker.association.leaves.limits import (
    DYNAMIC_PROGRAMMING,
    ENGINES,
    INTEGER_PROGRAMMING,
    PRICED_DYNAMIC_PROGRAMMING,
    SearchLimits,
)
from gda_tracker.association.leaves.packing import pack
from gda_tracker.association.leaves.prices import price, with_prices
from gda_tracker.association.leaves.problem import DROPPED, LeafProblem
from gda_tracker.association.leaves.search import search
from gda_tracker.association.leaves.stages import (
    Layout,
    Stages,
    batches,
    make_layout,
    make_stages,
    without_dominated,
)
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray

SLACK = 1e-9
"""Rounding allowed for in bounds, relative to the scores."""

_SPAN_AIMED_AT = 10.0
"""Without any known hypothesis, prices aim at a bound smaller by so much."""


@dataclass(slots=True)
class Solutions:
    """Hypotheses of some of G clusters, filled cluster by cluster.

    Per cluster (G,): ``engine``, an index into ``ENGINES``; ``gap``, by how much a hypothesis not
    among the answer could be better than the last one of it, 0 when proven; ``feasible``, False
    where none was found. ``rank`` (T,) is the column of each track in the ``parts``: cluster (H,),
    the caller's rows (H, K), ``DROPPED`` for dropped tracks and beyond the size, and log weight
    (H,), by cluster and falling weight.
    """

    engine: IntArray
    gap: FloatArray
    feasible: BoolArray
    rank: IntArray
    parts: list[tuple[IntArray, IntArray, FloatArray]] = field(default_factory=list)


def k_best_or_dropped(
    problem: LeafProblem, clusters: IntArray, k: int, log_dropped: FloatArray, limits: SearchLimits
) -> Solutions:
    """Find the k best hypotheses of some clusters (C,), ascending.

    Tracks of a cluster without any hypothesis may be dropped, at the weights ``log_dropped`` (T,).

    Raises
    ------
    NoFeasibleHypothesis
        If a cluster has no hypothesis all the same.
    """
    layout = make_layout(problem)
    found = k_best(problem, layout, clusters, k, limits)
    without = clusters[~found.feasible[clusters]]
    if len(without) == 0:
        return found
    among = np.zeros(problem.n_clusters, dtype=np.bool_)
    among[without] = True
    dropping = problem.with_drops(among[problem.cluster].nonzero()[0], log_dropped)
    again = k_best(dropping, layout, without, k, limits)
    if not again.feasible[without].all():
        raise NoFeasibleHypothesis(
            f"{np.count_nonzero(~again.feasible[without])} clusters of tracks have no hypothesis "
            "with one leaf for each track, and log_dropped allows no dropping"
        )
    found.engine[without] = again.engine[without]
    found.gap[without] += again.gap[without]
    found.feasible[without] = True
    found.parts += again.parts
    return found


def k_best(
    problem: LeafProblem, layout: Layout, clusters: IntArray, k: int, limits: SearchLimits
) -> Solutions:
    """Find the k best hypotheses of some clusters (C,), ascending, with one leaf of each track."""
    found = Solutions(
        np.zeros(problem.n_clusters, dtype=np.int64),
        np.zeros(problem.n_clusters),
        np.ones(problem.n_clusters, dtype=np.bool_),
        layout.rank,
    )
    for batch in batches(layout, clusters):
        stages = without_dominated(make_stages(problem, batch, layout), k)
        no_budget = np.full(len(batch), np.inf)
        widths = (limits.first_width, limits.second_width)
        _solve(problem, stages, k, widths, no_budget, limits, found)
    return found


def _solve(
    problem: LeafProblem,
    stages: Stages,
    k: int,
    widths: tuple[int, ...],
    budget: FloatArray,
    limits: SearchLimits,
    found: Solutions,
) -> None:
    """Answer a batch by dynamic programming: what one beam does not prove, in the next one.

    What that does not prove either is answered one by one. ``budget`` (B,) is a deficit within
    which the k best hypotheses are known to be, plus rounding.
    """
    batch = len(stages.clusters)
    width, *later_widths = widths
    answer = search(stages, k, max(width, k), budget)
    number = np.bincount(answer.slot, minlength=batch)
    last = np.full(batch, np.inf)
    full = number == k
    last[full] = answer.deficit[number.cumsum()[full] - 1]
    proven = (last <= answer.left_out) | np.isposinf(answer.left_out)
    found.engine[stages.clusters] = ENGINES.index(DYNAMIC_PROGRAMMING)
    found.feasible[stages.clusters] = number > 0
    kept = proven[answer.slot]
    options = answer.options[kept]
    weights = stages.log_score[options].sum(axis=1, where=options >= 0)
    rows = np.where(options >= 0, problem.row[stages.leaf[options]], DROPPED)
    found.parts.append((stages.clusters[answer.slot[kept]], rows, weights))
    open_slots = (~proven).nonzero()[0]
    if len(open_slots) == 0:
        return
    if later_widths:
        part, _ = stages.part(open_slots)
        rounding = SLACK * (1.0 + np.abs(part.top()).sum(axis=0) + last[open_slots])
        within = np.minimum(budget[open_slots], last[open_slots] + rounding)
        _solve(problem, part, k, tuple(later_widths), within, limits, found)
        return
    for slot in open_slots.tolist():
        single, own = stages.part(np.array([slot]))
        position = np.full(len(stages.leaf), -1)
        position[own] = np.arange(len(own))
        known = answer.options[answer.slot == slot][:, : single.n_steps]
        hard = _Hard(single, k, position[known], _total(single) - float(answer.left_out[slot]))
        engine = _solve_hard(problem, hard, limits)
        cluster = int(stages.clusters[slot])
        found.engine[cluster] = ENGINES.index(engine)
        found.feasible[cluster] = len(hard.options) > 0
        found.gap[cluster] = hard.gap
        rows = problem.row[single.leaf[hard.options]]
        found.parts.append((np.full(len(rows), cluster), rows, hard.weights))


class _Hard:
    """What is known of one cluster: its best hypotheses so far, and a bound of all others.

    ``options`` (H, K) are leaves by step, by falling ``weights`` (H,); ``ceiling`` bounds the log
    weight of the hypotheses that may be missing among the k best. ``slack`` is the rounding error
    that comparisons allow for.
    """

    def __init__(self, stages: Stages, k: int, options: IntArray, ceiling: float) -> None:
        self.stages = stages
        self.k = k
        self.options = options[:0]
        self.ceiling = np.inf
        self.slack = SLACK * (1.0 + float(np.abs(stages.log_score).max()) * stages.n_steps)
        self.learn(options, ceiling)

    def learn(self, options: IntArray, ceiling: float) -> None:
        """Add hypotheses that were found, and another bound."""
        united = np.unique(np.concatenate([self.options, options]), axis=0)
        weights = self.stages.log_score[united].sum(axis=1)
        order = (-weights).argsort(kind="stable")[: self.k]
        self.options, self.weights = united[order], weights[order]
        self.ceiling = min(self.ceiling, ceiling)

    @property
    def floor(self) -> float:
        """Log weight that a hypothesis must exceed to be of use."""
        return float(self.weights[-1]) if len(self.options) == self.k else -np.inf

    @property
    def gap(self) -> float:
        """By how much a missing hypothesis could be better than the last known one."""
        if self.ceiling <= self.floor + self.slack:
            return 0.0
        return self.ceiling - self.floor


def _solve_hard(problem: LeafProblem, hard: _Hard, limits: SearchLimits) -> str:
    """Improve what is known of a cluster until it is proven; returns the last engine."""
    stages = hard.stages
    target = hard.weights[0] if len(hard.weights) else _total(stages) - _SPAN_AIMED_AT
    prices, bound = price(stages, problem, float(target), limits.price_rounds)
    budget = bound - hard.floor + hard.slack
    priced = with_prices(stages, problem, prices, budget)
    answer = search(
        priced.stages,
        hard.k,
        max(limits.width, hard.k),
        np.array([budget - priced.unused]),
        priced.closing,
    )
    hard.learn(priced.order[answer.options], bound - priced.unused - float(answer.left_out[0]))
    # Integer programming finds one hypothesis: the best, or that there is any.
    served = hard.k > 1 and len(hard.options) > 0
    if hard.gap <= 0.0 or served or limits.nodes == 0:
        return PRICED_DYNAMIC_PROGRAMMING
    useful = np.zeros(len(stages.leaf), dtype=np.bool_)
    useful[priced.order] = True
    packed = pack(stages.keep(useful), problem, limits.nodes)
    options = np.zeros((0, stages.n_steps), dtype=np.int64)
    if packed.options is not None:
        options = useful.nonzero()[0][packed.options][None]
    hard.learn(options, packed.bound)
    return INTEGER_PROGRAMMING


def _total(stages: Stages) -> float:
    """Sum of the best scores of the tracks of a batch of one cluster."""
    return float(stages.top().sum())
