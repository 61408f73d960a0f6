"""Draws how a sensor's measurements join the objects of the others, exactly.

A subset dynamic programme over the measurements: f_i(S) sums the weights of all ways in which the
first i objects take the measurements S, and backward sampling draws one of them. How many are left
for new objects is weighted at the end, so any prior on the number of objects is exact.
"""

from __future__ import annotations

import numpy as np

from gda_tracker.vocabulary.arrays import FloatArray, IntArray

MAX_MEASUREMENTS = 12


def draw_matching(
    log_weight: FloatArray, log_matched: FloatArray, rng: np.random.Generator
) -> IntArray:
    """Draw partners (m,) of m measurements among n objects, -1 for none.

    The probability is proportional to the product of exp(``log_weight``) over the pairs times
    exp(``log_matched``) of the number of pairs.

    Parameters
    ----------
    log_weight : (n, m)
    log_matched : (m + 1,)

    Raises
    ------
    ValueError
        If there are more than ``MAX_MEASUREMENTS`` measurements.
    """
    n, m = log_weight.shape
    if m > MAX_MEASUREMENTS:
        raise ValueError(f"m = {m}: allowed are 0 to {MAX_MEASUREMENTS} measurements")
    subsets = np.arange(1 << m)
    bits = 1 << np.arange(m)
    member = (subsets[:, None] & bits) > 0
    without = subsets[:, None] & ~bits
    inside = [member[:, j].nonzero()[0] for j in range(m)]
    # table[i] is log f_i.
    table = np.full((n + 1, 1 << m), -np.inf)
    table[0, 0] = 0.0
    for i in range(n):
        possible = np.isfinite(log_weight[i]).nonzero()[0]
        table[i + 1] = table[i]
        for j in possible.tolist():
            joined = table[i][without[inside[j], j]] + log_weight[i, j]
            table[i + 1][inside[j]] = np.logaddexp(table[i + 1][inside[j]], joined)
    final = table[n] + log_matched[member.sum(axis=1)]
    state = _draw(final, rng)
    partner = np.full(m, -1)
    for i in range(n - 1, -1, -1):
        if state == 0:
            break
        held = member[state].nonzero()[0]
        ways = np.append(table[i][without[state, held]] + log_weight[i, held], table[i][state])
        chosen = _draw(ways, rng)
        if chosen < len(held):
            partner[held[chosen]] = i
            state = int(without[state, held[chosen]])
    return partner


def draw_conditional_bernoulli(
    log_odds: FloatArray, log_number: FloatArray, rng: np.random.Generator
) -> IntArray:
    """Draw flags (n,) with probability ~ product of odds of those set, times a factor of how many.

    Parameters
    ----------
    log_odds : (n,)
    log_number : (n + 1,)
    """
    n = len(log_odds)
    table = np.full((n + 1, n + 1), -np.inf)
    table[0, 0] = 0.0
    for i in range(n):
        table[i + 1] = table[i]
        table[i + 1, 1:] = np.logaddexp(table[i, 1:], table[i, :-1] + log_odds[i])
    left = _draw(table[n] + log_number, rng)
    flags = np.zeros(n, dtype=np.int64)
    for i in range(n - 1, -1, -1):
        if left == 0:
            break
        taken = table[i, left - 1] + log_odds[i]
        if np.log(rng.random()) < taken - table[i + 1, left]:
            flags[i] = 1
            left -= 1
    return flags


def _draw(log_weight: FloatArray, rng: np.random.Generator) -> int:
    share = np.cumsum(np.exp(log_weight - log_weight.max()))
    return int(np.searchsorted(share, rng.random() * share[-1], side="right"))
