"""Assignment: one detection per hypothesis at most, by the chapter's matrix or by the joint weight.

Hypotheses are taken as different tracks here.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from gda_tracker.association.best_hypothesis import best_hypothesis
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray

LOG_VANISHING = -1e6
"""Log weight that stands for an idle weight of zero where no hypothesis can do without it."""


def choose_most_probable(
    log_weight: FloatArray, log_idle_step: FloatArray, log_idle_element: FloatArray, sizes: IntArray
) -> BoolArray:
    """Pairs of the most probable joint hypothesis of each of B clusters: decision ``map``.

    Idle weights of zero (P_d = 1, clutter density 0) are taken as the limit of vanishing ones, so
    that there is an answer also where every hypothesis has weight zero.

    Parameters
    ----------
    log_weight : (B, S, K), -inf outside the gate
    log_idle_step : (B, S)
    log_idle_element : (B, K)
    sizes : (B,)
        Smaller side of each cluster, without padding.

    Returns
    -------
    (B, S, K) True for the chosen pairs.
    """
    chosen = np.zeros(log_weight.shape, dtype=np.bool_)
    idle_step = np.maximum(log_idle_step, LOG_VANISHING)
    idle_element = np.maximum(log_idle_element, LOG_VANISHING)
    single = sizes == 1
    if single.any():
        gain = log_weight[single] - idle_step[single, :, None] - idle_element[single, None]
        chosen[single] = _largest(gain) & (gain >= 0.0)
    for slot in (~single).nonzero()[0]:
        best = best_hypothesis(log_weight[slot], idle_step[slot], idle_element[slot])
        if best is None:
            raise ValueError("a cluster with finite idle weights has no feasible hypothesis")
        served = (best >= 0).nonzero()[0]
        chosen[slot, served, best[served]] = True
    return chosen


def choose_by_probability(p_generalised: FloatArray, sizes: IntArray) -> BoolArray:
    """Pairs of the assignment that minimises the sum of 1 - P_gen: decision ``gda``.

    (Tchamova et al. 2004, 14.4) In each of B clusters as many pairs inside the gate as possible;
    among those the smallest sum. Pairs that the rectangular solution has to place outside are
    dropped.

    Parameters
    ----------
    p_generalised : (B, S, K)
        P_gen = P_k P_a; -(K + 1) outside the gate.
    sizes : (B,)
        Smaller side of each cluster, without padding.

    Returns
    -------
    (B, S, K) True for the chosen pairs.
    """
    # A solution has K entries, q of them inside. Its sum of 1 - P_gen, with L for entries outside,
    # is K - sum(P_gen) + (K - q)(L - 1): the largest sum of P_gen with -(L - 1) outside is the
    # same, and tiny probabilities are not lost beside the 1. L - 1 > K makes q come first.
    chosen = np.zeros(p_generalised.shape, dtype=np.bool_)
    single = sizes == 1
    if single.any():
        chosen[single] = _largest(p_generalised[single])
    for slot in (~single).nonzero()[0]:
        row, column = linear_sum_assignment(p_generalised[slot], maximize=True)
        chosen[slot, row, column] = True
    return chosen & (p_generalised >= 0.0)


def _largest(values: FloatArray) -> BoolArray:
    """Mark the first largest entry of each (S, K) matrix of a stack."""
    flat = values.reshape(len(values), -1)
    marked = np.zeros(flat.shape, dtype=np.bool_)
    marked[np.arange(len(flat)), flat.argmax(axis=1)] = True
    return marked.reshape(values.shape)
