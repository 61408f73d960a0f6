"""``gda-tracker run --set-valued``: which nodes start, with which parameters."""

from __future__ import annotations

import argparse

import pytest

from gda_tracker.commands import run
from gda_tracker.commands.options import SET_VALUED_TRACKER
from gda_tracker.commands.run_nodes import what_runs
from gda_tracker.io.launch_plan import TRACKER_ARGUMENTS, tracker_plan
from gda_tracker.io.parameter_files import ParameterFileError
from gda_tracker.resources import resource


def parameters_of(*words):
    parser = argparse.ArgumentParser()
    run.add_arguments(parser)
    return run._parameters(parser.parse_args(words))


def test_the_node_starts_when_asked_for_with_the_parameters_of_the_file(tmp_path):
    assert SET_VALUED_TRACKER not in parameters_of()
    assert parameters_of("--set-valued")[SET_VALUED_TRACKER] == {}
    assert what_runs(parameters_of("--set-valued")) == "four nodes and the set-valued tracker"
    path = tmp_path / "sets.yaml"
    path.write_text("/**/set_valued_tracker:\n  ros__parameters:\n    theta: 4.0\n")
    assert SET_VALUED_TRACKER not in parameters_of("--params", str(path))
    found = parameters_of("--params", str(path), "--set-valued")
    assert found[SET_VALUED_TRACKER] == {"theta": 4.0}
    # It tracks in the frame of the others.
    frame = "/**/track_manager:\n  ros__parameters:\n    tracking_frame: odom\n"
    path.write_text(path.read_text() + frame)
    found = parameters_of("--params", str(path), "--set-valued")
    assert found[SET_VALUED_TRACKER] == {"theta": 4.0, "tracking_frame": "odom"}
    path.write_text("/**/set_valued_tracker:\n  ros__parameters:\n    theta: -4.0\n")
    with pytest.raises(ParameterFileError, match="theta = -4.0: allowed is a number > 0"):
        parameters_of("--params", str(path))


def test_the_launch_file_starts_it_in_either_way():
    values = {argument.name: argument.default for argument in TRACKER_ARGUMENTS}
    plain = tracker_plan(values, {})
    values["set_valued"] = "true"
    names = [[node.executable for node in p.nodes] for p in (plain, tracker_plan(values, {}))]
    assert names[1] == [*names[0], SET_VALUED_TRACKER]
    (command,) = tracker_plan({**values, "processes": "one"}, {}).programs
    assert command == ["gda-tracker", "run", "--set-valued"]


def test_the_shipped_file_holds_the_defaults():
    path = resource("params", "set_valued_tracker.yaml")
    found = parameters_of("--params", str(path), "--set-valued")
    assert found[SET_VALUED_TRACKER]["theta"] == 6.0
    assert found[SET_VALUED_TRACKER]["duplicate_scans"] == 2
