"""What the tracker is told: the scenario's tracker section, and nothing of the truth."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from gda_tracker.parameters import ParameterError
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.simulation.tracker_sections import KnownClass
from gda_tracker.tracking.ring import stage_parameters


@pytest.fixture
def scenario():
    return load_scenario("crossing_targets")


@pytest.mark.parametrize("name", ["crossing_targets", "closely_spaced_targets"])
@pytest.mark.parametrize("initiation", ["labelled", "automatic"])
def test_the_nodes_take_the_preset(name, initiation):
    tables = stage_parameters(tracker_preset(load_scenario(name), initiation))
    assert tables["track_manager"].initiation == initiation
    assert tables["track_manager"].azimuth_std_rad == pytest.approx(math.radians(0.3))
    assert tables["rcs_fuzzifier"].class_names == ["false_alarm", "fighter", "cargo"]
    assert tables["rcs_fuzzifier"].class_rcs_mean_m2 == [0.3, 1.2, 4.0]
    assert tables["rcs_fuzzifier"].class_labels == ["VS", "S", "B"]


def test_labelled_tracks_never_end_and_automatic_ones_do(scenario):
    assert tracker_preset(scenario)["track_manager"]["deletion_misses"] == 0
    automatic = stage_parameters(tracker_preset(scenario, "automatic"))
    assert automatic["track_manager"].deletion_misses > 0


def test_nothing_of_the_truth_is_told(scenario):
    other = replace(
        scenario,
        sensor=replace(scenario.sensor, detection_probability=0.5),
        clutter=replace(scenario.clutter, mean_false_alarms_per_scan=77.0),
        targets=tuple(
            replace(t, speed_mps=99.0, rcs_mean_m2=9.0, class_name="cargo", manoeuvres=())
            for t in scenario.targets
        ),
    )
    assert tracker_preset(other) == tracker_preset(scenario)


def test_labels_go_by_size_whatever_the_order(scenario):
    attribute = scenario.attribute
    turned = replace(scenario, attribute=replace(attribute, classes=attribute.classes[::-1]))
    preset = tracker_preset(turned)["rcs_fuzzifier"]
    assert preset["class_names"] == ["false_alarm", "cargo", "fighter"]
    assert preset["class_labels"] == ["VS", "B", "S"]


def test_a_third_class_is_medium_and_a_fourth_is_refused(scenario):
    attribute = scenario.attribute
    drone, ship = KnownClass("drone", 0.5, 2), KnownClass("ship", 90.0, 3)
    three = replace(attribute, classes=(*attribute.classes, drone))
    preset = tracker_preset(replace(scenario, attribute=three))
    assert preset["rcs_fuzzifier"]["class_labels"] == ["VS", "M", "B", "S"]
    stage_parameters(preset)
    four = replace(attribute, classes=(*three.classes, ship))
    with pytest.raises(
        ParameterError, match="attribute.classes has 4 entries: allowed are at most 3"
    ):
        tracker_preset(replace(scenario, attribute=four))


def test_a_slow_radar_does_not_end_tracks_between_scans(scenario):
    slow = replace(scenario, time=replace(scenario.time, scan_period_s=90.0))
    assert tracker_preset(slow)["track_manager"]["max_gap_s"] > 90.0
