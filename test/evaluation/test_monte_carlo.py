"""Monte Carlo: the result depends on the seed alone, methods are compared in pairs."""

from __future__ import annotations

import json
import os
from dataclasses import replace

import numpy as np
import pytest

from gda_tracker.evaluation.monte_carlo import monte_carlo
from gda_tracker.evaluation.statistics import mean_and_stderr
from gda_tracker.evaluation.table import format_result
from gda_tracker.parameters import ParameterError
from gda_tracker.simulation.scenarios import load_scenario

METHODS = ["gda/none/cv", "map/bayes/cv"]


@pytest.fixture(scope="module")
def scenarios():
    """Both shipped scenarios, cut short."""
    short = {"crossing_targets": 14, "closely_spaced_targets": 13}
    found = [load_scenario(name) for name in short]
    return [replace(s, time=replace(s.time, n_scans=short[s.name])) for s in found]


def without_times(results) -> str:
    """Exact text of everything but the processor times."""
    found = [result.to_dict() for result in results]
    for result in found:
        for method in result["methods"]:
            assert method.pop("cpu_ms_per_scan") > 0.0
    return json.dumps(found)


@pytest.fixture(scope="module")
def alone(scenarios):
    return monte_carlo(scenarios, METHODS, runs=5, seed=3, workers=1)


def test_the_number_of_workers_changes_nothing(scenarios, alone):
    before = dict(os.environ)
    done = []
    together = monte_carlo(
        scenarios, METHODS, runs=5, seed=3, workers=2, progress=lambda *step: done.append(step)
    )
    assert without_times(together) == without_times(alone)
    assert done[-1] == (10, 10)
    assert [n for n, _ in done] == sorted(n for n, _ in done)
    assert dict(os.environ) == before


def test_another_seed_is_another_result(scenarios, alone):
    other = monte_carlo(scenarios[:1], METHODS, runs=5, seed=4, workers=1)
    assert without_times(other) != without_times(alone[:1])


def test_runs_are_the_first_ones_of_the_seed(scenarios, alone):
    fewer = monte_carlo(scenarios[:1], METHODS, runs=2, seed=3, workers=1)
    for one, other in zip(fewer[0].methods, alone[0].methods, strict=True):
        np.testing.assert_array_equal(one.score, other.score[:2])


def test_a_method_scores_the_same_in_any_company(scenarios, alone):
    single = monte_carlo(scenarios[:1], METHODS[1:], runs=5, seed=3, workers=1)
    np.testing.assert_array_equal(single[0].methods[0].score, alone[0].methods[1].score)


def test_the_json_is_that_of_the_command(alone):
    found = alone[0].to_dict()
    assert list(found)[:4] == ["scenario", "runs", "seed", "methods"]
    assert (found["scenario"], found["runs"], found["seed"]) == ("crossing_targets", 5, 3)
    assert [method["method"] for method in found["methods"]] == METHODS
    for method in found["methods"]:
        assert list(method)[:8] == [
            "method",
            "purity_mean",
            "purity_stderr",
            "purity_per_track",
            "confusion",
            "missed",
            "false_alarm",
            "cpu_ms_per_scan",
        ]
        confusion = np.array(method["confusion"])
        assert confusion.shape == (2, 4)
        np.testing.assert_allclose(confusion.sum(axis=1), 1.0)
        np.testing.assert_allclose(np.diagonal(confusion), method["purity_per_track"])
        assert method["purity_mean"] == pytest.approx(np.mean(method["purity_per_track"]))
        assert method["missed"] == pytest.approx(confusion[:, 2].mean())
        assert method["false_alarm"] == pytest.approx(confusion[:, 3].mean())
    json.dumps(found, allow_nan=False)


def test_methods_that_revise_the_past_have_a_delayed_purity(scenarios):
    """Scored run by run from what the ring tells later, to the last scan."""
    result = monte_carlo(scenarios[1:2], ["map/bayes/cv", "mht/bayes/cv"], 4, 2, workers=1)[0]
    once, trees = result.to_dict()["methods"]
    assert "purity_delayed_mean" not in once
    assert result.methods[0].delayed is None
    delayed = result.methods[1].delayed
    assert delayed.shape == (4,)
    assert trees["purity_delayed_mean"] == pytest.approx(delayed.mean())
    assert trees["purity_delayed_stderr"] == pytest.approx(delayed.std(ddof=1) / 2.0)
    assert trees["purity_delayed_mean"] > trees["purity_mean"] > once["purity_mean"]
    text = format_result(result)
    assert f"{trees['purity_delayed_mean']:.3f}" in next(
        line for line in text.splitlines() if line.startswith("mht/bayes/cv")
    )
    assert "delayed" in text
    assert "delayed" not in format_result(monte_carlo(scenarios[:1], METHODS[:1], 1, 2)[0])


def test_differences_are_paired(alone):
    first, second = alone[0].methods
    difference = second.score - first.score
    assert (first.difference_mean, first.difference_stderr) == (0.0, 0.0)
    assert second.difference_mean == pytest.approx(difference.mean())
    assert second.difference_stderr == pytest.approx(difference.std(ddof=1) / np.sqrt(5))


def test_one_run_has_no_standard_error(scenarios):
    found = monte_carlo(scenarios[:1], METHODS[:1], runs=1, seed=0)[0].to_dict()
    assert found["methods"][0]["purity_stderr"] is None
    json.dumps(found, allow_nan=False)


def test_automatic_initiation_reports_continuity(scenarios):
    result = monte_carlo(scenarios[:1], METHODS, 3, 1, initiation="automatic", workers=1)[0]
    found = result.to_dict()
    assert found["initiation"] == "automatic"
    assert found["match_distance_m"] == pytest.approx(result.match_distance_m)
    for method in found["methods"]:
        assert method["purity_mean"] is None
        assert 0.3 < method["completeness"] <= 1.0
        assert method["identity_switches"] >= 0.0
        assert method["false_tracks"] >= 0.0
        assert 0.0 < method["position_rmse_m"] < result.match_distance_m
        parts = [method[f"gospa_{name}_m"] for name in ("localisation", "missed", "false")]
        assert np.sum(np.square(parts)) == pytest.approx(method["gospa_m"] ** 2)
        assert 0.0 < method["ospa_m"] <= result.match_distance_m
        # Two scans make a tentative track, three hits a confirmed one.
        assert 2.0 <= method["extraction_delay_scans"] < 6.0
        period_s = result.scenario.time.scan_period_s
        assert method["extraction_delay_s"] == pytest.approx(
            period_s * method["extraction_delay_scans"]
        )
        hours = 13 * period_s / 3600.0
        assert method["false_tracks_per_hour"] == pytest.approx(method["false_tracks"] / hours)
        assert (method["nees_dimension"], method["nis_dimension"]) == (4, 2)
        for name in ("nees", "nis"):
            assert method[f"{name}_lower"] < method[f"{name}_expected"] < method[f"{name}_upper"]
            assert 0.0 <= method[f"{name}_inside"] <= 1.0
            assert method[name] > 0.0
    json.dumps(found, allow_nan=False)


def test_a_given_match_distance_is_used(scenarios):
    result = monte_carlo(
        scenarios[:1], METHODS[:1], 1, 1, initiation="automatic", match_distance_m=1.0, workers=1
    )[0]
    assert result.match_distance_m == 1.0
    assert result.methods[0].score_mean < 0.1


def test_track_ids_follow_the_target_ids_not_their_order(scenarios):
    scenario = scenarios[0]
    renamed = tuple(replace(t, id=i) for t, i in zip(scenario.targets, (40, 7), strict=True))
    one = monte_carlo([scenario], ["clairvoyant"], 2, 1, workers=1)[0].methods[0]
    other = monte_carlo([replace(scenario, targets=renamed)], ["clairvoyant"], 2, 1, workers=1)
    np.testing.assert_array_equal(one.confusion[::-1, [1, 0, 2, 3]], other[0].methods[0].confusion)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"runs": 0}, "runs = 0: allowed is an integer >= 1"),
        ({"seed": -1}, "seed = -1: allowed is an integer >= 0"),
        ({"workers": 0}, "workers = 0: allowed is an integer >= 1"),
        ({"methods": []}, "methods"),
        ({"methods": ["gda/none"]}, "'gda/none': allowed is decision/attribute_term/filter"),
        ({"methods": ["gda/magic/cv"]}, "magic"),
        ({"initiation": "manual"}, "initiation = 'manual': allowed is one of labelled, automatic"),
        ({"match_distance_m": -1.0}, "match_distance_m = -1.0"),
        ({"methods": ["clairvoyant"], "initiation": "automatic"}, "allowed is labelled"),
    ],
)
def test_what_is_not_allowed_is_named_before_anything_runs(scenarios, options, message):
    with pytest.raises(ParameterError, match=message):
        monte_carlo(scenarios, **{"methods": METHODS, "runs": 10_000_000, **options})


def test_mean_and_standard_error():
    mean, stderr = mean_and_stderr(np.array([1.0, 2.0, np.nan, 6.0]))
    assert mean == pytest.approx(3.0)
    assert stderr == pytest.approx(np.std([1.0, 2.0, 6.0], ddof=1) / np.sqrt(3))
