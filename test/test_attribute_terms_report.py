"""The script behind the tables and the picture of ``docs/attribute-terms.md``."""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path

import numpy as np
import pytest

from gda_tracker.evaluation.monte_carlo import monte_carlo
from gda_tracker.evidence.frames import element_name
from gda_tracker.simulation.scenarios import load_scenario

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="module")
def report():
    name = "measure_attribute_terms"
    path = ROOT / "scripts" / f"{name}.py"
    specification = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(specification)
    sys.modules[name] = module  # where its dataclass looks for its annotations
    specification.loader.exec_module(module)
    yield module
    del sys.modules[name]


def test_the_total_intersection_has_its_name(report):
    names = ("VS", "S", "B")
    assert element_name(names, report.total_intersection(3)) == "VS&S&B"


def test_forgetting_is_scored_like_an_evaluation(report):
    """A factor of 1 is the default: the same purity as of ``evaluate`` on the same runs."""
    scenario = load_scenario("crossing_targets")
    outcomes = report.measure(scenario, "gda/dsm_classic/cv", 2, 1)
    (result,) = monte_carlo([scenario], ["gda/dsm_classic/cv"], 2, 1, workers=1)
    np.testing.assert_allclose(outcomes[0].purity, result.methods[0].score)
    ends = [outcome.intersection[:, -1].mean() for outcome in outcomes]
    assert ends == sorted(ends, reverse=True)
    assert ends[0] > 0.5 > 0.2 > ends[-1]


def test_an_evaluation_becomes_a_table(report, tmp_path, capsys):
    method = {"purity_mean": 0.5, "purity_stderr": 0.01, "difference_mean": -0.25}
    other = {**method, "method": "gda/pcr5/cv", "difference_stderr": 0.125}
    first = {**method, "method": "gda/none/cv", "difference_stderr": 0.0}
    file = tmp_path / "terms.json"
    content = {"scenario": "one", "difference_to": "gda/none/cv", "methods": [first, other]}
    file.write_text(json.dumps(content))
    assert report.main(["table", str(file)]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "| method | one | difference to gda/none/cv |",
        "| --- | --- | --- |",
        "| `gda/none/cv` | 0.500 +- 0.010 | - |",
        "| `gda/pcr5/cv` | 0.500 +- 0.010 | -0.250 +- 0.125 |",
    ]


def test_the_distance_of_dempster_falls_silent_and_its_likelihood_does_not(report):
    swaps = report.measure_swaps("dempster", 1500, 1)
    assert swaps.distance[-1] == pytest.approx(0.5, abs=0.05)
    assert swaps.likelihood[-1] > 0.8
    swaps = report.measure_swaps("bayes", 1500, 1)
    np.testing.assert_array_equal(swaps.distance, 0.5)  # it has none: all are equal
    np.testing.assert_array_equal(swaps.distance_log_ratio, 0.0)
    assert swaps.likelihood[-1] > 0.8


def test_the_classic_rule_grows_louder_by_distance_and_quieter_by_likelihood(report):
    swaps = report.measure_swaps("dsm_classic", 1500, 1)
    assert swaps.likelihood[-1] > 0.8
    assert swaps.likelihood_log_ratio[-1] < 0.2 * swaps.likelihood_log_ratio[3]
    assert swaps.distance_log_ratio[-1] > 2.0 * swaps.distance_log_ratio[3]
