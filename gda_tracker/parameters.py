"""Parameters, declared once: default, unit, range and meaning in one table per node.

A table is a frozen dataclass whose fields are made by :func:`parameter`. The same table gives the
ROS descriptors, the validation, the commented YAML files and the tables of the README.

>>> @dataclass(frozen=True)
... class Example:
...     gate_probability: float = parameter(0.99, "chance that it is gated", minimum=0.0)
>>> from_mapping(Example, {"gate_probability": 0.9}).gate_probability
0.9
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import typing
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

T = TypeVar("T")


class ParameterError(ValueError):
    """A parameter is unknown or has a value that is not allowed; the message is one line."""


@dataclass(frozen=True)
class Specification:
    """What is declared about one parameter."""

    name: str
    kind: type  # bool, int, float, str, or list of one of them as list[...]
    default: Any
    description: str
    unit: str = ""
    minimum: float | None = None
    maximum: float | None = None
    minimum_excluded: bool = False
    choices: tuple[str, ...] = ()
    live: bool = True
    advanced: bool = False

    @property
    def element_kind(self) -> type:
        """Type of the value, or of its elements for a list."""
        arguments = typing.get_args(self.kind)
        return arguments[0] if arguments else self.kind

    @property
    def is_list(self) -> bool:
        """Whether the value is a list."""
        return typing.get_origin(self.kind) is list

    @property
    def allowed(self) -> str:
        """The allowed values in words, e.g. ``a number > 0 and <= 1``."""
        if self.choices:
            return "one of " + ", ".join(self.choices)
        words = {bool: "true or false", int: "an integer", float: "a number", str: "a text"}
        text = words[self.element_kind]
        limits = []
        if self.minimum is not None:
            limits.append(f"{'>' if self.minimum_excluded else '>='} {self.minimum:g}")
        if self.maximum is not None:
            limits.append(f"<= {self.maximum:g}")
        if limits:
            text += " " + " and ".join(limits)
        if self.is_list:
            text = f"a list, each {text}"
        return text + (f" [{self.unit}]" if self.unit else "")

    def check(self, value: Any) -> Any:
        """Return ``value`` in the declared type; raise :class:`ParameterError` if not allowed."""
        if self.is_list:
            if isinstance(value, str) or not hasattr(value, "__iter__"):
                raise self._error(value)
            return [self._check_element(element, value) for element in value]
        return self._check_element(value, value)

    def _check_element(self, element: Any, value: Any) -> Any:
        kind = self.element_kind
        number = isinstance(element, int | float) and not isinstance(element, bool)
        if kind is float and number:
            element = float(element)
        elif kind is int and number and float(element).is_integer():
            element = int(element)
        elif not isinstance(element, kind):
            raise self._error(value)
        if kind in (int, float):
            bad = not math.isfinite(element)
            if self.minimum is not None:
                bad |= element <= self.minimum if self.minimum_excluded else element < self.minimum
            if self.maximum is not None:
                bad |= element > self.maximum
            if bad:
                raise self._error(value)
        if self.choices and element not in self.choices:
            raise self._error(value)
        return element

    def _error(self, value: Any) -> ParameterError:
        return ParameterError(f"parameter {self.name} = {value!r}: allowed is {self.allowed}")


def parameter(
    default: Any,
    description: str,
    *,
    unit: str = "",
    minimum: float | None = None,
    maximum: float | None = None,
    minimum_excluded: bool = False,
    choices: tuple[str, ...] = (),
    live: bool = True,
    advanced: bool = False,
) -> Any:
    """Declare one parameter of a table.

    ``live`` parameters act at the next scan boundary; the others are fixed at start-up.
    ``advanced`` ones go to the advanced YAML file.
    """
    metadata = {
        "description": description,
        "unit": unit,
        "minimum": minimum,
        "maximum": maximum,
        "minimum_excluded": minimum_excluded,
        "choices": choices,
        "live": live,
        "advanced": advanced,
    }
    if isinstance(default, list):
        return dataclasses.field(default_factory=lambda: list(default), metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def specifications(table: type) -> dict[str, Specification]:
    """Return the declared parameters of a table, by name, in the order of declaration."""
    kinds = typing.get_type_hints(table)
    found = {}
    for item in dataclasses.fields(table):
        if "description" not in item.metadata:
            continue
        if item.default is not dataclasses.MISSING:
            default = item.default
        else:
            default = item.default_factory()  # type: ignore[misc]
        found[item.name] = Specification(
            name=item.name, kind=kinds[item.name], default=default, **item.metadata
        )
    return found


def from_mapping(table: type[T], values: Mapping[str, Any]) -> T:
    """Build a table from ``values``; names that are missing take their default.

    Raises
    ------
    ParameterError
        For an unknown name, a wrong type, a value out of range, or a combination that the table's
        own ``__post_init__`` refuses.
    """
    known = specifications(table)
    for name in values:
        if name not in known:
            close = difflib.get_close_matches(name, known, n=1)
            hint = f", did you mean {close[0]}?" if close else ""
            raise ParameterError(
                f"parameter {name}: unknown{hint} Allowed are {', '.join(sorted(known))}"
            )
    return table(**{name: known[name].check(value) for name, value in values.items()})


def to_mapping(parameters: Any) -> dict[str, Any]:
    """Return the values of a table by name."""
    return {name: getattr(parameters, name) for name in specifications(type(parameters))}
