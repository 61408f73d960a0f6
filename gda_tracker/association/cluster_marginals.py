"""Marginals of all clusters of a scan, for several weightings of the same pairs at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from gda_tracker.association.belief_propagation import loopy_marginals
from gda_tracker.association.choices import (
    ENGINES,
    LOOPY_BELIEF_PROPAGATION,
    SUBSET_DYNAMIC_PROGRAMMING,
)
from gda_tracker.association.clustering import ClusterGroup, Clusters
from gda_tracker.association.errors import AssociationInputError, NoFeasibleHypothesis
from gda_tracker.association.joint import bordered_marginals
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, Int32Array, IntArray

LOG_IDLE_PENALTY = 20.0
"""The loopy engine cannot bound the number of pairs; each idle step costs this much instead."""


@dataclass(frozen=True, slots=True)
class JointWeights:
    """One weighting of the joint hypotheses of a scan, in logarithms.

    ``log_pair`` (P,) is log w of each pair, ``log_idle`` (H + n + 1,) log r of each hypothesis,
    then log c of each detection, then 0 for padding. Where ``least_assigned`` (G,) is given, only
    hypotheses with at least so many pairs count. ``fallback`` makes the weighting for clusters
    where every hypothesis has weight zero; without it their marginals are zero.
    """

    log_pair: FloatArray
    log_idle: FloatArray
    least_assigned: IntArray | None = None
    fallback: Callable[[], JointWeights] | None = None


@dataclass(frozen=True, slots=True)
class EngineLimits:
    """When the exact engine gives way, and when the loopy one gives up."""

    max_exact_size: int = 12
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

    Clusters of one group, under all weightings, go through the exact engine together. A cluster
    whose smaller side exceeds ``limits.max_exact_size`` goes through loopy belief propagation.

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
    for group in clusters.groups:
        bordered = _bordered(group, log_pair, log_idle)
        bound = None if least is None else least[:, group.clusters]
        if group.shape[2] <= limits.max_exact_size:
            marginals, feasible = _exact(bordered, bound)
        else:
            marginals, feasible, converged = _loopy(bordered, bound, limits)
            found.engine[group.clusters] = ENGINES.index(LOOPY_BELIEF_PROPAGATION)
            found.converged[group.clusters] = converged
        found.marginals[:, group.pairs] = marginals[(slice(None), *group.place)]
        if not feasible.all():
            _check_weights(log_pair, log_idle)
            _fall_back(clusters, group, feasible, weightings, limits, found)
    return found


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


def _exact(bordered: FloatArray, least: IntArray | None) -> tuple[FloatArray, BoolArray]:
    """Marginals (Q, B, S, K) and feasibility (Q, B) by subset dynamic programming."""
    layers, batch, rows, columns = bordered.shape
    answer = bordered_marginals(
        bordered.reshape(layers * batch, rows, columns),
        None if least is None else least.reshape(layers * batch),
    )
    marginals = answer.marginals.reshape(layers, batch, rows - 1, columns - 1)
    return marginals, answer.feasible.reshape(layers, batch)


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
