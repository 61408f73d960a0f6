"""The simulated radar that does not resolve close targets."""

import dataclasses

import numpy as np
import pytest

from gda_tracker.parameters import ParameterError, from_mapping
from gda_tracker.simulation.resolution import merged_detections, unresolved_groups
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.simulation.simulate import simulate
from gda_tracker.tracking.parameters import TrackManagerParameters


def test_pairs_are_linked_as_often_as_the_resolution_says():
    scenario = load_scenario("unresolved_pair")
    # The half-distance in range, then in azimuth, then three in a row that hang together.
    positions = np.zeros((4000, 3, 2))
    positions[:, :, 1] = [40_000.0, 40_150.0, 49_000.0]
    group = unresolved_groups(scenario, positions, np.random.default_rng(1))
    assert (group[:, 1] == 0).mean() == pytest.approx(0.5, abs=0.03)
    assert (group[:, 2] == 2).all()
    angle = np.pi / 2 + np.radians([0.0, 1.0, 2.0])
    positions = np.tile(40_000.0 * np.stack([np.cos(angle), np.sin(angle)], 1), (4000, 1, 1))
    group = unresolved_groups(scenario, positions, np.random.default_rng(2))
    # P_u is 1/2, 1/2 and 1/16; the ends are one group through the middle as well.
    assert (group[:, 1] == 0).mean() == pytest.approx(0.5 + 0.5 * 0.5 / 16, abs=0.03)
    assert (group[:, 2] == 0).mean() == pytest.approx(1 / 16 + 15 / 16 / 4, abs=0.03)


def test_a_group_gives_one_detection_at_the_mean():
    scenario = load_scenario("unresolved_pair")
    positions = np.array([[[-100.0, 40_000.0], [300.0, 40_100.0]]] * 3)
    group = np.array([[0, 0], [0, 1], [0, 0]])
    seen = np.array([[True, True], [True, True], [False, True]])
    polar = np.hypot(*positions[0].T), np.arctan2(positions[0, :, 1], positions[0, :, 0])
    noisy = np.tile(polar[0], (3, 1)) + 5.0, np.tile(polar[1], (3, 1))
    rcs = np.array([[1.0, 2.0]] * 3)
    found, ranges, azimuths, strength, source = merged_detections(
        scenario, positions, group, seen, noisy, rcs, np.random.default_rng(3)
    )
    assert found.tolist() == [[True, False], [True, True], [False, False]]
    assert ranges[0, 0] == pytest.approx(polar[0].mean() + 5.0)
    assert azimuths[0, 0] == pytest.approx(polar[1].mean())
    np.testing.assert_allclose(ranges[1], polar[0] + 5.0)
    assert strength[0, 0] == 3.0
    assert source[1].tolist() == [0, 1]


def test_without_a_resolution_nothing_else_is_drawn():
    scenario = load_scenario("unresolved_pair")
    resolved = dataclasses.replace(
        scenario,
        sensor=dataclasses.replace(
            scenario.sensor, resolution_range_m=0.0, resolution_azimuth_deg=0.0
        ),
    )
    merged, whole = simulate(scenario, 1), simulate(resolved, 1)
    counts = [[len(scan.range_m) for scan in one.detections] for one in (merged, whole)]
    assert counts[0][:2] == counts[1][:2]
    assert sum(counts[0]) < sum(counts[1]) - 5
    first = [np.sort(one.detections[0].range_m) for one in (merged, whole)]
    np.testing.assert_allclose(*first, rtol=1e-12)
    told = merged.preset["track_manager"]
    assert (told["resolution_range_m"], "resolution_range_m" in whole.preset["track_manager"]) == (
        150.0,
        False,
    )
    untold = load_scenario("unresolved_pair_untold")
    assert "resolution_range_m" not in simulate(untold, 1).preset["track_manager"]
    np.testing.assert_array_equal(
        simulate(untold, 1).detections[9].range_m, merged.detections[9].range_m
    )


def test_values_that_do_not_go_together_are_refused():
    sensor = load_scenario("unresolved_pair").sensor
    with pytest.raises(ParameterError, match="resolution_azimuth_deg = 0"):
        dataclasses.replace(sensor, resolution_azimuth_deg=0.0)
    with pytest.raises(ParameterError, match="false_alarm_probability = 0.01"):
        dataclasses.replace(sensor, false_alarm_probability=0.01)
    with pytest.raises(ParameterError, match="resolution_range_m = 100 and resolution_azimuth"):
        from_mapping(TrackManagerParameters, {"resolution_range_m": 100.0})
    both = {"resolution_range_m": 100.0, "resolution_azimuth_rad": 0.1}
    with pytest.raises(ParameterError, match="signal_strength"):
        from_mapping(TrackManagerParameters, {**both, "signal_strength": "swerling_1"})
