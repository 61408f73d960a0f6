"""The scenario schema: what is shipped loads, what is wrong is named in one line."""

from __future__ import annotations

import copy

import numpy as np
import pytest
import yaml

from gda_tracker.simulation.scenarios import (
    load_scenario,
    scenario_from_mapping,
    shipped_scenarios,
)
from gda_tracker.simulation.schema import ScenarioError
from gda_tracker.simulation.simulate import simulate


@pytest.fixture
def content() -> dict:
    return copy.deepcopy(yaml.safe_load(shipped_scenarios()["crossing_targets"].read_text()))


def test_shipped_scenarios_load_by_name_and_path():
    assert list(shipped_scenarios()) == [
        "busy_coast",
        "busy_coast_given",
        "class_by_motion",
        "class_by_motion_unaware",
        "closely_spaced_targets",
        "crossing_bearings",
        "crossing_targets",
        "extended_objects",
        "formations",
        "mixed_sensors",
        "moving_emitter",
        "road_network",
        "road_network_untold",
        "stop_and_go",
        "stop_and_go_unaware",
        "two_sensors",
        "unresolved_pair",
        "unresolved_pair_untold",
        "unresolved_three",
        "unresolved_turning",
        "weak_targets",
        "weak_targets_by_rcs",
    ]
    for name, path in shipped_scenarios().items():
        assert load_scenario(name) == load_scenario(path)
        assert load_scenario(name).name == name


def test_values_of_the_crossing_scenario():
    scenario = load_scenario("crossing_targets")
    assert scenario.time.scan_period_s == 5.0
    assert (scenario.time.n_scans, scenario.time.n_initiation_scans) == (25, 2)
    assert scenario.tracker.extraneous_return_density_per_rad_m == 1e-6
    assert [(t.id, t.class_name) for t in scenario.targets] == [(1, "fighter"), (2, "cargo")]
    assert scenario.targets[1].manoeuvres[0].turn == "right"
    assert [c.rcs_mean_m2 for c in scenario.attribute.classes] == [1.2, 4.0]
    assert scenario.attribute.membership.seed == 2004
    assert scenario.notes["monte_carlo"]["n_runs"] == 200


def test_notes_are_ignored(content):
    plain = scenario_from_mapping(content)
    content["monte_carlo"] = {"anything": ["goes", 1]}
    content["expected_purity"] = {"cv": 0.7}
    noted = scenario_from_mapping(content)
    assert noted.notes["expected_purity"] == {"cv": 0.7}
    assert (noted.time, noted.targets) == (plain.time, plain.targets)


def _set(path: str, value: object):
    def change(content: dict) -> None:
        *parents, last = path.split("/")
        for part in parents:
            content = content[int(part) if part.isdigit() else part]
        content[int(last) if last.isdigit() else last] = value

    return change


WRONG = [
    (_set("sensing", {}), "unknown key 'sensing'"),
    (_set("sensors", {}), "unknown key 'sensor'"),
    (_set("sensor/azimuth_std_rad", 1), "sensor: unknown key 'azimuth_std_rad'"),
    (_set("targets/0/colour", "red"), "targets[0]: unknown key 'colour'"),
    (_set("targets/0/manoeuvres/0/g", 1), "manoeuvres[0]: unknown key 'g'; allowed are start_scan"),
    (_set("attribute/classes/1/mean", 1), "classes[1]: unknown key 'mean'"),
    (_set("attribute/membership/bins", 1), "membership: unknown key 'bins'"),
    (lambda c: c["time"].pop("n_scans"), "time: missing key n_scans"),
    (lambda c: c.pop("clutter"), "missing key clutter"),
    (_set("time/n_scans", 2.5), "n_scans = 2.5: allowed is an integer >= 1"),
    (_set("time/n_scans", 2), "n_initiation_scans = 2: allowed is less than n_scans = 2"),
    (_set("time/scan_period_s", 0), "scan_period_s = 0: allowed is a number > 0 [s]"),
    (_set("sensor/detection_probability", 1.5), "1.5: allowed is a number >= 0 and <= 1"),
    (_set("sensor/range_std_m", float("nan")), "range_std_m = nan"),
    (_set("sensor/position_m", [0.0]), "position_m = [0.0]: allowed is a list of 2 numbers"),
    (_set("clutter/region_x_m", [5.0, 5.0]), "region_x_m = [5, 5]: allowed is [low, high]"),
    (_set("targets", []), "targets = []: allowed is a list of 1 or more entries"),
    (_set("targets/1/id", 1), "id = [1, 1]: allowed are ids that differ"),
    (_set("targets/1/class", "bomber"), "class = 'bomber': allowed are the names in"),
    (_set("targets/0/rcs_swerling", 5), "rcs_swerling = 5: allowed is an integer >= 1 and <= 4"),
    (_set("targets/0/manoeuvres/0/turn", "up"), "turn = 'up': allowed is one of left, right"),
    (_set("targets/0/manoeuvres/0/end_scan", 9), "end_scan = 9: allowed is more than start_scan"),
    (_set("targets/0/speed_mps", 0), "speed_mps = 0: allowed is more than 0"),
    (_set("targets/0", "fast"), "targets[0]: expected keys"),
    (_set("attribute/missed_track_hypotheses", "one"), "allowed is one of zero, table_14_3"),
    (_set("attribute/classes", [{}]), "classes = [{}]: allowed is a list of 2 or more"),
    (_set("name", 7), "name = 7: allowed is a text"),
]


@pytest.mark.parametrize(("change", "message"), WRONG, ids=[message for _, message in WRONG])
def test_a_wrong_scenario_is_named_in_one_line(content, change, message):
    change(content)
    with pytest.raises(ScenarioError) as error:
        scenario_from_mapping(content, "scenario x.yaml")
    text = str(error.value)
    assert message in text
    assert text.startswith("scenario x.yaml")
    assert "\n" not in text


def test_overlapping_turns_are_refused(content):
    turn = dict(content["targets"][0]["manoeuvres"][0], start_scan=13.0, end_scan=15.0)
    content["targets"][0]["manoeuvres"].append(turn)
    with pytest.raises(ScenarioError, match="start_scan = 13: allowed is >= 14"):
        scenario_from_mapping(content)


def test_a_file_that_is_not_there():
    with pytest.raises(ScenarioError, match="shipped are busy_coast, .*class_by_motion, class_by"):
        load_scenario("crossing_target")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name: [1", "not valid YAML"),
        ("", "expected keys"),
        ("- 1\n- 2\n", "expected keys"),
        ("name: a\nname: b\n", "key 'name' is given twice"),
    ],
)
def test_a_file_that_is_not_a_scenario(tmp_path, text, message):
    path = tmp_path / "broken.yaml"
    path.write_text(text)
    with pytest.raises(ScenarioError, match=message) as error:
        load_scenario(path)
    assert "\n" not in str(error.value)


def test_a_folder_is_not_a_scenario(tmp_path):
    with pytest.raises(ScenarioError, match="cannot be read"):
        load_scenario(tmp_path)


def test_an_exponent_without_a_point_is_a_number(tmp_path):
    text = shipped_scenarios()["crossing_targets"].read_text().replace("1.0e-6", "1e-6")
    path = tmp_path / "short.yaml"
    path.write_text(text)
    assert load_scenario(path) == load_scenario("crossing_targets")


def test_extended_targets_give_detections_all_over_their_ellipses():
    scenario = load_scenario("extended_objects")
    recording = simulate(scenario, 1, initiation="automatic")
    manager = recording.preset["track_manager"]
    assert (manager["extended_objects"], manager["initiation"]) == ("random_matrix", "automatic")
    counts, squares = np.zeros(3), np.zeros((3, 2, 2))
    for detections, truth in zip(recording.detections, recording.truth, strict=True):
        xy = detections.range_m[:, None] * np.stack(
            [np.cos(detections.azimuth_rad), np.sin(detections.azimuth_rad)], axis=1
        )
        for place, target in enumerate(truth.target_id):
            gap = xy[truth.source_id == target] - truth.target_state[place, :2]
            root = np.linalg.inv(np.linalg.cholesky(truth.target_extent[place]))
            counts[place] += len(gap)
            squares[place] += (root @ gap.T) @ (root @ gap.T).T
    expected = 60 * (2 + 58 * 0.95) / 60 * np.array([15.0, 8.0, 8.0])
    assert np.abs(counts - expected).max() < 5.0 * np.sqrt(expected.max())
    # A quarter of the extent, and the noise on top, 7 m across the boats' 50 m and 30 m.
    assert np.trace(squares[2]) / 2.0 / counts[2] == pytest.approx(0.27, abs=0.05)


def test_extents_need_what_the_tracker_is_told_of_them():
    content = yaml.safe_load(shipped_scenarios()["extended_objects"].read_text())
    del content["extended"]
    with pytest.raises(ScenarioError, match="allowed with the sections sensor and extended"):
        scenario_from_mapping(content)
