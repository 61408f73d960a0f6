"""Inspection: statistics, stamps, meanings, plausible RCS, parameters that run."""

import math

import numpy as np
import pytest
import yaml
from cloud_examples import cloud
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.errors import UserError
from gda_tracker.io.adapters import continental_yaml
from gda_tracker.io.parameter_files import read_parameter_file
from gda_tracker.io.radar import inspection as inspection_module
from gda_tracker.io.radar.frames import RadarFrame, detections_of_frame, frame_of_columns
from gda_tracker.io.radar.guesses import guess, judge_rcs
from gda_tracker.io.radar.input_parameters import RadarInputParameters
from gda_tracker.io.radar.inspection import inspect_frames, look_at_stamps
from gda_tracker.io.radar.inspection_report import report
from gda_tracker.io.radar.messages import frame_of_message
from gda_tracker.io.radar.parameter_groups.source import POINT_CLOUD
from gda_tracker.io.radar.recommendation import recommend, recommended_yaml
from gda_tracker.parameters import from_mapping
from gda_tracker.resources import resource
from gda_tracker.tracking.ring import stage_parameters

SECOND = 10**9


def columns_frame(columns, stamp_ns=0, kind="table", frame_id="radar"):
    arrays = {name: np.asarray(values, dtype=float) for name, values in columns.items()}
    return frame_of_columns(kind, stamp_ns, frame_id, arrays)


def float_cloud(columns, stamp_ns=0):
    """A frame like that of a PointCloud2 of float32."""
    arrays = {name: np.asarray(values, dtype=float) for name, values in columns.items()}
    types = dict.fromkeys(arrays, "float32")
    return RadarFrame(
        POINT_CLOUD, stamp_ns, "radar", types, lambda names, _: {n: arrays[n] for n in names}
    )


# --- statistics and stamps


def test_empty_frames_of_other_fields_do_not_hide_those_with_points():
    # RadarTracks without tracks does not tell whether tracks bring a covariance.
    empty, full = {"x": []}, {"x": [1.0, 2.0], "x_std": [0.1, 0.2]}
    frames = [columns_frame(columns, i) for i, columns in enumerate([empty, full, empty, full])]
    found = inspect_frames("x", frames)
    assert found.points == [0, 2, 0, 2]
    assert [item.name for item in found.statistics] == ["x", "x_std"]
    assert found.of("x_std").number == 4
    assert len(found.layouts) == 1
    assert len(found.examples) == 2


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.lists(st.floats(-1e6, 1e6) | st.just(math.nan), max_size=8), min_size=1, max_size=6)
)
def test_statistics_are_those_of_all_values(parts):
    found = inspect_frames("x", [columns_frame({"a": part}) for part in parts])
    every = np.concatenate([np.array(part, dtype=float) for part in parts])
    (item,) = found.statistics
    assert item.number == len(every)
    finite = every[np.isfinite(every)]
    if len(every):
        assert item.nan_share == pytest.approx(np.isnan(every).mean())
    if len(finite):
        assert (item.minimum, item.maximum) == (finite.min(), finite.max())
        assert item.median == np.median(finite)
    else:
        assert math.isnan(item.minimum)
        assert math.isnan(item.median)


def test_long_recordings_are_thinned_but_for_their_extremes(monkeypatch):
    monkeypatch.setattr(inspection_module, "MOST_POINTS", 100)
    frames = [columns_frame({"a": np.full(10, k), "b": np.full(10, -k)}) for k in range(1000)]
    found = inspect_frames("x", frames)
    item = found.of("a")
    assert (item.minimum, item.maximum, item.number) == (0, 999, 10_000)
    assert 400 < item.median < 600
    assert len(found.values["a"]) <= 100
    np.testing.assert_array_equal(found.values["a"], -found.values["b"])


def test_stamps_of_an_uneven_topic():
    seconds = [1.0, 1.1, 1.2, 1.2, 1.3, 1.15, 1.25, 2.25, 2.35]
    found = look_at_stamps([round(s * SECOND) for s in seconds])
    assert found.rate_hz == pytest.approx(10.0)
    assert (found.steps_back, found.repeated, found.gaps) == (1, 1, 1)
    assert found.longest_gap_s == pytest.approx(1.0)
    assert found.duration_s == pytest.approx(1.35)
    assert look_at_stamps([0, 0]).unset == 2
    assert math.isnan(look_at_stamps([5]).rate_hz)
    assert look_at_stamps([]).number == 0


def test_frames_with_other_fields_or_broken_ones_are_counted():
    def broken(names, overrides):
        raise UserError("data is short")

    frames = [
        columns_frame({"x": [1.0], "y": [2.0]}),
        columns_frame({"x": [1.0], "z": [2.0]}),
        RadarFrame("table", 5, "", {"x": "number", "y": "number"}, broken),
    ]
    found = inspect_frames("x", frames)
    assert len(found.layouts) == 2
    assert found.unreadable == {"data is short": 1}
    assert found.of("x").number == 1
    text = report(recommend(found))
    assert "2 layouts" in text
    assert "1 frames cannot be read: data is short" in text
    assert "unset" in text


# --- what fields mean


@settings(max_examples=30, deadline=None)
@given(
    st.sampled_from(["rad", "deg"]),
    st.sampled_from([1, -1]),
    st.sampled_from([0, 90, -90, 180]),
    st.integers(0, 100),
)
def test_the_sense_of_an_azimuth_is_found_and_its_parameters_are_right(unit, sign, zero, seed):
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-20.0, 60.0, (2, 40))
    azimuth = sign * (np.arctan2(y, x) - np.deg2rad(zero))
    published = np.rad2deg(azimuth) if unit == "deg" else azimuth
    columns = {"x": x, "y": y, "range": np.hypot(x, y), "azimuth": published}
    seen = inspect_frames("x", [columns_frame(columns)])
    found = guess(seen)
    assert found.units["azimuth"] == unit
    parameters = from_mapping(RadarInputParameters, found.parameters)
    scan = detections_of_frame(columns_frame(columns), parameters).detections
    turn = np.angle(np.exp(1j * (scan.azimuth_rad - np.arctan2(y, x))))
    assert np.abs(turn).max() < 1e-6


def test_an_azimuth_that_contradicts_x_and_y_is_left_out():
    rng = np.random.default_rng(3)
    x, y, azimuth = rng.uniform(-3.0, 3.0, (3, 50))
    seen = inspect_frames("x", [columns_frame({"x": x, "y": y, "azimuth": azimuth})])
    found = guess(seen)
    assert found.parameters["position_source"] == "cartesian"
    assert "does not agree" in found.remarks[0]


def test_names_that_hint_are_taken_and_said():
    names = {"dist": [10.0, 20.0], "theta": [30.0, 45.0], "vel": [1.0, 2.0], "intensity": [5, 6]}
    found = recommend(inspect_frames("x", [columns_frame(names)]))
    assert found.guesses.quantities == {"range": "dist", "azimuth": "theta", "range_rate": "vel"}
    assert found.changes["radar_input"]["field_names"] == [
        "range=dist",
        "azimuth=theta",
        "range_rate=vel",
    ]
    assert found.changes["radar_input"]["angle_unit"] == "deg"
    assert "signal strength, no radar cross section" in report(found)
    assert "preset: none fits" in report(found)


# --- radar cross sections


@pytest.mark.parametrize(
    ("values", "usable", "parameters", "text"),
    [
        (np.linspace(-20, 34, 50), True, {"rcs_unit": "dbsm"}, "plausible in dBsm: -20 to 34"),
        (np.zeros(50), False, {"rcs_unit": "none"}, "all values are 0"),
        (np.full(50, 7.0), False, {"rcs_unit": "none"}, "a constant is no radar cross section"),
        (
            np.arange(108, 163),
            True,
            {"rcs_unit": "dbsm", "rcs_offset": -128.0},
            "whole numbers around 128: dBsm + 128",
        ),
        (np.linspace(-300, 20, 50), False, {"rcs_unit": "none"}, "outside -60 to 70 dBsm"),
        (np.linspace(-20, 90, 50), False, {"rcs_unit": "none"}, "outside -60 to 70 dBsm"),
        (np.geomspace(0.01, 5e4, 50), True, {"rcs_unit": "m2"}, "plausible in m2"),
        (np.linspace(0.5, 30.0, 50), False, {"rcs_unit": "none"}, "declare rcs_unit"),
        (np.zeros(0), False, {"rcs_unit": "none"}, "no value is known"),
    ],
)
def test_radar_cross_sections_are_judged(values, usable, parameters, text):
    said, ok, found = judge_rcs(values)
    assert (ok, found) == (usable, parameters)
    assert text in said


def test_a_float_declared_as_a_byte_is_found():
    """The SRR520 driver's rcs; a true byte, signed or not, is left alone."""
    rng = np.random.default_rng(5)
    n = 60
    rcs = rng.normal(-5.0, 8.0, n).astype(np.float32)
    base = {name: rng.uniform(5.0, 50.0, n) for name in ("x", "y")}

    def seen(values, kind, declared=None):
        layout = [("x", "f4", 0), ("y", "f4", 4), ("rcs", kind, 8), ("snr", "f4", 12)]
        message = cloud({**base, "rcs": values, "snr": base["x"]}, layout, declared=declared)
        from types import SimpleNamespace

        message.header = SimpleNamespace(stamp=SimpleNamespace(sec=1, nanosec=0), frame_id="r")
        return guess(inspect_frames("x", [frame_of_message(message, POINT_CLOUD)]))

    found = seen(rcs, "f4", {"rcs": "u1"})
    assert found.parameters["field_types"] == ["rcs=float32"]
    assert found.rcs_usable
    for values, kind in ((np.round(rcs), "i1"), (rng.integers(100, 160, n), "u1")):
        assert "field_types" not in seen(values, kind).parameters


# --- parameters that run


def runs(found, tmp_path):
    """Write the parameters, read them as ``replay`` would; return those of the radar input."""
    path = tmp_path / "radar.yaml"
    path.write_text(recommended_yaml(found))
    values = read_parameter_file(path)
    radar_input = values.pop("radar_input")
    stage_parameters(values)
    return from_mapping(RadarInputParameters, radar_input), values


def ars548_frame():
    (frame,) = continental_yaml.frames(
        resource("data", "continental", "ars548_1708578204_202447652_detection.yaml")
    )
    return frame


def test_the_radars_own_speed_goes_into_the_preset(tmp_path):
    found = recommend(inspect_frames("street", [ars548_frame()]))
    assert found.preset == "continental_ars548"
    radar_input, values = runs(found, tmp_path)
    assert radar_input.sensor_speed_mps == pytest.approx(6.2, abs=0.1)
    assert radar_input.rcs_unit == "dbsm"
    assert values["track_manager"]["attribute_term"] == "bayes"
    scan = detections_of_frame(ars548_frame(), radar_input)
    assert np.mean(scan.still) > 0.95
    text = recommended_yaml(found)
    assert "Set by inspect: 98% of the points then stand still, 0% without" in text
    # The preset's own comments stay.
    assert "A car gives several detections within 2 m" in text


def altos(rcs, n=40):
    rng = np.random.default_rng(7)
    x, y = rng.uniform(5.0, 80.0, n), rng.uniform(-20.0, 20.0, n)
    columns = {"x": x, "y": y, "z": rng.normal(0, 1, n), "h": np.zeros(n), "s": rcs, "v": x}
    return [float_cloud(columns, (k + 1) * SECOND // 10) for k in range(5)]


@pytest.mark.parametrize(
    ("rcs", "unit", "term"),
    [
        (np.geomspace(0.01, 900.0, 40), "m2", "bayes"),
        (np.full(40, 3.0), "none", "none"),
        (np.zeros(40), "none", "none"),
    ],
)
def test_radar_cross_sections_that_cannot_be_are_switched_off(rcs, unit, term, tmp_path):
    found = recommend(inspect_frames("altos", altos(rcs)))
    assert found.preset == "altos"
    radar_input, values = runs(found, tmp_path)
    assert radar_input.rcs_unit == unit
    assert values["track_manager"]["attribute_term"] == term


def test_stamps_that_are_empty_are_replaced(tmp_path):
    frames = [
        float_cloud(frame.read(list(frame.types), {})) for frame in altos(np.linspace(1, 2000, 40))
    ]
    found = recommend(inspect_frames("altos", frames))
    assert runs(found, tmp_path)[0].stamp_source == "received"
    assert "empty: the driver leaves them 0" in report(found)


@pytest.mark.parametrize("reach", [10.0, 200.0, 50_000.0])
def test_a_radar_that_no_preset_knows_gets_parameters_that_run(reach, tmp_path):
    rng = np.random.default_rng(11)
    columns = {
        "rho": rng.uniform(0.1, 1.0, 60) * reach,
        "az": rng.uniform(-60.0, 60.0, 60),
        "vr": rng.normal(0.0, 0.2, 60),
    }
    frames = [columns_frame(columns, k * SECOND // 10, POINT_CLOUD) for k in range(1, 8)]
    found = recommend(inspect_frames("new radar", frames))
    assert found.preset == ""
    radar_input, values = runs(found, tmp_path)
    scan = detections_of_frame(frames[0], radar_input)
    assert np.abs(scan.detections.azimuth_rad).max(initial=0.0) < 1.1
    assert values["track_manager"]["attribute_term"] == "none"
    assert yaml.safe_load(recommended_yaml(found))
    assert "everything below is guessed" in recommended_yaml(found)


def test_what_has_no_position_gets_no_parameters():
    found = recommend(inspect_frames("lidar", [columns_frame({"u": [1.0], "v": [2.0]})]))
    assert not found.usable
    with pytest.raises(UserError, match="lidar: no parameters can be given: no position"):
        recommended_yaml(found)
    empty = recommend(inspect_frames("empty", [columns_frame({"x": [], "y": []})]))
    assert empty.problem == "no point was seen"
    assert "parameters: no point was seen" in report(empty)
