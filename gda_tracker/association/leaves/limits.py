"""How far the search for global hypotheses may go before its answer is given as unproven."""

from __future__ import annotations

from dataclasses import dataclass

INDEPENDENT = "independent"
DYNAMIC_PROGRAMMING = "dynamic_programming"
PRICED_DYNAMIC_PROGRAMMING = "priced_dynamic_programming"
INTEGER_PROGRAMMING = "integer_programming"
ENGINES = (
    INDEPENDENT,
    DYNAMIC_PROGRAMMING,
    PRICED_DYNAMIC_PROGRAMMING,
    INTEGER_PROGRAMMING,
)
"""Engines that answer a cluster, in the order in which they are tried."""


LEAST = {
    "first_width": 1,
    "second_width": 1,
    "width": 1,
    "price_rounds": 0,
    "nodes": 0,
    "transitions": 1,
}
"""Least value of each limit."""


@dataclass(frozen=True, slots=True)
class SearchLimits:
    """Limits of work, never of time: the same input gives the same answer.

    ``first_width`` and ``second_width`` are the beams of the first attempts (partial choices kept
    of each cluster), ``width`` that of the last one, which has prices on the detections;
    ``price_rounds`` are the rounds to find those prices; ``nodes`` the branch-and-bound nodes of
    the last resort, 0 to go without. ``transitions`` bounds states times leaves of a track in sums
    over all hypotheses.
    """

    first_width: int = 64
    second_width: int = 512
    width: int = 4096
    price_rounds: int = 120
    nodes: int = 2000
    transitions: int = 500_000

    def __post_init__(self) -> None:
        for name, least in LEAST.items():
            value = getattr(self, name)
            if value < least:
                raise ValueError(f"{name} = {value}: allowed are integers >= {least}")
