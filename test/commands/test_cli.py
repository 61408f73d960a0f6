"""The command line as a user meets it: help, offline replay, errors in one line."""

from __future__ import annotations

import csv
import json
import re

import numpy as np
import pytest

from gda_tracker.cli import COMMANDS, main
from gda_tracker.commands.replay_nodes import credits_needed
from gda_tracker.io.adapters import load_recording
from gda_tracker.io.parameter_files import parameter_yaml
from gda_tracker.resources import resource
from gda_tracker.simulation.playback import of_recording
from gda_tracker.tracking.ring import STAGE_TABLES, Ring

BOATS = resource("data", "autoferry", "scenario16")


def run(*arguments):
    """Run the command line, also where it ends by itself."""
    try:
        return main([str(a) for a in arguments])
    except SystemExit as end:
        return end.code


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_an_example(command, capsys):
    assert run(command, "--help") == 0
    out = capsys.readouterr().out
    assert "example" in out
    assert f"gda-tracker {command}" in out


def test_help_and_version(capsys):
    assert run("--help") == 0
    out = capsys.readouterr().out
    assert all(name in out for name in COMMANDS)
    assert run("--version") == 0
    assert capsys.readouterr().out.startswith("gda-tracker ")


def test_replay_writes_one_row_per_live_track_and_scan(tmp_path, capsys):
    table = tmp_path / "tracks.csv"
    assert run("replay", BOATS, "--offline", "--tracks", table) == 0
    out = capsys.readouterr().out
    assert "preset autoferry" in out
    assert "72 tracked" in out
    assert "target 1: completeness" in out
    recording = load_recording(BOATS)
    ring = Ring(recording.preset)
    with table.open() as file:
        rows = list(csv.DictReader(file))
    position = 0
    for scan, detections in enumerate(recording.detections):
        tracks = ring.process(detections).tracks
        for i in range(len(tracks)):
            row = rows[position]
            position += 1
            assert int(row["scan"]) == scan
            seconds, nanoseconds = row["stamp_s"].split(".")
            assert int(seconds) * 10**9 + int(nanoseconds) == detections.stamp_ns
            assert int(row["track_id"]) == tracks.track_id[i]
            state = [float(row[name]) for name in ("x_m", "y_m", "vx_mps", "vy_mps")]
            assert np.array_equal(state, tracks.mean[i])
            assert row["status"] == ("tentative", "confirmed")[tracks.status[i]]
            # No radar cross section in this recording: no class is claimed.
            assert row["class"] == ""
    assert position == len(rows)


def test_replay_writes_the_revised_past(tmp_path, capsys):
    table = tmp_path / "delayed.csv"
    arguments = ("replay", "crossing_targets", "--offline", "--tracks-delayed", table)
    assert run(*arguments, "--method", "mht/bayes/cv") == 0
    with table.open() as file:
        rows = list(csv.DictReader(file))
    # Two tracks on each of the 23 scans after the labelled ones, to the last one.
    assert [int(row["scan"]) for row in rows] == [scan for scan in range(23) for _ in range(2)]
    assert {row["track_id"] for row in rows} == {"1", "2"}
    capsys.readouterr()
    assert run(*arguments, "--method", "map/bayes/cv") == 2
    assert "allowed with decision mht" in capsys.readouterr().err


def test_replay_smooths_whatever_decides(tmp_path, capsys):
    table = tmp_path / "smoothed.csv"
    arguments = ("replay", "crossing_targets", "--tracks-smoothed", table)
    assert run(*arguments, "--offline", "--method", "map/bayes/cv") == 0
    with table.open() as file:
        rows = list(csv.DictReader(file))
    assert [int(row["scan"]) for row in rows] == [scan for scan in range(23) for _ in range(2)]
    shown = capsys.readouterr().out
    online = float(re.search(r"position error (\S+) m", shown)[1])
    smoothed = float(re.search(r"position error, smoothed: (\S+) m", shown)[1])
    assert smoothed < 0.9 * online
    assert "delayed" not in shown
    assert run(*arguments) == 2
    assert "allowed with --offline alone" in capsys.readouterr().err


def test_replay_takes_a_parameter_file_in_place_of_the_preset(tmp_path, capsys):
    path = tmp_path / "mine.yaml"
    path.write_text(parameter_yaml(STAGE_TABLES, False, {"track_manager": {"max_speed_mps": 1e-3}}))
    assert run("replay", BOATS, "--offline", "--params", path, "--method", "gda/none/cv") == 0
    assert str(path) in capsys.readouterr().out


REORDER = {"track_manager": {"reorder_window_s": 6.0, "time_jump_s": 60.0}}


def test_replay_with_a_reorder_window_answers_every_scan(tmp_path, capsys):
    path = tmp_path / "mine.yaml"
    path.write_text(parameter_yaml(STAGE_TABLES, False, REORDER))
    assert run("replay", BOATS, "--offline", "--params", path) == 0
    assert "scans: 72 tracked" in capsys.readouterr().out


@pytest.mark.parametrize("shuffled", [False, True])
def test_the_source_has_credit_for_all_scans_that_the_reorder_window_holds(shuffled):
    recording = load_recording(BOATS)
    if shuffled:
        place = np.argsort(np.arange(72) + np.random.default_rng(1).uniform(0.0, 2.0, 72))
        recording.detections = [recording.detections[k] for k in place]
    play = of_recording(recording)
    assert credits_needed(play, {}) == 1
    credits = credits_needed(play, REORDER)
    ring, answered = Ring(REORDER), 0
    for sent, detections in enumerate(play.detections):
        assert sent - answered < credits
        answered += len(ring.feed(detections))
    assert answered > 60


def test_replay_of_a_scenario(capsys):
    assert run("replay", "crossing_targets", "--offline", "--method", "map/bayes/cv") == 0
    assert "completeness" in capsys.readouterr().out


def test_replay_writes_why_it_associated_as_it_did(tmp_path, capsys):
    path = tmp_path / "why.jsonl"
    assert run("replay", BOATS, "--offline", "--association-log", path) == 0
    assert f"association log: {path}" in capsys.readouterr().out
    recording = load_recording(BOATS)
    ring = Ring(recording.preset)
    lines = path.read_text().splitlines()
    assert len(lines) == len(recording.detections)
    for line, detections in zip(lines, recording.detections, strict=True):
        tracks, entry = ring.process(detections).tracks, json.loads(line)
        assert entry["stamp_ns"] == detections.stamp_ns
        logged = {}
        for told in entry["tracks"]:  # of several hypotheses of a track one leads
            if logged.get(told["track_id"]) is None:
                logged[told["track_id"]] = told["detection"]
        for track, index in zip(tracks.track_id.tolist(), tracks.detection_index, strict=True):
            # A track that starts on the scan was not yet there to be associated.
            if track in logged:
                assert logged[track] == (None if index < 0 else index)


def test_evaluate_writes_json(tmp_path, capsys):
    path = tmp_path / "result.json"
    assert (
        run(
            *("evaluate", "crossing_targets", "--runs", 2, "--seed", 5, "--workers", 1),
            *("--method", "gda/none/cv", "--method", "clairvoyant", "--json", path),
        )
        == 0
    )
    result = json.loads(path.read_text())
    assert (result["scenario"], result["runs"], result["seed"]) == ("crossing_targets", 2, 5)
    assert [m["method"] for m in result["methods"]] == ["gda/none/cv", "clairvoyant"]
    for method in result["methods"]:
        assert np.allclose(np.sum(method["confusion"], axis=1), 1.0)


ERRORS = {
    "no such recording": (["replay", "nosuch", "--offline"], "nosuch does not exist"),
    "no such adapter": (["replay", BOATS, "--offline", "--adapter", "sonar"], "autoferry"),
    "no such method": (["replay", BOATS, "--offline", "--method", "gda/x/cv"], "dsm_classic"),
    "no such scenario": (["evaluate", "no_scenario", "--runs", "1"], "crossing_targets"),
    "bag without topics": (["replay", BOATS, "--offline", "--bag", "x"], "--bag"),
    "log without ring": (["replay", BOATS, "--association-log", "x"], "--association-log"),
    "log nowhere": (["replay", BOATS, "--offline", "--association-log", "/no/x"], "/no/x"),
    "rate": (["replay", BOATS, "--rate", "-1"], "--rate"),
    "no such file": (["replay", BOATS, "--offline", "--params", "nosuch.yaml"], "nosuch.yaml"),
}


@pytest.mark.parametrize("case", ERRORS)
def test_errors_are_one_line(case, capsys):
    arguments, word = ERRORS[case]
    assert run(*arguments) == 2
    err = capsys.readouterr().err.strip()
    assert err.count("\n") == 0, err
    assert word in err


def test_a_misspelt_parameter_is_named(tmp_path, capsys):
    path = tmp_path / "mine.yaml"
    path.write_text("/**/track_manager:\n  ros__parameters:\n    max_sped_mps: 3.0\n")
    assert run("replay", BOATS, "--offline", "--params", path) == 2
    err = capsys.readouterr().err.strip()
    assert "max_speed_mps" in err
    assert err.count("\n") == 0
