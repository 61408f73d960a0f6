"""Sums over all global hypotheses of clusters, by dynamic programming in logarithms.

Forward sums over the first tracks and backward sums over the last ones meet in the marginals. The
states are those of :mod:`gda_tracker.association.leaves.search`. States that are left out, because
they weigh nothing or because there are too many, are summed up as well, with an upper bound of what
could follow: the answer knows which share of all weight it has at least.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gda_tracker.association.leaves.fitting import fitting_leaves
from gda_tracker.association.leaves.outlook import last_affected, outlook
from gda_tracker.association.leaves.search import Closing, unused_costs
from gda_tracker.association.leaves.stages import Stages, WordArray
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray

LOG_NEGLIGIBLE = -60.0
"""States whose hypotheses together weigh less than exp of this of the best one are left out."""

LOOKED_AT = 8
"""Of states in plenty, so many times what can be kept are looked at closer."""


@dataclass(frozen=True, slots=True)
class Sums:
    """Marginals of O leaves of B clusters.

    ``probability`` (O,); ``log_partition`` (B,) the log weight of all hypotheses looked at;
    ``share`` (B,) their least share of the weight of all.
    """

    probability: FloatArray
    log_partition: FloatArray
    share: FloatArray


@dataclass(frozen=True, slots=True)
class _Transitions:
    """From the states of one step (``parent``) by a leaf (``option``) to those of the next one."""

    parent: IntArray
    option: IntArray
    log_factor: FloatArray
    child: IntArray


def collapsed(stages: Stages) -> tuple[Stages, IntArray]:
    """Unite leaves of one track that use the same contested detections; their weights add up.

    Returns the stages with the united leaves and the united leaf (O,) of each leaf.
    """
    order = np.lexsort((*stages.mask, stages.slot, stages.step))
    step, slot, mask = stages.step[order], stages.slot[order], stages.mask[:, order]
    begin = np.ones(len(order), dtype=np.bool_)
    begin[1:] = (step[1:] != step[:-1]) | (slot[1:] != slot[:-1])
    begin[1:] |= (mask[:, 1:] != mask[:, :-1]).any(axis=0)
    united_of = np.empty(len(order), dtype=np.int64)
    united_of[order] = begin.cumsum() - 1
    begins = begin.nonzero()[0]
    log_score = log_sums(stages.log_score[order], begins)
    # Stages stand by falling score.
    united_step, united_slot = step[begins], slot[begins]
    by_score = np.lexsort((-log_score, united_slot, united_step))
    place = np.empty(len(by_score), dtype=np.int64)
    place[by_score] = np.arange(len(by_score))
    united = replace(
        stages,
        leaf=stages.leaf[order[begins[by_score]]],
        log_score=log_score[by_score],
        mask=mask[:, begins[by_score]],
        step=united_step[by_score],
        slot=united_slot[by_score],
    )
    return united.keep(np.ones(len(by_score), dtype=np.bool_)), place[united_of]


def log_sums(values: FloatArray, begins: IntArray) -> FloatArray:
    """Logarithm of the sum of exp over consecutive segments, none of them empty."""
    if len(begins) == 0:
        return np.zeros(0)
    top = np.maximum.reduceat(values, begins)
    length = np.diff(begins, append=len(values))
    reference = np.where(top > -np.inf, top, 0.0)
    summed = np.add.reduceat(np.exp(values - np.repeat(reference, length)), begins)
    with np.errstate(divide="ignore"):
        found: FloatArray = reference + np.log(summed)
    return found


def sum_products(
    stages: Stages,
    path: IntArray,
    log_best: FloatArray,
    transitions: int,
    closing: Closing | None = None,
) -> Sums:
    """Marginals of the leaves of a batch.

    Parameters
    ----------
    stages : Stages
        Collapsed.
    path : (B, K)
        Leaves of one hypothesis of each cluster that is not left out, by step; -1 beyond the size.
    log_best : (B,)
        Log weight of a heavy hypothesis, for what is negligible.
    transitions : int
        States kept of each cluster, times the leaves of a track.
    closing : optional
        With a batch of one cluster: costs, not negative, of detections left unused.
    """
    batch = len(stages.clusters)
    width = max(1, transitions // int(stages.count.max()))
    some = stages.count > 0
    step_sum = np.zeros(stages.first.shape)
    step_sum[some] = log_sums(stages.log_score, stages.first[some])
    # What may follow weighs at most the product of the sums of the later tracks.
    rest = np.zeros((stages.n_steps + 1, batch))
    rest[:-1] = step_sum[::-1].cumsum(axis=0)[::-1]
    lost = np.full(batch, -np.inf)
    remaining = _sums_from(stages)
    affected: list[int] | None = None

    slot = np.arange(batch)
    log_sum = np.zeros(batch)
    mask = np.zeros((len(stages.mask), batch), dtype=np.uint64)
    on_path = mask.copy()
    states = []
    trail: list[_Transitions] = []
    for step in range(stages.n_steps):
        states.append((slot, log_sum))
        parent, option = fitting_leaves(stages, step, slot, mask)
        here = slot[parent]
        factor = stages.log_score[option]
        reached = mask[:, parent] | stages.mask[:, option]
        if closing is not None:
            factor = factor - unused_costs(reached, closing[step])
        weight = log_sum[parent] + factor
        reached &= stages.open_after[:, step, here]

        order, begin = _by_state(here, reached)
        total = log_sums(weight[order], begin.nonzero()[0])
        first = order[begin]
        group_slot, group_mask = here[first], reached[:, first]
        live = (path[:, step] >= 0).nonzero()[0]
        on_path[:, live] |= stages.mask[:, path[live, step]]
        on_path[:, live] &= stages.open_after[:, step, live]
        wanted = (group_mask == on_path[:, group_slot]).all(axis=0)
        bound = total + rest[step + 1, group_slot]
        floor = log_best[group_slot] + LOG_NEGLIGIBLE
        kept = wanted | (bound >= floor)
        _narrow(kept, wanted, group_slot, bound, LOOKED_AT * width)
        crowded = (np.bincount(group_slot[kept], minlength=batch) > width)[group_slot] & kept
        if crowded.any():
            affected = last_affected(stages) if affected is None else affected
            last = affected[step]
            bound[crowded] = total[crowded] + rest[last + 1, group_slot[crowded]]
            bound[crowded] += outlook(
                stages, remaining, step, last, group_slot[crowded], group_mask[:, crowded]
            )
            kept &= wanted | (bound >= floor)
        _narrow(kept, wanted, group_slot, bound, width)
        np.logaddexp.at(lost, group_slot[~kept], bound[~kept])
        number = np.where(kept, kept.cumsum() - 1, -1)
        child = np.empty(len(order), dtype=np.int64)
        child[order] = number[begin.cumsum() - 1]
        stays = (child >= 0).nonzero()[0]
        trail.append(_Transitions(parent[stays], option[stays], factor[stays], child[stays]))
        slot, log_sum, mask = group_slot[kept], total[kept], group_mask[:, kept]
    states.append((slot, log_sum))
    return _backward(stages, states, trail, lost)


def _by_state(slot: IntArray, mask: WordArray) -> tuple[IntArray, BoolArray]:
    """Order by cluster and open detections used, and where a new state begins in it."""
    order = np.lexsort((*mask, slot))
    begin = np.ones(len(order), dtype=np.bool_)
    begin[1:] = slot[order[1:]] != slot[order[:-1]]
    for word in mask:
        ordered = word[order]
        begin[1:] |= ordered[1:] != ordered[:-1]
    return order, begin


def _sums_from(stages: Stages) -> FloatArray:
    """Upper bound (O,) of the log weight of a leaf and those after it of its step and cluster."""
    first = stages.first[stages.step, stages.slot]
    left = first + stages.count[stages.step, stages.slot] - np.arange(len(first))
    bound: FloatArray = stages.log_score + np.log(left)
    return bound


def _narrow(
    kept: BoolArray, wanted: BoolArray, slot: IntArray, bound: FloatArray, width: int
) -> None:
    """Unmark the states of least bound of clusters with more than ``width``, but none wanted."""
    count = np.bincount(slot[kept])
    if max(count.tolist(), default=0) <= width:
        return
    rows = kept.nonzero()[0]
    order = rows[np.lexsort((-bound[rows], ~wanted[rows], slot[rows]))]
    rank = np.arange(len(order)) - (count.cumsum() - count)[slot[order]]
    kept[order[rank >= width]] = False


def _backward(
    stages: Stages,
    states: Sequence[tuple[IntArray, FloatArray]],
    trail: Sequence[_Transitions],
    lost: FloatArray,
) -> Sums:
    """Marginals from the sums over the rest of each hypothesis."""
    log_partition = np.full(len(stages.clusters), -np.inf)
    probability = np.zeros(len(stages.leaf))
    for step, (slot, log_sum) in enumerate(states):
        done = stages.size[slot] == step
        log_partition[slot[done]] = log_sum[done]
    following = np.zeros(len(states[-1][0]))
    for step in range(stages.n_steps - 1, -1, -1):
        slot, log_sum = states[step]
        moves = trail[step]
        onward = moves.log_factor + following[moves.child]
        joint = log_sum[moves.parent] + onward - log_partition[slot[moves.parent]]
        probability += np.bincount(moves.option, np.exp(joint), minlength=len(probability))
        begin = np.diff(moves.parent, prepend=-1) > 0
        following = np.where(stages.size[slot] == step, 0.0, -np.inf)
        following[moves.parent[begin]] = log_sums(onward, begin.nonzero()[0])
    with np.errstate(over="ignore"):
        share = 1.0 / (1.0 + np.exp(lost - log_partition))
    return Sums(probability, log_partition, share)
