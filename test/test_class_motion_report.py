"""The numbers of docs/class-motion.md and the script behind them."""

from __future__ import annotations

import json

import numpy as np

from gda_tracker.simulation.scenarios import load_scenario
from scripts import measure_class_motion as script

DOCS = script.ROOT / "docs"


def test_the_page_has_the_measured_table_and_both_know_more_than_one():
    numbers = json.loads((DOCS / "class-motion.json").read_text(encoding="utf-8"))
    begin, end = "<!-- class motion: begin (generated) -->\n", "\n<!-- class motion: end -->"
    page = (DOCS / "class-motion.md").read_text(encoding="utf-8")
    assert page.split(begin)[1].split(end)[0] == script.table(numbers)
    assert numbers["runs"] >= 10
    assert set(numbers["methods"]) == set(script.METHODS)
    for method, sources in numbers["methods"].items():
        # What dsm_classic knows of the radar cross section is lost to the total intersection later.
        scan = "10" if "dsm_classic" in method else "60"
        (rcs, _), (motion, _), (both, error) = (
            sources[source]["right"][scan] for source in ("RCS", "motion", "both")
        )
        assert both > max(rcs, motion) + 3.0 * error


def test_the_unaware_scenario_differs_by_the_option_alone():
    one, two = (load_scenario(f"class_by_motion{end}") for end in ("", "_unaware"))
    assert one.tracker.class_motion == "ranges"
    assert two.tracker.class_motion == "off"
    assert (one.targets, one.sensor, one.attribute) == (two.targets, two.sensor, two.attribute)


def test_what_is_level_counts_in_part_and_no_track_is_wrong():
    probability = np.array([[0.0, 0.5, 0.5], [0.2, 0.3, 0.5], [np.nan] * 3])
    shares = script.right_share(probability, np.array([1, 2, 1]))
    np.testing.assert_array_equal(shares, [0.5, 1.0, 0.0])
