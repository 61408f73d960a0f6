"""The nodes scan_source and evaluator on their own, as ``ros2 run`` starts them."""

from __future__ import annotations

import json
import signal
import subprocess
import sys

from graph_helpers import TIMEOUT_S, scenario_plays

from gda_tracker.nodes.evaluator import EvaluatorNode
from gda_tracker.nodes.runner import Nodes, RingProcesses
from gda_tracker.resources import resource

METHOD = "mht/bayes/cv"


def start(environment, node, *parameters):
    """Start a node with parameters ``name:=value``."""
    arguments = [word for p in parameters for word in ("-p", p)]
    return subprocess.Popen(
        [sys.executable, "-m", f"gda_tracker.nodes.{node}", "--ros-args", *arguments],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def end(process, timeout=TIMEOUT_S):
    """Wait for a process; return its code and what it said on standard error."""
    try:
        _, err = process.communicate(timeout=timeout)
    finally:
        process.kill()
        process.wait(30)
    return process.returncode, err


def wait_for_evaluator(domain):
    """Wait until the evaluator has its subscriptions."""
    with Nodes(lambda **o: [EvaluatorNode(**o)], domain) as nodes:
        # This one's own subscription counts too.
        assert nodes.spin_until(lambda: nodes.nodes[0].count_subscribers("truth") > 1, TIMEOUT_S)


def test_scores_of_a_scenario(environment, tmp_path):
    _, parameters = scenario_plays("crossing_targets", METHOD)
    output = tmp_path / "scores.json"
    with RingProcesses(parameters, environment):
        evaluator = start(environment, "evaluator", f"output:={output}")
        try:
            wait_for_evaluator(int(environment["ROS_DOMAIN_ID"]))
            source = start(
                environment, "scan_source", "runs:=2", "seed:=4", f"method:={METHOD}", "rate:=40.0"
            )
            assert end(source) == (0, "")
        finally:
            evaluator.send_signal(signal.SIGINT)
            code, err = end(evaluator, 30)
    assert code == 0, err
    scores = json.loads(output.read_text())
    # The evaluator may come too late for the first scans, never for the last.
    assert scores["runs"] in (1, 2)
    assert 23 <= scores["scans"] <= 46
    assert 0.0 <= scores["purity_mean"] <= 1.0
    assert 0.0 <= scores["purity_delayed_mean"] <= 1.0
    assert len(scores["purity_delayed_per_run"]) in (1, 2)
    assert scores["latency_ms_median"] > 0.0


def test_source_plays_a_recording_and_reports_errors(environment):
    boats = resource("data", "autoferry", "scenario13")
    source = start(environment, "scan_source", f"input:={boats}", "start_timeout_s:=1.0")
    code, err = end(source)
    assert code == 1
    assert "no track_manager found" in err
    wrong = start(environment, "scan_source", "input:=nosuch")
    code, err = end(wrong)
    assert code == 2
    assert err.strip().count("\n") == 0
    assert "nosuch" in err
