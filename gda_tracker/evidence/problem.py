"""A problem of evidence as JSON: a frame, its model, the sources, and what to do with them.

The reader of the calculator ``gda-tracker fuse``. Nothing is mended on the way: a problem is taken
as it stands or refused with one line that names the fault.

>>> problem = read_problem('{"frame": ["A", "B"], "model": {"empty": ["A&B"]}, "rule": "dempster",'
...                        ' "sources": [{"A": 0.3, "A|B": 0.7}, {"B": 0.6, "A | B": 0.4}]}')
>>> problem.model == shafer_model(("A", "B")), problem.sources[0]
(True, {5: 0.3, 7: 0.7})
>>> read_problem('{"frame": ["A", "B"], "rule": "dsmc", "sources": [{"A": 0.3}, {"B": 1}]}')
Traceback (most recent call last):
gda_tracker.evidence.problem.ProblemError: sources[0]: masses sum to 0.3; allowed is 1 within 1e-9
"""

from __future__ import annotations

import json
import math
import reprlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from gda_tracker.errors import UserError
from gda_tracker.evidence.combination import RULES as COMBINATION_RULES
from gda_tracker.evidence.frames import (
    MAX_ELEMENTS,
    Model,
    check_frame,
    constrained_model,
    element_name,
    free_model,
    parse_element,
    shafer_model,
)

RULES = (*COMBINATION_RULES, "discount", "pignistic")

# Decimal fractions written by hand or by a program miss one by a few units in the last place; a
# mass that was forgotten misses it by more.
SUM_TOLERANCE = 1e-9

# The rules look at every tuple of focal elements, one per source: half a minute at this bound.
MAX_TUPLES = 1_000_000

_KEYS = ("frame", "model", "sources", "rule", "reliability")
_REQUIRED = ("frame", "sources", "rule")
_MODELS = {"free": free_model, "shafer": shafer_model}
_MODEL_FORMS = 'allowed are "free", "shafer" and {"empty": [elements]}'


class ProblemError(UserError):
    """The problem cannot be read; the message names the fault and what is allowed."""


@dataclass(frozen=True)
class Problem:
    """What to combine, on which model, by which rule.

    Attributes
    ----------
    model
        Frame and model; without a ``model`` in the file the free one.
    model_given
        Whether the file has a model.
    sources
        Masses > 0 by Venn bitmask on the free model, in the file's order; they sum to one within
        ``SUM_TOLERANCE``. Elements that are dead on the model may carry mass: what becomes of it is
        the rule's business.
    rule
        One of ``RULES``.
    reliability
        Share of each source's mass that ``discount`` keeps, in [0, 1].
    """

    model: Model
    model_given: bool
    sources: tuple[dict[int, float], ...]
    rule: str
    reliability: float | None


def read_problem(content: str | bytes) -> Problem:
    """Read a problem from the text of a JSON file.

    Raises
    ------
    ProblemError
        If it is not JSON, or anything in it is not as allowed.
    """
    fields = _fields(content)
    frame = _frame(fields["frame"])
    model = _model(frame, fields["model"]) if "model" in fields else free_model(frame)
    rule = fields["rule"]
    if not isinstance(rule, str) or rule not in RULES:
        raise ProblemError(f"rule = {_show(rule)}: allowed are {', '.join(RULES)}")
    reliability = _reliability(fields, rule)
    return Problem(
        model=model,
        model_given="model" in fields,
        sources=_sources(frame, fields["sources"], rule),
        rule=rule,
        reliability=reliability,
    )


def _fields(content: str | bytes) -> dict[str, Any]:
    try:
        fields = json.loads(content, object_pairs_hook=_object)
    except ProblemError:
        raise
    except RecursionError:
        raise ProblemError("not a problem: its JSON is nested too deeply") from None
    except ValueError as error:  # syntax, encoding, a number of too many digits
        raise ProblemError(f"not JSON: {error}") from None
    if not isinstance(fields, dict):
        raise ProblemError(f"not a problem: allowed is an object with {', '.join(_KEYS)}")
    for key in fields:
        if key not in _KEYS:
            raise ProblemError(f"{_show(key)}: unknown key; allowed are {', '.join(_KEYS)}")
    for key in _REQUIRED:
        if key not in fields:
            raise ProblemError(f"{key}: missing; needed are {', '.join(_REQUIRED)}")
    return fields


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result: dict[str, Any] = {}
    for key, value in pairs:
        if key in result:
            raise ProblemError(f"{_show(key)}: stands twice in one object; allowed is once")
        result[key] = value
    return result


def _frame(value: Any) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
        raise ProblemError(f"frame = {_show(value)}: allowed is a list of names")
    if len(value) > MAX_ELEMENTS:
        raise ProblemError(
            f"frame of {len(value)} elements: allowed are 1 to {MAX_ELEMENTS}; the hyper-power set "
            f"of {MAX_ELEMENTS} has 7,579 elements, that of 6 has 7,828,352"
        )
    try:
        return check_frame(value)
    except ValueError as error:
        raise ProblemError(str(error)) from None


def _model(frame: tuple[str, ...], value: Any) -> Model:
    if isinstance(value, str) and value in _MODELS:
        return _MODELS[value](frame)
    if not isinstance(value, dict):
        raise ProblemError(f"model = {_show(value)}: {_MODEL_FORMS}")
    if list(value) != ["empty"]:
        raise ProblemError(f"model with keys {_show(list(value))}: {_MODEL_FORMS}")
    elements = value["empty"]
    if not isinstance(elements, list) or not all(isinstance(name, str) for name in elements):
        raise ProblemError(f"model.empty = {_show(elements)}: allowed is a list of elements")
    try:
        return constrained_model(frame, [_element(frame, name) for name in elements])
    except ValueError as error:
        raise ProblemError(f"model.empty: {error}") from None


def _sources(frame: tuple[str, ...], value: Any, rule: str) -> tuple[dict[int, float], ...]:
    if not isinstance(value, list):
        raise ProblemError(f"sources = {_show(value)}: allowed is a list of objects")
    least, most, allowed = {
        "pignistic": (1, 1, "1 source"),
        "discount": (1, math.inf, "1 or more sources"),
    }.get(rule, (2, math.inf, "2 or more sources"))
    if not least <= len(value) <= most:
        raise ProblemError(f"sources: {len(value)} for rule {rule}; allowed are {allowed}")
    sources = tuple(_source(frame, f"sources[{i}]", entry) for i, entry in enumerate(value))
    if rule in COMBINATION_RULES:
        tuples = math.prod(map(len, sources))
        if tuples > MAX_TUPLES:
            raise ProblemError(
                f"sources: {tuples:.3g} tuples of focal elements, one element of each source; "
                f"allowed are {MAX_TUPLES}"
            )
    return sources


def _source(frame: tuple[str, ...], where: str, value: Any) -> dict[int, float]:
    if not isinstance(value, dict):
        raise ProblemError(f"{where} = {_show(value)}: allowed is an object {{element: mass}}")
    masses: dict[int, float] = {}
    for text, entry in value.items():
        try:
            mask = _element(frame, text)
        except ValueError as error:
            raise ProblemError(f"{where}: {error}") from None
        if mask in masses:
            name = element_name(frame, mask)
            raise ProblemError(f"{where}: {_show(text)} is {name}, which has a mass already")
        masses[mask] = _number(
            f"{where}[{_show(text)}]", entry, "allowed is a mass from 0 to 1", 1.0 + SUM_TOLERANCE
        )
    total = math.fsum(masses.values())
    if abs(total - 1.0) > SUM_TOLERANCE:
        raise ProblemError(f"{where}: masses sum to {total!r}; allowed is 1 within 1e-9")
    return {mask: mass for mask, mass in masses.items() if mass}


def _element(frame: Sequence[str], text: str) -> int:
    try:
        return parse_element(frame, text)
    except RecursionError:
        raise ValueError(f"element {_show(text)}: parentheses are nested too deeply") from None


def _reliability(fields: dict[str, Any], rule: str) -> float | None:
    allowed = "allowed is a number from 0 to 1"
    if "reliability" in fields:
        return _number("reliability", fields["reliability"], allowed)
    if rule == "discount":
        raise ProblemError(f"reliability: missing, rule discount needs it; {allowed}")
    return None


def _number(where: str, value: Any, allowed: str, largest: float = 1.0) -> float:
    # A bool is an int to Python, not to JSON; NaN and Infinity are read though JSON has none.
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= largest:
        raise ProblemError(f"{where} = {_show(value)}: {allowed}")
    return float(value)


def _show(value: Any) -> str:
    """Write a value of the file in one line that is not too long."""
    shortener = reprlib.Repr()
    shortener.maxstring = shortener.maxother = shortener.maxlong = 60
    return shortener.repr(value)
