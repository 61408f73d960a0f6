"""Which engine computes the joint probabilities of a cluster, by estimated cost."""

from __future__ import annotations

from collections.abc import Sequence

from gda_tracker.association import subsets
from gda_tracker.association.choices import (
    FRONTIER_DYNAMIC_PROGRAMMING,
    LOOPY_BELIEF_PROPAGATION,
    SUBSET_DYNAMIC_PROGRAMMING,
)
from gda_tracker.association.elimination import Elimination, find_elimination
from gda_tracker.association.frontier import layers_of
from gda_tracker.vocabulary.arrays import IntArray

OPERATIONS_WORTH_AN_ORDER = 150_000.0
"""Below this, subsets are done before an order is found: about a dense cluster of 10 x 10."""

DENSE = 0.5
"""Share of gated pairs from which on no order beats subsets."""

MAX_KEPT_ENTRIES = 1 << 25
"""Doubles the frontier engine may keep from its forward pass: 256 MB."""


def always_subsets(steps: int, elements: int, max_exact_size: int) -> bool:
    """Whether clusters of this shape need no :func:`choose_engine`: subsets are cheap."""
    return (
        elements <= max_exact_size
        and subsets.operations(steps, elements) <= OPERATIONS_WORTH_AN_ORDER
    )


def choose_engine(
    step: IntArray,
    element: IntArray,
    steps: int,
    elements: int,
    max_exact_size: int,
    least_assigned: Sequence[int] = (0,),
) -> tuple[str, Elimination | None]:
    """Name of the engine for one cluster, and the order for the frontier engine.

    Exact if the smaller side is at most ``max_exact_size``, or if an order is found whose tables
    cost no more than those of a dense cluster of that size; then the cheaper exact engine.

    Parameters
    ----------
    step, element : (P,)
        Rows and columns of the pairs.
    steps, elements : int
        Larger and smaller side of the cluster.
    max_exact_size : int
    least_assigned : sequence of int
        Bounds on the number of pairs, of all weightings: to count pairs takes larger tables.
    """
    by_subsets = subsets.operations(steps, elements)
    layers = max(layers_of(bound, elements) for bound in least_assigned)
    allowed = subsets.operations(max_exact_size, max_exact_size)
    if elements <= max_exact_size:
        dense = len(step) >= DENSE * steps * elements
        if dense or by_subsets <= OPERATIONS_WORTH_AN_ORDER:
            return SUBSET_DYNAMIC_PROGRAMMING, None
        allowed = by_subsets
    order = find_elimination(step, element, steps, elements, allowed / layers)
    if order is not None and layers * order.memory > MAX_KEPT_ENTRIES:
        order = None
    if elements <= max_exact_size and (order is None or layers * order.cost >= by_subsets):
        return SUBSET_DYNAMIC_PROGRAMMING, None
    if order is None:
        return LOOPY_BELIEF_PROPAGATION, None
    return FRONTIER_DYNAMIC_PROGRAMMING, order
