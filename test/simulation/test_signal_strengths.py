"""Scenarios with signal strengths: what is strong enough is detected, as often as Swerling says."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest
import yaml
from scipy.stats import kstest

from gda_tracker.kinematics.signal_strength import swerling_detection_probability, threshold
from gda_tracker.simulation.scenarios import (
    ScenarioError,
    load_scenario,
    scenario_from_mapping,
    shipped_scenarios,
)
from gda_tracker.simulation.simulate import simulate


def test_detections_are_as_frequent_and_strong_as_swerling_says():
    scenario = load_scenario("weak_targets")
    scenario = replace(scenario, time=replace(scenario.time, n_scans=2000))
    recording = simulate(scenario, 1)
    source = np.concatenate([truth.source_id for truth in recording.truth[2:]])
    signal = np.concatenate([scan.attribute_values[0] for scan in recording.detections[2:]])
    rcs = np.concatenate([scan.rcs_m2 for scan in recording.detections[2:]])
    lambda_ = threshold(scenario.sensor.false_alarm_probability)
    assert signal.min() > lambda_
    np.testing.assert_allclose(rcs, signal - 1.0)
    for target in scenario.targets:
        own = signal[source == target.id]
        seen = swerling_detection_probability(np.array(target.rcs_mean_m2), 0.01)
        error = np.sqrt(seen * (1.0 - seen) / 1998)
        assert abs(len(own) / 1998 - seen) < 4.0 * error
        # Above the threshold an exponential signal is as it was above nothing.
        assert kstest(own - lambda_, "expon", args=(0, 1.0 + target.rcs_mean_m2)).pvalue > 1e-3
    assert kstest(signal[source < 0] - lambda_, "expon").pvalue > 1e-3
    assert all(len(np.unique(t.source_id[t.source_id > 0])) == 3 for t in recording.truth[:2])


def test_the_two_scenarios_differ_in_what_the_tracker_does_alone():
    on, off = (
        yaml.safe_load(shipped_scenarios()[name].read_text())
        for name in ("weak_targets", "weak_targets_by_rcs")
    )
    assert on["tracker"].pop("signal_strength") == "swerling_1"
    assert off["tracker"].pop("signal_strength") == "none"
    del on["name"], off["name"]
    assert on == off


def test_without_strengths_nothing_is_told():
    recording = simulate(load_scenario("crossing_targets"), 1)
    assert recording.detections[0].attribute_names == ()
    assert "signal_strength" not in recording.preset["track_manager"]


def test_only_exponential_cross_sections_have_strengths():
    content = copy.deepcopy(yaml.safe_load(shipped_scenarios()["weak_targets"].read_text()))
    content["targets"][1]["rcs_swerling"] = 3
    with pytest.raises(ScenarioError, match="rcs_swerling = 3: allowed are 1 and 2 with sensor"):
        scenario_from_mapping(content)
