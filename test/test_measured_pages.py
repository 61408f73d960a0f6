"""Figures of pages against the committed JSON, and the JSON against the scripts that wrote it."""

from __future__ import annotations

import json

import numpy as np
import pytest

from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.simulation.simulate import simulate
from scripts import measure_blind_zone as blind
from scripts import measure_extended_ring as extended
from scripts import measure_unresolved as unresolved
from scripts import measure_unresolved_tuned as tuned

DOCS = extended.ROOT / "docs"


def measured(name):
    return json.loads((DOCS / name).read_text(encoding="utf-8"))


def section(page, name):
    begin, end = f"<!-- {name}: begin (generated) -->\n", f"\n<!-- {name}: end -->"
    return (DOCS / page).read_text(encoding="utf-8").split(begin)[1].split(end)[0]


def test_extended_objects_in_the_ring():
    numbers = measured("extended_ring.json")
    for name, content in extended.tables(numbers).items():
        assert section("extended-objects.md", name) == content
    on, off = (numbers["scenario"][model] for model in ("random_matrix", "none"))
    assert set(on) == set(extended.MEASURES)
    assert set(off) == set(extended.MEASURES) - {"extent_error_m"}
    # What the page says it gains, beyond the errors of both.
    for name in ("position_rmse_m", "confirmed_tracks", "nees"):
        assert off[name][0] - on[name][0] > 3.0 * np.hypot(off[name][1], on[name][1])
    assert on["completeness"][0] > 0.95


def test_the_scan_of_the_car_in_the_ring_gives_what_is_written():
    assert (
        extended.car_numbers(extended.play(*extended.CAR)) == measured("extended_ring.json")["car"]
    )


def test_the_blind_zone():
    numbers = measured("blind-zone.json")
    assert section("blind-zone.md", "blind zone") == blind.table(numbers)
    assert list(numbers["methods"]) == list(blind.RULES.values())
    for label, entry in numbers["methods"].items():
        gain, error = entry["gain"]
        assert gain == pytest.approx(
            entry[blind.AWARE]["kept"][0] - entry[blind.UNAWARE]["kept"][0], abs=1e-4
        )
        # Nothing without a model that stands; else nearly every stop, and more false tracks.
        if label.endswith("cv"):
            assert gain == 0.0
        else:
            assert gain > 0.85
            assert gain > 10.0 * error
            more = entry[blind.AWARE]["false"][0] - entry[blind.UNAWARE]["false"][0]
            # Hardly any with sequential extraction, none here.
            assert more >= 0.0 if label.endswith("sequential") else more > 1.0


def test_a_run_of_the_blind_zone_counts_what_the_figures_count():
    scenario = load_scenario(blind.AWARE)
    recording = simulate(scenario, 1, 0, initiation="automatic")
    found = blind.follow(scenario, ("map/none/imm", "sequential"), recording)
    entry = measured("blind-zone.json")["methods"]["map/none/imm, sequential"][blind.AWARE]
    assert set(found) - {"places"} == set(entry)
    assert found["kept"] >= 2 / 3
    assert found["complete"] == pytest.approx(entry["complete"][0], abs=0.05)


def test_unresolved_targets_in_the_ring():
    numbers = measured("unresolved_ring.json")
    cases = {(case["scenario"], case["method"]): case for case in numbers["cases"]}
    assert list(cases) == list(unresolved.CASES)
    for key, case in cases.items():
        assert case["runs"] == round(200 * unresolved.CASES[key])
        assert list(case["settings"]) == list(unresolved.SETTINGS)
    # Three at a time gain too, in the joint engine and in the trees.
    for method in ("jpda/none/cv", "mht/none/cv"):
        without = cases["unresolved_three", method]["settings"]["without"]
        assert without["gain"][0] > 4.0 * without["gain"][1]
        assert without["more"] > 0.2


def test_unresolved_targets_each_side_at_its_best():
    numbers = measured("unresolved_tuned.json")
    assert section("unresolved.md", "tuned") == tuned.table(numbers)
    assert numbers["runs"] >= 200
    cases = {(case["scenario"], case["method"]): case for case in numbers["cases"]}
    assert list(cases) == list(tuned.CASES)
    for case in cases.values():
        for side in tuned.SIDES:
            one = case["sides"][side]
            tried = one["tried"]
            assert list(tried) == [f"{q:g}" for q in tuned.GRID_MPS2]
            # The best of those that were tried was taken.
            assert tried[f"{one['process_noise_std_mps2']:g}"] == max(tried.values())
    # Where targets turn, the model keeps them at least 20 % more often.
    case = cases["unresolved_turning", "mht/none/cv"]
    assert case["more"] >= 0.2
    assert case["gain"][0] > 4.0 * case["gain"][1]


def test_both_sides_differ_in_the_resolution_alone():
    with_it, without = (tuned.setting(side, 0.1) for side in ("with", "without"))
    assert set(without) - set(with_it) == {"resolution_range_m", "resolution_azimuth_rad"}
    played = tuned.played(
        "unresolved_turning", "mht/none/cv", 1, 5, {"with": tuned.setting("with", 0.4)}
    )
    assert played["with"]["kept"].tolist() in ([0.0], [1.0])
    assert 0.1 < played["with"]["nees"] < 10.0
