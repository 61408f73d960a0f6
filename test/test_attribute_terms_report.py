"""The scripts behind the tables and the picture of ``docs/attribute-terms.md``."""

from __future__ import annotations

import json

import numpy as np
import pytest

from gda_tracker.evaluation.monte_carlo import monte_carlo
from gda_tracker.evidence.frames import element_name
from gda_tracker.simulation.scenarios import load_scenario
from scripts import doc_tables, measure_history_policies
from scripts import measure_attribute_terms as report

pytestmark = pytest.mark.slow


@pytest.fixture
def document(tmp_path):
    """A document with an empty section for every table, and text around them."""
    names = [*report.SECTIONS.values(), "history policies", "history drift"]
    sections = [f"<!-- {n}: begin (generated) -->\nold\n<!-- {n}: end -->\n" for n in names]
    path = tmp_path / "document.md"
    path.write_text("before\n" + "between\n".join(sections) + "after\n")
    return path


def section(document, name):
    """Lines of a section."""
    begin, end = f"<!-- {name}: begin (generated) -->\n", f"\n<!-- {name}: end -->"
    return document.read_text().split(begin)[1].split(end)[0].splitlines()


# --- history policies ---------------------------------------------------------------------------


def test_the_total_intersection_has_its_name():
    names = ("VS", "S", "B")
    assert element_name(names, measure_history_policies.total_intersection(3)) == "VS&S&B"


@pytest.fixture(scope="module")
def outcomes():
    policies = measure_history_policies
    return {
        (name, method): policies.measure(load_scenario(name), method, 2, 1)
        for name in policies.SCENARIOS
        for method in policies.METHODS[:1]
    }


def test_policies_are_scored_like_an_evaluation(outcomes):
    """No policy is the default: the same purity as of ``evaluate`` on the same runs."""
    for (name, method), found in outcomes.items():
        (result,) = monte_carlo([load_scenario(name)], [method], 2, 1, workers=1)
        np.testing.assert_allclose(found["none"].purity, result.methods[0].score)


def test_forgetting_and_windows_stop_the_drift(outcomes):
    found = outcomes["crossing_targets", "gda/dsm_classic/cv"]
    for kind in ("forgetting", "window"):
        ends = [
            o.intersection[:, -1].mean() for n, o in found.items() if n in ("none",) or kind in n
        ]
        assert ends == sorted(ends, reverse=True)
        assert ends[0] > 0.5 > 0.2 > ends[-1]
    # One detection has no intersections.
    np.testing.assert_array_equal(found["window 1"].intersection, 0.0)
    # A window is full after so many detections, the initial belief being one of them.
    for size in (12, 6, 3):
        window, none = found[f"window {size}"].intersection, found["none"].intersection
        np.testing.assert_allclose(window[:, : size - 1], none[:, : size - 1], atol=1e-12)
        assert not np.allclose(window[:, size], none[:, size])


def test_policies_become_tables_and_a_picture(outcomes, document, tmp_path, monkeypatch):
    policies = measure_history_policies
    monkeypatch.setattr(policies, "METHODS", policies.METHODS[:1])
    monkeypatch.setattr(
        policies, "measure", lambda scenario, method, *_: outcomes[scenario.name, method]
    )
    picture = tmp_path / "new" / "policies.png"
    assert policies.main(["--document", str(document), "--picture", str(picture)]) == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
    rows = section(document, "history policies")
    assert [row.split(" | ")[1] for row in rows[2:]] == list(policies.POLICIES)
    found = outcomes["crossing_targets", "gda/dsm_classic/cv"]
    difference = found["window 3"].purity - found["none"].purity
    assert f"{found['window 3'].purity.mean():.3f} +- " in rows[-2]
    assert f"| {difference.mean():+.3f} +- " in rows[-2]
    drift = section(document, "history drift")
    assert len(drift) == 2 + len(policies.POLICIES)
    assert f"| {found['none'].intersection[:, -1].mean():.3f} |" in drift[2]
    assert document.read_text().startswith("before\n")
    assert document.read_text().endswith("-->\nafter\n")


# --- terms --------------------------------------------------------------------------------------


def test_an_evaluation_becomes_a_table(document, tmp_path):
    method = {"purity_mean": 0.5, "purity_stderr": 0.01, "difference_mean": -0.25}
    other = {**method, "method": "gda/pcr5/cv", "difference_stderr": 0.125}
    first = {**method, "method": "gda/none/cv", "difference_stderr": 0.0}
    file = tmp_path / "terms.json"
    content = {"scenario": "one", "difference_to": "gda/none/cv", "methods": [first, other]}
    file.write_text(json.dumps(content))
    assert report.main(["table", str(file), "--document", str(document)]) == 0
    assert section(document, "terms") == [
        "| method | one | difference to gda/none/cv |",
        "| --- | --- | --- |",
        "| `gda/none/cv` | 0.500 +- 0.010 | - |",
        "| `gda/pcr5/cv` | 0.500 +- 0.010 | -0.250 +- 0.125 |",
    ]


def test_the_distance_of_dempster_falls_silent_and_its_likelihood_does_not():
    swaps = report.measure_swaps("dempster", 1500, 1)
    assert swaps.distance[-1] == pytest.approx(0.5, abs=0.05)
    assert swaps.likelihood[-1] > 0.8
    swaps = report.measure_swaps("bayes", 1500, 1)
    np.testing.assert_array_equal(swaps.distance, 0.5)  # it has none: all are equal
    np.testing.assert_array_equal(swaps.distance_log_ratio, 0.0)
    assert swaps.likelihood[-1] > 0.8


def test_the_classic_rule_grows_louder_by_distance_and_quieter_by_likelihood():
    swaps = report.measure_swaps("dsm_classic", 1500, 1)
    assert swaps.likelihood[-1] > 0.8
    assert swaps.likelihood_log_ratio[-1] < 0.2 * swaps.likelihood_log_ratio[3]
    assert swaps.distance_log_ratio[-1] > 2.0 * swaps.distance_log_ratio[3]


def test_paired_differences_are_those_of_an_evaluation(document, monkeypatch):
    monkeypatch.setattr(report, "PAIRED", {"map/none/cv": ("map/bayes/cv",)})
    arguments = ["paired", "--runs", "3", "--seed", "2", "--document", str(document)]
    assert report.main(arguments) == 0
    expected = []
    for name in report.SCENARIOS:
        methods = ["map/none/cv", "map/bayes/cv"]
        (result,) = monte_carlo([load_scenario(name)], methods, 3, 2, workers=1)
        one, other = (method.score for method in result.methods)
        mean, error = (other - one).mean(), (other - one).std(ddof=1) / np.sqrt(3)
        expected.append(f"{mean:+.3f} +- {error:.3f}")
    assert section(document, "paired differences") == [
        "| method | compared with | crossing_targets | closely_spaced_targets |",
        "| --- | --- | --- | --- |",
        f"| `map/bayes/cv` | `map/none/cv` | {expected[0]} | {expected[1]} |",
    ]


def test_swaps_become_a_table(document):
    assert report.main(["swaps", "--runs", "50", "--document", str(document)]) == 0
    rows = section(document, "swaps")
    assert [row.split(" | ")[0] for row in rows[2:]] == [
        f"| `{term}`" for term in report.ATTRIBUTE_TERMS[1:]
    ]


@pytest.mark.parametrize("text", ["", "<!-- terms: end -->\n<!-- terms: begin (generated) -->\n"])
def test_a_document_without_the_section_is_left_alone(tmp_path, text):
    path = tmp_path / "document.md"
    path.write_text(text)
    with pytest.raises(ValueError, match="needs one <!-- terms: begin"):
        doc_tables.write_section(path, "terms", "new")
    assert path.read_text() == text


def test_the_document_has_every_section():
    names = [*report.SECTIONS.values(), "history policies", "history drift"]
    path = report.ROOT / "docs" / "attribute-terms.md"
    for name in names:
        assert section(path, name)[0].startswith("| ")
