"""The script behind docs/track-fusion.md: its tables are those of the shipped figures."""

from __future__ import annotations

import json

import numpy as np
import pytest

from gda_tracker.vocabulary.scans import ScanKey
from gda_tracker.vocabulary.tracks import Tracks
from scripts import measure_track_fusion as report
from scripts.track_fusion_case import RADARS, fused_once, nearest_neighbours, ring_case


@pytest.fixture(scope="module")
def figures():
    return json.loads((report.ROOT / "docs/track-fusion.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", list(report.TABLES))
def test_the_page_has_the_tables_of_the_measured_figures(figures, name):
    page = (report.ROOT / "docs/track-fusion.md").read_text(encoding="utf-8")
    begin, end = f"<!-- {name}: begin (generated) -->\n", f"\n<!-- {name}: end -->"
    assert page.split(begin)[1].split(end)[0] == report.TABLES[name](figures)


def test_what_was_measured_is_what_the_issue_asks(figures):
    rows = {
        name: {key: np.mean([one[key] for one in scores]) for key in scores[0]}
        for name, scores in figures["rings"]["scores"].items()
    }
    ours = rows.pop(report.FUSION_NAME)
    assert ours["once"] > 0.99
    for other in rows.values():
        assert ours["once"] > other["once"] + 0.4
        assert ours["gospa_m"] < 0.5 * other["gospa_m"]
    error, sigma = (np.array(figures["rings"]["bias"][key]) for key in ("error_m", "sigma_m"))
    assert (np.abs(error) <= 2.0 * sigma).mean() > 0.85
    topics = figures["topics"]
    assert (np.abs(topics["error_m"]) <= 2.0 * np.array(topics["sigma_m"])).all()


def test_an_ideal_run_tells_errors_of_states_and_of_biases(monkeypatch):
    monkeypatch.setattr(report, "IDEAL_SCANS", 5)
    nees, square, bias, naive = report._ideal_run(1, "equivalent_measurements")
    assert nees.shape == (5,)
    assert (0.5 < nees).all()
    assert (nees < 15.0).all()
    assert (square < 100.0**2).all()
    assert bias[0] == naive[0] == 0.0
    # The first estimate is the same; later ones are not.
    assert naive[1] == pytest.approx(bias[1], rel=0.05)
    assert abs(naive[4] - bias[4]) > 1e-3


def test_nearest_neighbours_join_the_wrong_tracks_where_biases_are_ignored():
    case = ring_case(0, 0, method="map/bayes/cv")
    truth = case.truth(12)
    live = {}
    for number, radar in enumerate(RADARS):
        mean = truth - [*radar.bias_m, 0.0, 0.0]
        n = len(mean)
        live[radar.name] = Tracks(
            ScanKey(1, radar.name, case.recordings[radar.name].detections[12].stamp_ns),
            "map",
            track_id=np.arange(n) + 100 * number,
            status=np.ones(n, dtype=np.int64),
            mean=mean,
            covariance=np.tile(np.diag([900.0, 900.0, 25.0, 25.0]), (n, 1, 1)),
        )
    wrong = nearest_neighbours(live, wide=True)
    assert not fused_once(case, wrong, live, 12).all()
    apart = nearest_neighbours(live, wide=False)
    assert not fused_once(case, apart, live, 12).any()
    right = nearest_neighbours(live, wide=True)
    right.member_track_id[:] = np.arange(len(right.mean))[:, None] + [0, 100]
    right.member[:] = np.arange(len(right.mean))[:, None] < len(truth)
    assert fused_once(case, right, live, 12).all()
