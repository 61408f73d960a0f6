"""Wrong parameters stop a node at its start; termination is quiet."""

from __future__ import annotations

import subprocess
import sys

import pytest
from graph_bench import Client
from graph_helpers import (
    TIMEOUT_S,
)

from gda_tracker.nodes.runner import STAGES, Nodes

WRONG = {
    "gate_probability:=2.0": ("gate_probability = 2.0", "<= 0.999999"),
    "gate_probabilty:=0.9": ("gate_probabilty", "gate_probability"),
    "decision:=best": ("decision = 'best'", "gda, map"),
    "confirmation_hits:=9": ("confirmation_hits = 9", "confirmation_scans"),
}


@pytest.mark.parametrize("assignment", WRONG)
def test_a_wrong_parameter_stops_start_up_with_one_line(assignment, environment):
    done = subprocess.run(
        [sys.executable, "-m", "gda_tracker.nodes.track_manager", "--ros-args", "-p", assignment],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 2
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1, done.stderr
    for word in WRONG[assignment]:
        assert word in lines[0]


def test_an_unknown_class_in_a_parameter_file(environment, tmp_path):
    path = tmp_path / "wrong.yaml"
    path.write_text(
        "/**/rcs_fuzzifier:\n  ros__parameters:\n"
        "    class_names: [false_alarm, fighter, zeppelin, ufo]\n"
    )
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "gda_tracker.nodes.rcs_fuzzifier",
            "--ros-args",
            "--params-file",
            path,
        ],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr
    assert "class_" in done.stderr


@pytest.mark.parametrize("stage", STAGES)
def test_termination_is_quiet_and_ends_with_zero(stage, environment):
    process = subprocess.Popen(
        [sys.executable, "-m", f"gda_tracker.nodes.{stage}"],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        with Nodes(lambda **o: [Client(**o)], int(environment["ROS_DOMAIN_ID"])) as nodes:
            client = nodes.nodes[0]
            assert nodes.spin_until(lambda: client.diagnostics, TIMEOUT_S)
        process.terminate()
        out, err = process.communicate(timeout=20)
    finally:
        process.kill()
        process.wait(20)
    assert process.returncode == 0, err
    assert "Traceback" not in out + err
