"""Simulated runs: statistics against the scenario, and reproducibility."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chisquare, kstest

from gda_tracker.attributes.rcs import cumulative_probability
from gda_tracker.simulation.scenarios import Scenario, load_scenario
from gda_tracker.simulation.simulate import CLUTTER, simulate
from gda_tracker.simulation.targets import true_states
from gda_tracker.vocabulary import Recording

RUNS = 60
# Fixed seed: the checks below either always pass or always fail.
SIGNIFICANCE = 1e-3


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return load_scenario("crossing_targets")


@pytest.fixture(scope="module")
def recordings(scenario) -> list[Recording]:
    return [simulate(scenario, 7, run) for run in range(RUNS)]


def gather(recordings: list[Recording], target: int) -> dict[str, np.ndarray]:
    """Measurements of one target (or of the clutter) over all scans of all runs."""
    rows = []
    for recording in recordings:
        for k, (d, t) in enumerate(zip(recording.detections, recording.truth, strict=True)):
            own = t.source_id == target
            n = np.count_nonzero(own)
            state = t.target_state[t.target_id == target].reshape(-1, 4)
            position = np.repeat(state[:, :2], n, axis=0) if len(state) else np.zeros((n, 2))
            rows.append(
                np.column_stack(
                    [np.full(n, k), d.range_m[own], d.azimuth_rad[own], d.rcs_m2[own], position]
                )
            )
    names = ("scan", "range", "azimuth", "rcs", "x", "y")
    return dict(zip(names, np.concatenate(rows).T, strict=True))


@pytest.mark.parametrize("target", [1, 2])
def test_noise_is_gaussian_with_the_sensors_deviations(recordings, target):
    found = gather(recordings, target)
    range_error = found["range"] - np.hypot(found["x"], found["y"])
    azimuth_error = found["azimuth"] - np.arctan2(found["y"], found["x"])
    assert kstest(range_error / 60.0, "norm").pvalue > SIGNIFICANCE
    assert kstest(azimuth_error / math.radians(0.3), "norm").pvalue > SIGNIFICANCE
    assert abs(np.corrcoef(range_error, azimuth_error)[0, 1]) < 0.1


@pytest.mark.parametrize(("target", "mean", "swerling"), [(1, 1.2, 3), (2, 4.0, 3), (-1, 0.3, 2)])
def test_radar_cross_sections_follow_their_swerling_model(recordings, target, mean, swerling):
    rcs = gather(recordings, target)["rcs"]
    assert kstest(rcs, lambda s: cumulative_probability(s, mean, swerling)).pvalue > SIGNIFICANCE


def test_clutter_is_poisson_and_uniform_in_the_rectangle(recordings, scenario):
    found = gather(recordings, CLUTTER)
    x = found["range"] * np.cos(found["azimuth"])
    y = found["range"] * np.sin(found["azimuth"])
    for values, (low, high) in [(x, scenario.clutter.region_x_m), (y, scenario.clutter.region_y_m)]:
        assert values.min() >= low - 1e-6
        assert values.max() <= high + 1e-6
        assert kstest(values, "uniform", (low, high - low)).pvalue > SIGNIFICANCE
    counts = np.array(
        [np.count_nonzero(t.source_id == CLUTTER) for r in recordings for t in r.truth]
    )
    assert counts.mean() == pytest.approx(10.0, abs=3.5 * math.sqrt(10.0 / len(counts)))
    assert counts.var() == pytest.approx(10.0, rel=0.15)


def test_initiation_scans_are_always_detected_and_the_others_with_p_d(recordings):
    scenario = load_scenario("crossing_targets")
    low = replace(scenario, sensor=replace(scenario.sensor, detection_probability=0.6))
    detected = np.zeros(scenario.time.n_scans)
    for run in range(RUNS):
        for k, t in enumerate(simulate(low, 3, run).truth):
            detected[k] += np.count_nonzero(t.source_id >= 0)
    np.testing.assert_array_equal(detected[:2], 2 * RUNS)
    trials = 2 * RUNS * (scenario.time.n_scans - 2)
    hits = detected[2:].sum()
    assert chisquare([hits, trials - hits], [0.6 * trials, 0.4 * trials]).pvalue > SIGNIFICANCE


def test_each_target_gives_at_most_one_detection_per_scan(recordings):
    for recording in recordings[:10]:
        for t in recording.truth:
            own = t.source_id[t.source_id >= 0]
            assert len(np.unique(own)) == len(own)


def test_order_within_a_scan_tells_nothing(recordings):
    first = [t.source_id[0] for r in recordings for t in r.truth]
    # 2 of about 12 detections come from targets.
    assert np.mean(np.array(first) >= 0) == pytest.approx(2.0 / 11.0, abs=0.04)


def test_truth_is_the_exact_path(scenario, recordings):
    states = true_states(scenario)
    for k, t in enumerate(recordings[0].truth):
        np.testing.assert_array_equal(t.target_state, states[k])
        np.testing.assert_array_equal(t.target_id, [1, 2])
        assert t.target_class == ("fighter", "cargo")


def test_stamps_are_whole_scan_periods_from_the_base(scenario):
    recording = simulate(scenario, 0, base_stamp_ns=1_700_000_000_123_456_789)
    stamps = [d.stamp_ns for d in recording.detections]
    expected = [1_700_000_000_123_456_789 + 5_000_000_000 * k for k in range(25)]
    assert stamps == expected
    assert [t.stamp_ns for t in recording.truth] == expected


def arrays(recording: Recording) -> list[np.ndarray]:
    found = []
    for d, t in zip(recording.detections, recording.truth, strict=True):
        found += [d.range_m, d.azimuth_rad, d.rcs_m2, t.source_id, t.target_state]
    return found


def test_a_run_depends_on_seed_and_run_alone(scenario):
    again = arrays(simulate(scenario, 5, 3))
    for one, other in zip(arrays(simulate(scenario, 5, 3)), again, strict=True):
        np.testing.assert_array_equal(one, other)
    for seed, run in [(5, 4), (6, 3)]:
        different = simulate(scenario, seed, run).detections[0]
        assert not np.isin(different.range_m, again[0]).any()


def test_more_clutter_leaves_the_targets_as_they_are(scenario):
    dense = replace(scenario, clutter=replace(scenario.clutter, mean_false_alarms_per_scan=40.0))
    one, other = gather([simulate(scenario, 5)], 1), gather([simulate(dense, 5)], 1)
    for name in one:
        np.testing.assert_array_equal(one[name], other[name])


def test_a_sensor_elsewhere_measures_from_there(scenario):
    quiet = replace(
        scenario,
        sensor=replace(
            scenario.sensor, position_m=(-3000.0, 60000.0), azimuth_std_deg=0.0, range_std_m=0.0
        ),
        clutter=replace(scenario.clutter, mean_false_alarms_per_scan=0.0),
    )
    recording = simulate(quiet, 0)
    d, t = recording.detections[0], recording.truth[0]
    np.testing.assert_array_equal(d.sensor_position_m, [-3000.0, 60000.0, 0.0])
    x = -3000.0 + d.range_m * np.cos(d.azimuth_rad)
    y = 60000.0 + d.range_m * np.sin(d.azimuth_rad)
    expected = t.target_state[t.source_id - 1, :2]
    np.testing.assert_allclose(np.column_stack([x, y]), expected, atol=1e-6)
    assert np.all(np.abs(d.azimuth_rad) <= math.pi)
