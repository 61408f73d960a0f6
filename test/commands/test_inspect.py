"""``gda-tracker inspect`` and ``replay`` of a radar, as a user meets them."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

from gda_tracker.cli import main
from gda_tracker.io.adapters import mmwave
from gda_tracker.io.bags import BagTopic, BagWriter
from gda_tracker.resources import resource

ROOT = Path(__file__).resolve().parents[2]
SRR520 = resource("data", "continental", "srr520_1708578209_45566935_near_detection.yaml")


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location(
        "make_radar_bags", ROOT / "scripts" / "make_radar_bags.py"
    )
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def street(script, tmp_path_factory):
    path = tmp_path_factory.mktemp("street") / "bag"
    return script.write_bag(path, "/front/points", script.ars548_clouds(12))


def run(*arguments):
    return main([str(argument) for argument in arguments])


def test_from_a_bag_to_tracks_in_two_commands(street, tmp_path, capsys):
    """What docs/radars.md promises, word for word."""
    path = tmp_path / "my_radar.yaml"
    assert run("inspect", street, "--yaml", path) == 0
    said = capsys.readouterr().out
    for text in (
        "/front/points: sensor_msgs/msg/PointCloud2",
        "12 frames in 0.55 s, 20 a second; 308 points each",
        "stamps: in order, no gaps",
        "rcs                        int8     3696",
        "radar cross section: plausible in dBsm: -20 to 34",
        "motion: the radar moves with 6.18 m/s along x",
        "preset: continental_ars548 (18 of 18 fields by name and type)",
        f"next: gda-tracker replay {street} --params {path}",
    ):
        assert text in said, text
    assert run("replay", street, "--params", path, "--offline") == 0
    said = capsys.readouterr()
    assert "standing still: 99.7% of the points" in said.out
    assert "confirmed tracks: 0" in said.out
    assert not said.err
    # Without the parameters the street moves, and replay says why.
    assert run("replay", street, "--offline") == 0
    said = capsys.readouterr()
    assert "confirmed tracks: 0" not in said.out
    assert "the radar moves: with sensor_speed_mps 6.18" in said.err


def test_a_bag_of_several_topics(script, tmp_path, capsys):
    path = tmp_path / "bag"
    kind = "sensor_msgs/msg/PointCloud2"
    topics = [
        BagTopic("/front", kind),
        BagTopic("/walk", kind),
        BagTopic("/log", "std_msgs/msg/Header"),
    ]
    frames = list(mmwave.frames(script.WALK))[:6]
    with BagWriter(path, topics) as bag:
        for stamp_ns, cloud in script.ars548_clouds(3):
            bag.write("/front", cloud, stamp_ns)
        for stamp_ns, cloud in script.walk_clouds(frames):
            bag.write("/walk", cloud, stamp_ns)
    assert run("inspect", path) == 0
    said = capsys.readouterr().out
    assert "preset: continental_ars548" in said
    assert "preset: mmwave_walk" in said
    assert "/log: std_msgs/msg/Header, 0 messages" in said
    assert run("inspect", path, "--yaml", tmp_path / "x.yaml") == 2
    assert "several topics; choose one with --topic: /front, /walk" in capsys.readouterr().err
    assert run("inspect", path, "--topic", "/walk", "--yaml", tmp_path / "x.yaml") == 0
    assert "--topic /walk --params" in capsys.readouterr().out
    for arguments, message in (
        (("--topic", "/up"), "topic /up: allowed is one of /front, /walk"),
        (("--topic", "/log"), "topic /log (std_msgs/msg/Header): allowed is one of /front, /walk"),
    ):
        assert run("inspect", path, *arguments) == 2
        assert message in capsys.readouterr().err
    assert run("replay", path, "--offline", "--topic", "/walk", "--preset", "mmwave_walk") == 0
    assert "parameters: preset mmwave_walk" in capsys.readouterr().out


def test_files_and_recordings_of_our_own(capsys):
    assert run("inspect", SRR520) == 0
    said = capsys.readouterr().out
    assert "preset: continental_srr520 (by the kind of file)" in said
    assert "as the preset finds for itself" in said
    assert run("inspect", ROOT / "data" / "autoferry" / "scenario16") == 0
    said = capsys.readouterr().out
    assert "these are detections already, which need none" in said
    assert "/truth: gda_tracker_msgs/msg/ScanTruth, 72 messages" in said


def test_replay_on_top_of_a_preset(street, tmp_path, capsys):
    path = tmp_path / "speed.yaml"
    path.write_text("radar_input:\n  ros__parameters:\n    sensor_speed_mps: 6.25\n")
    assert run("replay", street, "--offline", "--params", path) == 0
    said = capsys.readouterr().out
    assert "preset continental_ars548 (guessed from the fields) and" in said
    assert "confirmed tracks: 0" in said


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("replay", SRR520, "--topic", "/x"), "--topic /x: allowed with bags and ASTERIX only"),
        (("replay", SRR520, "--preset", "x"), "preset 'x': allowed is one of altos"),
        (("replay", "crossing_targets", "--preset", "altos"), "allowed with recordings only"),
        (("inspect", SRR520, "--topic", "/x"), "--topic /x: allowed with bags and ASTERIX only"),
        (("inspect", ROOT / "setup.py"), "no adapter knows this content"),
        (("inspect", "/x", "--seconds", "0"), "--seconds 0.0, --wait 10.0: allowed are numbers"),
        (("run", "--input", "/x", "--preset", "x"), "preset 'x': allowed is one of altos"),
    ],
)
def test_errors_are_one_line_and_say_what_is_allowed(arguments, message, capsys):
    assert run(*arguments) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1


def test_a_file_that_is_not_there_is_no_topic_either(capsys):
    assert main(["inspect", "missing/plots.csv"]) == 2
    told = capsys.readouterr().err.splitlines()
    assert told == [
        "gda-tracker inspect: missing/plots.csv: no such file, and no name that a topic can have"
    ]
