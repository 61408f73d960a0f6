"""``gda-tracker associate``: a problem in, an answer out, every fault in one line."""

from __future__ import annotations

import copy
import io
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from gda_tracker.association.xmap.problem import example, read_problem
from gda_tracker.association.xmap.solution import solve
from gda_tracker.cli import main

EXAMPLE = json.loads(example("ferry_6_1"))
PLAIN = {
    "sensors": [
        {
            "measurements": [
                {"position": [0.0, 0.0], "covariance": [[1.0, 0.0], [0.0, 1.0]]},
                {"position": [5.0, 1.0], "covariance": [[1.0, 0.2], [0.2, 1.0]]},
            ],
            "bias_covariance": [[0.0, 0.0], [0.0, 0.0]],
            "detection_probability": 0.9,
            "expected_false_alarms": 0.4,
        },
        {
            "measurements": [{"position": [3.0, 3.2], "covariance": [[1.0, 0.0], [0.0, 1.0]]}],
            "bias_covariance": [[9.0, 0.0], [0.0, 9.0]],
            "detection_probability": 0.8,
        },
    ],
    "prior": {"kind": "poisson", "mean": 2.0},
    "prior_covariance": [[25.0, 0.0], [0.0, 25.0]],
}
MISSING = object()


def changed(path, value, base=PLAIN):
    """The problem with one value exchanged, or taken away; path as sensors.0.bias_covariance."""
    problem = copy.deepcopy(base)
    *parents, last = [int(key) if key.isdigit() else key for key in path.split(".")]
    place = problem
    for key in parents:
        place = place[key]
    if value is MISSING:
        del place[last]
    else:
        place[last] = value
    return problem


@pytest.fixture
def associate(tmp_path, capsys):
    """Run the command on a problem (object, text or bytes): exit status, stdout, stderr."""

    def run(content, *options):
        text = content if isinstance(content, str | bytes) else json.dumps(content)
        path = tmp_path / "problem.json"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        status = main(["associate", str(path), *options])
        shown = capsys.readouterr()
        return status, shown.out, shown.err

    return run


def solved(outcome):
    status, out, _ = outcome
    assert status == 0
    return json.loads(out)


def test_the_example_is_solved_as_it_stands(capsys, monkeypatch):
    assert main(["associate", "--example"]) == 0
    printed = capsys.readouterr().out
    assert json.loads(printed) == EXAMPLE
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(printed.encode())))
    assert main(["associate", "-", "--top", "1"]) == 0
    answer = json.loads(capsys.readouterr().out)
    (best,) = answer["associations"]
    assert best["objects"] == [[0, 0, None], [1, 1, 0], [2, 2, 1]]
    assert best["probability"] == pytest.approx(0.452373, abs=5e-7)
    assert answer["covered"] == 1.0
    assert answer["bias"] == [None] * 3  # all diffuse: a common shift is unknown
    assert answer["relative_bias"]["reference"] == 2
    assert answer["relative_bias"]["sensors"][2]["mean"] == [0.0, 0.0]


def test_all_digits_are_printed(associate):
    answer = solved(associate(EXAMPLE, "--top", "1000"))
    problem = read_problem(json.dumps(EXAMPLE))
    solution = solve(problem.model, problem.data)
    shares = [entry["probability"] for entry in answer["associations"]]
    assert shares == solution.probability.tolist()
    assert len(shares) == 778
    assert sum(shares) == pytest.approx(1.0, abs=1e-12)
    for pair in answer["pairs"]:
        (s, i), (t, j) = pair["a"], pair["b"]
        total = sum(
            entry["probability"]
            for entry in answer["associations"]
            if any(row[s] == i and row[t] == j for row in entry["objects"])
        )
        assert pair["pair_probability"] == pytest.approx(total, abs=1e-12)
    assert len(answer["pairs"]) == 9 + 6 + 6


def test_a_plain_problem(associate):
    answer = solved(associate(PLAIN))
    assert len(answer["associations"]) == 3
    assert answer["bias"][0] == {"mean": [0.0, 0.0], "covariance": [[0.0, 0.0], [0.0, 0.0]]}
    assert 0.0 < answer["bias"][1]["covariance"][0][0] < 9.0  # something was learnt


def test_bias_mean_is_added_to_the_positions(associate):
    moved = copy.deepcopy(PLAIN)
    moved["sensors"][1]["measurements"][0]["position"] = [1.0, 1.2]
    moved["sensors"][1]["bias_mean"] = [2.0, 2.0]
    answer, plain = solved(associate(moved)), solved(associate(PLAIN))
    assert answer["pairs"] == plain["pairs"]
    # The posterior is of the whole bias.
    ours, theirs = answer["bias"][1], plain["bias"][1]
    assert ours["covariance"] == theirs["covariance"]
    np.testing.assert_allclose(ours["mean"], np.add(theirs["mean"], 2.0))


def test_a_sensor_without_measurements_is_a_sensor_that_missed(associate):
    silent = {"measurements": [], "bias_covariance": None, "detection_probability": 0.99}
    problem = changed("sensors", [*PLAIN["sensors"], silent])
    answer, plain = solved(associate(problem)), solved(associate(PLAIN))
    assert answer["bias"][2] is None
    # Objects that it does not see are rare, so pairs, which need fewer of them, gain.
    assert answer["pairs"][0]["pair_probability"] > plain["pairs"][0]["pair_probability"]


def test_a_prior_covariance_that_is_left_out_is_estimated(associate):
    answer = solved(associate(changed("prior_covariance", MISSING, EXAMPLE)))
    positions = [
        np.array([m["position"] for m in sensor["measurements"]]) for sensor in EXAMPLE["sensors"]
    ]
    scatter = sum((p - p.mean(axis=0)).T @ (p - p.mean(axis=0)) for p in positions)
    np.testing.assert_allclose(answer["prior_covariance"], scatter / (8 - 3))  # (3.16)


MEASUREMENT = "sensors.0.measurements.1"
FEATURE = "feature_model.sensors.1"
FAULTS = {
    "empty file": ("", "not JSON"),
    "not text": (b"\xff\xfe\x00", "not JSON"),
    "not an object": ([1], "problem = [1]: allowed is an object with sensors, prior"),
    "nested too deeply": ("[" * 100_000, "nested too deeply"),
    "key twice": ('{"prior": 1, "prior": 2}', "'prior': stands twice"),
    "unknown key": (changed("sensor", 1), "sensor: unknown key; allowed are sensors, prior"),
    "no prior": (changed("prior", MISSING), "prior: missing; needed are sensors, prior"),
    "one sensor": (changed("sensors", PLAIN["sensors"][:1]), "a list of 1; allowed are 2 or more"),
    "sensors of a wrong type": (changed("sensors", {}), "sensors = {}: allowed is a list of"),
    "no measurements": (
        changed("sensors", [{**s, "measurements": []} for s in PLAIN["sensors"]]),
        "sensors: no measurements; allowed is 1 or more in all",
    ),
    "unknown key of a sensor": (
        changed("sensors.1.pd", 1),
        "sensors[1].pd: unknown key; allowed are measurements",
    ),
    "position of a wrong length": (
        changed(f"{MEASUREMENT}.position", [1.0]),
        "sensors[0].measurements[1].position: a list of 1; allowed is a list of 2 numbers",
    ),
    "position of a wrong type": (
        changed(f"{MEASUREMENT}.position", [1.0, "a"]),
        "sensors[0].measurements[1].position[1] = 'a': allowed is a number",
    ),
    "NaN": (
        json.dumps(changed(f"{MEASUREMENT}.position", [1.0, 0.5])).replace("0.5", "NaN"),
        "sensors[0].measurements[1].position[1] = nan: allowed is a number",
    ),
    "covariance not definite": (
        changed(f"{MEASUREMENT}.covariance", [[1.0, 2.0], [2.0, 1.0]]),
        "sensors[0].measurements[1].covariance = [[1.0, 2.0], [2.0, 1.0]]: allowed is a sym",
    ),
    "covariance not symmetric": (
        changed(f"{MEASUREMENT}.covariance", [[1.0, 0.1], [0.2, 1.0]]),
        "allowed is a symmetric, positive definite matrix",
    ),
    "bias not definite": (
        changed("sensors.0.bias_covariance", [[1.0, 0.0], [0.0, 0.0]]),
        "sensors[0].bias_covariance = [[1.0, 0.0], [0.0, 0.0]]: allowed is a symmetric, positive "
        "definite matrix, zeros (none) or null (diffuse)",
    ),
    "certain detection": (
        changed("sensors.1.detection_probability", 1.0),
        "sensors[1].detection_probability = 1.0: allowed is a number > 0 and < 1",
    ),
    "detection per type without types": (
        changed("sensors.1.detection_probability", {"a": 0.5}),
        "sensors[1].detection_probability = {'a': 0.5}: allowed is a number",
    ),
    "negative false alarms": (
        changed("sensors.0.expected_false_alarms", -1),
        "sensors[0].expected_false_alarms = -1: allowed is a number >= 0",
    ),
    "unknown prior": (
        changed("prior", {"kind": "flat"}),
        "prior.kind = 'flat': allowed are poisson, diffuse, log_diffuse",
    ),
    "poisson without mean": (changed("prior", {"kind": "poisson"}), "prior.mean: missing"),
    "mean of zero": (changed("prior.mean", 0), "prior.mean = 0: allowed is a number > 0"),
    "mean of a diffuse prior": (
        changed("prior.mean", 2, EXAMPLE),
        "prior.mean = 2: allowed only with kind poisson",
    ),
    "type call without types": (
        changed(f"{MEASUREMENT}.type_call", "a"),
        "sensors[0].measurements[1].type_call = 'a': allowed only for a sensor with a matrix",
    ),
    "feature without model": (
        changed(f"{MEASUREMENT}.feature", 1),
        "sensors[0].measurements[1].feature = 1: allowed only for a sensor with a model",
    ),
    "unknown type call": (
        changed(f"{MEASUREMENT}.type_call", "circle", EXAMPLE),
        "type_call = 'circle': allowed are square, diamond, triangle, inverted_triangle, unknown",
    ),
    "no type call": (
        changed(f"{MEASUREMENT}.type_call", MISSING, EXAMPLE),
        "sensors[0].measurements[1].type_call: missing; allowed are square",
    ),
    "no feature": (
        changed(f"{MEASUREMENT}.feature", MISSING, EXAMPLE),
        "sensors[0].measurements[1].feature: missing; allowed is a number or null",
    ),
    "feature of a wrong type": (
        changed(f"{MEASUREMENT}.feature", "1", EXAMPLE),
        "sensors[0].measurements[1].feature = '1': allowed is a number or null",
    ),
    "type prior that sums to less": (
        changed("types.prior.square", 0.05, EXAMPLE),
        "types.prior: probabilities sum to 0.95",
    ),
    "confusion row that sums to less": (
        changed("types.confusion.2.square.square", 0.5, EXAMPLE),
        "types.confusion[2].square: probabilities sum to 0.55",
    ),
    "a matrix is missing": (
        changed("types.confusion", EXAMPLE["types"]["confusion"][:2], EXAMPLE),
        "types.confusion: a list of 2; allowed is a list of 3 confusion matrices or null",
    ),
    "a type is missing": (
        changed("types.confusion.1.square", MISSING, EXAMPLE),
        "types.confusion[1].square: missing",
    ),
    "an unseen type alone": (
        changed(
            "sensors.0.detection_probability", dict.fromkeys(EXAMPLE["types"]["prior"], 0), EXAMPLE
        ),
        "sensors[0].detection_probability: no object can be seen by this sensor alone",
    ),
    "unknown kind of feature": (
        changed("feature_model.kind", "uniform", EXAMPLE),
        "feature_model.kind = 'uniform': allowed are gaussian, von_mises",
    ),
    "gaussian without prior": (
        changed("feature_model.kind", "gaussian", EXAMPLE),
        "feature_model.prior_mean: missing",
    ),
    "std of zero": (
        changed(f"{FEATURE}.std", 0, EXAMPLE),
        "feature_model.sensors[1].std = 0: allowed is a number > 0",
    ),
    "jump above one": (
        changed(f"{FEATURE}.jump_probability.diamond", 1.5, EXAMPLE),
        "feature_model.sensors[1].jump_probability.diamond = 1.5: allowed is a number from 0 to 1",
    ),
    "absent without present": (
        changed(f"{FEATURE}.declared_if_present", MISSING, EXAMPLE),
        "feature_model.sensors[1].declared_if_absent = ",
    ),
    "impossible call": (
        changed(
            "types.confusion.0",
            {
                name: {"diamond": 0.5, "unknown": 0.5, "triangle": 0.0}
                for name in EXAMPLE["types"]["prior"]
            },
            EXAMPLE,
        ),
        "no association is possible: a measurement has a type call or feature that the model",
    ),
    "too few to estimate": (
        changed("prior_covariance", None),
        "prior_covariance: missing, and 3 positions of 2 sensors are too few",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_one_line_and_status_2(fault, associate):
    content, words = FAULTS[fault]
    status, out, err = associate(content)
    assert (status, out) == (2, "")
    assert err.startswith("gda-tracker associate: ")
    assert words in err
    assert err.count("\n") == 1
    assert len(err) < 400


@pytest.mark.parametrize("arguments", [[], ["problem.json", "--example"]])
def test_neither_or_both_of_problem_and_example(arguments, capsys):
    assert main(["associate", *arguments]) == 2
    assert "either PROBLEM.json or --example" in capsys.readouterr().err


@pytest.mark.parametrize("option", ["--top=-1", "--sweeps=0", "--seed=-1"])
def test_options_out_of_range(option, associate):
    status, _, err = associate(PLAIN, option)
    assert status == 2
    assert "allowed is an integer >= " in err


def test_enumeration_that_is_too_large_is_refused(associate):
    many = [
        {"position": [float(i), float(i * i)], "covariance": [[1.0, 0.0], [0.0, 1.0]]}
        for i in range(12)
    ]
    sensors = [{**sensor, "measurements": many} for sensor in PLAIN["sensors"]]
    status, _, err = associate(changed("sensors", sensors), "--method", "enumeration")
    assert status == 2
    assert "method = 'enumeration': " in err
    assert "allowed are 1000000" in err


def test_a_file_that_cannot_be_read(tmp_path, capsys):
    assert main(["associate", str(tmp_path / "none.json")]) == 2
    assert "cannot be read" in capsys.readouterr().err


def test_the_page_in_docs_is_true(associate):
    page = Path(__file__).parents[2].joinpath("docs", "cross-sensor-association.md")
    asked, answered = re.findall(r"```json\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    answer, shown = solved(associate(asked, "--top", "2")), json.loads(answered)
    assert answer.keys() == shown.keys()
    for ours, theirs in zip(answer["associations"], shown["associations"], strict=True):
        assert ours["objects"] == theirs["objects"]
        assert ours["probability"] == pytest.approx(theirs["probability"], rel=1e-9)
    np.testing.assert_allclose(answer["bias"][1]["mean"], shown["bias"][1]["mean"], rtol=1e-9)


def test_help_names_the_whole_schema(capsys):
    with pytest.raises(SystemExit) as end:
        main(["associate", "--help"])
    assert end.value.code == 0
    shown = capsys.readouterr().out
    for key in (*PLAIN, *EXAMPLE, *PLAIN["sensors"][0], "bias_mean", "covered"):
        assert key in shown
