"""Reading a section of a scenario file into a dataclass, with every key checked.

A section is a frozen dataclass whose fields are made by :func:`key`; the declaration gives unit,
range and meaning, and :func:`read_section` gives the errors: one line that names the key and what
is allowed.
"""

from __future__ import annotations

import dataclasses
import difflib
import typing
from collections.abc import Mapping
from typing import Any, TypeVar

from gda_tracker.parameters import ParameterError, Specification

T = TypeVar("T")


class ScenarioError(ParameterError):
    """A scenario cannot be read or a key in it is not allowed; the message is one line."""


def key(
    description: str,
    *,
    default: Any = dataclasses.MISSING,
    unit: str = "",
    minimum: float | None = None,
    maximum: float | None = None,
    minimum_excluded: bool = False,
    choices: tuple[str, ...] = (),
) -> Any:
    """Declare one key of a section; without ``default`` the key is required."""
    metadata = {
        "description": description,
        "unit": unit,
        "minimum": minimum,
        "maximum": maximum,
        "minimum_excluded": minimum_excluded,
        "choices": choices,
    }
    return dataclasses.field(default=default, metadata=metadata)


def check_keys(values: Any, allowed: list[str], required: list[str], where: str) -> None:
    """Refuse a section that is not a mapping, or has unknown or missing keys.

    Raises
    ------
    ScenarioError
        Naming the section, the key and the allowed keys.
    """
    if not isinstance(values, Mapping):
        raise ScenarioError(f"{where}: expected keys {', '.join(allowed)}, found {values!r}")
    for name in values:
        if name not in allowed:
            close = difflib.get_close_matches(str(name), allowed, n=1)
            hint = f" (did you mean {close[0]}?)" if close else ""
            raise ScenarioError(
                f"{where}: unknown key {name!r}{hint}; allowed are {', '.join(allowed)}"
            )
    missing = [name for name in required if name not in values]
    if missing:
        raise ScenarioError(f"{where}: missing key {', '.join(missing)}")


def check_list(values: Any, where: str, at_least: int) -> list[Any]:
    """Return ``values`` if it is a list of at least ``at_least`` entries; raise otherwise."""
    if not isinstance(values, list) or len(values) < at_least:
        raise ScenarioError(
            f"{where} = {values!r}: allowed is a list of {at_least} or more entries"
        )
    return values


def read_section(table: type[T], values: Any, where: str, **nested: Any) -> T:
    """Build ``table`` from the mapping ``values`` of a scenario file.

    Parameters
    ----------
    table : type
        Frozen dataclass with fields made by :func:`key`; a ``tuple[float, float]`` is read from a
        list of two numbers.
    values : mapping
        What the file says.
    where : str
        Name of the file and section for messages.
    **nested
        Fields of ``table`` that the caller has read already: they are allowed as keys, not checked.

    Raises
    ------
    ScenarioError
        For unknown or missing keys, a value out of range, or a combination that the
        ``__post_init__`` of ``table`` refuses.
    """
    hints = typing.get_type_hints(table)
    declared = {f.name: f for f in dataclasses.fields(table) if "description" in f.metadata}  # type: ignore[arg-type]
    required = [n for n, f in declared.items() if f.default is dataclasses.MISSING]
    check_keys(values, [*declared, *nested], required, where)
    found: dict[str, Any] = dict(nested)
    try:
        for name, item in declared.items():
            if name not in values:
                continue
            length = len(typing.get_args(hints[name])) if _is_tuple(hints[name]) else 0
            kind = list[float] if length else hints[name]
            value = Specification(name, kind, default=None, **item.metadata).check(values[name])
            if length and len(value) != length:
                raise ParameterError(
                    f"parameter {name} = {values[name]!r}: allowed is a list of {length} numbers"
                )
            found[name] = tuple(value) if length else value
        return table(**found)
    except ScenarioError:
        raise
    except ParameterError as error:
        raise ScenarioError(f"{where}: {str(error).removeprefix('parameter ')}") from None


def _is_tuple(hint: Any) -> bool:
    return typing.get_origin(hint) is tuple
