"""The report of a replay: one file, and its numbers are those of the replay."""

from __future__ import annotations

import re

import numpy as np
import pytest
from replay_pages import Page

from gda_tracker.cli import main
from gda_tracker.commands import replay_sections
from gda_tracker.io.adapters import load_recording
from gda_tracker.io.bags import BagTopic, BagWriter
from gda_tracker.io.messages import detections_to_message
from gda_tracker.resources import resource
from gda_tracker.simulation.playback import with_method
from gda_tracker.tracking.ring import PARTS_OF_A_ROUND, Ring

BOATS = resource("data", "autoferry", "scenario16")


@pytest.fixture(autouse=True)
def _no_pictures(monkeypatch):
    """Rendering takes most of the time; test/nodes/test_replay_report_live.py renders."""
    monkeypatch.setattr(replay_sections, "png", lambda figure: b"")


def replay(tmp_path, *arguments):
    path = tmp_path / "made" / "report.html"
    assert main(["replay", *map(str, arguments), "--offline", "--report", str(path)]) == 0
    text = path.read_text(encoding="utf-8")
    assert not re.search(r"url\(|@import|<script|https?:", text)
    return Page(text)


def test_report_of_a_real_recording_with_partial_truth(tmp_path, capsys):
    page = replay(tmp_path, BOATS, "--method", "map/none/cv")
    out = capsys.readouterr().out
    assert f"report: {tmp_path}" in out
    recording = load_recording(BOATS)
    ring = Ring(with_method(recording.preset, "map/none/cv"))
    results = [ring.process(detections) for detections in recording.detections]
    assert page.value("scans tracked") == "72"
    assert page.value("detections received") == "285"
    assert page.value("sensors") == "radar"
    confirmed = {int(i) for r in results for i in r.tracks.track_id[r.tracks.status == 1]}
    assert page.value("tracks confirmed") == str(len(confirmed))
    taken = sum(int((r.tracks.detection_index >= 0).sum()) for r in results)
    assert page.value("detections taken by a track") == str(taken)
    assert page.value("method") == "map/none/cv"
    assert page.value("track_manager.range_std_m") == "10"
    # The same measures as the summary prints.
    error = float(re.search(r"position error: (\S+) m", out)[1])
    assert float(page.value("position error [m RMS]")) == pytest.approx(error, abs=0.051)
    assert "false tracks" not in [row[0] for row in page.rows]
    assert any("knows some of what the radar sees" in text for text in page.texts)
    assert page.pictures == [
        "Tracks around the targets",
        "Plan position",
        "Tracks over time",
        "Normalised innovation squared (NIS)",
        "Latency per stage",
    ]
    assert any("bring no radar cross section" in text for text in page.texts)
    assert {*PARTS_OF_A_ROUND, "whole round"} <= {row[0] for row in page.rows}
    # One row a confirmed track, with what its history says.
    rows = {int(row[0]): row for row in page.rows if len(row) == 8 and row[0].isdigit()}
    assert set(rows) == confirmed
    first = next(k for k, r in enumerate(results) if 3 in r.tracks.track_id)
    stamps = [d.stamp_ns for d in recording.detections]
    assert rows[3][1] == f"{(stamps[first] - stamps[0]) / 1e9:.2f}"


def test_report_with_masses_classes_and_complete_truth(tmp_path, capsys):
    page = replay(tmp_path, "crossing_targets", "--method", "map/dsm_classic/cv")
    out = capsys.readouterr().out
    assert page.pictures == [
        "Tracks around the targets",
        "Plan position",
        "Tracks over time",
        "Class beliefs over time",
        "Radar cross section over time",
        "Conflict over time",
        "Normalised innovation squared (NIS)",
        "Latency per stage",
    ]
    completeness = float(re.search(r"completeness (\S+) ", out)[1])
    assert float(page.value("completeness")) == pytest.approx(completeness, abs=6e-4)
    assert float(page.value("false tracks")) == 0.0
    assert float(page.value("purity")) > 0.5


def write_bag(path, scans):
    with BagWriter(path, [BagTopic("detections", "gda_tracker_msgs/msg/DetectionArray")]) as writer:
        for detections in scans:
            writer.write("detections", detections_to_message(detections), detections.stamp_ns)
    return path


def test_what_was_left_out_stands_there_by_its_reason(tmp_path):
    scans = load_recording(BOATS).detections[:6]
    scans[2].range_m = scans[2].range_m.copy()
    scans[2].range_m[0] = np.nan
    scans[4].sensor_position_m = np.full(3, np.nan)
    page = replay(tmp_path, write_bag(tmp_path / "bag", scans))
    assert page.value("scans tracked") == "5"
    rejected = [row for row in page.rows if row[0].startswith("scans rejected: ")]
    assert rejected == [["scans rejected: bad_sensor_pose", "1"]]
    left_out = [row for row in page.rows if row[0].startswith("detections rejected: ")]
    assert left_out == [["detections rejected: not_finite", "1"]]


def test_a_recording_without_a_confirmed_track_has_a_report(tmp_path):
    page = replay(tmp_path, write_bag(tmp_path / "bag", load_recording(BOATS).detections[:1]))
    assert page.pictures == ["Plan position", "Latency per stage"]
    assert page.value("tracks confirmed") == "0"
    assert any("No track was confirmed" in text for text in page.texts)
    assert any("No confirmed track took a detection" in text for text in page.texts)


def test_a_report_that_cannot_be_written_is_an_error_in_one_line(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    path = tmp_path / "file" / "report.html"
    assert main(["replay", str(BOATS), "--offline", "--report", str(path)]) == 2
    told = capsys.readouterr()
    assert len(told.err.splitlines()) == 1
    assert "tracked" not in told.out  # before the replay, not after it


@pytest.mark.parametrize(
    ("marks", "longest"), [([], 0), ([0, 0], 0), ([1, 1, 0, 1], 2), ([0, 1, 1, 1], 3), ([1], 1)]
)
def test_longest_run(marks, longest):
    assert replay_sections._longest_run(np.array(marks, dtype=bool)) == longest
