"""AIS and drone tables through the simulated radar: read, told, tracked, scored."""

import json
import math

import numpy as np
import pytest

from gda_tracker import cli
from gda_tracker.io.adapters import InputOptions, RecordingError, guess_adapter, load_recording
from gda_tracker.resources import resource

AIS = resource("data", "trajectories", "solent_ais_15min.csv")
UAV = resource("data", "trajectories", "uav.csv")
AIS_HEAD = "Time,MMSI,Latitude_degrees,Longitude_degrees,COG_degrees,SOG_knots"
UAV_HEAD = "time,timestamp,latitude,longitude,altitude (m),speed"


@pytest.fixture
def few_ships(tmp_path):
    """Two ships for four minutes: one goes East with 10 knots, one is at anchor."""
    lines = [AIS_HEAD]
    for k in range(13):
        east = math.degrees(10 * 1852 / 3600 * 20 * k / (6.39e6 * math.cos(math.radians(50.76))))
        minute, second = divmod(20 * k, 60)
        time = f"2016-01-12 13:{minute:02}:{second:02}.5"
        lines.append(f"{time},235000001,50.76,{-1.10 + east:.6f},90,10")
        lines.append(f"{time},235000002,50.80,-1.10,360,0")
    lines.append("2016-01-12 13:01:10.0,235000002,10.0,54.8,360,0")  # a position far away
    path = tmp_path / "ships.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_the_shipped_tables():
    assert guess_adapter(AIS) == "ais"
    assert guess_adapter(UAV) == "uav"
    ships, drone = load_recording(AIS), load_recording(UAV)
    assert len(ships.detections) == len(ships.truth) == 300
    assert len({int(i) for one in ships.truth for i in one.target_id}) == 68
    assert len(drone.detections) == len(drone.truth) == 963
    assert "MIT" in ships.origin
    for recording in (ships, drone):
        assert all((one.source_id >= -1).all() for one in recording.truth)
        speeds = np.concatenate([np.hypot(*one.target_state[:, 2:].T) for one in recording.truth])
        assert speeds.max() < 26.0
    # The drone has a height, ships have none.
    assert drone.detections[0].elevation_rad is not None
    assert ships.detections[0].elevation_rad is None


def test_nobodys_identity_is_in_the_sample_or_comes_out(few_ships):
    ids = {line.split(",")[1] for line in AIS.read_text().splitlines()[1:]}
    assert len(ids) == 79
    assert all(len(name) == 2 for name in ids)
    recording = load_recording(few_ships)
    assert {int(i) for one in recording.truth for i in one.target_id} == {1, 2}
    assert "235" not in " ".join([recording.origin, *recording.notes])


def test_ships_are_where_they_reported_to_be(few_ships):
    recording = load_recording(few_ships)
    moving = np.array([one.target_state[0] for one in recording.truth])
    assert moving[:, 2] == pytest.approx(10 * 1852 / 3600, rel=2e-3)
    assert np.abs(moving[:, 3]).max() < 0.05
    anchored = np.array([one.target_state[1] for one in recording.truth])
    assert np.hypot(*(anchored[:, :2] - anchored[0, :2]).T).max() < 1e-6
    # 50.80 N, 1.10 W from 50.778 N, 1.0885 W.
    assert anchored[0, 1] == pytest.approx(0.022 * 111_240, rel=2e-3)
    assert anchored[0, 0] == pytest.approx(-0.0115 * 70_500, rel=1e-2)


def test_seed_and_run_choose_the_noise(few_ships):
    one, same, other, run = (
        load_recording(few_ships, "ais", InputOptions(seed=seed, run=run))
        for seed, run in ((1, 0), (1, 0), (2, 0), (1, 1))
    )
    ranges = [np.concatenate([s.range_m for s in r.detections]) for r in (one, same, other, run)]
    assert np.array_equal(ranges[0], ranges[1])
    assert not np.array_equal(ranges[0], ranges[2])
    assert not np.array_equal(ranges[0], ranges[3])


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (f"{AIS_HEAD}\n", "no rows"),
        (f"{AIS_HEAD}\n2016-01-12 13:02:11,1,50.7,-1.1,x,0\n", "line 2: expected Time"),
        (f"{AIS_HEAD}\nnoon,1,50.7,-1.1,0,0\n", "line 2: expected Time"),
        (f"{AIS_HEAD}\n2016-01-12 13:02:11,1\n", "line 2: expected Time"),
        (f"{AIS_HEAD}\n2016-01-12 13:02:11,1,50.7,-1.1,0,0\n", "no trajectory of two positions"),
        (f"{UAV_HEAD}\n2019-12-09 10:49:35,1,nan,-30.9,708,0\n", "positions that are not finite"),
        (f"{UAV_HEAD}\n2019-12-09 10:49:35,1,50.3,-30.9,708,0\n", "fewer than two positions"),
    ],
)
def test_tables_that_cannot_be_read(tmp_path, text, reason):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(RecordingError, match=reason):
        load_recording(path)


def test_tables_without_the_columns(tmp_path):
    path = tmp_path / "other.csv"
    path.write_text("a,b\n1,2\n")
    with pytest.raises(RecordingError, match="columns Time, MMSI, .* are missing"):
        load_recording(path, "ais")


def test_replay_and_evaluate(few_ships, tmp_path, capsys):
    arguments = ["--offline", "--method", "map/none/cv", "--seed", "3"]
    assert cli.main(["replay", str(few_ships), *arguments]) == 0
    said = capsys.readouterr().out
    assert "seed 3: 2 targets within 12 km" in said
    assert "parameters: preset simulated_coastal_radar" in said
    assert "targets: 2, completeness" in said
    assert "(within 70 m)" in said
    path = tmp_path / "out.json"
    methods = ["--method", "map/none/cv", "--method", "default"]
    command = ["evaluate", str(few_ships), "--adapter", "ais", "--runs", "2", *methods]
    assert cli.main([*command, "--json", str(path)]) == 0
    said = capsys.readouterr().out
    assert "ships: 2 targets, 2 runs, match distance 70 m" in said
    (one,) = json.loads(path.read_text())
    assert [score["method"] for score in one["methods"]] == ["map/none/cv", "default"]
    for score in one["methods"]:
        assert score["completeness"] > 0.85
        assert score["not_found"] == 0.0
        assert 0.0 < score["position_rmse_m"] < 30.0
        parts = score["localisation"] + score["missed"] + score["false"]
        assert parts >= score["gospa_m"] ** 2 - 1e-6  # the mean of squares, and of the root


@pytest.mark.parametrize(
    ("more", "reason"),
    [
        (("--runs", "0"), "--runs 0: allowed is an integer >= 1"),
        (("--report", "x.html"), "--report: allowed with scenarios only"),
        (("--confusion",), "--confusion: allowed with scenarios only"),
        (("--method", "map/none/xx"), "filter"),
    ],
)
def test_options_that_do_not_go_with_trajectories(more, reason, capsys):
    assert cli.main(["evaluate", str(UAV), "--adapter", "uav", *more]) == 2
    assert reason in capsys.readouterr().err
