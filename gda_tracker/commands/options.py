"""Options that several commands share: parameter files, methods, nodes and their tables."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gda_tracker.tracking.methods import parse_method
from gda_tracker.tracking.ring import stage_parameters

# Node whose parameters say what the fields of a radar mean; the four nodes do not know it.
RADAR_INPUT = "radar_input"
# Node that gives tracks out in the formats of others.
TRACK_OUTPUT = "track_output"
# Node that shows what the tracker does as markers.
MARKERS = "markers"
# Node that tracks the same detections by sets.
SET_VALUED_TRACKER = "set_valued_tracker"
# Node that fuses the tracks of several radars.
TRACK_FUSION = "track_fusion"
# Node that says what tracks do.
TRACK_EVENTS = "track_events"
# Node that counts the objects of formations.
TRACK_FORMATIONS = "track_formations"

Parameters = dict[str, dict[str, Any]]

METHOD_HELP = (
    "decision/attribute_term/filter, e.g. gda/none/cv (kinematics alone), gda/dsm_classic/cv "
    "(2004 chapter), map/bayes/cv (most probable joint hypothesis with Bayesian classes), "
    "mht/bayes/imm (hypothesis trees over several scans, manoeuvring targets), or default"
)


def add_parameter_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--params`` and ``--method``."""
    parser.add_argument(
        "--params",
        type=Path,
        metavar="FILE",
        help="parameters of the nodes, a ROS parameter YAML (see params/basic.yaml)",
    )
    parser.add_argument("--method", metavar="METHOD", help=METHOD_HELP)


def add_preset_option(parser: argparse.ArgumentParser) -> None:
    """Add ``--preset``."""
    parser.add_argument(
        "--preset",
        metavar="NAME",
        help="radar that this is, one of params/presets (docs/radars.md); --params goes on top",
    )


def gather_parameters(
    params: Path | None,
    method: str | None,
    preset: Mapping[str, Mapping[str, Any]] | None = None,
    preset_is_base: bool = False,
) -> Parameters:
    """Parameters ``{node: {name: value}}`` of the four nodes, checked.

    The file, else the preset; with ``preset_is_base`` the file on top of the preset. The method
    goes on top.

    Raises
    ------
    ParameterError
        For an unreadable file, an unknown node or parameter, or a value that is not allowed.
    """
    base = preset or {} if params is None or preset_is_base else {}
    merged = {node: dict(values) for node, values in base.items()}
    if params is not None:
        from gda_tracker.io.parameter_files import read_parameter_file

        for node, values in read_parameter_file(params).items():
            merged[node] = {**merged.get(node, {}), **values}
    for node in (
        RADAR_INPUT,
        TRACK_OUTPUT,
        MARKERS,
        SET_VALUED_TRACKER,
        TRACK_FUSION,
        TRACK_EVENTS,
        TRACK_FORMATIONS,
    ):
        merged.pop(node, None)
    if method is not None:
        merged["track_manager"] = {**merged.get("track_manager", {}), **parse_method(method)}
    stage_parameters(merged)
    return merged


def radar_input_of_file(params: Path | None) -> dict[str, Any] | None:
    """Parameters of the radar input in a file, ``None`` if it says nothing about it.

    Raises
    ------
    ParameterError
        As :func:`gather_parameters`.
    """
    return node_of_file(params, RADAR_INPUT)


def node_of_file(params: Path | None, node: str) -> dict[str, Any] | None:
    """Parameters of one node in a file, ``None`` if it says nothing about it.

    Raises
    ------
    ParameterError
        As :func:`gather_parameters`.
    """
    if params is None:
        return None
    from gda_tracker.io.parameter_files import read_parameter_file

    return read_parameter_file(params).get(node)
