"""ROS parameter files: read with every name and value checked, written with comments.

ROS ignores a misspelt name in a parameter file without a word; here it is an error. A file looks
so, with the node's name alone, or behind a namespace or wildcard (``/**``, ``/**/track_manager``,
``/radar/track_manager``)::

    /**/track_manager:
      ros__parameters:
        range_std_m: 5.0

A key that stands for every node (``/**``) gives each parameter to the nodes that know it. Of two
entries for one parameter the later one in the file holds.
"""

from __future__ import annotations

import difflib
import math
import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from gda_tracker.io.extended_input import fault_of_clusters
from gda_tracker.parameters import ParameterError, Specification, from_mapping, specifications
from gda_tracker.resources import resource
from gda_tracker.yaml_text import YamlError, load_yaml

PARAMETERS = "ros__parameters"
WILDCARDS = ("**", "*")
# Parameters that every node has and no table declares: they are left to ROS and the node.
OF_EVERY_NODE = ("autostart", "use_sim_time", "start_type_description_service", "qos_overrides")

# The node that makes detections of what a radar publishes.
RADAR_INPUT = "radar_input"
# The node that tracks by sets.
SET_VALUED_TRACKER = "set_valued_tracker"
# The node that gives tracks out in the formats of others.
TRACK_OUTPUT = "track_output"
# The node that shows what the tracker does as markers.
MARKERS = "markers"
# The node that fuses the tracks of several radars.
TRACK_FUSION = "track_fusion"
# The node that says what tracks do: leave their lane, stop, split off.
TRACK_EVENTS = "track_events"
# The node that counts the objects of formations.
TRACK_FORMATIONS = "track_formations"

Values = dict[str, dict[str, Any]]


class ParameterFileError(ParameterError):
    """A parameter file cannot be read; the message is one line and names the file."""


def stage_tables() -> dict[str, type]:
    """Return the parameter tables of the four nodes of the ring, by node name."""
    from gda_tracker.tracking.ring import STAGE_TABLES

    return dict(STAGE_TABLES)


def known_tables() -> dict[str, type]:
    """Return the tables that a parameter file may hold: of the ring and the nodes beside it."""
    from gda_tracker.events.parameters import EventParameters
    from gda_tracker.formations.parameters import FormationParameters
    from gda_tracker.fusion.parameters import TrackFusionParameters
    from gda_tracker.io.markers.parameters import MarkerParameters
    from gda_tracker.io.radar.input_parameters import RadarInputParameters
    from gda_tracker.io.track_output_parameters import TrackOutputParameters
    from gda_tracker.tracking.set_valued.parameters import SetValuedParameters

    return {
        **stage_tables(),
        RADAR_INPUT: RadarInputParameters,
        TRACK_OUTPUT: TrackOutputParameters,
        MARKERS: MarkerParameters,
        SET_VALUED_TRACKER: SetValuedParameters,
        TRACK_FUSION: TrackFusionParameters,
        TRACK_EVENTS: EventParameters,
        TRACK_FORMATIONS: FormationParameters,
    }


# --- reading --------------------------------------------------------------------------------------


def read_parameter_file(path: str | Path, tables: Mapping[str, type] | None = None) -> Values:
    """Return the parameters of a file by node, in the types that are declared.

    Parameters
    ----------
    path
        YAML file.
    tables
        Parameter tables of the nodes that may occur; by default those of :func:`known_tables`.

    Returns
    -------
    dict
        ``{node: {name: value}}`` with the nodes that occur in the file, in its order.

    Raises
    ------
    ParameterFileError
        If the file is not a parameter file, names a node or a parameter that does not exist, or has
        a value that is not allowed.
    """
    path = Path(path)
    return check_parameters(_load(path), known_tables() if tables is None else tables, str(path))


def shipped_presets() -> list[str]:
    """Return the names of the presets that come with the package."""
    return sorted(path.stem for path in resource("params", "presets").glob("*.yaml"))


def read_preset(name: str) -> Values:
    """Return the parameters of the preset ``params/presets/<name>.yaml``.

    Raises
    ------
    ParameterFileError
        If there is none of this name; the message names the others.
    """
    known = shipped_presets()
    if name not in known:
        raise ParameterFileError(f"preset {name!r}: allowed is one of {', '.join(known)}")
    return read_parameter_file(resource("params", "presets", f"{name}.yaml"))


def check_parameters(content: Any, tables: Mapping[str, type], source: str) -> Values:
    """Return the parameters in the content of a parameter file, see :func:`read_parameter_file`.

    ``source`` names the content in errors.
    """
    known = {node: specifications(table) for node, table in tables.items()}
    found: Values = {}
    for node, entries in _nodes(content, source):
        if node in WILDCARDS:
            _spread(entries, known, found, source)
            continue
        if node not in known:
            raise ParameterFileError(
                f"{source}: node {node}: unknown{_hint(node, known)}; known are {', '.join(known)}"
            )
        values = found.setdefault(node, {})
        for name, value in entries.items():
            if name not in known[node]:
                hint = _hint(name, known[node])
                raise ParameterFileError(f"{source}: node {node}: parameter {name}: unknown{hint}")
            values[name] = _check(known[node][name], value, f"{source}: node {node}")
    for node, values in found.items():
        try:
            from_mapping(tables[node], values)  # combinations of parameters
        except ParameterError as error:
            raise ParameterFileError(f"{source}: node {node}: {error}") from error
    fault = fault_of_clusters(found.get(RADAR_INPUT, {}), found.get("track_manager", {}))
    if fault:
        raise ParameterFileError(f"{source}: {fault}")
    return found


def _spread(
    entries: Mapping[str, Any],
    known: Mapping[str, Mapping[str, Specification]],
    found: Values,
    source: str,
) -> None:
    """Give each entry of a wildcard to all nodes that know it."""
    for name, value in entries.items():
        nodes = [node for node, declared in known.items() if name in declared]
        if not nodes:
            every = sorted({each for declared in known.values() for each in declared})
            raise ParameterFileError(
                f"{source}: parameter {name}: unknown to every node{_hint(name, every)}"
            )
        for node in nodes:
            checked = _check(known[node][name], value, f"{source}: node {node}")
            found.setdefault(node, {})[name] = checked


def _check(specification: Specification, value: Any, where: str) -> Any:
    try:
        return specification.check(value)
    except ParameterError as error:
        raise ParameterFileError(f"{where}: {error}") from error


def _hint(name: str, known: Any) -> str:
    close = difflib.get_close_matches(name, list(known), n=1)
    return f", did you mean {close[0]}?" if close else ""


def _nodes(content: Any, source: str, namespace: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the last part of each node's key, and its parameters, flat."""
    if not isinstance(content, dict) or not content:
        where = f" below {namespace}" if namespace else ""
        raise ParameterFileError(f"{source}: no node{where}: expected 'node: {PARAMETERS}: ...'")
    for key, below in content.items():
        if not isinstance(key, str) or not key.strip("/"):
            raise ParameterFileError(f"{source}: {key!r} is not the name of a node")
        full = f"{namespace}/{key.strip('/')}"
        if not isinstance(below, dict):
            raise ParameterFileError(f"{source}: {full.lstrip('/')}: {PARAMETERS} is missing")
        if PARAMETERS not in below:
            yield from _nodes(below, source, full)
            continue
        if len(below) > 1:
            other = next(name for name in below if name != PARAMETERS)
            raise ParameterFileError(f"{source}: {key}: {other} stands beside {PARAMETERS}")
        parameters = below[PARAMETERS]
        if parameters is None:
            parameters = {}
        if not isinstance(parameters, dict):
            raise ParameterFileError(f"{source}: {key}: {PARAMETERS} is not 'name: value' lines")
        flat = dict(_flatten(parameters))
        yield (
            full.rsplit("/", 1)[-1],
            {name: flat[name] for name in flat if name.split(".")[0] not in OF_EVERY_NODE},
        )


def _flatten(parameters: Mapping[Any, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in parameters.items():
        if isinstance(value, dict):
            yield from _flatten(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def _load(path: Path) -> Any:
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ParameterFileError(f"{path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ParameterFileError(f"{path}: not a text file") from error
    return read_yaml(text, str(path))


def read_yaml(text: str, source: str) -> Any:
    """Return the content of YAML as ROS reads it; ``source`` names it in errors.

    Raises
    ------
    ParameterFileError
        If it is not YAML, or a key occurs twice.
    """
    try:
        return load_yaml(text, source)
    except YamlError as error:
        raise ParameterFileError(str(error)) from error


# --- writing --------------------------------------------------------------------------------------


def parameter_yaml(
    tables: Mapping[str, type],
    advanced: bool | None,
    values: Mapping[str, Mapping[str, Any]] | None = None,
) -> str:
    """Return a commented parameter file of the basic, or of the advanced, parameters.

    Parameters
    ----------
    tables
        Parameter tables by node name.
    advanced
        Which half; ``None`` for both.
    values
        Values by node where they are not the defaults; unknown names raise
        :class:`~gda_tracker.parameters.ParameterError`.

    Returns
    -------
    str
        YAML; nodes without a parameter of this half are left out.
    """
    values = values or {}
    blocks = []
    for node, table in tables.items():
        declared = specifications(table)
        given = values.get(node, {})
        from_mapping(table, given)
        lines = [f"/**/{node}:", f"  {PARAMETERS}:"]
        for name, specification in declared.items():
            if advanced is None or specification.advanced == advanced:
                lines += _entry(specification, given.get(name, specification.default))
        if len(lines) > 2:
            blocks.append("\n".join(lines) + "\n")
    return "\n".join(blocks)


def _entry(specification: Specification, value: Any) -> list[str]:
    text = specification.description[:1].upper() + specification.description[1:]
    text = f"{text}. Allowed: {specification.allowed}."
    if not specification.live:
        text += " Fixed at start-up."
    comment = textwrap.wrap(
        text, 92, initial_indent="    # ", subsequent_indent="    # ", break_on_hyphens=False
    )
    return [*comment, f"    {specification.name}: {yaml_value(value, specification.element_kind)}"]


def yaml_value(value: Any, kind: type) -> str:
    """Return a value as ROS reads it back in the same type: ``1.0``, not ``1``, for a float."""
    if isinstance(value, list | tuple):
        return "[" + ", ".join(yaml_value(element, kind) for element in value) + "]"
    if kind is bool:
        return "true" if value else "false"
    if kind is float:
        value = float(value)
        if not math.isfinite(value):
            raise ParameterError(f"{value} cannot stand in a parameter file")
        mantissa, exponent, power = repr(value).partition("e")
        return mantissa + ("" if "." in mantissa else ".0") + exponent + power
    if kind is int:
        return str(int(value))
    return '"' + str(value).replace("\\", "\\\\").replace('"', '\\"') + '"'
