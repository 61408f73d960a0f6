"""What the remaining tracks can add at most to a partial choice: a bound that sees conflicts."""

from __future__ import annotations

import numpy as np

from gda_tracker.association.leaves.stages import Stages, WordArray
from gda_tracker.vocabulary.arrays import FloatArray, IntArray


def last_affected(stages: Stages) -> list[int]:
    """Last step (K,) with a leaf that uses a detection which is open after each step."""
    shape = stages.first.shape
    used = np.zeros((len(stages.mask), *shape), dtype=np.uint64)
    some = stages.count > 0
    if some.any():
        used[:, some] = np.bitwise_or.reduceat(stages.mask, stages.first[some], axis=1)
    found = []
    for step in range(shape[0]):
        shared = (used & stages.open_after[:, step : step + 1]) != 0
        later = shared.any(axis=(0, 2)).nonzero()[0]
        found.append(max(later.tolist(), default=step))
    return found


def outlook(
    stages: Stages, gain: FloatArray, step: int, last: int, slot: IntArray, mask: WordArray
) -> FloatArray:
    """Sum over the steps after ``step``, up to ``last``, of the gain of the first leaf that fits.

    Parameters
    ----------
    stages : Stages
    gain : (O,)
        Falls within the leaves of a step and cluster, so that the first leaf that fits has the
        largest gain.
    step, last : int
    slot, mask : (R,), (W, R)
        Cluster and open detections used of R partial choices.

    Returns
    -------
    (R,) -inf where a track has no leaf that fits.
    """
    total = np.zeros(len(slot))
    for later in range(step + 1, last + 1):
        rows = ((stages.size[slot] > later) & (total > -np.inf)).nonzero()[0]
        option = stages.first[later, slot[rows]]
        end = option + stages.count[later, slot[rows]]
        while len(rows):
            out = option == end
            total[rows[out]] = -np.inf
            inside = ~out
            rows, option, end = rows[inside], option[inside], end[inside]
            clash = np.zeros(len(rows), dtype=np.uint64)
            for word, leaf_word in zip(mask, stages.mask, strict=True):
                clash |= word[rows] & leaf_word[option]
            fits = clash == 0
            total[rows[fits]] += gain[option[fits]]
            rest = ~fits
            rows, option, end = rows[rest], option[rest] + 1, end[rest]
    return total
