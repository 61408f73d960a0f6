"""The commands ``run`` and ``record`` as a user starts and ends them."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from graph_bench import Client
from graph_helpers import TIMEOUT_S, differences, offline, play, scenario_plays

from gda_tracker.io.bags import Bag, read_bag
from gda_tracker.nodes.runner import Nodes, parameter_file
from gda_tracker.nodes.scan_source import ScanSourceNode

METHOD = "map/bayes/cv"
LATCHED = ("/radar_1/scans", "/radar_1/associations")


def start(environment, *arguments):
    """Start a command and wait until it says that it is up."""
    process = subprocess.Popen(
        [sys.executable, "-m", "gda_tracker.cli", *arguments],
        env={**environment, "PYTHONUNBUFFERED": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    line = process.stdout.readline()
    assert "Ctrl-C ends" in line, line + process.stderr.read()
    return process


def stop(process, number=signal.SIGINT):
    """Press Ctrl-C, or send another signal; return what it said."""
    process.send_signal(number)
    try:
        out, err = process.communicate(timeout=30)
    finally:
        process.kill()
        process.wait(30)
    assert process.returncode == 0, err
    assert "Traceback" not in err
    return out


@pytest.mark.parametrize(
    ("mode", "number"), [([], signal.SIGINT), (["--processes"], signal.SIGTERM)]
)
def test_run_live_in_a_namespace_with_a_parameter_file(mode, number, environment, tmp_path):
    plays, parameters = scenario_plays("crossing_targets", METHOD)
    path = parameter_file(parameters, tmp_path)
    bag, recorded = tmp_path / "bag", tmp_path / "recorded"
    run = start(
        environment,
        *("run", *mode, "--params", str(path), "--method", METHOD, "--namespace", "radar_1"),
        *("--bag", str(bag)),
    )
    record = start(environment, "record", str(recorded), "--namespace", "radar_1")
    try:
        with Nodes(
            lambda **o: [ScanSourceNode({}, plays=plays, collect=True, **o)],
            int(environment["ROS_DOMAIN_ID"]),
            ["--ros-args", "-r", "__ns:=/radar_1"],
        ) as nodes:
            source, complete = nodes.nodes[0], set()

            def told(message):
                for status in message.status:
                    values = {item.key: item.value for item in status.values}
                    if {f"recorded {topic}" for topic in LATCHED} <= set(values):
                        complete.add(values["bag"])

            source.create_subscription(DiagnosticArray, "/diagnostics", told, 10)
            played = play(nodes, source)
            # Latched topics: who comes late still gets the last of them.
            assert nodes.spin_until(lambda: complete == {str(bag), str(recorded)}, TIMEOUT_S)
        assert differences(played.tracks, offline(plays, parameters)) == []
    finally:
        said = [stop(record, number), stop(run, signal.SIGTERM)]
    assert "messages in" in said[0]
    for folder in (bag, recorded):
        # It was closed: it has its index and its metadata.
        assert (folder / "metadata.yaml").exists()
        assert Bag(folder).damage == ""
        topics = {record.topic for record in read_bag(folder)}
        assert set(LATCHED) <= topics


def test_replay_that_is_terminated_closes_its_bag(environment, tmp_path):
    bag, log = tmp_path / "bag", tmp_path / "log.txt"
    with log.open("w") as said:
        process = subprocess.Popen(
            [sys.executable, "-m", "gda_tracker.cli", "replay", "crossing_targets", "--rate", "1"]
            + ["--bag", str(bag), "--domain", environment["ROS_DOMAIN_ID"]],
            env=environment,
            stdout=said,
            stderr=said,
        )
        try:
            with Nodes(lambda **o: [Client(**o)], int(environment["ROS_DOMAIN_ID"])) as nodes:
                client = nodes.nodes[0]
                assert nodes.spin_until(
                    lambda: client.value("recorder", "recorded /scans") is not None, TIMEOUT_S
                ), log.read_text()
            process.terminate()
            process.wait(30)
        finally:
            process.kill()
            process.wait(30)
    assert process.returncode == 143, log.read_text()
    assert "Traceback" not in log.read_text()
    assert Bag(bag).damage == ""
    assert Bag(bag).topics["/scans"].message_count > 0


def test_run_refuses_a_wrong_method(environment):
    done = subprocess.run(
        [sys.executable, "-m", "gda_tracker.cli", "run", "--method", "gda/dsmc/cv"],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "dsm_classic" in done.stderr
