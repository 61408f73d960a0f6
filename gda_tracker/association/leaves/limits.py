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


@dataclass(frozen=True, slots=True)
class SearchLimits:
    """Limits of work, never of time: the same input gives the same answer.

    ``first_width`` is the beam of the first attempt (partial choices kept of each cluster),
    ``width`` that of the second, which has prices on the detections; ``price_rounds`` the rounds
    to find those; ``nodes`` the branch-and-bound nodes of the last resort, 0 to go without.
    """

    first_width: int = 64
    width: int = 4096
    price_rounds: int = 120
    nodes: int = 2000

    def __post_init__(self) -> None:
        for name, least in (("first_width", 1), ("width", 1), ("price_rounds", 0), ("nodes", 0)):
            value = getattr(self, name)
            if value < least:
                raise ValueError(f"{name} = {value}: allowed are integers >= {least}")
