"""Which leaves of a step fit partial choices: pairs that share no detection, in either form."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from gda_tracker.association.leaves.stages import Stages, WordArray, ragged_range
from gda_tracker.vocabulary.arrays import IntArray

DENSE = 4096
"""Pairs of one cluster from which on they are compared as a matrix: no index for each pair."""


def fitting_leaves(
    stages: Stages, step: int, slot: IntArray, mask: WordArray
) -> tuple[IntArray, IntArray]:
    """Pairs of a partial choice and a leaf of the next step of its cluster that uses none of its.

    Parameters
    ----------
    stages : Stages
    step : int
    slot, mask : (R,), (W, R)
        Cluster, ascending, and open detections used of R partial choices. Clusters of no more
        tracks than ``step`` have no next leaf.

    Returns
    -------
    parent, option : (P,)
        Rows of the partial choices and leaves, by row, then by leaf.
    """
    rows = (stages.size[slot] > step).nonzero()[0]
    slots = slot[rows]
    count = stages.count[step, slots]
    if int(count.sum()) < DENSE:
        return _one_by_one(stages, step, slots, mask, rows)
    new = np.ones(len(rows), dtype=np.bool_)
    new[1:] = slots[1:] != slots[:-1]
    begins = np.append(new.nonzero()[0], len(rows))
    large = (np.diff(begins) * count[begins[:-1]] >= DENSE).nonzero()[0]
    # Between the large ones all are compared at once.
    parts = []
    cuts = np.unique(np.concatenate([[0, len(rows)], begins[large], begins[large + 1]]))
    is_large = np.isin(cuts, begins[large])
    for (begin, end), dense in zip(pairwise(cuts.tolist()), is_large.tolist(), strict=False):
        compare = _as_matrix if dense else _one_by_one
        parts.append(compare(stages, step, slots[begin:end], mask, rows[begin:end]))
    if len(parts) == 1:
        return parts[0]
    none = np.zeros(0, dtype=np.int64)
    parent, option = zip(*parts, strict=True) if parts else ((none,), (none,))
    return np.concatenate(parent), np.concatenate(option)


def _as_matrix(
    stages: Stages, step: int, slot: IntArray, mask: WordArray, rows: IntArray
) -> tuple[IntArray, IntArray]:
    """Pairs of rows of one cluster."""
    first = int(stages.first[step, slot[0]])
    leaves = slice(first, first + int(stages.count[step, slot[0]]))
    begin, end = int(rows[0]), int(rows[-1]) + 1  # rows of a cluster stand together
    clash = mask[0, begin:end, None] & stages.mask[0, leaves]
    for word, leaf_word in zip(mask[1:], stages.mask[1:], strict=True):
        clash |= word[begin:end, None] & leaf_word[leaves]
    row, leaf = (clash == 0).nonzero()
    return row + begin, leaf + first


def _one_by_one(
    stages: Stages, step: int, slot: IntArray, mask: WordArray, rows: IntArray
) -> tuple[IntArray, IntArray]:
    """Pairs of rows of any clusters."""
    count = stages.count[step, slot]
    parent = np.repeat(rows, count)
    option = np.repeat(stages.first[step, slot], count) + ragged_range(count)
    clash = np.zeros(len(parent), dtype=np.uint64)
    for word, leaf_word in zip(mask, stages.mask, strict=True):
        clash |= word[parent] & leaf_word[option]
    fits = (clash == 0).nonzero()[0]
    return parent[fits], option[fits]
