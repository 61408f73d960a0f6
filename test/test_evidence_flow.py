"""``docs/evidence-flow.md``: its numbers are those of a fresh run, and the run is what it says."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from gda_tracker.evidence.frames import parse_element

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "evidence-flow.md"
MODULES = ("evidence_flow_case", "evidence_flow_page", "make_evidence_flow")


@pytest.fixture(scope="module")
def scripts():
    """The modules behind the page, which are no package."""
    before = sys.path.copy()
    sys.path.insert(0, str(ROOT / "scripts"))
    try:
        import evidence_flow_case
        import evidence_flow_page
        import make_evidence_flow

        yield SimpleNamespace(
            case=evidence_flow_case, page=evidence_flow_page, make=make_evidence_flow
        )
    finally:
        sys.path[:] = before
        for name in MODULES:
            sys.modules.pop(name, None)


@pytest.fixture(scope="module")
def case(scripts):
    return scripts.case.search(scripts.case.RUNS, scripts.case.SEED)


# --- the page -------------------------------------------------------------------------------------


def test_the_page_is_what_a_fresh_run_writes(scripts, case):
    page = PAGE.read_text()
    assert (
        scripts.make.differences(page, scripts.make.filled(page, scripts.page.blocks(case))) == []
    )


def test_every_number_of_the_generated_text_is_guarded(scripts):
    """Whichever number is wrong, by more than one in its last digit, the comparison says so."""
    guarded = 0
    for block in scripts.make.BLOCK.finditer(PAGE.read_text()):
        for line in block[0].splitlines():
            for number in scripts.make.NUMBER.finditer(line):
                wrong = f"{float(number[0]) * 1.5 + 7.0:.6g}"
                changed = line[: number.start()] + wrong + line[number.end() :]
                assert not scripts.make.same_line(changed, line), number[0]
                guarded += 1
    assert guarded > 150


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("P_k 0.261, 3 scans", "P_k 0.262, 3 scans", True),  # the last digit is left to rounding
        ("P_k 0.261, 3 scans", "P_k 0.263, 3 scans", False),
        ("P_k 0.261, 3 scans", "P_k 0.261, 4 scans", False),
        ("P_k 0.261, 3 scans", "P_a 0.261, 3 scans", False),
        ("P_a 1", "P_a 0.9999", True),
        ("P_a 0.5", "P_a 0.5001", True),
        ("P_a 0.5", "P_a 0.5003", False),
        ("8.09e-13", "8.10e-13", True),
        ("8.09e-13", "8.11e-13", False),
        ("8.09e-13", "8.09e-12", False),
    ],
)
def test_what_counts_as_the_same_line(scripts, one, other, same):
    assert scripts.make.same_line(one, other) is same
    assert bool(scripts.make.differences(one, other)) is not same


def test_a_missing_line_or_block_is_noticed(scripts):
    assert scripts.make.differences("a\nb", "a") == ["2 lines, a fresh run writes 1"]
    page = "<!-- flow pairs: begin (generated) -->\n<!-- flow pairs: end -->\n"
    written = scripts.make.filled(page, {"pairs": "new"})
    assert written.splitlines()[1] == "new"
    assert scripts.make.filled(written, {"pairs": "new"}) == written
    for wrong in (page + page, ""):
        with pytest.raises(ValueError, match="blocks of the page"):
            scripts.make.filled(wrong, {"pairs": "new"})


def test_its_pictures_are_the_ones_that_are_drawn(scripts, case):
    drawn = scripts.make.pictures(case)
    assert set(re.findall(r"\]\(images/(\S+)\)", PAGE.read_text())) == set(drawn)
    for name in drawn:
        stored = (ROOT / "docs" / "images" / name).read_bytes()
        assert stored.startswith(b"\x89PNG")
        assert len(stored) < 150_000


def test_the_fields_it_names_are_in_the_messages():
    section = PAGE.read_text().split("## See it for your own scan")[1]
    messages = {
        "associations": "Associations",
        "attribute_scores": "AttributeScores",
        "evidence": "Evidence",
        "predictions": "Predictions",
    }
    checked = 0
    for line in re.findall(r"^\| \d[^|]*\|(.+)\|$", section, flags=re.M):
        topics, fields = line.split("|")
        names = [messages[topic] for topic in re.findall(r"`(\w+)`", topics)]
        text = [(ROOT / "msg_schemas" / "msg" / f"{name}.msg").read_text() for name in names]
        for field in re.findall(r"`(\w+)`", fields):
            assert any(re.search(rf"^\S+ {field}\b", t, flags=re.M) for t in text), field
            checked += 1
    assert checked > 15


def test_its_python_example_prints_the_pairs(scripts, case, capsys):
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), flags=re.S)
    scenario = scripts.case.load_scenario(scripts.case.SCENARIO)
    ring = scripts.case.make_rings(scenario)[scripts.case.CHAPTER]
    play = scripts.case.start({"": ring}, scenario, scripts.case.SEED, case.run)
    for detections in play.detections[: case.shown]:
        ring.process(detections)
    exec(code, {"ring": ring, "detections": play.detections[case.shown]})
    printed = capsys.readouterr().out.splitlines()
    assert printed[0] == "['VS', 'S', 'B', 'VS|S|B']"
    (own,) = [line for line in printed if line.startswith(f"track 1 detection {case.rows[0]}:")]
    p_k = case.table(scripts.case.CHAPTER, "associations", "p_kinematic")[0, 0]
    assert f"P_k {p_k:.3f}" in own
    assert own.endswith("chosen")


# --- the scan it shows ----------------------------------------------------------------------------


def test_the_scan_is_as_the_rule_says(scripts, case):
    kinematics, chapter, likelihood = (case.result(name) for name in scripts.case.METHODS)
    own = np.eye(2, dtype=bool)
    assert chapter.predictions.track_id.tolist() == [1, 2]
    assert case.play.truth[case.shown].target_id.tolist() == [1, 2]
    assert len(chapter.associations.hypothesis) == 4
    pairs = case.pairs()
    np.testing.assert_array_equal(kinematics.associations.chosen[pairs], ~own)
    np.testing.assert_array_equal(chapter.associations.chosen[pairs], own)
    np.testing.assert_array_equal(likelihood.associations.chosen[pairs], own)
    assert chapter.associations.p_kinematic[pairs[0, 0]] <= 1 / 3
    np.testing.assert_array_equal(
        chapter.associations.p_kinematic, kinematics.associations.p_kinematic
    )
    # On every scan before it all methods gave each track the detection of its own target.
    for results in case.results.values():
        for result, truth in zip(results[: case.shown], case.play.truth, strict=False):
            assert truth.source_id[result.tracks.detection_index].tolist() == [1, 2]
            assert result.tracks.detection_index.min() >= 0


def test_no_earlier_run_has_such_a_scan(scripts, case):
    with pytest.raises(RuntimeError, match="no scan in"):
        scripts.case.search(case.run, scripts.case.SEED)


def test_the_listed_hypotheses_add_up_to_what_the_ring_says(scripts, case):
    """The list of table 14.2 against the ring's own engine, which lists nothing."""
    weights = scripts.case.weights(case)
    columns = {
        "kinematics": case.table(scripts.case.CHAPTER, "associations", "p_kinematic"),
        "distances": 1.0 - case.table(scripts.case.CHAPTER, "associations", "p_attribute"),
        "likelihoods": case.table(scripts.case.LIKELIHOOD, "associations", "joint_marginal"),
    }
    for name, expected in columns.items():
        found = np.zeros((2, 2))
        for weight, hypothesis in zip(weights[name], scripts.case.HYPOTHESES, strict=True):
            for track, detection in enumerate(hypothesis):
                if detection:
                    found[track, detection - 1] += weight
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-15)


def test_the_steps_are_what_the_page_explains(scripts, case):
    """Grades, masses, classic rule and distance written out with dictionaries."""
    result, pairs = case.result(scripts.case.CHAPTER), case.pairs()
    frame = result.evidence.frame
    singletons = [parse_element(frame, name) for name in frame]
    before, scores = result.predictions, result.scores
    grades = case.rings[scripts.case.CHAPTER].fuzzifier.membership(result.scan.rcs_m2[case.rows])
    for track in (0, 1):
        history = dict(zip(before.focal.tolist(), before.masses[track], strict=True))
        for column in (0, 1):
            measured = dict(zip(singletons, grades[column] / grades[column].sum(), strict=True))
            candidate = dict.fromkeys(history, 0.0)
            for a, m_a in history.items():
                for b, m_b in measured.items():
                    candidate[a & b] = candidate.get(a & b, 0.0) + m_a * m_b
            pair = pairs[track, column]
            found = dict(zip(scores.focal.tolist(), scores.masses[pair], strict=True))
            for element, mass in candidate.items():
                assert found.get(element, 0.0) == pytest.approx(mass, abs=1e-14)
            change = [mass - history.get(element, 0.0) for element, mass in candidate.items()]
            assert scores.distance[pair] == pytest.approx(np.linalg.norm(change), rel=1e-9)
