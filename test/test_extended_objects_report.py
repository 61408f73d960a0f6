"""The numbers of docs/extended-objects.md and the script behind them."""

from __future__ import annotations

import json

import numpy as np
import pytest

from scripts import measure_extended as report

PAGE = report.ROOT / "docs" / "extended-objects.md"


@pytest.fixture(scope="module")
def measured():
    return json.loads((report.ROOT / "docs/extended_objects.json").read_text(encoding="utf-8"))


def test_the_page_has_the_measured_tables(measured):
    text = PAGE.read_text(encoding="utf-8")
    for name, content in report.tables(measured).items():
        begin, end = f"<!-- {name}: begin (generated) -->\n", f"\n<!-- {name}: end -->"
        assert text.split(begin)[1].split(end)[0] == content


def test_a_small_run_agrees_with_the_benchmark(measured):
    distance, _ = report.benchmark(60, 7)
    for name, values in distance.items():
        runs = values.mean(axis=0)
        mean, stderr = measured["benchmark"][name]["all"]
        error = np.hypot(runs.std(ddof=1) / np.sqrt(60), stderr)
        assert runs.mean() == pytest.approx(mean, abs=4.5 * error)


def test_the_scan_of_the_car_gives_what_is_written(measured):
    assert report.track_car()[2] == measured["car"]


def test_the_scenario_is_the_published_one():
    orientation, centre = report.course()
    assert len(orientation) == 133
    way = np.hypot(*np.diff(centre, axis=0).T)
    np.testing.assert_allclose(way, 500 / 36 * 10)
    assert np.degrees(orientation[[0, 40, 75, -1]]).tolist() == [-45.0, 0.0, 90.0, 180.0]
