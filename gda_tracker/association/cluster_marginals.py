"""Marginals of all clusters of a scan, for several weightings of the same pairs at once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from gda_tracker.association.belief_propagation import loopy_marginals
from gda_tracker.association.choices import (
    ENGINES,
    FRONTIER_DYNAMIC_PROGRAMMING,
    SUBSET_DYNAMIC_PROGRAMMING,
)
from gda_tracker.association.clustering import ClusterGroup, Clusters
from gda_tracker.association.elimination import Elimination
from gda_tracker.association.engine_choice import MAX_KEPT_ENTRIES, always_subsets, choose_engine
from gda_tracker.association.errors import AssociationInputError, NoFeasibleHypothesis
from gda_tracker.association.frontier import frontier_marginals, layers_of
from gda_tracker.association.joint import bordered_marginals
from gda_tracker.association.weightings import JointWeights
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, Int32Array, IntArray

LOG_IDLE_PENALTY = 20.0
"""The loopy engine cannot bound the number of pairs; each idle step costs this much instead."""


@dataclass(frozen=True, slots=True)
class EngineLimits:
    """When the exact engine gives way, and when the loopy one gives up."""

    max_exact_size: int = 14
    iterations: int = 200
    tolerance: float = 1e-6


@dataclass(frozen=True, slots=True)
class ClusterMarginals:
    """Marginals (Q, P) of Q weightings, and the engine behind each of G clusters.

    ``engine`` (G,) indexes ``ENGINES``; ``converged`` (G,) is False where it did not settle.
    """

    marginals: FloatArray
    engine: Int32Array
    converged: BoolArray


def cluster_marginals(
    clusters: Clusters, weightings: Sequence[JointWeights], limits: EngineLimits
) -> ClusterMarginals:
    """Marginal probability of every pair under each of Q weightings.

    Clusters of one group, under all weightings, go through the subset engine together. Where that
    is dear, the engine is chosen cluster by cluster (:func:`engine_choice.choose_engine`).

    Raises
    ------
    AssociationInputError
        If a log weight is NaN or +inf.
    """
    log_pair = np.array([weighting.log_pair for weighting in weightings])
    log_idle = np.array([weighting.log_idle for weighting in weightings])
    least = _least_assigned(weightings, len(clusters))
    found = ClusterMarginals(
        np.zeros_like(log_pair),
        np.full(len(clusters), ENGINES.index(SUBSET_DYNAMIC_PROGRAMMING), dtype=np.int32),
        np.ones(len(clusters), dtype=np.bool_),
    )
    for group, engine, orders in _by_engine(clusters, least, limits):
        bordered = _bordered(group, log_pair, log_idle)
        bound = None if least is None else least[:, group.clusters]
        found.engine[group.clusters] = ENGINES.index(engine)
        if engine == SUBSET_DYNAMIC_PROGRAMMING:
            marginals, feasible = _by_subsets(bordered, bound)
        elif engine == FRONTIER_DYNAMIC_PROGRAMMING:
            marginals, feasible = _by_frontier(group, orders, bordered, bound)
        else:
            marginals, feasible, converged = _loopy(bordered, bound, limits)
            found.converged[group.clusters] = converged
        found.marginals[:, group.pairs] = marginals[(slice(None), *group.place)]
        if not feasible.all():
            _check_weights(log_pair, log_idle)
            _fall_back(clusters, group, feasible, weightings, limits, found)
    return found


def _by_engine(
    clusters: Clusters, least: IntArray | None, limits: EngineLimits
) -> Iterator[tuple[ClusterGroup, str, list[Elimination]]]:
    """Groups of clusters that one engine answers; for the frontier engine with their orders."""
    size = limits.max_exact_size
    for group in clusters.groups:
        batch, steps, elements = group.shape
        if always_subsets(steps, elements, size):
            yield group, SUBSET_DYNAMIC_PROGRAMMING, []
            continue
        slot, step, element = group.place
        slots: dict[str, list[int]] = {}
        orders = []
        for index in range(batch):
            mine = slot == index
            number = group.clusters[index]
            engine, order = choose_engine(
                step[mine],
                element[mine],
                int(clusters.larger[number]),
                int(clusters.smaller[number]),
                size,
                (0,) if least is None else least[:, number].tolist(),
            )
            slots.setdefault(engine, []).append(index)
            if order is not None:
                orders.append(order)
        for engine, members in slots.items():
            part = group if len(members) == batch else group.part(np.array(members))
            yield part, engine, orders if engine == FRONTIER_DYNAMIC_PROGRAMMING else []


def _least_assigned(weightings: Sequence[JointWeights], count: int) -> IntArray | None:
    """Bounds (Q, G) on the number of pairs, 0 where a weighting has none."""
    if all(weighting.least_assigned is None for weighting in weightings):
        return None
    least = np.zeros((len(weightings), count), dtype=np.int64)
    for layer, weighting in enumerate(weightings):
        if weighting.least_assigned is not None:
            least[layer] = weighting.least_assigned
    return least


def _bordered(group: ClusterGroup, log_pair: FloatArray, log_idle: FloatArray) -> FloatArray:
    """Log weights (Q, B, S + 1, K + 1) of Q weightings, as the engine takes them."""
    batch, steps, elements = group.shape
    bordered = np.full((len(log_pair), batch, steps + 1, elements + 1), -np.inf)
    bordered[(slice(None), *group.place)] = log_pair[:, group.pairs]
    bordered[..., elements] = log_idle[:, group.steps]
    bordered[..., steps, :elements] = log_idle[:, group.elements]
    return bordered


def _by_subsets(bordered: FloatArray, least: IntArray | None) -> tuple[FloatArray, BoolArray]:
    """Marginals (Q, B, S, K) and feasibility (Q, B) by subset dynamic programming."""
    layers, batch, rows, columns = bordered.shape
    answer = bordered_marginals(
        bordered.reshape(layers * batch, rows, columns),
        None if least is None else least.reshape(layers * batch),
    )
    marginals = answer.marginals.reshape(layers, batch, rows - 1, columns - 1)
    return marginals, answer.feasible.reshape(layers, batch)


def _by_frontier(
    group: ClusterGroup, orders: Sequence[Elimination], bordered: FloatArray, least: IntArray | None
) -> tuple[FloatArray, BoolArray]:
    """Marginals (Q, B, S, K) and feasibility (Q, B) by frontier dynamic programming."""
    layers, batch, rows, columns = bordered.shape
    marginals = np.zeros((layers, batch, rows - 1, columns - 1))
    feasible = np.zeros((layers, batch), dtype=np.bool_)
    slot, step, element = group.place
    for index, order in enumerate(orders):
        mine = slot == index
        place = step[mine], element[mine]
        steps, elements = int(place[0].max()) + 1, int(group.sizes[index])
        kept = [*range(steps), rows - 1], [*range(elements), columns - 1]
        weights = bordered[:, index][:, *np.ix_(*kept)]
        bounds = np.zeros(layers, dtype=np.int64) if least is None else least[:, index]
        for bound in np.unique(bounds):
            same = (bounds == bound).nonzero()[0]
            room = max(1, MAX_KEPT_ENTRIES // (order.memory * layers_of(int(bound), elements)))
            for first in range(0, len(same), room):
                chosen = same[first : first + room]
                answer = frontier_marginals(order, *place, weights[chosen], int(bound))
                marginals[(chosen[:, None], index, *place)] = answer.marginals
                feasible[chosen, index] = answer.feasible
    return marginals, feasible


def _loopy(
    bordered: FloatArray, least: IntArray | None, limits: EngineLimits
) -> tuple[FloatArray, BoolArray, BoolArray]:
    """Marginals (Q, B, S, K), feasibility (Q, B), convergence (B,) by loopy belief propagation."""
    _check_weights(bordered)
    layers, batch, rows, columns = bordered.shape
    marginals = np.zeros((layers, batch, rows - 1, columns - 1))
    feasible = np.zeros((layers, batch), dtype=np.bool_)
    converged = np.ones(batch, dtype=np.bool_)
    for layer, slot in np.ndindex(layers, batch):
        weight = bordered[layer, slot, :-1, :-1]
        idle_steps, idle_elements = bordered[layer, slot, :-1, -1], bordered[layer, slot, -1, :-1]
        bound = 0 if least is None else int(least[layer, slot])
        if bound > 1:
            idle_steps = idle_steps - LOG_IDLE_PENALTY
        try:
            answer = loopy_marginals(
                weight, idle_steps, idle_elements, limits.iterations, limits.tolerance
            )
        except NoFeasibleHypothesis:
            continue
        share = 1.0
        if bound == 1:  # without the empty hypothesis
            log_empty = idle_steps.sum() + idle_elements.sum() - answer.log_partition
            share = -np.expm1(min(log_empty, 0.0))
        if share > 0.0:
            feasible[layer, slot] = True
            marginals[layer, slot] = np.minimum(answer.marginals / share, 1.0)
        converged[slot] &= answer.converged
    return marginals, feasible, converged


def _fall_back(
    clusters: Clusters,
    group: ClusterGroup,
    feasible: BoolArray,
    weightings: Sequence[JointWeights],
    limits: EngineLimits,
    found: ClusterMarginals,
) -> None:
    """Answer the clusters of a group that have no feasible hypothesis (Q, B) by the fallback."""
    for layer, weighting in enumerate(weightings):
        if weighting.fallback is None or feasible[layer].all():
            continue
        part = group.part((~feasible[layer]).nonzero()[0])
        again = cluster_marginals(
            Clusters(
                clusters.pair_cluster,
                clusters.larger,
                clusters.smaller,
                clusters.pair_count,
                (part,),
            ),
            [weighting.fallback()],
            limits,
        )
        found.marginals[layer, part.pairs] = again.marginals[0, part.pairs]
        found.converged[part.clusters] &= again.converged[part.clusters]


def _check_weights(*log_weights: FloatArray) -> None:
    for weights in log_weights:
        if not weights.max(initial=-np.inf) < np.inf:  # False for NaN
            raise AssociationInputError(
                f"log weights of joint hypotheses have the maximum {weights.max()}: allowed are "
                "finite values and -inf"
            )
