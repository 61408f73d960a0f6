"""Scenarios: who flies where, what the sensor sees, and what the tracker is told.

A scenario is one YAML file (``params/scenarios``). Everything a tracker may know stands in the
sections ``tracker`` and ``attribute``, and the RCS model of the clutter; the rest is truth and
never reaches it. The key ``monte_carlo`` and keys that start with ``expected_`` are notes: kept,
never interpreted here.

>>> scenario = load_scenario("crossing_targets")
>>> [target.class_name for target in scenario.targets]
['fighter', 'cargo']
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import yaml

from gda_tracker.resources import resource
from gda_tracker.simulation.extended_targets import ExtendedKnowledge, Extent
from gda_tracker.simulation.schema import ScenarioError, check_keys, check_list, read_section
from gda_tracker.simulation.sensor_sections import ModelledSensor, ReachSection, read_sensors
from gda_tracker.simulation.signal_strengths import check_strengths
from gda_tracker.simulation.tracker_sections import (
    Attribute,
    KnownClass,
    Membership,
    TrackerKnowledge,
)
from gda_tracker.simulation.world_sections import Clutter, Manoeuvre, Sensor, Stop, Target, Timing

NOTES = "monte_carlo"
NOTES_PREFIX = "expected_"


@dataclass(frozen=True)
class Scenario:
    """A scenario file, read and checked; ``notes`` are ``monte_carlo`` and ``expected_*``.

    With several ``sensors``, each with a model of its own, ``sensor`` stands for the first of them
    where one noise and one place are asked for, ``reach`` is there, and the tracks start by
    themselves; so they do where ``extended`` tells of targets with several detections a scan.
    """

    name: str
    time: Timing
    sensor: Sensor
    clutter: Clutter
    targets: tuple[Target, ...]
    tracker: TrackerKnowledge
    attribute: Attribute
    sensors: tuple[ModelledSensor, ...] = ()
    reach: ReachSection | None = None
    extended: ExtendedKnowledge | None = None
    notes: Mapping[str, Any] = field(default_factory=dict)

    @property
    def only_automatic(self) -> bool:
        """Whether tracks can start by themselves only."""
        return bool(self.sensors) or self.extended is not None


def shipped_scenarios() -> dict[str, Path]:
    """Return the scenarios that come with the package: path by name, in alphabetical order."""
    return {path.stem: path for path in sorted(resource("params", "scenarios").glob("*.yaml"))}


def load_scenario(name_or_path: str | Path) -> Scenario:
    """Read and check a scenario.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a shipped scenario, or the path of a YAML file.

    Raises
    ------
    ScenarioError
        If there is no such scenario, the file cannot be read, or its contents are not allowed.
    """
    shipped = shipped_scenarios()
    path = shipped.get(str(name_or_path), Path(name_or_path))
    if not path.exists():
        raise ScenarioError(
            f"scenario {str(name_or_path)!r}: neither a file nor a shipped scenario; shipped are "
            f"{', '.join(shipped)}"
        )
    try:
        content = yaml.load(path.read_text(encoding="utf-8"), Loader=_Loader)
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(f"scenario {path}: cannot be read: {error}") from None
    except yaml.YAMLError as error:
        raise ScenarioError(f"scenario {path}: not valid YAML: {_one_line(error)}") from None
    scenario = scenario_from_mapping(content, f"scenario {path}")
    if not scenario.tracker.context_file:
        return scenario
    told = path.resolve().parent / scenario.tracker.context_file
    return replace(scenario, tracker=replace(scenario.tracker, context_file=str(told)))


def scenario_from_mapping(content: Any, where: str = "scenario") -> Scenario:
    """Check the contents of a scenario file; ``where`` begins every message.

    Raises
    ------
    ScenarioError
        Naming the section, the key, its value and what is allowed.
    """
    several = isinstance(content, Mapping) and "sensors" in content
    sections = ["name", "time", "clutter", "targets", "tracker", "attribute"]
    sections += ["sensors", "reach"] if several else ["sensor"]
    extended = isinstance(content, Mapping) and "extended" in content
    sections += ["extended"] if extended else []
    notes = {}
    if isinstance(content, Mapping):
        notes = {k: v for k, v in content.items() if k == NOTES or str(k).startswith(NOTES_PREFIX)}
        content = {k: v for k, v in content.items() if k not in notes}
    check_keys(content, sections, sections, where)
    name = content["name"]
    if not isinstance(name, str) or not name:
        raise ScenarioError(f"{where}: name = {name!r}: allowed is a text")
    attribute = _read_attribute(content["attribute"], f"{where}: attribute")
    targets = tuple(
        _read_target(entry, f"{where}: targets[{index}]")
        for index, entry in enumerate(check_list(content["targets"], f"{where}: targets", 1))
    )
    _check_targets(targets, attribute, f"{where}: targets")
    if not several:
        check_strengths(content["sensor"], targets, where)
    sensors = read_sensors(content, where) if several else ()
    if any(target.extent for target in targets) and (several or not extended):
        raise ScenarioError(
            f"{where}: targets with an extent: allowed with the sections sensor and extended"
        )
    given = content["sensor"] if extended and isinstance(content.get("sensor"), Mapping) else {}
    others = (
        "false_alarm_probability",
        "resolution_range_m",
        "blind_speed_mps",
        "range_rate_std_mps",
    )
    for other in others:
        if given.get(other):
            raise ScenarioError(
                f"{where}: sensor: {other} = {given[other]}: allowed is none with the section "
                "extended"
            )
    return Scenario(
        name=name,
        time=read_section(Timing, content["time"], f"{where}: time"),
        sensor=(
            Sensor(
                sensors[0].position_m,
                sensors[0].azimuth_std_deg,
                sensors[0].range_std_m,
                sensors[0].detection_probability,
            )
            if several
            else read_section(Sensor, content["sensor"], f"{where}: sensor")
        ),
        clutter=read_section(Clutter, content["clutter"], f"{where}: clutter"),
        targets=targets,
        tracker=read_section(TrackerKnowledge, content["tracker"], f"{where}: tracker"),
        attribute=attribute,
        sensors=sensors,
        reach=(
            read_section(ReachSection, content["reach"], f"{where}: reach") if several else None
        ),
        extended=(
            read_section(ExtendedKnowledge, content["extended"], f"{where}: extended")
            if extended
            else None
        ),
        notes=notes,
    )


def _read_target(entry: Any, where: str) -> Target:
    if isinstance(entry, Mapping):
        entry = {("class_name" if k == "class" else k): v for k, v in entry.items()}
    turns = entry.get("manoeuvres", []) if isinstance(entry, Mapping) else []
    halts = entry.get("stops", []) if isinstance(entry, Mapping) else []
    manoeuvres = tuple(
        read_section(Manoeuvre, turn, f"{where}: manoeuvres[{index}]")
        for index, turn in enumerate(check_list(turns, f"{where}: manoeuvres", 0))
    )
    extent = entry.get("extent") if isinstance(entry, Mapping) else None
    if extent is not None:
        extent = read_section(Extent, extent, f"{where}: extent")
    stops = tuple(
        read_section(Stop, halt, f"{where}: stops[{index}]")
        for index, halt in enumerate(check_list(halts, f"{where}: stops", 0))
    )
    return read_section(Target, entry, where, manoeuvres=manoeuvres, stops=stops, extent=extent)


def _read_attribute(content: Any, where: str) -> Attribute:
    check_keys(
        content,
        ["classes", "membership", "missed_track_hypotheses", "history_initialisation"],
        ["classes"],
        where,
    )
    classes = tuple(
        read_section(KnownClass, entry, f"{where}: classes[{index}]")
        for index, entry in enumerate(check_list(content["classes"], f"{where}: classes", 2))
    )
    names = [known.name for known in classes]
    if len(set(names)) < len(names):
        raise ScenarioError(f"{where}: classes = {names}: allowed are names that differ")
    membership = read_section(Membership, content.get("membership", {}), f"{where}: membership")
    return read_section(Attribute, content, where, classes=classes, membership=membership)


def _check_targets(targets: tuple[Target, ...], attribute: Attribute, where: str) -> None:
    ids = [target.id for target in targets]
    if len(set(ids)) < len(ids):
        raise ScenarioError(f"{where}: id = {ids}: allowed are ids that differ")
    known = [entry.name for entry in attribute.classes]
    for target in targets:
        if target.class_name not in known:
            raise ScenarioError(
                f"{where}: class = {target.class_name!r}: allowed are the names in "
                f"attribute.classes: {', '.join(known)}"
            )


def _one_line(error: yaml.YAMLError) -> str:
    return " ".join(str(error).split())


class _Loader(yaml.SafeLoader):
    """YAML as people write it: 1e-6 is a number (YAML 1.2), a key given twice is an error."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        names = [name.value for name, _ in node.value]
        for name in names:
            if names.count(name) > 1 and name != "<<":
                raise yaml.constructor.ConstructorError(
                    None, None, f"key {name!r} is given twice", node.start_mark
                )
        return super().construct_mapping(node, deep)


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)[eE][-+]?[0-9]+$"),
    list("-+0123456789."),
)
