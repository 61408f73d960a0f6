"""The page of lanes and plans: its tables are those of its numbers, and say what the text says."""

from __future__ import annotations

import json
from pathlib import Path

from scripts.measure_lanes import METHODS, TOLD, UNTOLD, tables

DOCS = Path(__file__).resolve().parent.parent / "docs"


def numbers():
    return json.loads((DOCS / "lanes.json").read_text(encoding="utf-8"))


def test_the_page_shows_the_numbers():
    page = (DOCS / "lanes.md").read_text(encoding="utf-8")
    section = page.split("<!-- lanes: begin (generated) -->")[1].split("<!-- lanes: end -->")[0]
    assert section.strip() == tables(numbers()).strip()


def test_keepers_gain_under_every_method_and_nobody_is_held():
    found = numbers()
    assert list(found["methods"]) == list(METHODS)
    for entry in found["methods"].values():
        for who in ("keepers", "planned"):
            gain, error = entry["gain"][who]
            assert gain < -2.5 * error
            assert gain < -0.1 * entry[UNTOLD][who][0]
        # What it costs those who leave, over their whole way and while they leave.
        assert entry["gain"]["leavers"][0] < 1.5
        assert entry["gain"]["departure"][0] < 8.0
        lost, error = entry["gain"]["lost"]
        assert lost < max(0.03, 2.0 * error)
        assert entry[TOLD]["ms"][0] < 20.0 * entry[UNTOLD]["ms"][0]


def test_who_keeps_to_a_lane_is_tracked_consistently():
    matched = numbers()["matched"]
    mean, error = matched["with, all known to keep"]["nees"]
    assert abs(mean - 4.0) < 3.0 * error
    assert matched["with"]["nees"][0] < 4.0
    assert matched["with"]["rms_m"] < 0.75 * matched["without"]["rms_m"]
