"""The parts of the benchmarks that decide what a figure means: scenes, scores, choice, warm-up."""

import itertools
import json
import math

import numpy as np
import pytest

from benchmarks import against_commit, joint
from benchmarks.autoferry_vs_stonesoup import Setting, best, grid, objective
from benchmarks.measuring import table, write_results
from benchmarks.ring_latency import WARM_UP_SCANS, warm
from benchmarks.scenarios import SceneParameters, make_scene, save_scene
from benchmarks.scoring import ospa_m, score_recording, score_scene
from benchmarks.stage_times import StageTimes
from gda_tracker.association.choices import (
    FRONTIER_DYNAMIC_PROGRAMMING,
    LOOPY_BELIEF_PROPAGATION,
    SUBSET_DYNAMIC_PROGRAMMING,
)
from gda_tracker.association.clustering import find_clusters
from gda_tracker.io.adapters.scan_npz import load
from gda_tracker.tracking.ring import Ring
from gda_tracker.vocabulary.scans import ScanKey, ScanTruth
from gda_tracker.vocabulary.tracks import CONFIRMED, TENTATIVE, Tracks

pytestmark = pytest.mark.slow

# --- scenes ---------------------------------------------------------------------------------------


def test_a_scene_depends_on_its_parameters_and_seed_alone():
    first, again = (make_scene(SceneParameters(12, 6.0, seed=3)) for _ in range(2))
    other = make_scene(SceneParameters(12, 6.0, seed=4))
    assert all(np.array_equal(first[name], again[name]) for name in first)
    assert not np.array_equal(first["truth_state"], other["truth_state"])


@pytest.fixture(scope="module")
def scene():
    return make_scene(SceneParameters(targets=60, clutter=30.0, seed=5))


def test_detections_scatter_about_the_truth_as_the_data_sheet_says(scene):
    meta = json.loads(str(scene["meta"]))
    scan = np.repeat(np.arange(meta["scans"]), np.diff(scene["scan_ptr"]))
    own = scene["truth_id"] >= 0
    x, y = scene["truth_state"][scan[own], scene["truth_id"][own]][:, [0, 2]].T
    range_error = (scene["range"][own] - np.hypot(x, y)) / meta["sigma_range"]
    gap = scene["azimuth"][own] - np.arctan2(x, y)
    azimuth_error = np.angle(np.exp(1j * gap)) / meta["sigma_azimuth"]
    for error in (range_error, azimuth_error):
        assert abs(error.mean()) < 0.1
        assert error.std() == pytest.approx(1.0, abs=0.06)
    detected = own.sum() / (meta["scans"] * meta["targets"])
    assert detected == pytest.approx(meta["p_detect"], abs=0.01)


def test_false_alarms_are_as_many_as_asked_and_inside_the_coverage(scene):
    false = scene["truth_id"] < 0
    assert false.sum() / 40 == pytest.approx(30.0, abs=4.0)
    assert scene["range"][false].min() >= 5_000.0
    assert scene["range"][false].max() <= 120_000.0
    assert abs(np.sin(scene["azimuth"][false]).mean()) < 0.1
    density = json.loads(str(scene["meta"]))["clutter_density"]
    assert density * 115_000.0 * 2.0 * math.pi == pytest.approx(30.0)


def test_targets_stay_in_the_coverage_and_fly_as_they_say(scene):
    state = scene["truth_state"]
    distance = np.hypot(state[..., 0], state[..., 2])
    assert distance.min() > 5_000.0
    assert distance.max() < 120_000.0
    speed = np.hypot(state[..., 1], state[..., 3])
    assert speed.min() >= 120.0 - 1e-6
    assert speed.max() <= 260.0 + 1e-6
    # A chord is shorter than the path, never longer.
    step = np.hypot(np.diff(state[..., 0], axis=0), np.diff(state[..., 2], axis=0))
    assert (step <= 5.0 * speed[1:] + 1e-6).all()
    assert np.median(step / (5.0 * speed[1:])) > 0.99


def test_about_half_of_the_targets_fly_in_groups_close_together(scene):
    sizes = np.bincount(scene["truth_group"])
    assert sizes.min() >= 1
    assert sizes.max() <= 4
    together = sizes[sizes > 1].sum() / sizes.sum()
    assert 0.25 < together < 0.75
    for group in np.flatnonzero(sizes > 1):
        members = scene["truth_state"][0, scene["truth_group"] == group][:, [0, 2]]
        gap = np.hypot(*(members[1:] - members[:-1]).T)
        assert gap.max() < 2_000.0


def test_rcs_has_the_means_of_the_classes(scene):
    kind = scene["truth_type"][scene["truth_id"]]
    own = scene["truth_id"] >= 0
    assert scene["rcs"][own & (kind == 0)].mean() == pytest.approx(1.2, rel=0.1)
    assert scene["rcs"][own & (kind == 1)].mean() == pytest.approx(4.0, rel=0.1)
    assert scene["rcs"][~own].mean() == pytest.approx(0.3, rel=0.15)


@pytest.mark.parametrize(("name", "value"), [("targets", 0), ("scans", 2), ("clutter", -1.0)])
def test_a_scene_that_cannot_be_made_names_the_parameter(name, value):
    with pytest.raises(ValueError, match=f"{name} = {value}: allowed is"):
        SceneParameters(**{"targets": 2, "clutter": 1.0, name: value})


def test_a_written_scene_is_read_with_its_truth_and_data_sheet(tmp_path):
    parameters = SceneParameters(targets=4, clutter=2.0, seed=1, scans=12)
    recording = load(save_scene(tmp_path / "scene.npz", parameters))
    manager = recording.preset["track_manager"]
    assert manager["clutter_density_per_m_rad"] == pytest.approx(parameters.clutter_density)
    ring = Ring({"track_manager": {**manager, "decision": "map", "attribute_term": "none"}})
    tracks = [ring.process(detections).tracks for detections in recording.detections]
    score = score_scene(tracks, recording.truth)
    assert score["missed_percent"] == 0.0
    assert score["rmse_m"] < 500.0


# --- scores ---------------------------------------------------------------------------------------


def tracks_at(points, ids=None, status=None):
    n = len(points)
    return Tracks(
        key=ScanKey(0, "radar", 0),
        track_id=np.arange(n) if ids is None else np.array(ids),
        status=np.full(n, CONFIRMED) if status is None else np.array(status),
        mean=np.hstack([np.reshape(points, (n, 2)), np.zeros((n, 2))]),
    )


def truth_at(points):
    n = len(points)
    state = np.hstack([np.reshape(points, (n, 2)), np.zeros((n, 2))])
    return ScanTruth("radar", 0, np.arange(n, dtype=np.int32), state)


def test_ospa_of_simple_cases():
    assert ospa_m(tracks_at([]), truth_at([]), 100.0) == 0.0
    assert ospa_m(tracks_at([]), truth_at([(0.0, 0.0)]), 100.0) == 100.0
    assert ospa_m(tracks_at([(3.0, 4.0)]), truth_at([(0.0, 0.0)]), 100.0) == pytest.approx(5.0)
    both = tracks_at([(3.0, 4.0), (500.0, 0.0)])
    assert ospa_m(both, truth_at([(0.0, 0.0)]), 100.0) == pytest.approx((5.0 + 100.0) / 2.0)
    tentative = tracks_at([(0.0, 0.0)], status=[TENTATIVE])
    assert ospa_m(tentative, truth_at([(0.0, 0.0)]), 100.0) == 100.0


def test_ospa_equals_the_definition_by_enumeration():
    rng = np.random.default_rng(8)
    for n, m in itertools.product(range(1, 5), repeat=2):
        live, targets = rng.uniform(0, 100, (n, 2)), rng.uniform(0, 100, (m, 2))
        fewer, more = (live, targets) if n <= m else (targets, live)
        distance = np.minimum(np.linalg.norm(fewer[:, None] - more[None], axis=2), 40.0)
        least = min(
            sum(distance[i, j] for i, j in enumerate(order))
            for order in itertools.permutations(range(len(more)), len(fewer))
        )
        expected = (least + 40.0 * (len(more) - len(fewer))) / len(more)
        assert ospa_m(tracks_at(live), truth_at(targets), 40.0) == pytest.approx(expected)


def test_scene_scores_count_misses_false_tracks_and_switches():
    truth = [truth_at([(0.0, 0.0), (5_000.0, 0.0)])] * 10
    steady = [tracks_at([(0.0, 0.0), (5_000.0, 0.0)], ids=[1, 2])] * 10
    good = score_scene(steady, truth, skip_scans=0)
    assert (good["missed_percent"], good["false_percent"], good["switches"]) == (0.0, 0.0, 0)
    alone = [tracks_at([(0.0, 0.0), (90_000.0, 0.0)], ids=[1, 3])] * 10
    bad = score_scene(alone, truth, skip_scans=0)
    assert (bad["missed_percent"], bad["false_percent"]) == (50.0, 50.0)
    swapped = steady[:5] + [tracks_at([(0.0, 0.0), (5_000.0, 0.0)], ids=[2, 1])] * 5
    assert score_scene(swapped, truth, skip_scans=0)["switches"] == 2


def test_recording_scores_are_within_the_match_distance():
    truth = [truth_at([(0.0, 0.0), (100.0, 0.0)])] * 4
    tracks = [tracks_at([(0.0, 24.0), (100.0, 26.0)])] * 4
    score = score_recording(tracks, truth, 25.0)
    assert score["completeness"] == {"0": 1.0, "1": 0.0}
    assert score["rmse_m"] == pytest.approx(24.0)
    assert score["tracks"] == 2


# --- joint probabilities --------------------------------------------------------------------------


def test_the_joint_benchmark_runs_and_names_the_engines(tmp_path, capsys):
    path = tmp_path / "joint.json"
    joint.main(["--repeats", "1", "--out", str(path)])
    printed = capsys.readouterr().out
    cases = {case["case"]: case for case in json.loads(path.read_text())["cases"]}
    assert list(cases) == [case.name for case in joint.CASES]
    for name, case in cases.items():
        dense = name.startswith("dense") or name == "200 tracks in clumps of 4 to 8"
        engine = SUBSET_DYNAMIC_PROGRAMMING if dense else FRONTIER_DYNAMIC_PROGRAMMING
        assert case["engines"] == [engine]
        assert case["loopy_engines"] == [LOOPY_BELIEF_PROPAGATION]
        assert 0.0 <= case["loopy_mean_error"] <= case["loopy_largest_error"] < 0.5
    assert all(name in printed for name in cases)


def test_the_clumps_have_the_sizes_they_are_named_for():
    apart, linked = (joint.clumps(200, linked) for linked in (False, True))
    sizes = [len(list(group)) for _, group in itertools.groupby(apart.tolist())]
    assert sum(sizes) == 200
    assert set(sizes[:-1]) <= {4, 5, 6, 7, 8}
    for gate, count in ((apart, len(sizes)), (linked, 1)):
        pairs = (index.astype(np.int32) for index in np.nonzero(gate))
        assert len(find_clusters(*pairs, 200, 200)) == count


# --- choice of settings, warm-up, output ----------------------------------------------------------


def score(shares, flips=0, rmse_m=5.0):
    return {"completeness": dict(zip("12", shares, strict=True)), "flips": flips, "rmse_m": rmse_m}


def test_the_objective_is_mean_completeness_less_a_cost_per_flip():
    assert objective([score((1.0, 0.5)), score((0.7, 0.8))]) == pytest.approx(0.75)
    assert objective([score((1.0, 0.5), flips=2)]) == pytest.approx(0.65)


def test_the_best_setting_is_chosen_on_the_named_recordings_only():
    settings = grid()[:3]
    results = [
        (settings[0], {"a": score((1.0, 1.0)), "b": score((0.1, 0.1))}),
        (settings[1], {"a": score((0.5, 0.5)), "b": score((0.9, 0.9), rmse_m=6.0)}),
        (settings[2], {"a": score((0.5, 0.5)), "b": score((0.9, 0.9), rmse_m=4.0)}),
    ]
    assert best(results, ["a"])[0] == settings[0]
    assert best(results, ["b"])[0] == settings[2]
    assert best(results, ["a", "b"])[0] == settings[2]


def test_the_grid_has_every_combination_once():
    assert len(set(grid())) == len(grid()) == 32
    assert all(isinstance(setting, Setting) for setting in grid())


def test_warm_up_leaves_out_the_first_scene_and_the_first_scans():
    scans = WARM_UP_SCANS + 2
    values = [[100.0 * scene + scan for scan in range(scans)] for scene in range(3)]
    expected = [100.0 * s + k for s in (1, 2) for k in (WARM_UP_SCANS, WARM_UP_SCANS + 1)]
    assert warm(values).tolist() == expected


def test_stage_times_track_as_the_ring_does(tmp_path):
    path = save_scene(tmp_path / "scene.npz", SceneParameters(targets=5, clutter=3.0, scans=8))
    recording = load(path)
    timed, plain = StageTimes(Ring(recording.preset)), Ring(recording.preset)
    for detections in recording.detections:
        seconds = timed.process(detections)
        tracks = plain.process(detections).tracks
        assert np.array_equal(timed.ring.manager.tracks().mean, tracks.mean)
        assert min(seconds.values()) >= 0.0
        stages = sum(value for name, value in seconds.items() if name != "total")
        assert stages >= seconds["total"] - 1e-9


def test_results_say_on_what_machine_they_were_measured(tmp_path):
    content = json.loads(write_results(tmp_path / "deep" / "x.json", {"figure": 1.5}).read_text())
    assert content["figure"] == 1.5
    assert {"cpu", "cores", "python", "numpy", "linear_algebra_threads"} <= set(content["machine"])


def test_a_table_aligns_its_columns():
    lines = table(["name", "value"], [["a", 1.23456], ["long name", None]]).splitlines()
    assert [len(line) for line in lines] == [16] * 4
    assert lines[2].endswith("1.23")
    assert lines[3].endswith("-")


# --- against an earlier commit --------------------------------------------------------------------


def test_the_ratio_is_that_of_paired_times_with_the_interval_of_the_sign_test():
    before = np.linspace(1.0, 2.0, 20)
    found = against_commit.summary(before, before * np.linspace(0.9, 1.09, 20))
    assert found["ratio"] == pytest.approx(0.995)
    # Between the 6th and the 15th of 20 the median lies with 95.9 %.
    assert found["ratio_lowest"] == pytest.approx(0.95)
    assert found["ratio_highest"] == pytest.approx(1.04)
    assert found["before_ms"] == pytest.approx(1500.0)


def test_two_trees_take_turns_and_one_that_cannot_is_said():
    root = against_commit.ROOT
    (row,) = against_commit.compare((root, root), [("crossing_targets", "map/none/cv")], 1, 1)
    assert row["turns"] == 1
    assert 0.1 < row["ratio"] < 10.0
    with (
        against_commit.Worker(root / "docs") as worker,
        pytest.raises(RuntimeError, match="the process has ended"),
    ):
        worker.scan_s("crossing_targets", "map/none/cv", 1)
