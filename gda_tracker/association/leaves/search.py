"""The k best choices of leaves of clusters, by dynamic programming with a beam that keeps count.

A partial choice has a *deficit*: what it lacks to the highest scores of its tracks. Deficits only
grow, so that a partial choice which was left out bounds all hypotheses that descend from it:
whatever is found with a smaller deficit than everything left out is proven best. Where the beam has
to be narrowed, the bound looks ahead to the leaves that the remaining tracks can still take.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gda_tracker.association.leaves.fitting import fitting_leaves
from gda_tracker.association.leaves.outlook import last_affected, outlook
from gda_tracker.association.leaves.stages import Stages, WordArray
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray

Closing = Sequence[Sequence[tuple[int, int, float]]]
"""Per step the detections that no later step may use: word, bit, and the cost of leaving it."""


@dataclass(frozen=True, slots=True)
class Found:
    """H hypotheses of the B clusters of a batch, by cluster and rising deficit.

    ``slot`` (H,) the cluster; ``deficit`` (H,); ``options`` (H, K) the leaf of each step as index
    into the stages, -1 beyond the size of the cluster. ``left_out`` (B,) is a lower bound of the
    deficit of every hypothesis that was not looked at, inf if there is none.
    """

    slot: IntArray
    deficit: FloatArray
    options: IntArray
    left_out: FloatArray


def search(
    stages: Stages,
    k: int,
    width: int,
    budget: FloatArray,
    closing: Closing | None = None,
) -> Found:
    """Find up to k best hypotheses of each cluster.

    Parameters
    ----------
    stages : Stages
        Of B clusters.
    k : int
        Hypotheses wanted of each cluster.
    width : int
        Partial choices kept of each cluster after a step, at least k.
    budget : (B,)
        Hypotheses of a larger deficit are not wanted.
    closing : optional
        With a batch of one cluster: costs, not negative, of detections left unused.
    """
    batch = len(stages.clusters)
    deficit = stages.top()[stages.step, stages.slot] - stages.log_score
    slot = np.arange(batch)
    value = np.zeros(batch)
    mask = np.zeros((len(stages.mask), batch), dtype=np.uint64)
    left_out = np.full(batch, np.inf)
    affected: list[int] | None = None
    trail: list[tuple[IntArray, IntArray]] = []
    finished: list[tuple[IntArray, IntArray, FloatArray]] = []
    for step in range(stages.n_steps):
        done = stages.size[slot] == step
        ready = done.nonzero()[0]
        finished.append((ready, slot[ready], value[ready]))
        parent, option = fitting_leaves(stages, step, slot, mask)
        reached = value[parent] + deficit[option]
        wanted = (reached <= budget[slot[parent]]).nonzero()[0]
        parent, option, value = parent[wanted], option[wanted], reached[wanted]
        slot = slot[parent]
        mask = mask[:, parent] | stages.mask[:, option]
        if closing is not None:
            value += unused_costs(mask, closing[step])
        mask &= stages.open_after[:, step, slot]
        kept = _best_of_states(slot, value, mask, k)
        crowded = _crowded(slot[kept], width, batch)
        if crowded.any():
            affected = last_affected(stages) if affected is None else affected
            rows = kept[crowded]
            bound = value[kept]
            bound[crowded] -= outlook(
                stages, -deficit, step, affected[step], slot[rows], mask[:, rows]
            )
            kept = kept[_narrow(slot[kept], bound, width, budget, left_out)]
        trail.append((parent[kept], option[kept]))
        slot, value, mask = slot[kept], value[kept], mask[:, kept]
    finished.append((np.arange(len(slot)), slot, value))
    return _trace(stages, trail, finished, left_out)


def unused_costs(mask: WordArray, closing: Sequence[tuple[int, int, float]]) -> FloatArray:
    """Sum of the costs of those detections that are not in the masks (W, R)."""
    total = np.zeros(mask.shape[1])
    for word, bit, cost in closing:
        total += np.where((mask[word] >> np.uint64(bit)) & np.uint64(1) == 0, cost, 0.0)
    return total


def _best_of_states(slot: IntArray, value: FloatArray, mask: WordArray, k: int) -> IntArray:
    """Rows of the k least values of each state, a cluster with its open detections used."""
    order: IntArray = np.lexsort((value, *mask, slot))
    if len(order) == 0:
        return order
    begin = np.ones(len(order), dtype=np.bool_)
    begin[1:] = slot[order[1:]] != slot[order[:-1]]
    for word in mask:
        sorted_word = word[order]
        begin[1:] |= sorted_word[1:] != sorted_word[:-1]
    if k == 1:
        return order[begin]
    begins = begin.nonzero()[0]
    rank = np.arange(len(order)) - begins[begin.cumsum() - 1]
    return order[rank < k]


def _crowded(slot: IntArray, width: int, batch: int) -> BoolArray:
    """Rows of the clusters that have more than ``width``."""
    crowded: BoolArray = (np.bincount(slot, minlength=batch) > width)[slot]
    return crowded


def _narrow(
    slot: IntArray, bound: FloatArray, width: int, budget: FloatArray, left_out: FloatArray
) -> IntArray:
    """Rows of the least bounds of each cluster, ``width`` at most; notes what is left out.

    Rows beyond the budget, and those that no hypothesis descends from, are not wanted.
    """
    wanted = ((bound < np.inf) & (bound <= budget[slot])).nonzero()[0]
    order = wanted[np.lexsort((bound[wanted], slot[wanted]))]
    count = np.bincount(slot[wanted], minlength=len(budget))
    rank = np.arange(len(order)) - (count.cumsum() - count)[slot[order]]
    first_out = order[rank == width]
    left_out[slot[first_out]] = np.minimum(left_out[slot[first_out]], bound[first_out])
    kept: IntArray = np.sort(order[rank < width])
    return kept


def _trace(
    stages: Stages,
    trail: Sequence[tuple[IntArray, IntArray]],
    finished: Sequence[tuple[IntArray, IntArray, FloatArray]],
    left_out: FloatArray,
) -> Found:
    """Follow finished hypotheses back to their leaves."""
    row, slot, value = (np.concatenate(parts) for parts in zip(*finished, strict=True))
    order = np.lexsort((value, slot))
    row, slot, value = row[order], slot[order], value[order]
    options = np.full((len(row), stages.n_steps), -1)
    size = stages.size[slot]
    for step in range(stages.n_steps - 1, -1, -1):
        parent, option = trail[step]
        here = (size > step).nonzero()[0]
        options[here, step] = option[row[here]]
        row[here] = parent[row[here]]
    return Found(slot, value, options, left_out)
