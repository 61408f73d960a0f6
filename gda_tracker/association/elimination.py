"""Order in which a sparse cluster is worked off, so that few of its nodes are open at a time.

A node (track or measurement) is open from its first pair to its last. The dynamic programme of
``frontier.py`` carries one bit per open node, so its cost is exponential in their number, the
width. To find the narrowest order is as hard as the marginals themselves; the best of several
cheap ones is taken, with either side as the one that is served node by node.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from gda_tracker.vocabulary.arrays import IntArray

OPEN, PAIR, CLOSE = range(3)

OPERATIONS_PER_ENTRY = 2.0 / 3.0
OPERATIONS_PER_ACTION = 2000.0
"""Cost of an action, by table entry and for its calls, in operations of the subset engine."""

MAX_OPERATIONS = 2.0**30
"""No order is looked for beyond, whatever the cost allowed."""


@dataclass(frozen=True, slots=True)
class Elimination:
    """How to work off a cluster of ``steps`` and ``elements``.

    ``actions`` are (kind, number, bit, other bit): open node ``number`` as highest bit; join pair
    ``number``, whose step and element stand at the two bits; close node ``number`` at ``bit``.
    Nodes are the steps, then the elements. ``width`` is the largest number of open nodes,
    ``operations`` what the tables cost in units of :func:`subsets.operations`, ``memory`` the
    number of table entries kept from the forward pass.
    """

    actions: tuple[tuple[int, int, int, int], ...]
    width: int
    operations: float
    memory: int

    @property
    def cost(self) -> float:
        """``operations``, and what the calls cost however small the tables are."""
        return self.operations + OPERATIONS_PER_ACTION * len(self.actions)


def find_elimination(
    step: IntArray, element: IntArray, steps: int, elements: int, max_operations: float
) -> Elimination | None:
    """Cheapest order found for a cluster, or ``None`` if each costs more than ``max_operations``.

    Parameters
    ----------
    step, element : (P,)
        Rows and columns of the pairs.
    steps, elements : int
        Number of rows and columns; those without a pair are opened and closed at once.
    max_operations : float
        In units of :func:`subsets.operations`.
    """
    max_operations = min(max_operations, MAX_OPERATIONS)
    # When the first node closes, all its partners are open.
    partners = np.concatenate([np.bincount(step, minlength=1), np.bincount(element, minlength=1)])
    if OPERATIONS_PER_ENTRY * 2.0 ** min(partners.min(), 1000) > max_operations:
        return None
    best: tuple[float, bool, list[int]] | None = None
    for turned in (False, True):
        sides = (element, step, elements, steps) if turned else (step, element, steps, elements)
        for order in _orders(*sides, max_operations):
            cost = _estimated_operations(order, *sides)
            if best is None or cost < best[0]:
                best = cost, turned, order
            if cost <= OPERATIONS_PER_ACTION * len(step):
                # The calls cost more than the tables: a narrower order saves little.
                return _compiled(order, turned, step, element, steps, elements, max_operations)
    if best is None:
        return None
    _, turned, order = best
    return _compiled(order, turned, step, element, steps, elements, max_operations)


def _orders(
    row: IntArray, column: IntArray, rows: int, columns: int, max_operations: float
) -> Iterator[list[int]]:
    """Orders of the rows: greedy from both ends of the cluster, and reverse Cuthill-McKee."""
    by_row, by_column = [0] * rows, [0] * columns
    for i, j in zip(row.tolist(), column.tolist(), strict=True):
        by_row[i] |= 1 << j
        by_column[j] |= 1 << i
    width = 2 + int(max_operations).bit_length()
    far = _farthest(by_row, by_column, 0)
    for start in dict.fromkeys((_farthest(by_row, by_column, far), far)):
        order = _greedy(by_row, by_column, start, width)
        if order is not None:
            yield order
    ones = np.ones(2 * len(row), dtype=np.int8)
    place = np.concatenate([row, column + rows]), np.concatenate([column + rows, row])
    graph = coo_array((ones, place), shape=(rows + columns,) * 2).tocsr()
    nodes = reverse_cuthill_mckee(graph, symmetric_mode=True)
    yield nodes[nodes < rows].tolist()


def _bits(mask: int) -> Iterator[int]:
    while mask:
        lowest = mask & -mask
        yield lowest.bit_length() - 1
        mask ^= lowest


def _farthest(by_row: list[int], by_column: list[int], start: int) -> int:
    """A row of fewest pairs among those farthest from ``start``."""
    level, seen = [start], 1 << start
    while True:
        near = 0
        for i in level:
            for j in _bits(by_row[i]):
                near |= by_column[j]
        near &= ~seen
        if not near:
            return min(level, key=lambda i: by_row[i].bit_count())
        seen |= near
        level = list(_bits(near))


def _greedy(by_row: list[int], by_column: list[int], start: int, width: int) -> list[int] | None:
    """Order that leaves the fewest columns open after every row; rows in reach longest come first.

    ``None`` as soon as more than ``width`` columns are open.
    """
    missing = [mask.bit_count() for mask in by_column]
    last = sum(1 << j for j, count in enumerate(missing) if count == 1)
    left = dict.fromkeys(range(len(by_row)))
    reach: dict[int, None] = {}
    seen = done = 0
    order: list[int] = []
    current = start
    while True:
        order.append(current)
        del left[current]
        reach.pop(current, None)
        for j in _bits(by_row[current]):
            missing[j] -= 1
            if missing[j] == 1:
                last |= 1 << j
            elif missing[j] == 0:
                last &= ~(1 << j)
                done |= 1 << j
            if not seen >> j & 1:
                reach.update((i, None) for i in _bits(by_column[j]) if i in left)
        seen |= by_row[current]
        if (seen & ~done).bit_count() > width:
            return None
        if not left:
            return order
        fresh, closing = ~seen, last
        current = min(
            reach or left,
            key=lambda i: (by_row[i] & fresh).bit_count() - (by_row[i] & closing).bit_count(),
        )


def _estimated_operations(
    order: list[int], row: IntArray, column: IntArray, rows: int, columns: int
) -> float:
    """Table entries of serving the rows in this order, without working it out pair by pair."""
    place = np.empty(rows, dtype=np.intp)
    place[order] = np.arange(rows)
    time = place[row]
    first, last = np.full(columns, rows), np.full(columns, -1)
    np.minimum.at(first, column, time)
    np.maximum.at(last, column, time)
    lasting = last > first
    opened = np.bincount(first[lasting], minlength=rows)
    closed = np.bincount(last[lasting], minlength=rows)
    after = (opened - closed).cumsum()
    width = np.maximum(after, after - opened + closed) + 1.0
    degree = np.bincount(time, minlength=rows)
    return OPERATIONS_PER_ENTRY * float((degree * np.exp2(width)).sum())


def _compiled(
    order: list[int],
    turned: bool,
    step: IntArray,
    element: IntArray,
    steps: int,
    elements: int,
    max_operations: float,
) -> Elimination | None:
    """Actions for an order of the steps, or of the elements if ``turned``.

    A node's pairs come in the order: those that close the other node, those that leave it open,
    those that open it. So the table is narrow before it widens. ``None`` if it costs more than
    ``max_operations``.
    """
    served, other = (element, step) if turned else (step, element)
    served_first, other_first = (steps, 0) if turned else (0, steps)
    rows, columns = (elements, steps) if turned else (steps, elements)
    pairs: list[list[tuple[int, int]]] = [[] for _ in range(rows)]
    for number, (i, j) in enumerate(zip(served.tolist(), other.tolist(), strict=True)):
        pairs[i].append((number, j))
    missing = np.bincount(other, minlength=columns).tolist()
    actions: list[tuple[int, int, int, int]] = []
    frontier: list[int] = []
    width = memory = 0
    entries = 0

    def act(kind: int, number: int, bit: int, second: int = 0) -> None:
        nonlocal entries
        actions.append((kind, number, bit, second))
        entries += 1 << len(frontier)

    def close(node: int) -> None:
        bit = frontier.index(node)
        act(CLOSE, node, bit)
        del frontier[bit]

    for j in (j for j in range(columns) if missing[j] == 0):
        frontier.append(other_first + j)
        act(OPEN, other_first + j, 0)
        close(other_first + j)
    for i in order:
        row = served_first + i
        frontier.append(row)
        act(OPEN, row, len(frontier) - 1)

        def rank(pair: tuple[int, int]) -> int:
            return (0 if missing[pair[1]] == 1 else 2) + (other_first + pair[1] not in frontier)

        for number, j in sorted(pairs[i], key=rank):
            column = other_first + j
            if column not in frontier:
                frontier.append(column)
                act(OPEN, column, len(frontier) - 1)
            width = max(width, len(frontier))
            act(PAIR, number, frontier.index(row), frontier.index(column))
            memory += 1 << (len(frontier) - 2)
            missing[j] -= 1
            if missing[j] == 0:
                close(column)
        close(row)
        if entries * OPERATIONS_PER_ENTRY > max_operations:
            return None
    return Elimination(tuple(actions), width, entries * OPERATIONS_PER_ENTRY, memory)
