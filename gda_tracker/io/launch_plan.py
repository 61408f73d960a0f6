"""What the launch files start, as plain data: nodes, their parameters, programs, the environment.

The launch files in ``launch/`` turn a plan into launch actions and hold no logic of their own.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gda_tracker.errors import UserError
from gda_tracker.io.markers.parameters import LAYERS, marker_topic, marker_topics
from gda_tracker.io.parameter_files import (
    MARKERS,
    RADAR_INPUT,
    SET_VALUED_TRACKER,
    TRACK_EVENTS,
    TRACK_FORMATIONS,
    TRACK_FUSION,
    TRACK_OUTPUT,
    read_parameter_file,
)
from gda_tracker.resources import resource
from gda_tracker.tracking.ring import STAGE_TABLES

STAGES = tuple(STAGE_TABLES)
OUTPUTS = ("radar_tracks", "detections_3d", "tracked_objects")
PROCESSES = ("four", "one")
# Markers of the scenarios are this much larger than those of a road.
DEMO_SCALE = 100.0
SWITCHES = {"true": True, "1": True, "false": False, "0": False}


class LaunchError(UserError):
    """A launch argument is not allowed; the message is one line and names it."""


@dataclass(frozen=True, slots=True)
class Argument:
    """An argument of a launch file: name, default, one line of help."""

    name: str
    default: str
    description: str


@dataclass(frozen=True, slots=True)
class NodePlan:
    """One node: its executable (also its name) and parameters, files and values, the last wins."""

    executable: str
    parameters: list[str | dict[str, Any]]
    respawn: bool = True
    namespace: str | None = None
    """In place of the plan's."""


@dataclass(slots=True)
class Plan:
    """All that is started; ``programs`` are command lines, ``environment`` is set before."""

    namespace: str = ""
    environment: dict[str, str] = field(default_factory=dict)
    nodes: list[NodePlan] = field(default_factory=list)
    programs: list[list[str]] = field(default_factory=list)


TRACKER_ARGUMENTS = (
    Argument("topic", "", "topic of the radar's driver; empty: the topic detections is read"),
    Argument("preset", "", "radar that this is, one of params/presets (docs/radars.md)"),
    Argument("params", "", "parameter file of the nodes, on top of the preset"),
    Argument("namespace", "", "namespace of nodes and topics"),
    Argument("use_sim_time", "", "true: time comes on /clock; empty: true with bag, else false"),
    Argument("bag", "", "bag that is played, with its clock"),
    Argument("record", "", "folder of a bag into which all topics are recorded"),
    Argument("outputs", "", f"formats beside tracks, with commas between: {', '.join(OUTPUTS)}"),
    Argument("rviz", "false", "true: start RViz too, and the node markers for it"),
    Argument("markers", "false", "true: start the node markers, and record them with record"),
    Argument("set_valued", "false", "true: start the node set_valued_tracker too"),
    Argument(
        "events", "", "file of lanes and plans, or true without one: start the node track_events"
    ),
    Argument("formations", "false", "true: start the node track_formations too"),
    Argument("autostart", "true", "false: nodes wait for their lifecycle transitions"),
    Argument("processes", "four", "four: one process per node; one: all nodes in one process"),
)
FUSION_ARGUMENTS = (
    Argument("radars", "radar_1,radar_2", "namespaces of the rings, with commas between"),
    Argument("topics", "", "topics of the radars' drivers in that order; empty: NAME/detections"),
    Argument("presets", "", "presets of the radars in that order, or one for all (docs/radars.md)"),
    Argument("params", "", "parameter file of all nodes, on top of the presets"),
    Argument("rings", "true", "false: the rings run already, only track_fusion is started"),
    Argument("use_sim_time", "false", "true: time comes on /clock"),
    Argument("rviz", "false", "true: start RViz too"),
)
DEMO_ARGUMENTS = (
    Argument("input", "crossing_targets", "scenario by name or file"),
    Argument("method", "default", "decision/attribute_term/filter, or default"),
    Argument("rate", "1.0", "speed relative to the scenario's time; 0: as fast as it goes"),
    Argument("namespace", "", "namespace of nodes and topics"),
    Argument("record", "", "folder of a bag into which all topics are recorded"),
    Argument("rviz", "false", "true: start RViz too, and the node markers for it"),
)


def tracker_plan(values: Mapping[str, str], environment: Mapping[str, str]) -> Plan:
    """Return what ``tracker.launch.py`` starts.

    Parameters
    ----------
    values
        Of :data:`TRACKER_ARGUMENTS` by name.
    environment
        Of the process that launches.

    Raises
    ------
    UserError
        If an argument, the preset or the parameter file is not allowed.
    """
    sim_time = _switch(values, "use_sim_time", bool(values["bag"]))
    autostart = _switch(values, "autostart")
    files = _parameter_files(values["preset"], values["params"])
    outputs = [name.strip() for name in values["outputs"].split(",") if name.strip()]
    for name in outputs:
        if name not in OUTPUTS:
            raise LaunchError(f"outputs:={name}: allowed is one of {', '.join(OUTPUTS)}")
    rviz, markers = _switch(values, "rviz"), _switch(values, "markers")
    sets = _switch(values, "set_valued")
    plan = _plan(values, environment, sim_time)
    if values["processes"] == "one":
        if not autostart:
            raise LaunchError("autostart:=false: allowed with processes:=four only")
        plan.programs.append(_run_command(values, outputs, sim_time, markers or rviz, sets))
    elif values["processes"] == "four":
        common = {"use_sim_time": sim_time, "autostart": autostart}
        nodes: dict[str, dict[str, Any]] = {stage: {} for stage in STAGES}
        if values["topic"]:
            nodes[RADAR_INPUT] = {"input_topic": values["topic"]}
        if outputs:
            nodes[TRACK_OUTPUT] = {name: name for name in outputs}
        if markers or rviz:
            nodes[MARKERS] = {}
        if sets:
            nodes[SET_VALUED_TRACKER] = {}
        if _events_wanted(values):
            nodes[TRACK_EVENTS] = _context_file(values)
        if _switch(values, "formations"):
            nodes[TRACK_FORMATIONS] = {}
        plan.nodes += [NodePlan(node, [*files, {**own, **common}]) for node, own in nodes.items()]
        _record(plan, values["record"], outputs, markers)
    else:
        raise LaunchError(
            f"processes:={values['processes']}: allowed is one of {', '.join(PROCESSES)}"
        )
    if values["bag"]:
        # The scans of a bag that is played without its clock would be of the past.
        plan.programs.append(["ros2", "bag", "play", values["bag"], *(["--clock"] * sim_time)])
    return plan


def fusion_plan(values: Mapping[str, str], environment: Mapping[str, str]) -> Plan:
    """Return what ``fusion.launch.py`` starts: a ring per radar in its namespace, and track_fusion.

    Raises
    ------
    UserError
        If an argument, a preset or the parameter file is not allowed.
    """
    radars = _words(values["radars"])
    if len(radars) < 2 or len(set(radars)) < len(radars):
        raise LaunchError(f"radars:={values['radars']}: allowed are 2 or more names that differ")
    topics = _per_radar(values, "topics", len(radars), (0, len(radars)))
    presets = _per_radar(values, "presets", len(radars), (0, 1, len(radars)))
    sim_time = _switch(values, "use_sim_time")
    common = {"use_sim_time": sim_time}
    plan = _plan({**values, "namespace": ""}, environment, sim_time)
    # A file for all radars is checked once; ROS gives its entries to the nodes of any namespace.
    own = _parameter_files("", values["params"])
    rings = zip(radars, topics, presets, strict=True) if _switch(values, "rings") else ()
    for radar, topic, preset in rings:
        files = [*_parameter_files(preset, ""), *own]
        nodes: dict[str, dict[str, Any]] = {stage: {} for stage in STAGES}
        if topic:
            nodes[RADAR_INPUT] = {"input_topic": topic}
        plan.nodes += [
            NodePlan(node, [*files, {**table, **common}], namespace=radar)
            for node, table in nodes.items()
        ]
    plan.nodes.append(NodePlan(TRACK_FUSION, [*own, {"radars": radars, **common}]))
    return plan


def _words(text: str) -> list[str]:
    return [word for part in text.split(",") if (word := part.strip().strip("/"))]


def _per_radar(
    values: Mapping[str, str], name: str, n_radars: int, allowed: tuple[int, ...]
) -> list[str]:
    """Return the entries of a list, one per radar; empty ones where there are none."""
    found = [part.strip() for part in values[name].split(",")] if values[name].strip() else []
    if len(found) not in allowed:
        sizes = " or ".join(str(size) for size in dict.fromkeys(allowed))
        raise LaunchError(f"{name}:={values[name]}: allowed are {sizes} entries")
    return found * n_radars if len(found) == 1 else found or [""] * n_radars


def demo_plan(values: Mapping[str, str], environment: Mapping[str, str]) -> Plan:
    """Return what ``demo.launch.py`` starts: the ring, and a scenario that is played into it.

    Raises
    ------
    UserError
        If an argument is not allowed.
    """
    from gda_tracker.simulation.playback import with_method
    from gda_tracker.simulation.preset import tracker_preset
    from gda_tracker.simulation.scenarios import load_scenario
    from gda_tracker.tracking.methods import parse_method
    from gda_tracker.tracking.ring import stage_parameters

    try:
        rate = float(values["rate"])
    except ValueError:
        rate = -1.0
    if not 0.0 <= rate < float("inf"):
        raise LaunchError(f"rate:={values['rate']}: allowed is a number >= 0")
    parse_method(values["method"])
    parameters = with_method(tracker_preset(load_scenario(values["input"])), values["method"])
    tables = stage_parameters(parameters)
    manager = tables["track_manager"]
    method = f"{manager.decision}/{manager.attribute_term}/{manager.filter}"
    plan = _plan(values, environment, sim_time=False)
    if _switch(values, "rviz"):
        # A scenario is seen from 10 km and more.
        plan.nodes.append(NodePlan(MARKERS, [{"scale": DEMO_SCALE}]))
    for stage in STAGES:
        # In the declared types; launch takes no empty lists, which are the defaults anyway.
        own = {name: getattr(tables[stage], name) for name in parameters.get(stage, {})}
        own = {name: value for name, value in own.items() if value != []}
        plan.nodes.append(NodePlan(stage, [own] if own else []))
    source = {"input": values["input"], "method": method, "rate": rate}
    plan.nodes.append(NodePlan("scan_source", [source], respawn=False))
    _record(plan, values["record"], [])
    return plan


def _plan(values: Mapping[str, str], environment: Mapping[str, str], sim_time: bool) -> Plan:
    """Return a plan of what all launch files start."""
    plan = Plan(values["namespace"].strip("/"))
    spellings = ("FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE")
    if not any(environment.get(name) for name in spellings):
        # A shared-memory segment that large scans fit into.
        plan.environment = dict.fromkeys(spellings, str(resource("params", "fastdds.xml")))
    if _switch(values, "rviz"):
        plan.programs.append(_rviz_command(plan.namespace, sim_time))
    return plan


def _rviz_command(namespace: str, sim_time: bool) -> list[str]:
    """Return the command that starts RViz with all layers; their topics move with the namespace."""
    command = ["rviz2", "-d", str(resource("launch", "tracker.rviz")), "--ros-args"]
    command += ["-p", f"use_sim_time:={str(sim_time).lower()}"]
    if namespace:
        for layer in LAYERS:
            topic = marker_topic(layer)
            command += ["-r", f"/{topic}:=/{namespace}/{topic}"]
    return command


def _switch(values: Mapping[str, str], name: str, otherwise: bool | None = None) -> bool:
    text = values[name].strip().lower()
    if not text and otherwise is not None:
        return otherwise
    if text not in SWITCHES:
        raise LaunchError(f"{name}:={values[name]}: allowed is true or false")
    return SWITCHES[text]


def _parameter_files(preset: str, params: str) -> list[str | dict[str, Any]]:
    """Return the files in the order in which nodes read them; all are checked."""
    from gda_tracker.io.parameter_files import read_preset

    files: list[str | dict[str, Any]] = []
    if preset:
        read_preset(preset)
        files.append(str(resource("params", "presets", f"{preset}.yaml")))
    if params:
        read_parameter_file(params)
        files.append(os.path.abspath(Path(params).expanduser()))
    return files


def _record(plan: Plan, folder: str, outputs: list[str], markers: bool = False) -> None:
    from gda_tracker.io.track_outputs import FORMATS

    if folder:
        # A bag is begun once: a second start would find its folder.
        own: dict[str, Any] = {"bag": folder}
        also = [f"{name}={FORMATS[name][0]}" for name in outputs]
        also += marker_topics() if markers else []
        if also:
            own["also"] = also
        plan.nodes.append(NodePlan("recorder", [own], respawn=False))


def _events_wanted(values: Mapping[str, str]) -> bool:
    return values["events"] not in ("", "false", "0")


def _context_file(values: Mapping[str, str]) -> dict[str, str]:
    """Parameters of node track_events; the file is read now, to say what is wrong with it."""
    from gda_tracker.io.context_files import read_context_file
    from gda_tracker.tracking.context_files import full_path

    if SWITCHES.get(values["events"]):
        return {}
    path = os.path.abspath(full_path(values["events"]))
    read_context_file(path)
    return {"context_file": path}


def _run_command(
    values: Mapping[str, str], outputs: list[str], sim_time: bool, markers: bool, sets: bool
) -> list[str]:
    command = ["gda-tracker", "run"]
    for option, name in (
        ("--input", "topic"),
        ("--preset", "preset"),
        ("--params", "params"),
        ("--namespace", "namespace"),
        ("--bag", "record"),
    ):
        if values[name]:
            command += [option, values[name]]
    for name in outputs:
        command += ["--output", name]
    if _events_wanted(values):
        command += ["--events", *_context_file(values).values()]
    if _switch(values, "formations"):
        command.append("--formations")
    switches = {"--use-sim-time": sim_time, "--markers": markers, "--set-valued": sets}
    return [*command, *(option for option, given in switches.items() if given)]
