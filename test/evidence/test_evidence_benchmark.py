"""What the benchmark of the rules compares is the same on both sides."""

import pytest

from benchmarks.evidence import CASES, measure_evidencelib
from gda_tracker.evidence.combination import RULES
from gda_tracker.evidence.frames import free_model, shafer_model


@pytest.mark.parametrize(("size", "rule", "model_name", "goal_ms"), CASES)
def test_masses_are_those_of_evidencelib(size, rule, model_name, goal_ms):
    if size > 3 and rule == "dsmh":
        size = 3  # 0.3 s for each pair there
    make = free_model if model_name == "free" else shafer_model
    model = make(tuple("ABCD"[:size]))
    found = measure_evidencelib(size, rule, model_name, model, pairs=2)
    assert found["largest_difference"] < 1e-12
    assert found["all_pairs_s"] > 0.0


def test_all_rules_are_measured():
    assert {rule for _, rule, _, _ in CASES} | {"pcr6"} == set(RULES)
