"""The page docs/clutter-maps.md: tables from the committed figures, and what it says of them."""

from __future__ import annotations

import json

from scripts import measure_clutter_maps as report


def figures():
    return json.loads(report.FIGURES.read_text())


def test_the_tables_of_the_page_are_those_of_the_figures():
    page = report.PAGE.read_text()
    for table in report.tables(figures()).values():
        assert table in page


def test_the_figures_are_of_the_settings_that_the_script_has_now():
    found = figures()
    made = {(entry["method"], entry["variant"]) for entry in found["gain"]}
    names = [name for name, _, _ in report.VARIANTS]
    assert made == {(m, n) for m in report.MEASURED_METHODS for n in names}
    made = {(entry["model"], entry["memory_scans"], entry["factor"]) for entry in found["measured"]}
    assert len(made) == 2 * len(report.MEMORIES) * len(report.FACTORS)


def test_what_the_page_says_holds():
    found = figures()
    for method in report.MEASURED_METHODS:
        told, tenth, *estimated, true = (
            next(e for e in found["gain"] if (e["method"], e["variant"]) == (method, name))
            for name, _, _ in report.VARIANTS
        )
        assert tenth["false_tracks"]["mean"] > told["false_tracks"]["mean"] > 5.0
        for entry in estimated:
            assert entry["false_tracks"]["mean"] < 0.4 * told["false_tracks"]["mean"]
            near = 3.0 * (entry["false_tracks"]["error"] + true["false_tracks"]["error"]) + 0.5
            assert abs(entry["false_tracks"]["mean"] - true["false_tracks"]["mean"]) < near
    for entry in found["field"]:
        for truth, value in entry["probability"].items():
            assert abs(value["mean"] - float(truth)) < 0.04
        for place in ("elsewhere_busy", "elsewhere_quiet", "at_targets_busy", "at_targets_quiet"):
            assert abs(entry[place]["mean"] - 1.0) < 0.2
