"""``gda-tracker tune`` as a user meets it, on a scenario cut short and on real recordings."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from gda_tracker.cli import main
from gda_tracker.io.adapters import load_recording
from gda_tracker.io.parameter_files import read_parameter_file
from gda_tracker.resources import resource
from gda_tracker.simulation.scenarios import shipped_scenarios
from gda_tracker.tracking.ring import stage_parameters

BOATS, MORE_BOATS = (resource("data", "autoferry", f"scenario{n}") for n in (13, 16))
FAST = ("--method", "map/none/cv", "--runs", "1", "--workers", "1")


def run(*arguments):
    return main([str(argument) for argument in arguments])


@pytest.fixture
def short(tmp_path):
    """Path of a crossing scenario cut to eight scans."""
    text = shipped_scenarios()["crossing_targets"].read_text()
    path = tmp_path / "short.yaml"
    path.write_text(text.replace("n_scans: 25", "n_scans: 8"))
    return path


def test_boats_searched_and_held_back(tmp_path, capsys):
    """The whole way: search, comparison, report, pictures, and parameters that run."""
    out = tmp_path / "out"
    arguments = ("tune", BOATS, "--held-back", MORE_BOATS, *FAST, "--output", out, "--trials", 8)
    arguments += ("--parameter", "process_noise_std_mps2=0.1:4:log", "--seed", 3)
    assert run(*arguments) == 0
    shown = capsys.readouterr().out
    result = json.loads((out / "result.json").read_text())
    assert len(result["trials"]) == 8
    assert result["failed"] == []
    default, chosen = result["default"], result["chosen"]
    best = min(result["trials"], key=lambda trial: trial["values"])
    if best["values"] < default["values"]:
        assert chosen == best
    else:
        assert chosen is None
    held_back = result["held_back"]
    numbers = held_back["objectives"]["gospa"]
    assert held_back["beats_default"] == (numbers["tuned"] < numbers["default"])
    page, yaml = (out / "report.html").read_text(), (out / "tuned.yaml").read_text()
    flat = " ".join(yaml.replace("\n#", " ").split())
    for statement in result["statements"]:
        assert statement in shown
        assert " ".join(statement.split()) in flat
    assert held_back["verdict"] in result["statements"]
    assert ("does NOT beat" in flat) != held_back["beats_default"]
    assert f"{numbers['default']:.3f}" in page
    assert page.count('<img alt="') == 2
    for name in ("course", "parameters"):
        assert (out / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    # The file holds the preset of the recording and the tuned value, and it runs.
    known = read_parameter_file(out / "tuned.yaml")
    manager = dict(load_recording(BOATS).preset["track_manager"])
    manager.update(decision="map", attribute_term="none", filter="cv")
    manager.update((chosen or default)["point"])
    assert known == {"track_manager": manager}
    stage_parameters(known)
    assert run("replay", MORE_BOATS, "--offline", "--params", out / "tuned.yaml") == 0
    assert "72 tracked" in capsys.readouterr().out
    # The same command goes on with the study: nothing is left to do, and it says the same.
    assert run(*arguments) == 0
    assert json.loads((out / "result.json").read_text()) == result


def test_trade_off_of_a_scenario_and_another_pick(short, tmp_path, capsys):
    out = tmp_path / "out"
    arguments = ("tune", short, "--held-back", short, *FAST, "--output", out, "--trials", 8)
    arguments += ("--objective", "completeness", "--objective", "false-tracks")
    arguments += ("--parameter", "confirmation_hits=2:4", "--parameter", "confirmation_scans=2:6")
    assert run(*arguments) == 0
    shown = capsys.readouterr().out
    result = json.loads((out / "result.json").read_text())
    assert (out / "trade_off.png").exists()
    assert set(result["held_back"]["objectives"]) == {"completeness", "false_tracks"}
    # Points with more hits than scans are named; they end nothing.
    for failed in result["failed"]:
        assert f"trial {failed['number']} failed: parameter confirmation_hits" in shown
    assert len(result["failed"]) + len(result["trials"]) == 8
    other = result["trials"][-1]
    assert run(*arguments, "--pick", other["number"]) == 0
    assert json.loads((out / "result.json").read_text())["chosen"] == other
    known = read_parameter_file(out / "tuned.yaml")["track_manager"]
    assert known["confirmation_hits"] == other["point"]["confirmation_hits"]
    capsys.readouterr()
    assert run(*arguments, "--pick", 99) == 2
    assert "--pick 99: the study has no such trial" in capsys.readouterr().err


def test_truth_from_a_table(tmp_path, capsys):
    """A recording without truth, and its targets in a file beside it: the same GOSPA."""
    recording = load_recording(BOATS)
    table, bare = tmp_path / "truth.csv", tmp_path / "bare.csv"
    rows = ["stamp_ns,target_id,x_m,y_m"]
    for known in recording.truth:
        for target, state in zip(known.target_id, known.target_state, strict=True):
            rows.append(f"{known.stamp_ns},{target},{float(state[0])!r},{float(state[1])!r}")
    table.write_text("\n".join(rows) + "\n")
    lines = ["stamp_ns,x_m,y_m"]
    for scan in recording.detections:
        x = scan.range_m * np.cos(scan.azimuth_rad) + scan.sensor_position_m[0]
        y = scan.range_m * np.sin(scan.azimuth_rad) + scan.sensor_position_m[1]
        lines += [f"{scan.stamp_ns},{float(a)!r},{float(b)!r}" for a, b in zip(x, y, strict=True)]
    bare.write_text("\n".join(lines) + "\n")
    common = (*FAST, "--trials", 1, "--parameter", "deletion_misses=7:8", "--preset", "autoferry")
    assert run("tune", bare, *common, "--output", tmp_path / "one") == 2
    assert "give them with --truth" in capsys.readouterr().err
    assert run("tune", bare, "--truth", table, *common, "--output", tmp_path / "one") == 0
    shown = capsys.readouterr().out
    assert "No recording was held back" in shown
    one = json.loads((tmp_path / "one" / "result.json").read_text())["default"]["measures"]
    assert one["completeness"] > 0.5


ERRORS = {
    "unknown objective": (["--objective", "speed"], "allowed is one of gospa"),
    "truth is partial": (["--objective", "false_tracks"], "--complete-truth"),
    "unknown parameter": (["--parameter", "range_std=1:2"], "did you mean range_std_m"),
    "no trials": (["--trials", "0"], "--trials 0: allowed is an integer >= 1"),
    "seed": (["--seed", "-1"], "--seed -1"),
    "time": (["--time-limit", "-1"], "--time-limit -1"),
    "seen": (["--held-back", str(BOATS)], "hold back another recording"),
    "other default": (["--held-back", "crossing_targets"], "have different defaults: "),
    "storage": (["--storage", "study"], "NAME.journal"),
    "truth": (["--truth", "nosuch.csv"], "nosuch.csv does not exist"),
}


@pytest.mark.parametrize("name", ERRORS)
def test_errors_are_one_line(name, tmp_path, capsys):
    options, reason = ERRORS[name]
    assert run("tune", BOATS, "--output", tmp_path / "out", "--runs", 1, *options) == 2
    shown = capsys.readouterr().err
    assert reason in shown
    assert shown.count("\n") == 1


def test_without_optuna_it_names_the_command_that_installs_it(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "optuna", None)
    assert run("tune", BOATS, "--output", tmp_path / "out") == 2
    shown = capsys.readouterr().err
    assert "pip install gda_tracker[tune]" in shown
    assert shown.count("\n") == 1
    assert not (tmp_path / "out").exists()
    # Nothing else needs it.
    assert run("replay", BOATS, "--offline", "--method", "gda/none/cv") == 0


def test_ctrl_c_keeps_the_study(short, tmp_path):
    out = tmp_path / "out"
    command = [sys.executable, "-m", "gda_tracker.cli", "tune", str(short), *FAST]
    command += ["--output", str(out), "--trials", "1000000", "--parameter", "deletion_misses=2:9"]
    # Its own session: Ctrl-C at a terminal reaches all processes of the group.
    process = subprocess.Popen(
        command,
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        journal = out / "study.journal"
        while not journal.exists() or b'"values"' not in journal.read_bytes():
            assert process.poll() is None
            time.sleep(0.05)
        os.killpg(process.pid, signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130
    assert "study tune is kept in" in errors
    assert "the same command goes on" in errors
    assert "Traceback" not in errors
