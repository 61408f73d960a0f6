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
import numbers
import sys
import typing
from collections.abc import Hashable, Iterable, Mapping, Set
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import Any, TypeVar

from gda_tracker.errors import UserError

T = TypeVar("T")

# Characters of a value in an error.
LONGEST_VALUE = 100
# Of ROS parameters.
LARGEST_INTEGER, LARGEST_FLOAT = 2**63 - 1, sys.float_info.max


class ParameterError(UserError):
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
            return ("a list, each " if self.is_list else "") + "one of " + ", ".join(self.choices)
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
        if not self.is_list:
            return self._check_element(value, value)
        # No lists, though iterable: no order, or elements that were not meant.
        if isinstance(value, str | bytes | Mapping | Set) or not isinstance(value, Iterable):
            raise self._error(value)
        return [self._check_element(element, value) for element in value]

    def _check_element(self, element: Any, value: Any) -> Any:
        kind = self.element_kind
        if kind in (int, float):
            element = self._number(element, value)
            bad = not abs(element) <= (LARGEST_INTEGER if kind is int else LARGEST_FLOAT)
            if self.minimum is not None:
                bad |= element <= self.minimum if self.minimum_excluded else element < self.minimum
            if self.maximum is not None:
                bad |= element > self.maximum
            if bad:
                raise self._error(value)
        elif not isinstance(element, kind):
            raise self._error(value)
        if self.choices and element not in self.choices:
            raise self._error(value)
        return element

    def _number(self, element: Any, value: Any) -> int | float:
        """Return a number, of Python or numpy, as the declared type; 3.0 is an integer."""
        if isinstance(element, bool) or not isinstance(element, numbers.Real):
            raise self._error(value)
        if self.element_kind is int and isinstance(element, numbers.Integral):
            return int(element)
        try:
            number = float(element)
        except OverflowError:
            raise self._error(value) from None
        if self.element_kind is int:
            if not number.is_integer():
                raise self._error(value)
            return int(number)
        return number

    def _error(self, value: Any) -> ParameterError:
        return ParameterError(
            f"parameter {self.name} = {_in_a_line(value)}: allowed is {self.allowed}"
        )


def _in_a_line(value: Any) -> str:
    """Write a value, cut where it is long."""
    text = " ".join(repr(value).split())
    return text if len(text) <= LONGEST_VALUE else text[:LONGEST_VALUE] + " ..."


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


def specifications(table: type) -> Mapping[str, Specification]:
    """Return the declared parameters of a table, by name, in the order of declaration."""
    return _specifications(typing.cast(Hashable, table))


@lru_cache(maxsize=64)
def _specifications(table: Any) -> Mapping[str, Specification]:
    kinds = typing.get_type_hints(table)
    found = {}
    for item in dataclasses.fields(table):
        if "description" not in item.metadata:
            continue
        factory = item.default_factory
        found[item.name] = Specification(
            name=item.name,
            kind=kinds[item.name],
            default=factory() if callable(factory) else item.default,
            **item.metadata,
        )
    return MappingProxyType(found)  # cached, hence not to be changed


def from_mapping(table: type[T], values: Mapping[str, Any]) -> T:
    """Build a table from ``values``; names that are missing take their default.

    Raises
    ------
    ParameterError
        For an unknown name, a wrong type, a value out of range, or a combination that the table's
        own ``__post_init__`` refuses.
    """
    known = specifications(table)
    anything: object = values  # as it may come from a file
    if not isinstance(anything, Mapping):
        raise ParameterError(f"parameters = {_in_a_line(values)}: allowed are names with values")
    for name in values:
        if name not in known:
            close = difflib.get_close_matches(str(name), known, n=1)
            hint = f", did you mean {close[0]}?" if close else ""
            raise ParameterError(
                f"parameter {name}: unknown{hint}; allowed are {', '.join(sorted(known))}"
            )
    return table(**{name: known[name].check(value) for name, value in values.items()})


def to_mapping(parameters: Any) -> dict[str, Any]:
    """Return the values of a table by name."""
    return {name: getattr(parameters, name) for name in specifications(type(parameters))}
