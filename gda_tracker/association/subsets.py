"""Sums over all joint hypotheses of a cluster by dynamic programming over subsets.

A cluster has ``steps`` (the larger side: tracks or measurements) and ``elements`` (the smaller
side). After step i, f_i(S) is the sum of the weights of all ways to serve steps 1 to i that use
exactly the elements S: f_i(S) = r_i f_{i-1}(S) + sum over j in S of w_ij f_{i-1}(S without j).
b_i(S) is the sum over the ways to go on: b_{i-1}(S) = r_i b_i(S) + sum over j not in S of w_ij
b_i(S with j). A pair has weight w_ij sum over S of f_{i-1}(S) b_i(S with j). Nothing is divided or
subtracted, so weights of zero are exact.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from gda_tracker.vocabulary.arrays import FloatArray, IntArray

MAX_TABLE_ELEMENTS = 12
"""Up to here subsets are visited by index tables; beyond, bit by bit, without tables."""


def terminal_weights(idle: FloatArray, least_assigned: IntArray | None) -> FloatArray:
    """Weight (B, 2^elements) of ending with the subset used: product of the other idle weights.

    Parameters
    ----------
    idle : (B, elements + 1)
        Weight of an element that stays unused; the last column must be 1.
    least_assigned : (B,) or None
        Hypotheses with fewer pairs than this weigh nothing.
    """
    elements = idle.shape[1] - 1
    if elements <= MAX_TABLE_ELEMENTS:
        terminal = idle.take(_unused(elements), axis=1, mode="clip").prod(axis=2)
    else:
        terminal = np.ones((len(idle), 1 << elements))
        for j in range(elements):
            half = 1 << j
            terminal[:, half : 2 * half] = terminal[:, :half]
            terminal[:, :half] *= idle[:, j, None]
    if least_assigned is not None:
        terminal *= _sizes(elements) >= least_assigned[:, None]
    return terminal


def sweep(weight: FloatArray, terminal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Weight of every pair, summed over all joint hypotheses that hold it.

    Parameters
    ----------
    weight : (B, steps, elements + 1)
        Weight of each pair; in the last column that of leaving the step idle.
    terminal : (B, 2^elements)
        From :func:`terminal_weights`.

    Returns
    -------
    sums : (B, steps, elements + 1)
        Summed weights, the last column for the idle step.
    total : (B,)
        Summed weight of all hypotheses.
    """
    if weight.shape[2] - 1 <= MAX_TABLE_ELEMENTS:
        return _sweep_by_tables(weight, terminal)
    return _sweep_by_bits(weight, terminal)


def operations(steps: int, elements: int) -> float:
    """Multiplications of :func:`sweep` for one cluster, roughly: the unit of all cost estimates."""
    return float(steps * (elements + 1) * 2**elements)


def memory_elements(steps: int, elements: int) -> int:
    """Doubles that :func:`sweep` needs per cluster, roughly."""
    columns = elements + 2 if elements <= MAX_TABLE_ELEMENTS else 1
    return (steps + 2) * (1 << elements) * columns


@cache
def _sizes(elements: int) -> IntArray:
    """Number of elements in each subset (2^elements,)."""
    sizes = np.zeros(1 << elements, dtype=np.int64)
    for j in range(elements):
        sizes[1 << j : 2 << j] = sizes[: 1 << j] + 1
    sizes.setflags(write=False)
    return sizes


@cache
def _unused(elements: int) -> NDArray[np.intp]:
    """Index table (2^elements, elements): the element if the subset lacks it, else ``elements``."""
    subset = np.arange(1 << elements, dtype=np.intp)[:, None]
    element = np.arange(elements, dtype=np.intp)
    unused = np.where((subset >> element) & 1 == 1, elements, element)
    unused.setflags(write=False)
    return unused


@cache
def _tables(elements: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Index tables (2^elements, elements + 1): the subset without, and with, each element.

    The last column is the subset itself; index 2^elements, a slot that holds zero, marks what
    cannot be.
    """
    subset = np.arange(1 << elements, dtype=np.intp)[:, None]
    bit = np.append(np.left_shift(1, np.arange(elements, dtype=np.intp)), 0)
    holds = (subset & bit) > 0
    without = np.where(holds | (bit == 0), subset ^ bit, 1 << elements)
    joined = np.where(holds, 1 << elements, subset | bit)
    without.setflags(write=False)
    joined.setflags(write=False)
    return without, joined


def _sweep_by_tables(weight: FloatArray, terminal: FloatArray) -> tuple[FloatArray, FloatArray]:
    batch, steps, columns = weight.shape
    size = terminal.shape[1]
    without, joined = _tables(columns - 1)
    factors = weight[..., None]

    # f_0 and the last b are needed at the empty set only: index 0.
    forward = np.zeros((steps, batch, size + 1))
    forward[0, :, 0] = 1.0
    gathered = np.empty((steps, batch, size, columns))
    if steps > 1:
        forward[1][:, joined[0]] = weight[:, 0]
    for i in range(1, steps - 1):
        forward[i].take(without, axis=1, out=gathered[0], mode="clip")
        np.matmul(gathered[0], factors[:, i], out=forward[i + 1, :, :size, None])

    backward = np.zeros((batch, size + 1))
    backward[:, :size] = terminal
    for i in range(steps - 1, 0, -1):
        backward.take(joined, axis=1, out=gathered[i], mode="clip")
        np.matmul(gathered[i], factors[:, i], out=backward[:, :size, None])
    backward.take(joined, axis=1, out=gathered[0], mode="clip")
    sums = np.matmul(forward[:, :, None, :size], gathered)[:, :, 0].swapaxes(0, 1)
    sums = weight * sums
    return sums, sums[:, 0].sum(axis=1)


def _sweep_by_bits(weight: FloatArray, terminal: FloatArray) -> tuple[FloatArray, FloatArray]:
    batch, steps, columns = weight.shape
    elements = columns - 1
    size = terminal.shape[1]

    def halves(values: FloatArray, j: int) -> FloatArray:
        """View (B, rest, 2, rest): subsets without, and with, element j."""
        return values.reshape(batch, size >> (j + 1), 2, 1 << j)

    forward = np.zeros((steps + 1, batch, size))
    forward[0, :, 0] = 1.0
    for i in range(steps - 1):
        np.multiply(forward[i], weight[:, i, -1, None], out=forward[i + 1])
        for j in range(elements):
            grown = weight[:, i, j, None, None] * halves(forward[i], j)[:, :, 0]
            halves(forward[i + 1], j)[:, :, 1] += grown

    backward = terminal
    sums = np.empty_like(weight)
    for i in range(steps - 1, -1, -1):
        previous = backward * weight[:, i, -1, None]
        sums[:, i, -1] = np.einsum("bs,bs->b", forward[i], backward)
        for j in range(elements):
            ahead = halves(backward, j)[:, :, 1]
            sums[:, i, j] = np.einsum("bhl,bhl->b", halves(forward[i], j)[:, :, 0], ahead)
            halves(previous, j)[:, :, 0] += weight[:, i, j, None, None] * ahead
        backward = previous
    return weight * sums, backward[:, 0]
