from __future__ import annotations

import dataclasses
import importlib.util
import shutil
from pathlib import Path

import message_examples as examples
import numpy as np
import pytest
from asterix_examples import block, plot
from message_examples import assert_identical
from recording_examples import npz

from gda_tracker.io import messages
from gda_tracker.io.adapters import ADAPTERS, RecordingError, guess_adapter, load_recording
from gda_tracker.io.adapters.bag import write_recording
from gda_tracker.io.bags import Bag, BagTopic, BagWriter
from gda_tracker.io.parameter_files import read_preset
from gda_tracker.resources import resource

DATA = Path(__file__).parent / "data"
EXCERPT = DATA / "autoferry_excerpt_detections.json"


def assert_same_recording(actual, expected) -> None:
    assert len(actual.detections) == len(expected.detections)
    for left, right in zip(actual.detections, expected.detections, strict=True):
        assert_identical(left, right)
    assert (actual.truth is None) == (expected.truth is None)
    for left, right in zip(actual.truth or (), expected.truth or (), strict=True):
        assert_identical(left, right)


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
        "asterix": tmp_path / "radar.bin",
        "ais": shutil.copy(resource("data/trajectories/solent_ais_15min.csv"), tmp_path / "a"),
        "uav": shutil.copy(resource("data/trajectories/uav.csv"), tmp_path / "b"),
    }
    cases["asterix"].write_bytes(block(48, plot(1.0, 10.0, 20.0)))
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
