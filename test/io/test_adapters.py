from __future__ import annotations

import dataclasses
import importlib.util
import json
import math
import shutil
from pathlib import Path

import message_examples as examples
import numpy as np
import pytest
from message_examples import assert_identical

from gda_tracker.io import messages
from gda_tracker.io.adapters import ADAPTERS, RecordingError, guess_adapter, load_recording
from gda_tracker.io.adapters.bag import write_recording
from gda_tracker.io.bags import Bag, BagTopic, BagWriter
from gda_tracker.io.parameter_files import read_preset
from gda_tracker.resources import resource

DATA = Path(__file__).parent / "data"
EXCERPT = DATA / "autoferry_excerpt_detections.json"


def excerpt_entries() -> list[dict]:
    return [entry for entry in json.loads(EXCERPT.read_text()) if entry["sensorID"] == 2]


def assert_same_recording(actual, expected) -> None:
    assert len(actual.detections) == len(expected.detections)
    for left, right in zip(actual.detections, expected.detections, strict=True):
        assert_identical(left, right)
    assert (actual.truth is None) == (expected.truth is None)
    for left, right in zip(actual.truth or (), expected.truth or (), strict=True):
        assert_identical(left, right)


# --- autoferry ------------------------------------------------------------------------------------


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


# --- scan_npz -------------------------------------------------------------------------------------


def npz_arrays(**changes) -> dict:
    """Arrays of a small scenario: 3 scans with 2, 0 and 3 detections, 2 targets."""
    azimuth = np.array([0.0, np.pi / 2, np.pi, -np.pi / 2, -3.0])
    meta = {"seed": 7, "sigma_range": 60.0, "sigma_azimuth": 0.005, "p_detect": 0.97}
    meta["clutter_density"] = 2e-5
    arrays = {
        "times": np.array([0.0, 5.0, 10.0]),
        "scan_ptr": np.array([0, 2, 2, 5]),
        "azimuth": azimuth,
        "range": np.array([1e4, 2e4, 3e4, 4e4, 5e4]),
        "rcs": np.array([1.0, 2.0, 0.3, 4.0, 5.0]),
        "truth_id": np.array([0, 1, -1, 1, 0]),
        "truth_state": np.arange(24.0).reshape(3, 2, 4),
        "truth_type": np.array([0, 1]),
        "truth_group": np.array([0, 0]),
        "meta": np.array(json.dumps(meta)),
    }
    arrays.update(changes)
    return {name: value for name, value in arrays.items() if value is not None}


def npz(tmp_path, **changes) -> Path:
    path = tmp_path / "scenario.npz"
    np.savez(path, **npz_arrays(**changes))
    return path


def test_scan_npz_is_turned_to_rep_103(tmp_path):
    recording = load_recording(npz(tmp_path), "scan_npz")
    assert [len(scan.range_m) for scan in recording.detections] == [2, 0, 3]
    assert [scan.stamp_ns for scan in recording.detections] == [0, 5 * 10**9, 10**10]
    first, _, last = recording.detections
    np.testing.assert_allclose(first.azimuth_rad, [np.pi / 2, 0.0], atol=1e-15)
    np.testing.assert_allclose(last.azimuth_rad, [-np.pi / 2, np.pi, 3.0 - 1.5 * np.pi], atol=1e-15)
    azimuth = npz_arrays()["azimuth"][2:]
    np.testing.assert_allclose(np.cos(last.azimuth_rad), np.sin(azimuth), atol=1e-15)
    np.testing.assert_allclose(np.sin(last.azimuth_rad), np.cos(azimuth), atol=1e-15)
    assert last.rcs_m2.tolist() == [0.3, 4.0, 5.0]
    assert last.range_std_m.tolist() == [60.0]
    assert last.azimuth_std_rad.tolist() == [0.005]
    assert last.sensor_position_m.tolist() == [0.0, 0.0, 0.0]


def test_scan_npz_azimuth_stays_in_half_open_circle(tmp_path):
    angles = np.linspace(-np.pi, np.pi, 10_001)[1:]
    path = npz(
        tmp_path,
        times=np.array([0.0]),
        scan_ptr=np.array([0, len(angles)]),
        azimuth=angles,
        range=np.ones(len(angles)),
        rcs=None,
        truth_id=None,
        truth_state=None,
        truth_type=None,
    )
    recording = load_recording(path, "scan_npz")
    azimuth = recording.detections[0].azimuth_rad
    assert azimuth.min() > -np.pi
    assert azimuth.max() <= np.pi
    assert recording.truth is None
    assert recording.detections[0].rcs_m2 is None


def test_scan_npz_truth(tmp_path):
    recording = load_recording(npz(tmp_path), "scan_npz")
    assert [truth.source_id.tolist() for truth in recording.truth] == [[0, 1], [], [-1, 1, 0]]
    truth = recording.truth[1]
    assert truth.target_id.tolist() == [0, 1]
    assert truth.target_class == ("fighter", "cargo")
    # x, vx, y, vy in the file
    assert truth.target_state[0].tolist() == [8.0, 10.0, 9.0, 11.0]


def test_scan_npz_preset_takes_the_data_sheet(tmp_path):
    told = load_recording(npz(tmp_path), "scan_npz").preset["track_manager"]
    assert told["detection_probability"] == 0.97
    assert told["clutter_density_per_m_rad"] == 2e-5
    silent = load_recording(npz(tmp_path, meta=None), "scan_npz")
    assert silent.preset == read_preset("scan_npz")
    assert silent.detections[0].range_std_m is None


BAD_ARRAYS = {
    "array range (D,) is missing": {"range": None},
    "array scan_ptr (K + 1,) is missing": {"scan_ptr": None},
    "array scan_ptr does not rise from 0 to 5": {"scan_ptr": np.array([0, 3, 2, 5])},
    "array times is not 3 numbers": {"times": np.array([0.0, 1.0])},
    "array azimuth has the shape (4,), not (5,)": {"azimuth": np.zeros(4)},
    "array azimuth holds <U1, not numbers": {"azimuth": np.array(["a"] * 5)},
    "array rcs has the shape (5, 1)": {"rcs": np.zeros((5, 1))},
    "array truth_state has the shape (2, 2, 4), not (3, N, 4)": {
        "truth_state": np.zeros((2, 2, 4))
    },
    "array truth_id is not one of -1 to 1": {"truth_id": np.array([0, 1, -1, 1, 2])},
    "array truth_type is not one of 0, 1": {"truth_type": np.array([0, 2])},
    "array truth_type (N,) is missing": {"truth_type": None},
    "meta is not JSON": {"meta": np.array("{")},
    "meta is not an object": {"meta": np.array("[]")},
    "meta: sigma_range = -1: allowed is a number > 0": {"meta": np.array('{"sigma_range": -1}')},
    "meta: node track_manager: parameter detection_probability = 2": {
        "meta": np.array('{"p_detect": 2}')
    },
}


@pytest.mark.parametrize("text", BAD_ARRAYS)
def test_scan_npz_errors_name_file_and_array(tmp_path, text):
    path = npz(tmp_path, **BAD_ARRAYS[text])
    with pytest.raises(RecordingError) as caught:
        load_recording(path, "scan_npz")
    assert str(caught.value).startswith(f"{path}: ")
    assert text in str(caught.value)


def test_scan_npz_files_that_are_none(tmp_path):
    path = npz(tmp_path)
    cut = tmp_path / "cut.npz"
    cut.write_bytes(path.read_bytes()[:500])
    pickled = tmp_path / "pickled.npz"
    np.savez(pickled, **npz_arrays(meta=np.array([{}], dtype=object)))
    single = tmp_path / "single.npz"
    with single.open("wb") as file:
        np.save(file, np.zeros(3))
    text = tmp_path / "text.npz"
    text.write_text("nothing")
    for bad in (cut, pickled, single, text, tmp_path):
        with pytest.raises(RecordingError) as caught:
            load_recording(bad, "scan_npz")
        assert str(bad) in str(caught.value)
        assert "\n" not in str(caught.value)


# --- bag ------------------------------------------------------------------------------------------


def test_a_recording_survives_a_bag_exactly(tmp_path):
    recording = load_recording(EXCERPT, "autoferry")
    write_recording(tmp_path / "bag", recording, preset="autoferry")
    read = load_recording(tmp_path / "bag", "bag")
    assert_same_recording(read, recording)
    assert (read.name, read.origin) == (recording.name, recording.origin)
    assert (read.preset_name, read.preset) == ("autoferry", read_preset("autoferry"))
    assert read.warnings == []


def test_a_simulated_recording_survives_a_bag_exactly(tmp_path):
    recording = load_recording(npz(tmp_path), "scan_npz")
    recording.detections[1].rcs_m2 = None  # no detections: what is measured cannot be told
    write_recording(tmp_path / "bag", recording)
    read = load_recording(tmp_path / "bag", "bag")
    assert_same_recording(read, recording)
    assert (read.preset_name, read.preset) == ("default", {})


def test_statements_keep_their_place_among_the_scans(tmp_path):
    recording = load_recording(EXCERPT, "autoferry")
    base = examples.statement()
    recording.statements = [
        (position, dataclasses.replace(base, sequence=number))
        for number, position in enumerate((0, 2, 2, len(recording.detections) - 1), start=1)
    ]
    # One that comes again is taken once.
    again = [*recording.statements, recording.statements[0]]
    write_recording(tmp_path / "bag", dataclasses.replace(recording, statements=again))
    read = load_recording(tmp_path / "bag", "bag")
    assert read.statements == recording.statements
    assert_same_detections(read, recording)


def bag_of_detections(path: Path, scans, topic: str = "/radar/detections") -> None:
    kind = BagTopic(topic, "gda_tracker_msgs/msg/DetectionArray")
    with BagWriter(path, [kind]) as bag:
        for number, scan in enumerate(scans):
            bag.write(topic, messages.detections_to_message(scan), number)


def test_scans_that_were_sent_again_are_taken_once(tmp_path):
    first = examples.detections(3)
    second = examples.detections(4)
    second.stamp_ns += 1
    bag_of_detections(tmp_path / "bag", [first, first, second, first])
    read = load_recording(tmp_path / "bag")
    assert [len(scan.range_m) for scan in read.detections] == [3, 4]
    assert read.warnings == ["2 scans were sent again and are taken once"]
    assert read.truth is None


def test_messages_that_cannot_be_read_are_counted_and_named(tmp_path):
    good = messages.detections_to_message(examples.detections(3))
    bad = messages.detections_to_message(examples.detections(3))
    bad.covariance = [1.0, 2.0]
    kind = BagTopic("/detections", "gda_tracker_msgs/msg/DetectionArray")
    with BagWriter(tmp_path / "bag", [kind]) as bag:
        for number in range(8):
            bag.write("/detections", bad, number)
        bag.write("/detections", b"\0\1\0\0", 8)
        bag.write("/detections", good, 9)
    read = load_recording(tmp_path / "bag")
    assert len(read.detections) == 1
    assert len(read.warnings) == 6
    text = "message 0 on /detections is left out: covariance has 2 elements, 3 x 4 x 4 expected"
    assert read.warnings[0] == text
    assert read.warnings[5] == "4 more messages are left out"
    with BagWriter(tmp_path / "only bad", [kind]) as bag:
        bag.write("/detections", bad, 0)
    with pytest.raises(RecordingError, match="no scan could be read; message 0 on /detections"):
        load_recording(tmp_path / "only bad")


def test_a_cut_bag_is_read_as_far_as_it_goes(tmp_path):
    write_recording(tmp_path / "bag", load_recording(EXCERPT, "autoferry"), preset="autoferry")
    (mcap,) = (tmp_path / "bag").glob("*.mcap")
    whole = load_recording(tmp_path / "bag")
    (tmp_path / "bag" / "metadata.yaml").unlink()
    data = mcap.read_bytes()
    sizes = set()
    first = data.index(b"radar\0")  # in the first message
    for size in range(first + 350, len(data) - 1, 250):
        mcap.write_bytes(data[:size])
        read = load_recording(tmp_path / "bag")
        assert "is damaged" in read.warnings[0]
        assert_same_detections(read, whole)
        if read.truth is not None and len(read.warnings) > 1:
            assert read.warnings[1] == f"1 of {len(read.detections)} scans have no truth"
            assert np.isnan(read.truth[-1].target_state).all()
            assert read.truth[-1].target_id.tolist() == [1, 2]
        sizes.add(len(read.detections))
    assert sizes == {1, 2, 3, 4, 5, 6}


def assert_same_detections(part, whole) -> None:
    for left, right in zip(part.detections, whole.detections[: len(part.detections)], strict=True):
        assert_identical(left, right)


def test_bags_without_detections_name_their_topics(tmp_path):
    with BagWriter(tmp_path / "bag", [BagTopic("/tracks", "gda_tracker_msgs/msg/TrackArray")]):
        pass
    with pytest.raises(RecordingError, match=r"no topic of type .*; its topics are /tracks$"):
        load_recording(tmp_path / "bag")


def test_a_preset_that_is_not_shipped_is_a_warning(tmp_path):
    write_recording(tmp_path / "bag", load_recording(EXCERPT, "autoferry"), preset="mystery")
    read = load_recording(tmp_path / "bag")
    assert (read.preset_name, read.preset) == ("default", {})
    assert "preset 'mystery'" in read.warnings[0]


def test_a_missing_library_is_a_line(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    with pytest.raises(RecordingError, match=r"pip install gda_tracker\[bags\]"):
        load_recording(resource("data/autoferry/scenario13"))


# --- auto -----------------------------------------------------------------------------------------


def test_adapters_are_guessed_by_content(tmp_path):
    write_recording(tmp_path / "bag", load_recording(EXCERPT, "autoferry"))
    (mcap,) = (tmp_path / "bag").glob("*.mcap")
    cases = {
        "autoferry": shutil.copy(EXCERPT, tmp_path / "renamed.txt"),
        "scan_npz": shutil.copy(npz(tmp_path), tmp_path / "renamed.bin"),
        "bag": tmp_path / "bag",
        "mmwave": shutil.copy(resource("data/mmwave_walk/SOT.tar.xz"), tmp_path / "walk.bin"),
        "continental_yaml": next(resource("data/continental").glob("srr520*.yaml")),
        "csv": tmp_path / "table.txt",
    }
    cases["csv"].write_text("time_s,range_m,azimuth_deg\n0.0,10.0,3.0\n")
    for name, path in cases.items():
        assert guess_adapter(path) == name
        assert f"read as {name}, guessed from the content" in load_recording(path).origin
    assert guess_adapter(mcap) == "bag"
    assert set(cases) == set(ADAPTERS)


def test_guessing_says_what_is_known(tmp_path):
    unknown = tmp_path / "file.txt"
    unknown.write_text("hello")
    with pytest.raises(RecordingError, match="no adapter knows this content. Known are bag: "):
        load_recording(unknown)
    with pytest.raises(RecordingError, match="no adapter knows"):
        load_recording(tmp_path)
    for adapter in ("auto", "bag"):
        with pytest.raises(RecordingError, match=r"nowhere does not exist$"):
            load_recording(tmp_path / "nowhere", adapter)
    with pytest.raises(RecordingError, match="adapter 'x': allowed is one of auto, bag, autoferry"):
        load_recording(unknown, "x")


# --- shipped bags ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "scans", "detections", "closest"),
    [
        ("scenario2", 70, 437, 21),
        ("scenario3", 78, 394, 33),
        ("scenario13", 69, 167, 9),
        ("scenario16", 72, 285, 28),
    ],
)
def test_shipped_bags(name, scans, detections, closest):
    bag = Bag(resource("data/autoferry", name))
    assert {topic: item.message_count for topic, item in bag.topics.items()} == {
        "/detections": scans,
        "/truth": scans,
    }
    recording = load_recording(resource("data/autoferry", name))
    assert recording.warnings == []
    assert recording.preset_name == "autoferry"
    assert len(recording.detections) == len(recording.truth) == scans
    assert sum(len(scan.range_m) for scan in recording.detections) == detections
    stamps = np.array([scan.stamp_ns for scan in recording.detections])
    assert 0.9e9 < np.diff(stamps).min()
    assert 1.6e9 < np.median(np.diff(stamps)) < 1.7e9
    assert all(truth.target_id.tolist() == [1, 2] for truth in recording.truth)
    position = np.stack([truth.target_state[:, :2] for truth in recording.truth])
    assert np.isfinite(position).all()
    assert round(np.linalg.norm(position[:, 0] - position[:, 1], axis=1).min()) == closest
    assert (
        (resource("data/autoferry/LICENSE")).read_text().startswith("Creative Commons Legal Code")
    )


def test_the_script_makes_the_adapters_recording(tmp_path):
    path = resource("scripts/make_autoferry_bags.py")
    specification = importlib.util.spec_from_file_location("make_autoferry_bags", path)
    script = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(script)
    for kind in ("detections", "groundTruth"):
        shutil.copy(DATA / f"autoferry_excerpt_{kind}.json", tmp_path / f"scenario5_{kind}.json")
    options = [str(tmp_path), "--scenarios", "5", "--output"]
    for output in ("a", "b"):
        assert script.main([*options, str(tmp_path / output)]) == 0
    expected = load_recording(tmp_path / "scenario5_detections.json", "autoferry")
    assert_same_recording(load_recording(tmp_path / "a" / "scenario5"), expected)
    for file in ("metadata.yaml", "scenario5.mcap"):
        left, right = (tmp_path / output / "scenario5" / file for output in ("a", "b"))
        assert left.read_bytes() == right.read_bytes()
    assert script.main([*options, str(tmp_path / "a")]) == 1
