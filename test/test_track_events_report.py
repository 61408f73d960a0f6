"""The page docs/track-events.md: tables from the committed figures, and what it says of them."""

from __future__ import annotations

import json
import math

import numpy as np

from gda_tracker.events.monte_carlo import QUANTITIES, Followed, count_decisions, matched_tracks
from scripts import measure_events_in_the_ring as ring_report
from scripts import measure_stops as stops
from scripts import measure_track_events as report


def figures():
    return json.loads(report.FIGURES.read_text())


def test_the_tables_of_the_page_are_those_of_the_figures():
    assert report.tables(figures()) in report.PAGE.read_text()


def test_the_figures_are_of_the_settings_that_the_script_has_now():
    found = figures()
    tracks = matched_tracks(1, 200, np.random.default_rng(0))
    assert math.isclose(found["position_std_m"], math.sqrt(tracks.covariance[-1][1, 1]))
    made = {(e["quantity"], e["truth"], e["design"]) for e in found["designs"]}
    assert made == {(q, t, d) for q in QUANTITIES for t in report.TRUTHS for d in report.DESIGNS}
    for entry in found["margins"]:
        step = entry["margin_m"] / found["position_std_m"]
        truth = report.TRUTHS[entry["truth"]]
        expected = report.expected_rate(truth, step, report.LANE_SIDES, report.parameters(0.05))
        assert math.isclose(entry["expected"], expected)


def test_what_the_page_says_holds():
    found = figures()
    # No test errs more often than designed, by two standard errors.
    for entry in found["designs"]:
        assert entry["rate"] < entry["design"] + 2.0 * entry["standard_error"]
    # Siegmund's theory at two memories; at three negative correlation takes up to half off.
    expected = {}
    for entry in found["margins"]:
        error = 2.0 * entry["standard_error"]
        assert 0.5 * entry["expected"] - error < entry["rate"] < entry["expected"] + error
        if entry["margin_m"] == report.FACTOR_MARGIN_M:
            expected[entry["truth"]] = entry["expected"]
    for entry in found["factors"]:
        if entry["factor"] == 2.0:
            error = 2.0 * entry["standard_error"]
            assert abs(entry["rate"] - expected[entry["truth"]]) < error
        if entry["factor"] == 0.0:
            assert entry["rate"] > 2.0 * entry["design"]


def test_the_table_of_the_ring_is_that_of_its_figures_and_holds_the_design():
    found = json.loads(ring_report.FIGURES.read_text())
    assert ring_report.table(found) in ring_report.PAGE.read_text()
    assert tuple(found["methods"]) == ring_report.METHODS
    for entry in found["methods"].values():
        assert 4.0 < entry["nees"] < 5.0
        for name in ring_report.TESTS:
            for truth in report.TRUTHS:
                one = entry[name][truth]
                assert one["rate"] < one["design"] + 2.0 * one["standard_error"]


def test_tracks_of_the_ring_are_followed_with_their_errors():
    followed, known = ring_report.follow("map/none/cv", 6, 25, 3)
    assert followed.scans == 25
    ids, error, covariance, detected = followed.at(20)
    assert 5 <= len(ids) <= 6
    assert (np.diff(ids) > 0).all()
    assert np.isin(ids, followed.track_id).all()
    assert np.abs(error[:, :2]).max() < ring_report.OWN_M
    assert covariance.shape == (len(ids), 4, 4)
    assert detected.sum() < sum(len(each[0]) for each in followed.each)
    assert 0.5 < known["tracked"] <= 1.0
    # Tests count the same whichever way errors come.
    matched = matched_tracks(20, 60, np.random.default_rng(1))
    same = Followed([matched.at(scan) for scan in range(60)], matched.dt_s)
    one, other = (
        count_decisions("lane", report.TRUTHS["h0"], tracks, report.parameters(0.05))
        for tracks in (matched, same)
    )
    assert (one.h0, one.h1) == (other.h0, other.h1)
    assert one.total > 50


def test_the_table_of_stops_is_that_of_its_figures_and_they_are_told():
    found = json.loads(stops.FIGURES.read_text())
    assert stops.table(found) in stops.PAGE.read_text()
    assert found["runs"] >= 8
    assert tuple(found["methods"]) == stops.METHODS
    for entry in found["methods"].values():
        assert entry["states alone"]["told"][0] < 0.1
        one = entry["and missed detections"]
        assert one["told"][0] > 0.8
        # Not more than the design allows: 0.001 a test, of a few scans each.
        assert one["false"] <= 3
    assert tuple(found["at the bound"]) == stops.AT_BOUND
    for one in found["at the bound"].values():
        assert one["finished"] > 100
        assert one["wrong"] <= one["design"] * one["finished"]


def test_a_vehicle_stands_from_when_it_is_slow_until_it_is_not():
    """At 15 m/s it brakes with 1.5 m/s2 from scan 25, at 48 s: 1 m/s is reached after 14/1.5 s."""
    begin, end = stops.standing(stops.load_scenario("stop_and_go"))[0]
    assert math.isclose(begin, 48.0 + 14.0 / 1.5)
    assert math.isclose(end, 88.0 + 1.0 / 1.5)
