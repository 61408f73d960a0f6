from __future__ import annotations

import json
import math
import shutil
from pathlib import Path

import numpy as np
import pytest

from gda_tracker.io.adapters import RecordingError, load_recording

DATA = Path(__file__).parent / "data"
EXCERPT = DATA / "autoferry_excerpt_detections.json"


def excerpt_entries() -> list[dict]:
    return [entry for entry in json.loads(EXCERPT.read_text()) if entry["sensorID"] == 2]


def test_autoferry_takes_the_radar_scans_in_order():
    recording = load_recording(EXCERPT, "autoferry")
    entries = excerpt_entries()
    assert [len(scan.range_m) for scan in recording.detections] == [1, 2, 5, 1, 0, 1]
    stamps = [scan.stamp_ns for scan in recording.detections]
    assert stamps == [round(entry["time"] * 1e9) for entry in entries]
    assert [scan.sequence for scan in recording.detections] == [1, 2, 3, 4, 5, 6]
    assert {scan.sensor_id for scan in recording.detections} == {"radar"}
    assert recording.name == "autoferry_excerpt"
    assert recording.preset_name == "autoferry"
    assert "CC0-1.0" in recording.origin
    assert "Heterogeneous multi-sensor tracking" in recording.origin


def test_autoferry_positions_are_east_north():
    recording = load_recording(EXCERPT, "autoferry")
    entry, scan = excerpt_entries()[2], recording.detections[2]
    north, east = np.array(entry["measurement"])
    own_north, own_east = entry["ownshipPosition"]
    x = scan.sensor_position_m[0] + scan.range_m * np.cos(scan.azimuth_rad)
    y = scan.sensor_position_m[1] + scan.range_m * np.sin(scan.azimuth_rad)
    np.testing.assert_allclose(x, own_east + east, atol=1e-9)
    np.testing.assert_allclose(y, own_north + north, atol=1e-9)
    assert scan.sensor_position_m[2] == 0.0
    assert scan.sensor_orientation_xyzw.tolist() == [0.0, 0.0, 0.0, 1.0]
    assert [scan.rcs_m2, scan.range_rate_mps, scan.elevation_rad] == [None, None, None]


def test_autoferry_truth_belongs_to_the_same_entry():
    recording = load_recording(EXCERPT, "autoferry")
    detections = json.loads(EXCERPT.read_text())
    truths = json.loads(EXCERPT.with_name("autoferry_excerpt_groundTruth.json").read_text())
    expected = [t for d, t in zip(detections, truths, strict=True) if d["sensorID"] == 2]
    for truth, scan, targets in zip(recording.truth, recording.detections, expected, strict=True):
        assert truth.stamp_ns == scan.stamp_ns
        assert truth.target_id.tolist() == [1, 2]
        for row, target in enumerate(targets):
            north, east, _ = target["position"]
            assert truth.target_state[row, :2].tolist() == [east, north]
            assert np.isnan(truth.target_state[row, 2:]).all()
        assert truth.source_id is None


def test_autoferry_without_truth(tmp_path):
    path = shutil.copy(EXCERPT, tmp_path / "scenario1_detections.json")
    recording = load_recording(path, "autoferry")
    assert recording.truth is None
    assert len(recording.detections) == 6


def changed(tmp_path, change) -> Path:
    """Copy the excerpt, with one change to its list of entries."""
    entries = json.loads(EXCERPT.read_text())
    change(entries)
    path = tmp_path / "scenario1_detections.json"
    path.write_text(json.dumps(entries))
    return path


def set_field(name, value):
    def change(entries):
        entries[0][name] = value

    return change


BAD_ENTRIES = {
    "entry 0: time is missing": lambda entries: entries[0].pop("time"),
    "entry 0: time = 'x' is not": set_field("time", "x"),
    "entry 0: time = nan is not": set_field("time", math.nan),
    "entry 0: measurement is missing": lambda entries: entries[0].pop("measurement"),
    "entry 0: measurement: expected [[north ...], [east ...]]": set_field(
        "measurement", [[1], [2, 3]]
    ),
    "found the shape (3, 2)": set_field("measurement", [[1, 2], [3, 4], [5, 6]]),
    "found the shape (3,)": set_field("measurement", [1, 2, 3]),
    "entry 0: measurement: expected": set_field("measurement", "far away"),
    "entry 0: ownshipPosition is not [north, east]": set_field("ownshipPosition", [1, 2, 3]),
    "entry 0: ownship: expected": set_field("ownshipPosition", "x"),
    "entry 0: sensorID is missing": lambda entries: entries[0].pop("sensorID"),
    "entry 1: not an object": lambda entries: entries.insert(1, 3),
    "no radar scan (sensorID 2) in 0 entries": lambda entries: entries.clear(),
}


@pytest.mark.parametrize("text", BAD_ENTRIES)
def test_autoferry_errors_name_file_and_entry(tmp_path, text):
    path = changed(tmp_path, BAD_ENTRIES[text])
    with pytest.raises(RecordingError) as caught:
        load_recording(path, "autoferry")
    assert str(caught.value).startswith(f"{path}: ")
    assert text in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (b"[1, 2", "not JSON in line 1"),
        (b'{"sensorID": 2}', "not a list of entries"),
        (b"\xff\xfe", "not a text file"),
    ],
)
def test_autoferry_files_that_are_none(tmp_path, content, text):
    path = tmp_path / "scenario1_detections.json"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=text):
        load_recording(path, "autoferry")


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda truth: truth.pop(), "7 entries, 8 in scenario1_detections.json"),
        (lambda truth: truth.__setitem__(0, 5), "entry 0: not a list of targets"),
        (lambda truth: truth[0][0].pop("targetID"), "entry 0: targetID is missing"),
        (lambda truth: truth[0][0].update(targetID="a"), "targetID is not an integer"),
        (lambda truth: truth[0][0].update(position=[1]), "position is not [north, east, down]"),
    ],
)
def test_autoferry_truth_errors_name_file_and_entry(tmp_path, change, text):
    path = shutil.copy(EXCERPT, tmp_path / "scenario1_detections.json")
    truth = json.loads(EXCERPT.with_name("autoferry_excerpt_groundTruth.json").read_text())
    change(truth)
    truth_path = tmp_path / "scenario1_groundTruth.json"
    truth_path.write_text(json.dumps(truth))
    with pytest.raises(RecordingError) as caught:
        load_recording(path, "autoferry")
    assert str(caught.value).startswith(f"{truth_path}: ")
    assert text in str(caught.value)
