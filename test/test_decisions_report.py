"""The script behind docs/decisions.md and the README's measured table; both are its work."""

from __future__ import annotations

import json

import numpy as np
import pytest

from gda_tracker.evaluation.monte_carlo import monte_carlo
from gda_tracker.io.adapters import load_recording
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.simulation.simulate import simulate
from gda_tracker.tracking.methods import default_method
from scripts import measure_decisions as report

pytestmark = pytest.mark.slow

FEW = ("gda/none/cv", "mht/bayes/imm")


def section(path, name):
    """Text of a section."""
    begin, end = f"<!-- {name}: begin (generated) -->\n", f"\n<!-- {name}: end -->"
    return path.read_text(encoding="utf-8").split(begin)[1].split(end)[0]


@pytest.fixture(scope="module")
def measured():
    """The figures that are shipped."""
    return json.loads((report.ROOT / "docs/decisions.json").read_text(encoding="utf-8"))


# --- the shipped pages --------------------------------------------------------------------------


@pytest.mark.parametrize("name", list(report.PAGE_TABLES))
def test_the_page_has_the_tables_of_the_measured_figures(measured, name):
    assert section(report.ROOT / "docs/decisions.md", name) == report.PAGE_TABLES[name](measured)


def test_the_readme_has_the_measured_figures_of_its_command(measured):
    written = section(report.ROOT / "README.md", "measured")
    assert written == report.readme_table(measured)
    assert f"--runs {measured['runs']} --seed {measured['seed']}" in written
    assert "--method default" in written
    assert f"`{default_method()}`, the default" in written


def test_everything_was_measured(measured):
    assert list(measured["scenarios"]) == list(report.SCENARIOS)
    for found in measured["scenarios"].values():
        assert list(found) == list(report.METHODS)
    assert set(measured["variants"]) == {f"{v}: {name}" for v, name, _ in report.variants()}
    assert set(measured["recordings"]) == set(report.RECORDINGS)


def test_the_recordings_give_what_is_written(measured):
    """Without chance: the same tracks today."""
    name = "Autoferry 13"
    recording = load_recording(str(report.RECORDINGS[name]))
    found = report.measure_recording(recording, "map/none/cv")
    written = measured["recordings"][name]["map/none/cv"]
    for figure in ("completeness", "switches", "flips", "confirmed_tracks", "longest_share"):
        assert found[figure] == written[figure]
    assert found["position_rmse_m"] == pytest.approx(written["position_rmse_m"], abs=0.02)


# --- the script ---------------------------------------------------------------------------------


def test_figures_are_those_of_an_evaluation():
    scenario = load_scenario("crossing_targets")
    (found,) = report.measure_scenarios([scenario], FEW, 2, 3, 1)
    (result,) = monte_carlo([scenario], list(FEW), 2, 3, workers=1)
    for entry in (method.to_dict() for method in result.methods):
        mine = found[entry["method"]]
        assert mine["purity_mean"] == pytest.approx(entry["purity_mean"], abs=1e-5)
        assert mine["difference_mean"] == pytest.approx(entry["difference_mean"], abs=1e-5)
        assert ("purity_delayed_mean" in mine) == entry["method"].startswith("mht")


def test_variants_differ_in_what_they_say_and_nothing_else():
    for variant, name, scenario in report.variants():
        plain = load_scenario(name)
        one, other = simulate(plain, 1, 0), simulate(scenario, 1, 0)
        for before, after in zip(one.detections, other.detections, strict=True):
            np.testing.assert_array_equal(before.range_m, after.range_m)
            np.testing.assert_array_equal(before.azimuth_rad, after.azimuth_rad)
            same_rcs = np.array_equal(before.rcs_m2, after.rcs_m2)
            assert same_rcs == variant.startswith("means")
        told = [tracker_preset(s)["rcs_fuzzifier"]["class_rcs_mean_m2"] for s in (plain, scenario)]
        factor = {"one class": 1.0, "means told x 1.5": 1.5, "means told / 1.5": 1 / 1.5}[variant]
        np.testing.assert_allclose(told[1], [told[0][0], *(factor * m for m in told[0][1:])])
        if variant == "one class":
            assert {target.class_name for target in scenario.targets} == {"fighter"}
            assert {target.rcs_mean_m2 for target in scenario.targets} == {1.2}


def test_the_best_and_what_is_near_it_stand_out(measured):
    changed = json.loads(json.dumps(measured))
    for place, method in enumerate(report.METHODS):
        changed["scenarios"]["crossing_targets"][method] |= {
            "purity_mean": 0.9 if place == 3 else 0.88 if place == 5 else 0.5,
            "purity_stderr": 0.01,
        }
    rows = report.scenarios_table(changed).splitlines()[2:]
    bold = [row.split(" | ")[3].startswith("**") for row in rows]
    assert [place for place, is_bold in enumerate(bold) if is_bold] == [3, 5]


def test_one_command_writes_everything(measured, tmp_path, monkeypatch, capsys):
    page, readme = tmp_path / "page.md", tmp_path / "readme.md"
    names = [*report.PAGE_TABLES, "origin"]
    page.write_text(
        "before\n" + "".join(f"<!-- {n}: begin (generated) -->\n<!-- {n}: end -->\n" for n in names)
    )
    readme.write_text("<!-- measured: begin (generated) -->\nold\n<!-- measured: end -->\nafter\n")
    paths = ["--document", str(page), "--readme", str(readme), "--json", str(tmp_path / "r.json")]
    monkeypatch.setattr(report, "METHODS", FEW)
    monkeypatch.setattr(report, "VARIANT_METHODS", FEW[1:])
    monkeypatch.setattr(report, "README_METHODS", FEW)
    monkeypatch.setattr(report, "RECORDED_METHODS", ("map/none/cv",))
    short = {"walk": report.RECORDINGS["walk"]}
    monkeypatch.setattr(report, "RECORDINGS", short)
    assert report.main(["--runs", "2", "--workers", "1", *paths]) == 0
    figures = json.loads((tmp_path / "r.json").read_text())
    assert figures["runs"] == 2
    assert section(page, "scenarios") == report.scenarios_table(figures)
    assert "| walk | `map/none/cv` | no truth |" in section(page, "recordings")
    assert section(readme, "measured").startswith("```sh\ngda-tracker evaluate crossing_targets")
    assert readme.read_text().endswith("-->\nafter\n")
    # Written again from the file, the same.
    before = page.read_text()
    assert report.main(["--from", str(tmp_path / "r.json"), *paths]) == 0
    assert page.read_text() == before
    with pytest.raises(SystemExit):
        report.main(["--runs", "1", *paths])
    assert "allowed is an integer >= 2" in capsys.readouterr().err
