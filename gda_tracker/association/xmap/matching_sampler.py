"""Draws how a sensor's measurements join the objects of the others, exactly.

A subset dynamic programme over the measurements: f_i(S) sums the weights of all ways in which the
first i objects take the measurements S, and backward sampling draws one of them. How many are left
for new objects is weighted at the end, so any prior on the number of objects is exact.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray

MAX_MEASUREMENTS = 12

SMALLEST_TOTAL = 1e-150
"""Below this the sum of the scaled weights may have lost what matters: logarithms are used."""


class _Subsets(NamedTuple):
    """Subsets of m things by bit mask: members (2^m, m), the subset without each, its size."""

    member: BoolArray
    without: IntArray
    size: IntArray


@lru_cache(maxsize=MAX_MEASUREMENTS + 1)
def _subsets(m: int) -> _Subsets:
    mask = np.arange(1 << m)[:, None]
    bits = 1 << np.arange(m)
    member = (mask & bits) > 0
    return _Subsets(member, mask & ~bits, member.sum(axis=1))


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
    subsets = _subsets(m)
    # Factors of at most one: what a measurement gains at best goes to the end.
    largest = np.maximum(log_weight.max(axis=0, initial=0.0), 0.0)
    log_final = subsets.member @ largest + log_matched[subsets.size]
    log_final -= log_final.max()
    weight = np.exp(log_weight - largest)
    table = np.zeros((n + 1, 1 << m))
    table[0, 0] = 1.0
    for i in range(n):
        table[i + 1] = table[i] + (table[i][subsets.without] * subsets.member) @ weight[i]
    final = table[n] * np.exp(log_final)
    if final.sum() < SMALLEST_TOTAL:
        return _draw_by_logarithms(log_weight, log_matched, subsets, rng)
    state = _draw(final, rng)
    partner = np.full(m, -1)
    for i in range(n - 1, -1, -1):
        if state == 0:
            break
        held = subsets.member[state].nonzero()[0]
        smaller = subsets.without[state, held]
        ways = table[i][smaller] * weight[i, held]
        if rng.random() * table[i + 1, state] >= table[i, state]:
            chosen = _draw(ways, rng)
            partner[held[chosen]] = i
            state = int(smaller[chosen])
    return partner


def _draw_by_logarithms(
    log_weight: FloatArray, log_matched: FloatArray, subsets: _Subsets, rng: np.random.Generator
) -> IntArray:
    """As ``draw_matching``, for weights that differ by more than doubles do; slower."""
    n, m = log_weight.shape
    inside = [subsets.member[:, j].nonzero()[0] for j in range(m)]
    table = np.full((n + 1, 1 << m), -np.inf)
    table[0, 0] = 0.0
    for i in range(n):
        table[i + 1] = table[i]
        for j in np.isfinite(log_weight[i]).nonzero()[0].tolist():
            joined = table[i][subsets.without[inside[j], j]] + log_weight[i, j]
            table[i + 1][inside[j]] = np.logaddexp(table[i + 1][inside[j]], joined)
    state = _draw_log(table[n] + log_matched[subsets.size], rng)
    partner = np.full(m, -1)
    for i in range(n - 1, -1, -1):
        held = subsets.member[state].nonzero()[0]
        smaller = subsets.without[state, held]
        ways = np.append(table[i][smaller] + log_weight[i, held], table[i][state])
        chosen = _draw_log(ways, rng)
        if chosen < len(held):
            partner[held[chosen]] = i
            state = int(smaller[chosen])
    return partner


def draw_conditional_bernoulli(
    log_odds: FloatArray, log_number: FloatArray, rng: np.random.Generator
) -> BoolArray:
    """Draw flags (n,) with probability ~ product of odds of those set, times a factor of how many.

    Parameters
    ----------
    log_odds : (n,)
    log_number : (n + 1,)
    """
    n = len(log_odds)
    flags = np.zeros(n, dtype=np.bool_)
    if not np.isfinite(log_odds).any():
        return flags
    table = np.full((n + 1, n + 1), -np.inf)
    table[0, 0] = 0.0
    for i in range(n):
        table[i + 1] = table[i]
        table[i + 1, 1:] = np.logaddexp(table[i, 1:], table[i, :-1] + log_odds[i])
    left = _draw_log(table[n] + log_number, rng)
    for i in range(n - 1, -1, -1):
        if left == 0:
            break
        taken = table[i, left - 1] + log_odds[i]
        if np.log(rng.random()) < taken - table[i + 1, left]:
            flags[i] = True
            left -= 1
    return flags


def _draw_log(log_weight: FloatArray, rng: np.random.Generator) -> int:
    return _draw(np.exp(log_weight - log_weight.max()), rng)


def _draw(weight: FloatArray, rng: np.random.Generator) -> int:
    share = weight.cumsum()
    return int(share.searchsorted(rng.random() * share[-1], side="right"))
