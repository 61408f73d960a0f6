"""``gda-tracker fuse``: a problem in, an answer out, every fault in one line."""

from __future__ import annotations

import doctest
import io
import json
import math
import re
import sys
from fractions import Fraction
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.cli import main
from gda_tracker.commands.fuse import example
from gda_tracker.evidence import calculator, problem

PLAIN = {
    "frame": ["A", "B", "C"],
    "model": {"empty": ["A&B"]},
    "sources": [{"A": 0.3, "A|B": 0.7}, {"B": 0.6, "A|B|C": 0.4}],
    "rule": "dsmh",
}
MISSING = object()


def changed(**fields):
    merged = {**PLAIN, **fields}
    return {key: value for key, value in merged.items() if value is not MISSING}


@pytest.fixture
def fuse(tmp_path, capsys):
    """Run the command on a problem (object, text or bytes): exit status, stdout, stderr."""

    def run(content, *options):
        text = content if isinstance(content, str | bytes) else json.dumps(content)
        path = tmp_path / "problem.json"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        status = main(["fuse", str(path), *options])
        shown = capsys.readouterr()
        return status, shown.out, shown.err

    return run


def solved(outcome):
    status, out, _ = outcome
    assert status == 0
    return json.loads(out)


def test_the_answer_of_the_plain_problem(fuse):
    status, out, err = fuse(PLAIN)
    assert (status, err) == (0, "")
    answer = json.loads(out)
    assert list(answer) == ["result", "conflict", "pignistic", "entropy_nats"]
    # A .3 * .4; A with B .18 -> A|B; A|B with B -> B .42; A|B .28 + .18.
    assert answer["result"] == pytest.approx({"A": 0.12, "B": 0.42, "A|B": 0.46})
    assert answer["conflict"] == pytest.approx(0.18)
    # Parts left: A, B, C, A&C, B&C. A has 2, A&C among them; half of A and of B is also in C.
    assert answer["pignistic"] == pytest.approx({"A": 0.35, "B": 0.65, "C": 0.5})
    parts = [0.06 + 0.115] * 2 + [0.21 + 0.115] * 2
    assert answer["entropy_nats"] == pytest.approx(-sum(p * math.log(p) for p in parts))


@pytest.mark.parametrize("rule", problem.RULES)
def test_the_example_of_each_rule_is_solved_as_it_stands(rule, capsys, monkeypatch):
    assert main(["fuse", "--example", rule]) == 0
    printed = capsys.readouterr().out
    assert json.loads(printed) == example(rule)
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(printed.encode())))
    assert main(["fuse", "-"]) == 0
    shown = capsys.readouterr()
    assert shown.err == ""
    answer = json.loads(shown.out)
    if rule != "pignistic":
        assert math.fsum(answer["result"].values()) == pytest.approx(1.0, abs=1e-15)


def test_the_example_without_a_rule(capsys):
    assert main(["fuse", "--example"]) == 0
    assert json.loads(capsys.readouterr().out)["rule"] == "dsmh"


def test_all_digits_are_printed(fuse):
    third = 1 / 3
    sources = [{"A": third, "A|B": 1 - third}, {"B": 0.1 + 0.2, "A|B|C": 1 - (0.1 + 0.2)}]
    text = json.dumps(changed(sources=sources, rule="dsmc"))
    result = solved(fuse(text))["result"]
    (direct,) = calculator.solve(problem.read_problem(text))
    assert result == direct.result  # not a bit is lost on the way
    exact = Fraction(third) * Fraction(0.1 + 0.2)
    assert result["A&B"] == float(exact)


def test_total_conflict_is_status_3(fuse):
    apart = changed(sources=[{"A": 1}, {"B": 1}], rule="dempster")
    status, out, err = fuse(apart)
    assert (status, json.loads(out), err) == (3, {"undefined": "total conflict"}, "")


def test_almost_total_conflict_is_not(fuse):
    tiny = 1e-200
    sources = [{"A": 1 - tiny, "C": tiny}, {"B": 1 - tiny, "C": tiny}]
    answer = solved(fuse(changed(model="shafer", sources=sources, rule="dempster")))
    assert answer["result"] == {"C": 1.0}
    assert answer["entropy_nats"] == 0.0
    assert math.copysign(1.0, answer["entropy_nats"]) == 1.0


def test_pignistic_transforms_the_one_source(fuse):
    source = {"A": 0.5, "B|C": 0.2, "A|B|C": 0.3}
    answer = solved(fuse(changed(model="shafer", sources=[source], rule="pignistic")))
    assert answer["result"] == pytest.approx({"A": 0.6, "B": 0.2, "C": 0.2})
    assert answer["pignistic"] == answer["result"]
    assert answer["conflict"] == 0.0
    entropy = -0.6 * math.log(0.6) - 0.4 * math.log(0.2)
    assert answer["entropy_nats"] == pytest.approx(entropy)


def test_discount_takes_each_source_for_itself(fuse):
    sources = [{"A": 1.0}, {"B": 0.5, "A|B|C": 0.5}]
    answers = solved(fuse(changed(sources=sources, rule="discount", reliability=0.75)))
    assert [answer["result"] for answer in answers] == [
        {"A": 0.75, "A|B|C": 0.25},
        {"B": 0.375, "A|B|C": 0.625},
    ]
    one = solved(fuse(changed(sources=sources[:1], rule="discount", reliability=0.75)))
    assert one == answers[0]


def test_elements_that_the_model_merges_are_one_in_the_result(fuse):
    # A is empty: A|B is B, and A|B|C is B|C.
    merging = {"B": 0.1, "A|B": 0.2, "B|C": 0.3, "A|B|C": 0.4}
    plain = changed(model={"empty": ["A", "B&C"]}, sources=[merging], rule="discount")
    result = solved(fuse({**plain, "reliability": 0.5}))["result"]
    assert result == pytest.approx({"B": 0.15, "B|C": 0.85})
    result = solved(fuse({**plain, "rule": "dsmh", "sources": [merging, {"A|B|C": 1}]}))["result"]
    assert result == pytest.approx({"B": 0.3, "B|C": 0.7})


def test_mass_of_an_element_that_the_model_empties(fuse):
    source = {"A&B": 0.4, "C": 0.6}
    dead = changed(sources=[source], rule="pignistic")
    # As in the hybrid rule .4 goes to A|B: parts A, B, A&C, B&C; C has parts C, A&C, B&C.
    answer = solved(fuse(dead))
    assert answer["conflict"] == 0.4
    assert answer["result"] == pytest.approx({"A": 0.4, "B": 0.4, "C": 0.8})
    # Discounting leaves it where it is, under its name on the free model.
    answer = solved(fuse({**dead, "rule": "discount", "reliability": 0.5}))
    assert answer["result"] == pytest.approx({"A&B": 0.2, "C": 0.3, "A|B|C": 0.5})
    # Two such sources: the hybrid rule has a place for the product, the disjunctive has none.
    both = changed(sources=[source, source])
    assert solved(fuse(both))["result"]["A|B"] == pytest.approx(0.16)
    status, out, err = fuse({**both, "rule": "disjunctive"})
    assert (status, out) == (2, "")
    assert "A&B" in err
    assert err.count("\n") == 1


def test_dsmc_stands_on_the_free_model(fuse):
    answer = solved(fuse(changed(rule="dsmc")))
    assert answer["result"] == pytest.approx({"A": 0.12, "B": 0.42, "A&B": 0.18, "A|B": 0.28})
    assert answer["conflict"] == pytest.approx(0.18)
    # The decision is on the problem's model all the same: as the hybrid rule's here.
    assert answer["pignistic"] == solved(fuse(PLAIN))["pignistic"]


@pytest.mark.parametrize("empty", [[], ["A&B", "A&C", "B&C"]])
def test_models_by_name(fuse, empty):
    name = "shafer" if empty else "free"
    assert solved(fuse(changed(model=name))) == solved(fuse(changed(model={"empty": empty})))


def test_without_a_model_it_is_the_free_one_and_said_so(fuse):
    status, out, err = fuse(changed(model=MISSING, rule="dempster"))
    assert status == 0
    assert json.loads(out) == solved(fuse(changed(model="free", rule="dempster")))
    assert "no model" in err
    assert err.count("\n") == 1


def test_a_reliability_that_is_not_used_is_said(fuse):
    status, out, err = fuse(changed(reliability=0.85))
    assert status == 0
    assert json.loads(out) == solved(fuse(PLAIN))
    assert "reliability" in err


def test_elements_by_any_spelling(fuse):
    spelt = [{"A": 0.3, " B | A ": 0.7}, {"B": 0.6, "(A|B)|C": 0.4, "C&A": 0}]
    assert solved(fuse(changed(sources=spelt))) == solved(fuse(PLAIN))


def test_sums_within_the_tolerance_are_taken_as_they_are(fuse):
    near = [{"A": 0.5, "A|B": 0.5 + 5e-10}, {"A|B|C": 1.0}]
    result = solved(fuse(changed(sources=near)))["result"]
    assert result == {"A": 0.5, "A|B": 0.5 + 5e-10}


def with_source(text):
    """A problem whose first source is this text of JSON."""
    return json.dumps(changed(sources=["SOURCE", {"B": 1}])).replace('"SOURCE"', text)


FAULTS = {
    "empty file": ("", "not JSON"),
    "not JSON": ("{frame: A}", "not JSON"),
    "not text": (b"\xff\xfe\x00", "not JSON"),
    "not an object": ([1], "allowed is an object with frame, model, sources"),
    "nested too deeply": ("[" * 100_000, "nested too deeply"),
    "number of too many digits": (with_source('{"A": %s}' % ("1" * 5000)), "not JSON"),
    "unknown key": (changed(rules="dsmc"), "'rules': unknown key; allowed are frame"),
    "key twice": ('{"frame": ["A"], "frame": ["A"]}', "'frame': stands twice"),
    "no frame": (changed(frame=MISSING), "frame: missing"),
    "no sources": (changed(sources=MISSING), "sources: missing"),
    "no rule": (changed(rule=MISSING), "rule: missing"),
    "frame of a wrong type": (changed(frame="ABC"), "frame = 'ABC': allowed is a list of names"),
    "name of a wrong type": (changed(frame=["A", 1]), "allowed is a list of names"),
    "empty frame": (changed(frame=[]), "allowed are 1 to 5 elements"),
    "frame too large": (changed(frame=list("ABCDEF")), "frame of 6 elements: allowed are 1 to 5"),
    "frame far too large": (changed(frame=list(map(str, range(10**4)))), "frame of 10000 elem"),
    "name twice": (changed(frame=["A", "A"]), "names that differ"),
    "name with an operator": (changed(frame=["A", "B&C"]), "'B&C': allowed is a name without"),
    "name with a line break": (changed(frame=["A", "B\nC"]), "'B\\nC'"),
    "unknown model": (changed(model="shaffer"), 'model = \'shaffer\': allowed are "free", "sha'),
    "model of a wrong type": (changed(model=None), "model = None: allowed are"),
    "unknown key of the model": (changed(model={"void": ["A&B"]}), "['void']: allowed are"),
    "more keys of the model": (changed(model={"empty": [], "x": 1}), "['empty', 'x']: allowed"),
    "no key of the model": (changed(model={}), "[]: allowed are"),
    "constraints of a wrong type": (changed(model={"empty": "A&B"}), "list of elements"),
    "constraint of a wrong type": (changed(model={"empty": [3]}), "list of elements"),
    "unknown element in the model": (changed(model={"empty": ["A&D"]}), "model.empty: element 'D'"),
    "everything empty": (changed(model={"empty": ["A|B|C"]}), "without any Venn part"),
    "unknown rule": (changed(rule="pcr7"), "rule = 'pcr7': allowed are dsmc, dsmh, dempster"),
    "rule of a wrong type": (changed(rule=["dsmc"]), "rule = ['dsmc']: allowed are"),
    "sources of a wrong type": (changed(sources={"A": 1}), "allowed is a list of objects"),
    "no source": (changed(sources=[]), "sources: 0 for rule dsmh; allowed are 2 or more"),
    "one source": (changed(sources=[{"A": 1}]), "sources: 1 for rule dsmh; allowed are 2 or more"),
    "pignistic of two": (changed(rule="pignistic"), "2 for rule pignistic; allowed are 1 source"),
    "discount of none": (
        changed(rule="discount", reliability=0.5, sources=[]),
        "0 for rule discount; allowed are 1 or more",
    ),
    "too many tuples": (
        changed(sources=[{"A": 0.5, "B": 0.25, "C": 0.25}] * 13),
        "1.59e+06 tuples of focal elements",
    ),
    "source of a wrong type": (with_source("[0.3, 0.7]"), "sources[0] = [0.3, 0.7]: allowed is an"),
    "source without mass": (with_source("{}"), "sources[0]: masses sum to 0"),
    "unknown element": (with_source('{"D": 1}'), "sources[0]: element 'D': unknown; allowed are"),
    "element cut short": (with_source('{"A|": 1}'), "element 'A|': a name is missing at the end"),
    "no element": (with_source('{"": 1}'), "element '': a name is missing"),
    "parentheses without end": (with_source('{"%s": 1}' % ("(" * 10**5)), "nested too deeply"),
    "element twice": (with_source('{"A|B": 0.5, "A|B": 0.5}'), "'A|B': stands twice"),
    "element twice, spelt otherwise": (
        with_source('{"A|B": 0.5, "B|A": 0.5}'),
        "sources[0]: 'B|A' is A|B, which has a mass already",
    ),
    "element twice, one without mass": (with_source('{"A|B": 1, "B|A": 0}'), "has a mass already"),
    "too little": (with_source('{"A": 0.3, "B": 0.6}'), "sources[0]: masses sum to 0.8999999"),
    "too little by 2e-9": (with_source('{"A": 0.999999998}'), "allowed is 1 within 1e-9"),
    "too much": (with_source('{"A": 0.9, "B": 0.6}'), "sources[0]: masses sum to 1.5"),
    "more than all": (with_source('{"A": 2}'), "sources[0]['A'] = 2: allowed is a mass from 0"),
    "negative": (with_source('{"A": -0.1, "B": 1.1}'), "sources[0]['A'] = -0.1: allowed is a mass"),
    "NaN": (with_source('{"A": NaN}'), "sources[0]['A'] = nan: allowed is a mass"),
    "infinite": (with_source('{"A": 1e999}'), "sources[0]['A'] = inf: allowed is a mass"),
    "text for a number": (with_source('{"A": "1"}'), "sources[0]['A'] = '1': allowed is a mass"),
    "bool for a number": (with_source('{"A": true}'), "sources[0]['A'] = True: allowed is a mass"),
    "null for a number": (with_source('{"A": null}'), "sources[0]['A'] = None: allowed is a mass"),
    "huge integer": (with_source('{"A": 1%s}' % ("0" * 400)), "allowed is a mass"),
    "reliability missing": (changed(rule="discount"), "reliability: missing, rule discount needs"),
    "reliability too large": (
        changed(rule="discount", reliability=1.5),
        "reliability = 1.5: allowed is a number from 0 to 1",
    ),
    "reliability too large, not used": (changed(reliability=-1), "reliability = -1: allowed is"),
    "reliability of a wrong type": (changed(reliability=True), "reliability = True: allowed is"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_one_line_and_status_2(fault, fuse):
    content, words = FAULTS[fault]
    status, out, err = fuse(content)
    assert (status, out) == (2, "")
    assert err.startswith("gda-tracker fuse: ")
    assert words in err
    assert err.count("\n") == 1
    assert len(err) < 300


def test_a_file_that_cannot_be_read(tmp_path, capsys):
    for path in (tmp_path / "none.json", tmp_path):
        assert main(["fuse", str(path)]) == 2
        shown = capsys.readouterr()
        assert f"{path}: cannot be read: " in shown.err
        assert shown.err.count("\n") == 1
        assert shown.out == ""


@pytest.mark.parametrize("arguments", [[], ["problem.json", "--example=dsmc"]])
def test_neither_or_both_of_problem_and_example(arguments, capsys):
    assert main(["fuse", *arguments]) == 2
    assert "either PROBLEM.json or --example" in capsys.readouterr().err


def test_help_teaches(capsys):
    with pytest.raises(SystemExit) as end:
        main(["fuse", "--help"])
    assert end.value.code == 0
    shown = capsys.readouterr().out
    assert all(rule in shown for rule in problem.RULES)
    for words in ("total conflict", "status 3", "1e-9", "gda-tracker fuse --example", "natural"):
        assert words in shown


def test_the_page_in_docs_is_true(fuse):
    page = Path(__file__).parents[2].joinpath("docs", "fuse.md").read_text(encoding="utf-8")
    asked, answered = re.findall(r"```json\n(.*?)```", page, flags=re.DOTALL)
    status, out, err = fuse(asked)
    assert (status, out, err) == (0, answered, "")
    result = solved(fuse({**json.loads(asked), "rule": "pcr5"}))["result"]
    assert result == pytest.approx({"meningitis": 0.486, "contusion": 0.486, "tumour": 0.028})
    rows = re.findall(r"^\| `(\w+)`(?:, `(\w+)`)? \| \d", page, flags=re.MULTILINE)
    assert [rule for row in rows for rule in row if rule] == list(problem.RULES)


@pytest.mark.parametrize("module", [problem, calculator])
def test_examples_in_docstrings(module):
    outcome = doctest.testmod(module)
    assert outcome.attempted > 0
    assert outcome.failed == 0


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from("AB|&("), inner, max_size=3)
    ),
    max_leaves=6,
)


@settings(deadline=None, max_examples=200)
@given(st.sampled_from([*PLAIN, "reliability"]), json_values, st.sampled_from(problem.RULES))
def test_whatever_stands_in_a_field_is_read_or_refused(key, value, rule):
    text = json.dumps({**PLAIN, "rule": rule, "reliability": 0.5, key: value})
    try:
        sources = problem.read_problem(text).sources
    except problem.ProblemError as error:
        outcome = str(error)
    else:
        outcome = "read"
        assert all(math.isclose(math.fsum(source.values()), 1.0) for source in sources)
    assert outcome
    assert "\n" not in outcome
