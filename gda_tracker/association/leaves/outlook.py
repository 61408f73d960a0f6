"""What the remaining tracks can add at most to a partial choice: a bound that sees conflicts."""

from __future__ import annotations

import numpy as np

from gda_tracker.association.leaves.stages import Stages, WordArray
from gda_tracker.vocabulary.arrays import FloatArray, IntArray

FIRST_BLOCK = 8
"""Leaves that are tried at once, then twice as many, and so on: most partial choices need few."""


MANY = 512
"""Partial choices from which on it pays to look at equal ones once."""


def used_bits(stages: Stages) -> WordArray:
    """Detections (W, K, B) that the leaves of each step and cluster use."""
    used = np.zeros((len(stages.mask), *stages.first.shape), dtype=np.uint64)
    some = stages.count > 0
    if some.any():
        used[:, some] = np.bitwise_or.reduceat(stages.mask, stages.first[some], axis=1)
    return used


def last_affected(stages: Stages) -> list[int]:
    """Last step (K,) with a leaf that uses a detection which is open after each step."""
    used = used_bits(stages)
    found = []
    for step in range(stages.n_steps):
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
    used = used_bits(stages)
    total = np.zeros(len(slot))
    for later in range(step + 1, last + 1):
        rows = ((stages.size[slot] > later) & (total > -np.inf)).nonzero()[0]
        slots = slot[rows]
        relevant = mask[:, rows] & used[:, later, slots]
        if len(rows) < MANY:
            total[rows] += _first_that_fits(stages, gain, later, slots, relevant)
            continue
        # What the step's own leaves do not use makes no difference: few states are left.
        order = np.lexsort((*relevant, slots))
        new = np.ones(len(order), dtype=np.bool_)
        new[1:] = slots[order[1:]] != slots[order[:-1]]
        for word in relevant:
            ordered = word[order]
            new[1:] |= ordered[1:] != ordered[:-1]
        first = order[new]
        found = _first_that_fits(stages, gain, later, slots[first], relevant[:, first])
        total[rows[order]] += found[new.cumsum() - 1]
    return total


def _first_that_fits(
    stages: Stages, gain: FloatArray, step: int, slot: IntArray, mask: WordArray
) -> FloatArray:
    """Gain (R,) of the first leaf of a step that fits, -inf if there is none."""
    found = np.full(len(slot), -np.inf)
    rows = np.arange(len(slot))
    option = stages.first[step, slot]
    end = option + stages.count[step, slot]
    block = FIRST_BLOCK
    while len(rows):
        tried = option[:, None] + np.arange(block)
        fits = tried < end[:, None]
        np.minimum(tried, len(gain) - 1, out=tried)
        for word, leaf_word in zip(mask, stages.mask, strict=True):
            fits &= (word[rows, None] & leaf_word[tried]) == 0
        place = fits.argmax(axis=1)
        fitting = fits[np.arange(len(rows)), place]
        found[rows[fitting]] = gain[(option + place)[fitting]]
        option += block
        rest = (~fitting & (option < end)).nonzero()[0]
        rows, option, end = rows[rest], option[rest], end[rest]
        block *= 2
    return found
