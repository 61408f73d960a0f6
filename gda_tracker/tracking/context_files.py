"""Lanes and plans written by hand, as YAML: read with every key checked.

``params/context_example.yaml`` is one and explains the keys; docs/track-events.md has a table.
"""

from __future__ import annotations

import difflib
import math
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gda_tracker.kinematics.context import DIRECTIONS_OF_LANES, Context, Lane, Plan
from gda_tracker.parameters import ParameterError
from gda_tracker.yaml_text import YamlError, load_yaml

LARGEST_M, LARGEST_S = 1e9, 9e9
LARGEST_FILE_BYTES = 50_000_000
FILE_KEYS = ("frame_id", "lanes", "plans")
LANE_KEYS = ("name", "width_m", "margin_m", "direction", "points_m")
PLAN_KEYS = ("name", "track_id", "margin_m", "waypoints")
WAYPOINT_KEYS = ("time_s", "position_m", "tolerance_m", "tolerance_s")


class ContextFileError(ParameterError):
    """A file of lanes and plans cannot be used; the message is one line and names the place."""


def read_context_file(path: str | Path) -> Context:
    """Return the lanes and plans of a YAML file.

    Raises
    ------
    ContextFileError
        If the file cannot be read, is not YAML, a key is unknown or missing, or a value is not
        allowed; the message names file, lane or plan, and key.
    """
    path = full_path(path)
    try:
        if path.stat().st_size > LARGEST_FILE_BYTES:
            raise ContextFileError(f"{path}: larger than {LARGEST_FILE_BYTES} bytes")
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ContextFileError(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ContextFileError(f"{path}: not a text file") from None
    return parse_context(text, str(path))


def full_path(path: str | Path) -> Path:
    """Return the path with its ``~`` replaced.

    Raises
    ------
    ContextFileError
        If it is no path, or of a user that there is not.
    """
    if "\0" in str(path):
        raise ContextFileError(f"{str(path)!r}: allowed is a path")
    try:
        return Path(path).expanduser()
    except RuntimeError:
        raise ContextFileError(f"{path}: there is no such home directory") from None


def parse_context(text: str, name: str) -> Context:
    """Return the lanes and plans of a YAML text; ``name`` stands for it in errors.

    Raises
    ------
    ContextFileError
        As :func:`read_context_file`.
    """
    try:
        content = load_yaml(text, name)
    except (YamlError, ValueError, RecursionError) as error:
        raise ContextFileError(" ".join(str(error).split())) from None
    values = _section(content, FILE_KEYS, (), name)
    frame = values.get("frame_id", "")
    if not isinstance(frame, str):
        raise ContextFileError(f"{name}: frame_id = {_told(frame)}: allowed is a text")
    lanes = _each(values.get("lanes"), f"{name}: lanes", f"{name}: lane", _lane)
    plans = _each(values.get("plans"), f"{name}: plans", f"{name}: plan", _plan)
    _distinct([lane.name for lane in lanes], f"{name}: lanes")
    _distinct([plan.name for plan in plans], f"{name}: plans")
    _distinct([plan.track_id for plan in plans], f"{name}: plans: track_id", "one plan each")
    return Context(frame, tuple(lanes), tuple(plans))


def _lane(document: Any, where: str) -> Lane:
    values = _section(document, LANE_KEYS, ("name", "width_m", "margin_m", "points_m"), where)
    name = _name(values["name"], where)
    where = f"{where} ({name})"
    direction = values.get("direction", "both")
    if direction not in DIRECTIONS_OF_LANES:
        raise ContextFileError(
            f"{where}: direction = {_told(direction)}: allowed is one of "
            f"{', '.join(DIRECTIONS_OF_LANES)}"
        )
    points = _list(values["points_m"], f"{where}: points_m", 2)
    polyline = np.array(
        [_point(point, f"{where}: points_m, point {k}") for k, point in enumerate(points, 1)]
    )
    short = np.flatnonzero(np.hypot(*np.diff(polyline, axis=0).T) < 1e-6)
    if len(short):
        raise ContextFileError(
            f"{where}: points_m, point {short[0] + 2}: the same place as the one before it"
        )
    return Lane(
        name,
        polyline,
        _positive(values["width_m"], f"{where}: width_m"),
        _positive(values["margin_m"], f"{where}: margin_m"),
        direction,
    )


def _plan(document: Any, where: str) -> Plan:
    values = _section(document, PLAN_KEYS, PLAN_KEYS, where)
    name = _name(values["name"], where)
    where = f"{where} ({name})"
    track_id = values["track_id"]
    if isinstance(track_id, bool) or not isinstance(track_id, int) or not 0 <= track_id < 2**63:
        raise ContextFileError(f"{where}: track_id = {_told(track_id)}: allowed is an integer >= 0")
    times, points, tolerances, early_late = [], [], [], []
    for k, waypoint in enumerate(_list(values["waypoints"], f"{where}: waypoints", 2), 1):
        place = f"{where}, waypoint {k}"
        found = _section(waypoint, WAYPOINT_KEYS, WAYPOINT_KEYS[:3], place)
        time_s = _number(found["time_s"], f"{place}: time_s")
        if not 0.0 <= time_s <= LARGEST_S:
            raise ContextFileError(
                f"{place}: time_s = {time_s}: allowed is a number >= 0 and <= {LARGEST_S:g}"
            )
        times.append(round(time_s * 1e9))
        if k > 1 and times[-1] <= times[-2]:
            raise ContextFileError(
                f"{place}: time_s = {time_s}: allowed is a time after the waypoint before it"
            )
        points.append(_point(found["position_m"], f"{place}: position_m"))
        tolerances.append(_positive(found["tolerance_m"], f"{place}: tolerance_m"))
        early_late.append(_number(found.get("tolerance_s", 0.0), f"{place}: tolerance_s"))
        if not 0.0 <= early_late[-1] <= LARGEST_S:
            raise ContextFileError(
                f"{place}: tolerance_s = {early_late[-1]}: allowed is a number >= 0 and <= "
                f"{LARGEST_S:g}"
            )
    margin = _positive(values["margin_m"], f"{where}: margin_m")
    return Plan(
        name,
        track_id,
        np.array(times, dtype=np.int64),
        np.array(points),
        np.array(tolerances),
        margin,
        np.array(early_late),
    )


def _each(value: Any, where: str, one: str, read: Callable[[Any, str], Any]) -> list[Any]:
    if value is None:
        return []
    return [read(item, f"{one} {k}") for k, item in enumerate(_list(value, where, 0), 1)]


def _section(
    document: Any, allowed: tuple[str, ...], required: tuple[str, ...], where: str
) -> Mapping[str, Any]:
    if not isinstance(document, Mapping):
        found = "nothing" if document is None else _told(document)
        raise ContextFileError(f"{where}: {found}: allowed are keys {', '.join(allowed)}")
    for name in document:
        if name not in allowed:
            close = difflib.get_close_matches(str(name), allowed, n=1)
            hint = f", did you mean {close[0]}?" if close else ""
            raise ContextFileError(
                f"{where}: unknown key {name!r}{hint} (allowed are {', '.join(allowed)})"
            )
    for name in required:
        if name not in document:
            raise ContextFileError(f"{where}: the key {name} is missing")
    return document


def _list(value: Any, where: str, least: int) -> list[Any]:
    if not isinstance(value, list) or len(value) < least:
        what = f"a list of at least {least}" if least else "a list"
        raise ContextFileError(f"{where} = {_told(value)}: allowed is {what}")
    return value


def _name(value: Any, where: str) -> str:
    if not isinstance(value, str) or not value:
        raise ContextFileError(f"{where}: name = {_told(value)}: allowed is a text")
    return value


def _told(value: Any) -> str:
    """The beginning of a value; of integers with thousands of digits there is no text."""
    try:
        return repr(value)[:60]
    except ValueError:
        return "(too many digits)"


def _distinct(values: list[Any], where: str, rule: str = "different names") -> None:
    twice = [value for value, count in Counter(values).items() if count > 1]
    if twice:
        raise ContextFileError(f"{where}: {twice[0]!r} occurs twice, allowed is {rule}")


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ContextFileError(f"{where} = {_told(value)}: allowed is a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ContextFileError(f"{where} = {_told(value)[:20]}: allowed is a finite number")
    return number


def _positive(value: Any, where: str) -> float:
    number = _number(value, where)
    if not 0.0 < number <= LARGEST_M:
        raise ContextFileError(f"{where} = {number}: allowed is a number > 0 and <= {LARGEST_M:g}")
    return number


def _point(value: Any, where: str) -> list[float]:
    if not isinstance(value, list) or len(value) != 2:
        raise ContextFileError(f"{where} = {_told(value)}: allowed is [x, y]")
    point = [_number(number, where) for number in value]
    if max(map(abs, point)) > LARGEST_M:
        raise ContextFileError(f"{where} = {value}: allowed are numbers up to {LARGEST_M:g}")
    return point
