"""The tables of docs/filters.md: what is measured, and how it is written."""

from __future__ import annotations

import numpy as np

from gda_tracker.tracking.parameters import TrackManagerParameters
from scripts import measure_filters
from scripts.measure_filters import CLAIRVOYANT, DECISIONS, FILTERS, SHORT_LIST, Found


def test_every_filter_is_measured_with_its_own_models(monkeypatch):
    chosen = {name: FILTERS[name] for name in ("cv", "gpb2, cv + turn")}
    monkeypatch.setattr(measure_filters, "FILTERS", chosen)
    found = measure_filters.measure(measure_filters.SCENARIOS[0], 1, 1, 0)
    assert set(found) == {(f, d) for f in chosen for d in (CLAIRVOYANT, *DECISIONS)}
    errors = [found[name, CLAIRVOYANT].error_m[0] for name in chosen]
    assert errors[0] != errors[1]
    for name in chosen:
        one = found[name, CLAIRVOYANT]
        assert 0.0 < one.smoothed_m[0] < one.error_m[0] < 5000.0
        assert found[name, "map/bayes"].purity == []


def test_all_models_are_allowed():
    for values in FILTERS.values():
        assert TrackManagerParameters(**values).filter == values["filter"]


def test_differences_are_paired():
    run = np.random.default_rng(1).uniform(0.2, 0.8, 30)
    found = {
        "a": {
            (name, decision): Found([9.0, 11.0], [4.0, 6.0], list(run + 0.05 * k), [], [0.002])
            for k, name in enumerate(FILTERS)
            for decision in (CLAIRVOYANT, *DECISIONS)
        }
    }
    lines = measure_filters.error_table(found).splitlines()
    assert len(lines) == 2 + len(FILTERS)
    assert "| 10 +- 1 | 5 +- 1 |" in lines[2]
    lines = measure_filters.purity_table(found).splitlines()
    assert len(lines) == 2 + 2 * len(SHORT_LIST)
    assert "+0.100 +- 0.000" in lines[4]
    assert "| 2.0 |" in lines[4]
