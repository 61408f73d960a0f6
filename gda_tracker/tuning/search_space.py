"""Which parameters are searched, and between which values: declared ranges and a default space.

>>> parse_range("range_std_m=5:40:log", {})
Range(node='track_manager', name='range_std_m', low=5.0, high=40.0, log=True, choices=())
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gda_tracker.parameters import ParameterError, Specification, specifications
from gda_tracker.tracking.parameter_groups.life import SEQUENTIAL
from gda_tracker.tracking.parameter_groups.sensor import ESTIMATED
from gda_tracker.tracking.ring import STAGE_TABLES
from gda_tracker.vocabulary.recordings import Recording

Values = Mapping[str, Mapping[str, Any]]
Point = Mapping[str, Any]

MANAGER = "track_manager"
HELP = "allowed is name=low:high, name=low:high:log or, of choices, name=one|other"
# Around the default: from its nth part to n times as much, by logarithm.
AROUND = {
    "range_std_m": 4.0,
    "azimuth_std_rad": 4.0,
    "range_rate_std_mps": 4.0,
    "process_noise_std_mps2": 8.0,
    "clutter_density_per_m_rad": 30.0,
}
# From, to, by logarithm; wider where the default lies outside.
BETWEEN = {
    "detection_probability": (0.5, 0.99, False),
    "gate_probability": (0.9, 0.9999, False),
    "deletion_misses": (2, 12, False),
    "tentative_deletion_misses": (1, 4, False),
    "false_track_probability": (1e-6, 0.1, True),
    "missed_track_probability": (0.001, 0.3, True),
    "clutter_memory_scans": (10.0, 200.0, True),
    "mht_new_target_ratio": (0.01, 1.0, True),
}
MOST_HITS, LEAST_SCANS, MOST_SCANS = 4, 4, 6


@dataclass(frozen=True)
class Range:
    """What one parameter may be: from ``low`` to ``high``, or one of ``choices``."""

    node: str
    name: str
    low: float = 0.0
    high: float = 0.0
    log: bool = False
    choices: tuple[Any, ...] = ()

    @property
    def specification(self) -> Specification:
        """What is declared about the parameter."""
        return specifications(STAGE_TABLES[self.node])[self.name]

    def __contains__(self, value: object) -> bool:
        """Whether a value lies inside."""
        if self.choices:
            return value in self.choices
        return isinstance(value, int | float) and self.low <= value <= self.high

    def __str__(self) -> str:
        if self.choices:
            return " or ".join(_text(choice) for choice in self.choices)
        return f"{self.low:g} to {self.high:g}" + (", by logarithm" if self.log else "")


def with_point(base: Values, space: Sequence[Range], point: Point) -> dict[str, dict[str, Any]]:
    """Parameters ``{node: {name: value}}``: the base, and on top the values of a point."""
    merged = {node: dict(values) for node, values in base.items()}
    for item in space:
        if item.name in point:
            merged.setdefault(item.node, {})[item.name] = point[item.name]
    return merged


def base_value(base: Values, node: str, name: str) -> Any:
    """Value of a parameter in the base, its declared default if the base does not name it."""
    return base.get(node, {}).get(name, specifications(STAGE_TABLES[node])[name].default)


def base_point(base: Values, space: Sequence[Range]) -> dict[str, Any]:
    """The values of the base for the parameters that are searched."""
    return {item.name: base_value(base, item.node, item.name) for item in space}


def parse_range(text: str, base: Values) -> Range:
    """Read ``name=low:high``, ``name=low:high:log`` or ``name=one|other``.

    The name may have its node before it, ``track_manager.range_std_m``. ``base`` only serves to
    say what the default is where a range is refused.

    Raises
    ------
    ParameterError
        If the name is unknown or the parameter cannot have these values.
    """
    name, found, values = text.partition("=")
    if not found or not values:
        raise ParameterError(f"--parameter {text}: {HELP}")
    node, specification = _find(name.strip(), text)
    where = f"--parameter {text}"
    if specification.is_list:
        raise ParameterError(f"{where}: {specification.name} is a list, which is not searched")
    if specification.element_kind in (str, bool):
        return _choices(node, specification, values.split("|"), where)
    parts = values.split(":")
    if len(parts) not in (2, 3) or (len(parts) == 3 and parts[2] != "log"):
        default = base_value(base, node, specification.name)
        raise ParameterError(f"{where}: {HELP}; the default is {default}")
    try:
        low, high = (specification.check(float(part)) for part in parts[:2])
    except ParameterError as error:
        raise ParameterError(f"{where}: {error}") from error
    except ValueError as error:  # not a number
        raise ParameterError(f"{where}: {HELP}") from error
    log = len(parts) == 3
    if not low < high:
        raise ParameterError(f"{where}: allowed is a low that is less than high")
    if log and not low > 0:
        raise ParameterError(f"{where}: allowed is a low above 0 for a search by logarithm")
    return Range(node, specification.name, low, high, log)


def default_space(base: Values, recordings: Sequence[Recording]) -> list[Range]:
    """Ranges around the base of the parameters that most trackers need, and that act here.

    A parameter is left out where it cannot act: noise that all detections bring themselves,
    ``m_of_n`` under the sequential test and the other way round, trees without decision ``mht``. A
    track that may never end (``deletion_misses`` 0) stays so.
    """
    table = specifications(STAGE_TABLES[MANAGER])
    idle = _idle(base, recordings)
    space = []
    for name, factor in AROUND.items():
        value = base_value(base, MANAGER, name)
        if name in idle or not value > 0.0:
            continue
        low, high = _inside(table[name], value / factor, value * factor)
        space.append(Range(MANAGER, name, low, high, True))
    for name, (low, high, log) in BETWEEN.items():
        value = base_value(base, MANAGER, name)
        if name in idle or value <= 0:
            continue
        space.append(Range(MANAGER, name, min(low, value), max(high, value), log))
    if "confirmation_hits" not in idle:
        space += _confirmation(base)
    return space


def _confirmation(base: Values) -> list[Range]:
    """M and N of ``m_of_n``, so that M never exceeds N."""
    hits = base_value(base, MANAGER, "confirmation_hits")
    scans = base_value(base, MANAGER, "confirmation_scans")
    between = max(min(LEAST_SCANS, scans), hits)
    found = [Range(MANAGER, "confirmation_scans", between, max(MOST_SCANS, scans))]
    most = max(hits, min(MOST_HITS, between))
    if most > 2:
        found.insert(0, Range(MANAGER, "confirmation_hits", 2, most))
    return found


def _idle(base: Values, recordings: Sequence[Recording]) -> set[str]:
    """Names of parameters that cannot act."""
    scans = [scan for recording in recordings for scan in recording.detections]
    idle = set()
    for name, field in (("range_std_m", "range_std_m"), ("azimuth_std_rad", "azimuth_std_rad")):
        if all(s.covariance is not None or getattr(s, field) is not None for s in scans):
            idle.add(name)
    measured = [scan for scan in scans if scan.range_rate_mps is not None]
    brought = all(s.covariance is not None or s.range_rate_std_mps is not None for s in measured)
    if brought or not base_value(base, MANAGER, "use_range_rate"):
        idle.add("range_rate_std_mps")
    if base_value(base, MANAGER, "extraction") == SEQUENTIAL:
        idle |= {"confirmation_hits", "deletion_misses", "tentative_deletion_misses"}
    else:
        idle |= {"false_track_probability", "missed_track_probability"}
    if base_value(base, MANAGER, "clutter_density") != ESTIMATED:
        idle.add("clutter_memory_scans")
    if base_value(base, MANAGER, "decision") != "mht":
        idle.add("mht_new_target_ratio")
    return idle


def _inside(specification: Specification, low: float, high: float) -> tuple[float, float]:
    """The part of a range that is allowed."""
    if specification.maximum is not None:
        high = min(high, specification.maximum)
    if specification.minimum is not None:
        low = max(low, specification.minimum)
    return low, high


def _find(name: str, text: str) -> tuple[str, Specification]:
    node, dot, last = name.rpartition(".")
    if dot and node not in STAGE_TABLES:
        allowed = ", ".join(STAGE_TABLES)
        raise ParameterError(f"--parameter {text}: node {node}: allowed is one of {allowed}")
    for candidate in [node] if dot else list(STAGE_TABLES):
        known = specifications(STAGE_TABLES[candidate])
        if last in known:
            return candidate, known[last]
    from difflib import get_close_matches

    every = [each for table in STAGE_TABLES.values() for each in specifications(table)]
    close = get_close_matches(last, every, n=1)
    hint = f", did you mean {close[0]}?" if close else ""
    raise ParameterError(f"--parameter {text}: {last} is unknown{hint}")


def _choices(node: str, specification: Specification, words: Sequence[str], where: str) -> Range:
    truths = {"true": True, "false": False}
    values: list[Any] = list(words)
    if specification.element_kind is bool:
        values = [truths.get(word, word) for word in words]
    elif not specification.choices:
        raise ParameterError(f"{where}: {specification.name} is a text, which is not searched")
    try:
        checked = tuple(dict.fromkeys(specification.check(value) for value in values))
    except ParameterError as error:
        raise ParameterError(f"{where}: {error}") from error
    if len(checked) < 2:
        raise ParameterError(f"{where}: allowed are two choices or more, as in name=one|other")
    return Range(node, specification.name, choices=checked)


def _text(choice: Any) -> str:
    return str(choice).lower() if isinstance(choice, bool) else str(choice)
