"""``gda-tracker run --set-valued``: which nodes start, with which parameters."""

from __future__ import annotations

import argparse

import pytest

from gda_tracker.commands import run
from gda_tracker.commands.options import SET_VALUED_TRACKER
from gda_tracker.io.parameter_files import ParameterFileError
from gda_tracker.resources import resource


def parameters_of(*words):
    parser = argparse.ArgumentParser()
    run.add_arguments(parser)
    return run._parameters(parser.parse_args(words))


def test_the_node_starts_when_asked_for_or_declared(tmp_path):
    assert SET_VALUED_TRACKER not in parameters_of()
    assert parameters_of("--set-valued")[SET_VALUED_TRACKER] == {}
    path = tmp_path / "sets.yaml"
    path.write_text("/**/set_valued_tracker:\n  ros__parameters:\n    theta: 4.0\n")
    for words in (("--params", str(path)), ("--params", str(path), "--set-valued")):
        assert parameters_of(*words)[SET_VALUED_TRACKER] == {"theta": 4.0}
    path.write_text("/**/set_valued_tracker:\n  ros__parameters:\n    theta: -4.0\n")
    with pytest.raises(ParameterFileError, match="theta = -4.0: allowed is a number > 0"):
        parameters_of("--params", str(path))


def test_the_shipped_file_holds_the_defaults():
    found = parameters_of("--params", str(resource("params", "set_valued_tracker.yaml")))
    assert found[SET_VALUED_TRACKER]["theta"] == 6.0
    assert found[SET_VALUED_TRACKER]["duplicate_scans"] == 2
