"""Options that several commands share: parameter files, methods, nodes and their tables."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gda_tracker.tracking.methods import parse_method
from gda_tracker.tracking.ring import stage_parameters

Parameters = dict[str, dict[str, Any]]

METHOD_HELP = (
    "decision/attribute_term/filter, e.g. gda/none/cv (kinematics alone), gda/dsm_classic/cv "
    "(2004 chapter), map/bayes/cv (most probable joint hypothesis with Bayesian classes)"
)


def add_parameter_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--params`` and ``--method``."""
    parser.add_argument(
        "--params",
        type=Path,
        metavar="FILE",
        help="parameters of the nodes, a ROS parameter YAML (see params/gda_tracker.yaml)",
    )
    parser.add_argument("--method", metavar="METHOD", help=METHOD_HELP)


def gather_parameters(
    params: Path | None, method: str | None, preset: Mapping[str, Mapping[str, Any]] | None = None
) -> Parameters:
    """Parameters ``{node: {name: value}}``: the file, else the preset; the method on top; checked.

    Raises
    ------
    ParameterError
        For an unreadable file, an unknown node or parameter, or a value that is not allowed.
    """
    if params is not None:
        from gda_tracker.io.parameter_files import read_parameter_file

        found: Mapping[str, Mapping[str, Any]] = read_parameter_file(params)
    else:
        found = preset or {}
    merged = {node: dict(values) for node, values in found.items()}
    if method is not None:
        merged["track_manager"] = {**merged.get("track_manager", {}), **parse_method(method)}
    stage_parameters(merged)
    return merged
