"""Scenarios with several sensors: the file, what is simulated, what the tracker is told."""

from __future__ import annotations

import copy

import numpy as np
import pytest
import yaml

from gda_tracker.kinematics.measurement_models import measure
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import (
    ScenarioError,
    load_scenario,
    scenario_from_mapping,
    shipped_scenarios,
)
from gda_tracker.simulation.sensor_network import simulate_network, sites_at
from gda_tracker.tracking.ring import stage_parameters

WITH_SENSORS = ("busy_coast", "crossing_bearings", "mixed_sensors", "moving_emitter", "two_sensors")


@pytest.fixture
def content():
    return copy.deepcopy(yaml.safe_load(shipped_scenarios()["mixed_sensors"].read_text()))


@pytest.mark.parametrize("name", WITH_SENSORS)
def test_the_nodes_take_the_preset(name):
    scenario = load_scenario(name)
    told = stage_parameters(tracker_preset(scenario))["track_manager"]
    assert told.initiation == "automatic"
    for sensor in scenario.sensors:
        own = told.of_sensor(sensor.id)
        assert told.model_of(sensor.id) == sensor.model
        assert own.clutter_density_per_m_rad == sensor.clutter_density
        assert own.range_std_m == sensor.range_std_m


def test_detections_are_measurements_with_noise_in_the_order_of_time():
    scenario = load_scenario("mixed_sensors")
    gaps = {sensor.id: [] for sensor in scenario.sensors}
    count = {sensor.id: 0 for sensor in scenario.sensors}
    sensors = {sensor.id: sensor for sensor in scenario.sensors}
    for run in range(8):
        recording = simulate_network(scenario, 5, run)
        stamps = [scan.stamp_ns for scan in recording.detections]
        assert stamps == sorted(stamps)
        for scan, truth in zip(recording.detections, recording.truth, strict=True):
            sensor = sensors[scan.sensor_id]
            model = sensor.measured
            columns = {
                "range": scan.range_m,
                "azimuth": scan.azimuth_rad,
                "range_rate": scan.range_rate_mps,
            }
            for quantity, column in columns.items():
                if quantity not in model.quantities:
                    assert column is None or np.isnan(column).all()
            value = np.stack([columns[q] for q in model.quantities], axis=1)
            wanted = measure(model, sites_at(sensor, scan.stamp_ns / 1e9), truth.target_state[0])
            own = truth.source_id == 1
            gaps[scan.sensor_id] += list((value[own] - wanted) / sensor.deviations)
            count[scan.sensor_id] += int((~own).sum())
    scans = 8 * scenario.time.n_scans
    for sensor in scenario.sensors:
        found = np.array(gaps[sensor.id])
        assert len(found) / scans == pytest.approx(sensor.detection_probability, abs=0.08)
        assert np.abs(found.mean(axis=0)).max() < 0.25
        assert found.std(axis=0) == pytest.approx(1.0, abs=0.15)
        assert count[sensor.id] / scans == pytest.approx(sensor.false_alarms_per_scan, rel=0.25)


def test_platforms_move_and_runs_can_be_repeated():
    scenario = load_scenario("moving_emitter")
    one, other = (simulate_network(scenario, 2, 7).detections for _ in range(2))
    for scan, again in zip(one, other, strict=True):
        np.testing.assert_array_equal(scan.range_m, again.range_m)
    last = one[-1]
    np.testing.assert_allclose(last.sensor_position_m, [59 * 4 * 150.0, 59 * 4 * 60.0, 0.0])
    np.testing.assert_allclose(last.reference_velocity_mps, [60.0, -150.0, 0.0])
    different = simulate_network(scenario, 2, 8).detections
    assert not np.array_equal(different[0].range_m, one[0].range_m)


def _sensor(key, value):
    def change(content):
        content["sensors"][1][key] = value

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_sensor("model", "sonar"), r"sensors\[1\]: model"),
        (_sensor("range_std_m", 0.0), r"sensors\[1\]: range_std_m"),
        (_sensor("range_extent_m", [5.0, 5.0]), r"range_extent_m = \[5, 5\]"),
        (_sensor("reference_position_m", [1000.0, -4000.0]), "another place than position_m"),
        (_sensor("id", "finder"), "names that differ"),
        (_sensor("colour", "red"), "unknown key 'colour'"),
        (lambda content: content.pop("reach"), "missing key reach"),
        (lambda content: content.update(sensors=[]), "list of 1 or more"),
        (lambda content: content.update(sensor={}), "unknown key 'sensor'"),
    ],
)
def test_a_wrong_section_is_named(content, change, message):
    change(content)
    with pytest.raises(ScenarioError, match=message):
        scenario_from_mapping(content)


def test_false_bearings_are_as_many_in_the_busy_sector_as_its_density_says():
    scenario = load_scenario("busy_coast")
    sensor = scenario.sensors[0]
    rng = np.random.default_rng(1)
    azimuth = np.concatenate([sensor.false_alarms(rng)[:, 0] for _ in range(4000)])
    count, edges = np.histogram(np.mod(azimuth, 2.0 * np.pi), 36, (0.0, 2.0 * np.pi))
    centre = 0.5 * (edges[1:] + edges[:-1])
    expected = 4000.0 * sensor.true_clutter_density(centre) * np.radians(10.0)
    assert np.all(np.abs(count - expected) < 5.0 * np.sqrt(expected))
    assert expected.max() > 80.0 * expected.min()
    assert expected.sum() == pytest.approx(4000.0 * sensor.false_alarms_per_scan)


@pytest.mark.parametrize(
    ("place", "changes"),
    [
        (1, {"busy_share": 0.5, "busy_sector_deg": [0.0, 30.0]}),  # it has no azimuths
        (0, {"busy_share": 0.5}),
        (0, {"busy_share": 0.5, "busy_sector_deg": [30.0, 0.0]}),
        (0, {"busy_share": 0.5, "busy_sector_deg": [0.0, 400.0]}),
    ],
)
def test_a_busy_sector_that_is_none_is_refused(content, place, changes):
    content["sensors"][place].update(changes)
    with pytest.raises(ScenarioError, match="busy_share = 0.5"):
        scenario_from_mapping(content)
