"""Sums over all joint hypotheses of a sparse cluster by dynamic programming over its open nodes.

The pairs are worked off in an order in which few nodes are open at a time (``elimination.py``).
f(S) is the summed weight of all ways so far that have used exactly the open nodes S: a pair (i, j)
adds w_ij f(S) to f(S with i and j) for every S without both, and closing a node adds its idle
weight times f(S) to f(S with it) and forgets it. b(S) sums the ways to go on, backwards. A pair has
weight w_ij sum over S of f(S) b(S with i and j). Nothing is divided or subtracted, so weights of
zero are exact. In a chain of gates the cost grows linearly with its length.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gda_tracker.association.elimination import CLOSE, OPEN, PAIR, Elimination
from gda_tracker.association.scaling import scale_by_duals
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray

ACTIONS_PER_SCALING = 128
"""With factors up to 1 every action at most doubles the largest entry of a table."""


class FrontierProbabilities(NamedTuple):
    """Marginals (Q, P), log partition (Q,) and whether any hypothesis has weight (Q,).

    Where none has, the marginals are zero and the log partition is -inf.
    """

    marginals: FloatArray
    log_partition: FloatArray
    feasible: BoolArray


def frontier_marginals(
    elimination: Elimination,
    step: IntArray,
    element: IntArray,
    bordered: FloatArray,
    least_assigned: int = 0,
) -> FrontierProbabilities:
    """Marginals of the pairs of one cluster, under Q weightings.

    Parameters
    ----------
    elimination : Elimination
        For the pairs ``step``, ``element``.
    step, element : (P,)
        Rows and columns of the pairs.
    bordered : (Q, S + 1, K + 1)
        Log weights as for :func:`joint.bordered_marginals`; overwritten. They are -inf for what
        is not among the pairs.
    least_assigned : int
        Only hypotheses with at least so many pairs count.
    """
    steps, elements = bordered.shape[1] - 1, bordered.shape[2] - 1
    smaller = min(steps, elements)
    of_steps = steps <= elements
    counted = np.zeros(steps + elements, dtype=np.bool_)
    if least_assigned == smaller:
        # Nothing may be idle on the smaller side; known beforehand, scaling takes it into account.
        smaller_side = bordered[:, :-1, -1] if of_steps else bordered[:, -1, :-1]
        smaller_side[:] = -np.inf
    elif least_assigned > 1:
        # At least L pairs: at most ``smaller`` - L idle nodes on the smaller side.
        counted[:steps], counted[steps:] = of_steps, not of_steps
    taken, feasible = scale_by_duals(bordered)
    feasible &= least_assigned <= smaller
    np.exp(bordered, out=bordered)
    pair = np.ascontiguousarray(bordered[:, step, element].T)
    idle = np.concatenate([bordered[:, :-1, -1], bordered[:, -1, :-1]], axis=1).T.copy()
    layers = layers_of(least_assigned, smaller)
    sums, total, exponent = _sweep(elimination, pair, idle, layers, counted, least_assigned == 1)
    feasible &= total > 0.0
    total = np.where(feasible, total, 1.0)
    with np.errstate(divide="ignore"):
        log_partition = np.where(feasible, np.log(total) + exponent * np.log(2.0) + taken, -np.inf)
    marginals: FloatArray = np.where(feasible, sums / total, 0.0).T
    return FrontierProbabilities(marginals, log_partition, feasible)


def layers_of(least_assigned: int, smaller: int) -> int:
    """How many times larger the tables are where hypotheses need so many pairs.

    One pair takes no counting: all hypotheses have one but the empty hypothesis.
    """
    return smaller - least_assigned + 1 if 1 < least_assigned < smaller else 1


def _sweep(
    elimination: Elimination,
    pair: FloatArray,
    idle: FloatArray,
    layers: int,
    counted: BoolArray,
    without_empty: bool,
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Forward and backward pass over tables (2^width, layers, Q).

    Parameters
    ----------
    pair : (P, Q)
    idle : (N, Q)
        Idle weights of the nodes.
    layers : int
    counted : (N,)
        The second axis of the tables is the number of idle nodes among the counted ones;
        hypotheses with ``layers`` of them or more weigh nothing.
    without_empty : bool
        Leave the hypothesis without pairs out of the total.

    Returns
    -------
    sums : (P, Q)
        Summed weight of the hypotheses that hold each pair, over 2^exponent.
    total : (Q,)
        Summed weight of all hypotheses, over 2^exponent.
    exponent : (Q,)
    """
    forward = _forward(elimination, pair, idle, layers, counted)
    pairs, weightings = pair.shape
    sums = np.zeros((pairs, weightings))
    first = np.zeros((pairs, weightings))
    scaling = _Scaling(weightings)
    table = np.ones((1, layers, weightings))
    for turn, (kind, number, bit, other) in enumerate(reversed(elimination.actions)):
        if kind == PAIR:
            neither, both = _quarters(table, bit, other)
            np.einsum("hmlcq,hmlcq->q", forward.kept[number], both, out=sums[number])
            if without_empty:
                first[number] = table[(1 << bit) + (1 << other), 0]
            neither += pair[number] * both
        elif kind == OPEN:
            table = table[: len(table) >> 1]
        else:
            after = table.reshape(-1, 1 << bit, *table.shape[1:])
            table = np.empty((len(after), 2, *after.shape[1:]))
            table[:, 1] = after
            if counted[number]:
                table[:, 0, :, -1] = 0.0
                np.multiply(idle[number], after[..., 1:, :], out=table[:, 0, :, :-1])
            else:
                np.multiply(idle[number], after, out=table[:, 0])
            table = table.reshape(-1, *after.shape[2:])
        scaling.watch(turn, table)

    turns = forward.turn_of_pair
    ahead = scaling.exponents(len(elimination.actions) - 1 - turns)
    sums = np.ldexp(sums, forward.scaling.exponents(turns) + ahead - forward.exponent)
    total = forward.total
    if without_empty:
        # Every other hypothesis has a first pair; before it, all that is closed is idle.
        log_idle = np.zeros((len(elimination.actions) + 1, weightings))
        with np.errstate(divide="ignore"):
            for turn, (kind, number, _, _) in enumerate(elimination.actions):
                log_idle[turn + 1] = log_idle[turn] + (np.log(idle[number]) if kind == CLOSE else 0)
        shift = np.exp(log_idle[turns] + np.log(2.0) * (ahead - forward.exponent))
        total = (pair * first * shift).sum(axis=0)
    return sums, total, forward.exponent


class _Forward(NamedTuple):
    """What the forward pass leaves.

    ``kept`` are, for each pair, its weight times the entries that hold neither of its nodes when
    its turn comes;
    ``turn_of_pair`` (P,) is that turn. ``total`` (Q,) is the summed weight of all hypotheses over
    2^``exponent``.
    """

    kept: list[FloatArray]
    turn_of_pair: IntArray
    scaling: _Scaling
    total: FloatArray
    exponent: IntArray


def _forward(
    elimination: Elimination, pair: FloatArray, idle: FloatArray, layers: int, counted: BoolArray
) -> _Forward:
    pairs, weightings = pair.shape
    kept: list[FloatArray] = [pair] * pairs
    turn_of_pair = np.zeros(pairs, dtype=np.int64)
    scaling = _Scaling(weightings)
    table = np.zeros((1, layers, weightings))
    table[0, 0] = 1.0
    for turn, (kind, number, bit, other) in enumerate(elimination.actions):
        if kind == PAIR:
            neither, both = _quarters(table, bit, other)
            kept[number] = pair[number] * neither
            turn_of_pair[number] = turn
            both += kept[number]
        elif kind == OPEN:
            opened = np.zeros((2 * len(table), layers, weightings))
            opened[: len(table)] = table
            table = opened
        else:
            split = table.reshape(-1, 2, 1 << bit, layers, weightings)
            if counted[number]:
                table = split[:, 1].copy()
                table[..., 1:, :] += idle[number] * split[:, 0, :, :-1]
            else:
                table = idle[number] * split[:, 0]
                table += split[:, 1]
            table = table.reshape(-1, layers, weightings)
        scaling.watch(turn, table)
    return _Forward(kept, turn_of_pair, scaling, table.sum(axis=(0, 1)), scaling.exponent)


class _Scaling:
    """Keeps a table within the range of doubles, by powers of two, and remembers them."""

    def __init__(self, weightings: int) -> None:
        self._after = [np.zeros(weightings, dtype=np.int64)]

    @property
    def exponent(self) -> IntArray:
        """Exponent (Q,) taken out so far."""
        return self._after[-1]

    def watch(self, turn: int, table: FloatArray) -> None:
        """Scale the table (..., Q) in place, every so often."""
        if turn % ACTIONS_PER_SCALING == ACTIONS_PER_SCALING - 1:
            _, exponent = np.frexp(table.reshape(-1, table.shape[-1]).max(axis=0))
            np.ldexp(table, -exponent, out=table)
            self._after.append(self._after[-1] + exponent)

    def exponents(self, turns: IntArray) -> IntArray:
        """Exponents (P, Q) taken out before the given turns (P,)."""
        found: IntArray = np.array(self._after)[turns // ACTIONS_PER_SCALING]
        return found


def _quarters(table: FloatArray, one: int, other: int) -> tuple[FloatArray, FloatArray]:
    """Views of the entries without both, and with both, of two open nodes."""
    low, high = min(one, other), max(one, other)
    split = table.reshape(
        len(table) >> (high + 1), 2, 1 << (high - low - 1), 2, 1 << low, *table.shape[1:]
    )
    return split[:, 0, :, 0], split[:, 1, :, 1]
