"""The desk of the parameters: what they are, what they may be, and changes with their answers."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from gda_tracker.parameters import (
    ParameterError,
    Specification,
    from_mapping,
    specifications,
    to_mapping,
)
from gda_tracker.tracking.ring import STAGE_TABLES

Parameters = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True, slots=True)
class Answer:
    """Whether a change was accepted, and why not.

    ``acts_from_scan`` is the number of the first scan that it acts on, ``None`` where that is not
    known here: a ring that runs elsewhere takes it when it opens its next scan.
    """

    accepted: bool
    reason: str = ""
    acts_from_scan: int | None = None


class Desk(Protocol):
    """Who has the parameters: a ring that is replayed here, or the nodes of one that runs."""

    def values(self) -> Parameters:
        """Values by node and name; a node that does not answer is missing."""

    def change(self, node: str, values: Mapping[str, Any]) -> Answer:
        """Change parameters of a node, all or none."""


def table_of(node: str) -> type:
    """Return the parameter table of a node of the ring.

    Raises
    ------
    ParameterError
        For another node.
    """
    if node not in STAGE_TABLES:
        raise ParameterError(f"node {node}: unknown; allowed are {', '.join(STAGE_TABLES)}")
    return STAGE_TABLES[node]


def parsed(specification: Specification, text: Any) -> Any:
    """Return the value that somebody typed, checked.

    Raises
    ------
    ParameterError
        If it is not allowed.
    """
    if not isinstance(text, str) or (
        not specification.is_list and specification.element_kind is str
    ):
        return specification.check(text)
    try:
        return specification.check(json.loads(text))
    except json.JSONDecodeError:
        return specification.check(text)  # raises, with what is allowed


def desk_json(values: Parameters) -> list[dict[str, Any]]:
    """Every parameter of every node: what it is and its value now."""
    found = []
    for node, table in STAGE_TABLES.items():
        if node not in values:
            continue
        for name, item in specifications(table).items():
            found.append(
                {
                    "node": node,
                    "name": name,
                    "value": values[node].get(name, item.default),
                    "default": item.default,
                    "description": item.description,
                    "unit": item.unit,
                    "allowed": item.allowed,
                    "choices": list(item.choices) if not item.is_list else [],
                    "live": item.live,
                    "advanced": item.advanced,
                }
            )
    return found


def with_defaults(parameters: Parameters) -> dict[str, dict[str, Any]]:
    """Values of all parameters of the ring, also of those that were not given."""
    return {
        node: to_mapping(from_mapping(table, parameters.get(node, {})))
        for node, table in STAGE_TABLES.items()
    }
