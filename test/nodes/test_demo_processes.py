"""The demo through real processes: the whole of it, a node that ends, a node that hangs."""

from __future__ import annotations

import argparse
import json
import os
import signal
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gda_tracker.commands import demo, demo_play
from gda_tracker.io.bags import Bag
from gda_tracker.nodes import runner

pytestmark = pytest.mark.nodes


@pytest.fixture
def part():
    """One run of the crossing targets."""
    return demo.make_parts(1, 3)[1][demo.OFF]


def test_both_methods_see_the_same_scans():
    recording, parts = demo.make_parts(2, 5)
    off, on = parts[demo.OFF], parts[demo.ON]
    for one, other in zip(off.plays, on.plays, strict=True):
        for a, b in zip(one.detections, other.detections, strict=True):
            assert a.stamp_ns == b.stamp_ns
            np.testing.assert_array_equal(a.range_m, b.range_m)
            np.testing.assert_array_equal(a.rcs_m2, b.rcs_m2)
    assert off.scans == on.scans == 2 * 23
    assert off.parameters["track_manager"]["attribute_term"] == "none"
    assert on.parameters["track_manager"]["attribute_term"] == "dsm_classic"
    boats = parts[demo.AUTOFERRY]
    assert boats.scans == len(recording.detections) == 72
    assert boats.plays[0].initial is None
    assert "CC0" in recording.origin


@pytest.mark.timeout(240)
def test_the_whole_demo(tmp_path, environment, monkeypatch, capsys):
    monkeypatch.setattr(runner, "private_environment", lambda: environment)
    parser = argparse.ArgumentParser()
    demo.add_arguments(parser)
    arguments = parser.parse_args(["--out", str(tmp_path / "out"), "--runs", "2", "--seed", "3"])
    assert demo.run(arguments) == 0
    shown = capsys.readouterr().out
    scores = json.loads((tmp_path / "out" / demo.SCORES).read_text())["parts"]
    assert [scores[name]["scans"] for name in demo.FOLDERS] == [72, 46, 46]
    assert [scores[name]["lost_scans"] for name in demo.FOLDERS] == [0, 0, 0]
    assert scores[demo.AUTOFERRY]["completeness"] > 0.8
    assert f"{scores[demo.ON]['purity_mean']:.3f} +-" in shown
    page = (tmp_path / "out" / demo.REPORT).read_text()
    assert page.count("data:image/png;base64,") == 7
    for name in demo.FOLDERS:
        topics = Bag(tmp_path / "out" / name).topics
        for topic in demo_play.PER_SCAN_TOPICS:
            assert topics[f"/{topic}"].message_count >= scores[name]["scans"], (name, topic)


@pytest.mark.timeout(120)
def test_a_node_that_does_not_start_is_named(part, tmp_path, environment):
    parameters = {**part.parameters, "association": {"no_such_parameter": 1}}
    with pytest.raises(demo.DemoError, match="^node association ended with code 2$"):
        demo.play_part(
            replace(part, parameters=parameters), tmp_path / "bag", environment, lambda done: None
        )


@pytest.mark.timeout(120)
def test_a_node_that_hangs_is_named(tmp_path, environment, monkeypatch):
    part = demo.make_parts(30, 3)[1][demo.OFF]  # enough scans to be in the midst of them
    monkeypatch.setattr(demo_play, "STALL_TIMEOUT_S", 6.0)
    rings = []

    class Remembered(runner.RingProcesses):
        def __enter__(self):
            rings.append(self)
            return super().__enter__()

    monkeypatch.setattr(runner, "RingProcesses", Remembered)
    stopped = []

    def show(done: int) -> None:
        if not stopped and done >= 3:
            stopped.append(rings[0].processes["attribute_fusion"].pid)
            os.kill(stopped[0], signal.SIGSTOP)

    began = time.monotonic()
    # Processes share memory with the one that was stopped, and may have to wait for it.
    with pytest.raises(demo.DemoError, match="^node .*attribute_fusion.* does not answer"):
        demo.play_part(part, tmp_path / "bag", environment, show)
    assert time.monotonic() - began < 100.0
    assert not Path(f"/proc/{stopped[0]}").exists()
