"""Statements written by hand, as YAML: read with every key checked.

The keys are those of the message, but that the classes of a piece are one mapping, and what a
running ring knows may be left out::

    source: lookout
    kind: fuzzy
    about: place
    reliability: 0.8
    pieces:
      - region: {shape: gaussian, centre_m: [7200, 300], covariance_m2: [90000, 0, 0, 90000]}
        classes: {fighter: 1.0, cargo: 0.2}

A file holds one statement or more, with a line ``---`` between them.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import yaml

from gda_tracker.errors import UserError
from gda_tracker.tracking.statement_door import (
    EXPLANATIONS,
    StatementRejected,
    validate_statement,
)
from gda_tracker.vocabulary.statements import Statement, StatementPiece, StatementRegion

KEYS = ("source", "kind", "about", "pieces", "track_id", "reliability", "rule")
OPTIONAL_KEYS = ("sequence", "stamp_s", "frame_id")
PIECE_KEYS = ("region", "classes", "mass")
REGION_KEYS = tuple(item.name for item in fields(StatementRegion))
_TEXTS = ("source", "kind", "about", "rule", "frame_id", "shape")
_INTEGERS = ("track_id", "sequence")


class StatementFileError(UserError):
    """A statement cannot be read; the message is one line."""


@dataclass(frozen=True, slots=True)
class Draft:
    """A statement in which time, number and frame may be missing (``None``)."""

    statement: Statement
    sequence: int | None
    stamp_ns: int | None
    frame_id: str | None

    def complete(self, sequence: int, stamp_ns: int, frame_id: str) -> Statement:
        """Return the statement with what is missing; checked.

        Raises
        ------
        StatementFileError
            With the reason for which the door would refuse it.
        """
        statement = replace(
            self.statement,
            sequence=sequence if self.sequence is None else self.sequence,
            stamp_ns=stamp_ns if self.stamp_ns is None else self.stamp_ns,
            frame_id=frame_id if self.frame_id is None else self.frame_id,
        )
        try:
            return validate_statement(statement, frame_id)
        except StatementRejected as rejection:
            raise StatementFileError(f"{rejection}: {EXPLANATIONS[str(rejection)]}") from None


def read_statements(text: str, name: str) -> list[Draft]:
    """Return the statements of a YAML text; ``name`` stands for it in errors.

    Raises
    ------
    StatementFileError
        If it is no YAML, a key is unknown or missing, or a value has the wrong type.
    """
    try:
        documents = [found for found in yaml.safe_load_all(text) if found is not None]
    except yaml.YAMLError as error:
        raise StatementFileError(f"{name}: no YAML: {' '.join(str(error).split())}") from None
    if not documents:
        raise StatementFileError(f"{name}: no statement")
    return [
        _draft(document, f"{name}: statement {number}")
        for number, document in enumerate(documents, start=1)
    ]


def _draft(document: Any, where: str) -> Draft:
    values = _section(document, (*KEYS, *OPTIONAL_KEYS), ("source", "kind", "about"), where)
    pieces = values.get("pieces")
    if not isinstance(pieces, list):
        raise StatementFileError(f"{where}: pieces = {pieces!r}: allowed is a list of pieces")
    stamp_s = values.get("stamp_s")
    statement = Statement(
        source=values["source"],
        sequence=1,
        stamp_ns=0,
        kind=values["kind"],
        about=values["about"],
        pieces=tuple(
            _piece(piece, f"{where}, piece {number}")
            for number, piece in enumerate(pieces, start=1)
        ),
        track_id=values.get("track_id", 0),
        reliability=values.get("reliability", 1.0),
        rule=values.get("rule", ""),
    )
    stamp_ns = None if stamp_s is None else round(stamp_s * 1e9)
    return Draft(statement, values.get("sequence"), stamp_ns, values.get("frame_id"))


def _piece(document: Any, where: str) -> StatementPiece:
    values = _section(document, PIECE_KEYS, (), where)
    classes = values.get("classes") or {}
    if not isinstance(classes, Mapping):
        raise StatementFileError(
            f"{where}: classes = {classes!r}: allowed are names with grades, as {{fighter: 1.0}}"
        )
    grades = [_number(grade, f"{where}: classes, {name}") for name, grade in classes.items()]
    region = StatementRegion()
    if values.get("region") is not None:
        region = StatementRegion(
            **_section(values["region"], REGION_KEYS, ("shape",), f"{where}, region")
        )
    return StatementPiece(
        region, tuple(str(name) for name in classes), tuple(grades), values.get("mass", 1.0)
    )


def _section(
    document: Any, allowed: tuple[str, ...], required: tuple[str, ...], where: str
) -> dict[str, Any]:
    """The values of a mapping, in their types."""
    if not isinstance(document, Mapping):
        raise StatementFileError(f"{where}: {document!r}: allowed are keys {', '.join(allowed)}")
    for name in document:
        if name not in allowed:
            close = difflib.get_close_matches(str(name), allowed, n=1)
            hint = f", did you mean {close[0]}?" if close else ""
            raise StatementFileError(
                f"{where}: unknown key {name!r}{hint} (allowed are {', '.join(allowed)})"
            )
    for name in required:
        if name not in document:
            raise StatementFileError(f"{where}: the key {name} is missing")
    return {name: _value(name, value, where) for name, value in document.items()}


def _value(name: str, value: Any, where: str) -> Any:
    if name in ("pieces", "region", "classes"):
        return value
    if name in _TEXTS:
        if not isinstance(value, str):
            raise StatementFileError(f"{where}: {name} = {value!r}: allowed is a text")
        return value
    if name in _INTEGERS:
        if not isinstance(value, int) or isinstance(value, bool):
            raise StatementFileError(f"{where}: {name} = {value!r}: allowed is an integer")
        return value
    if name.endswith(("_m", "_m2")) and name not in ("nearest_m", "farthest_m"):
        if not isinstance(value, list):
            raise StatementFileError(f"{where}: {name} = {value!r}: allowed is a list of numbers")
        return tuple(_number(each, f"{where}: {name}") for each in value)
    return _number(value, f"{where}: {name}")


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise StatementFileError(f"{where} = {value!r}: allowed is a number")
    try:
        return float(value)
    except OverflowError:
        raise StatementFileError(f"{where} = {str(value)[:20]}...: too large") from None
