"""The ring reaches the purity that the 2004 chapter's schemes are known for, on both scenarios.

Reference values are those of 300 runs of an independent prototype. With 40 runs a purity has a
standard error near 0.04, so the bands are about three of these wide; the seed is fixed.
"""

from __future__ import annotations

import pytest

from gda_tracker.evaluation.monte_carlo import monte_carlo
from gda_tracker.simulation.scenarios import load_scenario

REFERENCE = {
    "crossing_targets": {
        "gda/none/cv": 0.726,
        "gda/dsm_classic/cv": 0.854,
        "gda/dempster/cv": 0.740,
        "gda/dsm_hybrid/cv": 0.790,
        "gda/pcr5/cv": 0.811,
        "map/bayes/cv": 0.871,
    },
    "closely_spaced_targets": {
        "gda/none/cv": 0.551,
        "gda/dsm_classic/cv": 0.615,
        "gda/dempster/cv": 0.549,
        "gda/dsm_hybrid/cv": 0.601,
        "gda/pcr5/cv": 0.580,
        "map/bayes/cv": 0.743,
    },
}


@pytest.fixture(scope="module")
def purity():
    scenarios = [load_scenario(name) for name in REFERENCE]
    methods = [*REFERENCE["crossing_targets"], "clairvoyant"]
    results = monte_carlo(scenarios, methods, runs=40, seed=1)
    return {r.scenario.name: {m.method: m for m in r.methods} for r in results}


@pytest.mark.slow
@pytest.mark.parametrize("scenario", REFERENCE)
def test_purity_is_near_the_reference(purity, scenario):
    for method, reference in REFERENCE[scenario].items():
        assert purity[scenario][method].score_mean == pytest.approx(reference, abs=0.12), method


@pytest.mark.slow
@pytest.mark.parametrize("scenario", REFERENCE)
def test_the_attribute_helps_in_paired_comparison(purity, scenario):
    for method in ("gda/dsm_classic/cv", "map/bayes/cv"):
        found = purity[scenario][method]
        assert found.difference_mean > found.difference_stderr, method


@pytest.mark.slow
@pytest.mark.parametrize("scenario", REFERENCE)
def test_the_truth_is_the_upper_bound(purity, scenario):
    best = purity[scenario]["clairvoyant"]
    # 0.99 for the detection, 0.99 for the gate, which the process noise makes wide enough.
    assert best.score_mean == pytest.approx(0.99, abs=0.01)
    assert all(best.score_mean > m.score_mean for m in purity[scenario].values() if m is not best)
