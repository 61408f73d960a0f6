"""Quality of tracking over runs: the ring's results in, additive roots of mean squares out."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gda_tracker.evaluation.consistency import score_nees, score_nis
from gda_tracker.evaluation.continuity import score_continuity
from gda_tracker.evaluation.matching import match_run
from gda_tracker.evaluation.quality import score_quality
from gda_tracker.evaluation.quality_results import combine_quality
from gda_tracker.evaluation.set_distances import score_set_distances
from gda_tracker.evaluation.statistics import root_mean_square
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.simulation.simulate import simulate
from gda_tracker.tracking.ring import Ring, RingResult
from gda_tracker.tracking.smoothing import Smoother
from gda_tracker.vocabulary.scans import Detections, ScanKey, ScanReport, ScanTruth

DISTANCE_M = 400.0


def tracked(run):
    recording = simulate(load_scenario("crossing_targets"), 4, run, initiation="automatic")
    manager = {**recording.preset["track_manager"], "decision": "map", "filter": "cv"}
    ring = Ring({**recording.preset, "track_manager": manager})
    return [ring.process(scan) for scan in recording.detections], recording.truth


@pytest.fixture(scope="module")
def runs():
    return [tracked(run) for run in range(3)]


def test_one_run_has_every_measure(runs):
    results, truth = runs[0]
    tracks = [result.tracks for result in results]
    found = score_quality(results, truth, DISTANCE_M)
    again = score_continuity(tracks, truth, match_distance_m=DISTANCE_M)
    assert found.continuity.completeness == again.completeness
    np.testing.assert_array_equal(found.continuity.extraction_delay_s, again.extraction_delay_s)
    distances = score_set_distances(tracks, truth, DISTANCE_M)
    np.testing.assert_array_equal(found.distances.gospa_m, distances.gospa_m)
    nees = score_nees(tracks, truth, match_run(tracks, truth, DISTANCE_M))
    np.testing.assert_array_equal(found.nees.squared, nees.squared)
    predictions = [result.predictions for result in results]
    nis = score_nis(
        tracks, predictions, [result.associations for result in results], [None] * len(results)
    )
    np.testing.assert_array_equal(found.nis.squared, nis.squared)
    assert len(nis.squared) > 0
    assert nis.squared.max() <= nis.threshold


def test_localisation_is_the_error_of_the_matches_below_the_cut_off(runs):
    """Two independent paths to one number: GOSPA's assignment and that of the continuity."""
    results, truth = runs[1]
    found = score_quality(results, truth, 1e5)
    squares = found.distances.localisation.sum()
    matched = found.continuity.matched.sum()
    # Far beyond any distance GOSPA, too, pairs as many as it can; squares weigh another way.
    assert squares <= matched * found.continuity.position_rmse_m**2 * (1.0 + 1e-12)
    known = sum(len(entry.target_id) for entry in truth)
    assert found.distances.missed.sum() == pytest.approx((known - matched) * 1e10 / 2.0)


def test_means_over_runs(runs):
    each = [score_quality(results, truth, DISTANCE_M) for results, truth in runs]
    found = combine_quality(each)
    assert found.values["completeness"] == pytest.approx(
        np.mean([run.continuity.completeness for run in each])
    )
    np.testing.assert_array_equal(found.completeness, [run.continuity.completeness for run in each])
    squares = np.stack([run.distances.gospa_m**2 for run in each])
    assert found.values["gospa_m"] == pytest.approx(math.sqrt(squares.mean()))
    np.testing.assert_allclose(found.gospa_m, np.sqrt(squares.mean(axis=0)))
    np.testing.assert_allclose(
        found.localisation_m**2 + found.missed_m**2 + found.false_m**2, found.gospa_m**2
    )
    lives = np.concatenate([run.continuity.false_track_life_s for run in each])
    assert found.values["false_track_life_s"] == pytest.approx(lives.mean())
    everything = np.concatenate([run.nees.squared for run in each])
    assert found.values["nees"] == pytest.approx(everything.mean())
    assert found.nees.samples.sum() == len(everything)


def test_a_scan_that_was_not_tracked_cannot_be_scored(runs):
    results, truth = runs[0]
    rejected = RingResult(ScanReport(ScanKey(0, "radar", 12), "rejected"))
    with pytest.raises(ValueError, match="scan at 12 ns: it was not tracked"):
        score_quality([*results[:-1], rejected], truth, DISTANCE_M)


def test_root_mean_square_and_its_error():
    values = np.array([9.0, 16.0, 25.0, 16.0])
    root, error = root_mean_square(values)
    assert root == pytest.approx(math.sqrt(16.5))
    # By sampling: the root of the mean of as many draws with this mean and scatter.
    draws = np.random.default_rng(3).normal(16.5, values.std(ddof=1), (20_000, 4)).mean(axis=1)
    assert error == pytest.approx(np.sqrt(draws).std(), rel=0.05)
    assert root_mean_square(np.zeros(3))[0] == 0.0
    assert math.isnan(root_mean_square(np.zeros(3))[1])
    assert math.isnan(root_mean_square(np.array([4.0]))[1])
    assert math.isnan(root_mean_square(np.zeros(0))[0])


def test_trees_have_the_innovations_of_the_leaf_that_speaks():
    """Where nothing is ambiguous they are those of a decision by single scans, value by value."""
    rng = np.random.default_rng(8)
    found = []
    for decision in ("map", "mht"):
        rng = np.random.default_rng(8)
        ring = Ring({"track_manager": {"decision": decision, "clutter_density_per_m_rad": 1e-9}})
        results, truth = [], []
        for k in range(12):
            r = np.array([9e3, 3e4]) + 100.0 * k + rng.normal(0.0, 30.0, 2)
            a = np.array([0.3, 1.2]) + rng.normal(0.0, 0.005, 2)
            results.append(ring.process(Detections("radar", k * 4_000_000_000, r, a)))
            truth.append(ScanTruth("radar", k * 4_000_000_000, np.zeros(0, dtype=np.int32)))
        found.append(score_quality(results, truth, 400.0).nis)
    assert len(found[0].squared) > 12
    np.testing.assert_array_equal(found[1].scan, found[0].scan)
    np.testing.assert_allclose(found[1].squared, found[0].squared, rtol=1e-9)


def test_trees_in_clutter_have_an_nis_and_later_is_better():
    recording = simulate(load_scenario("crossing_targets"), 4, 0, initiation="automatic")
    ring = Ring(recording.preset)
    assert ring.manager.parameters.decision == "mht"
    ring.smoother = Smoother()
    results = [ring.process(scan) for scan in recording.detections]
    delayed = [told for result in results for told in result.delayed] + ring.rest_of_delayed()
    found = score_quality(results, recording.truth, DISTANCE_M, delayed, ring.smoother.tracks())
    assert len(found.nis.squared) > 20
    assert 0.0 < found.nis.squared.max() <= found.nis.threshold
    # Every value is the innovation of a row that was given its detection.
    for scan, result in enumerate(results):
        given = result.assigned[result.associations.hypothesis] == result.associations.detection
        known = set(result.associations.mahalanobis_squared[given].tolist())
        assert known >= set(found.nis.squared[found.nis.scan == scan].tolist())
    online = found.continuity.position_rmse_m
    assert found.smoothed_rmse_m < 0.9 * online
    assert found.delayed_rmse_m < 0.9 * online
    assert score_quality(results, recording.truth, DISTANCE_M).smoothed_rmse_m is math.nan
