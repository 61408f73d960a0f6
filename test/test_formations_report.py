"""The page docs/formations.md: tables from the committed figures, and what it says of them."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from scripts import measure_formations as report
from scripts.formation_information import true_counts


def figures():
    return json.loads(report.FIGURES.read_text())


def test_the_tables_of_the_page_are_those_of_the_figures():
    assert report.tables(figures()) in report.PAGE.read_text()


def test_the_figures_are_of_the_settings_that_the_script_has_now():
    found = figures()
    made = {(e["case"], e["design"], e["truth"]) for e in found["errors"]}
    assert made == {(c, d, n) for c in report.CASES for d in report.DESIGNS for n in report.NUMBERS}
    assert all(len(entry["share"]) == report.SCANS for entry in found["cardinality"])


def test_what_a_scan_says_at_best():
    # Two objects: linked with the probability 1/2 at this distance.
    counts = true_counts(np.array([[0.0, 0.0], [300.0, 0.0]]), 300.0, 3)
    both = 0.5 * 0.9**2
    assert counts == pytest.approx([0.5 * 0.1 + 0.5 * 0.01, 0.5 * 0.9 + 0.09, both, 0.0])
    found = report.what_a_scan_says()
    for entry, committed in zip(found, figures()["information"], strict=True):
        assert entry == pytest.approx(committed)
        # No model says more than the true distribution.
        assert entry["places_nat"] >= entry["draws_nat"] > 0.0
    assert found[-1]["draws_scans"] > report.SCANS


def test_what_the_page_says_holds():
    found = figures()
    # No test errs more often than designed, by three standard errors; few are left open.
    for entry in found["errors"]:
        allowed = entry["design"] + 3.0 * math.sqrt(entry["design"] / entry["tests"])
        assert entry["too_many"] <= allowed
        assert entry["too_few"] <= allowed
        assert entry["open"] < 0.01
    # Nor far less often, where the steps of the ratio are small.
    for entry in found["errors"]:
        if entry["case"] == "P_D 0.6" and entry["truth"] == 3:
            assert entry["too_many"] + entry["too_few"] > 0.4 * entry["design"]
    numbers = {(e["case"], e["kind"]): e for e in found["cardinality"]}
    resolved = "resolved, without the resolution"
    for kind, scans in (("decided", 22), ("probable", 16)):
        assert max(numbers[resolved, kind]["scans_until_90_by_number"]) == scans
        without = numbers["partly unresolved, without the resolution", kind]["last"]
        assert numbers["partly unresolved, with the resolution", kind]["last"] > without
    assert found["lineage"]["runs_with_one_split"] == 1.0
    assert found["lineage"]["runs_with_one_merger"] == 1.0
