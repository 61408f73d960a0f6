"""Calibration: the right probabilities pass, wrong ones do not, and the simulation is the model."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.stats import kstest

from gda_tracker.association.xmap.partitions import enumerate_associations
from gda_tracker.association.xmap.problem import example, read_problem
from gda_tracker.association.xmap.scoring import structure_of
from gda_tracker.cli import main
from gda_tracker.evaluation import figures
from gda_tracker.evaluation.calibration import (
    BIAS_IGNORED,
    EDGES,
    JUMP_IGNORED,
    NOISE_IGNORED,
    calibrate_ferry,
    tally_of,
)
from gda_tracker.evaluation.calibration_report import (
    PUBLISHED_CORRECT,
    PUBLISHED_TOTAL,
    format_tables,
    from_published,
    verdict,
)
from gda_tracker.parameters import ParameterError
from gda_tracker.simulation.cross_sensor import (
    FERRY_6_2,
    association_prior,
    expected_objects_by_type,
    simulate_scenes,
)

RUNS = 600


@pytest.fixture(scope="module")
def model():
    return read_problem(example("ferry_6_1")).model


@pytest.fixture(scope="module")
def scenes(model):
    labels = enumerate_associations(model.sizes)
    structure = structure_of(model, labels)
    rng = np.random.default_rng(1)
    return labels, structure, simulate_scenes(model, labels, structure, FERRY_6_2, 3000, rng)


@pytest.fixture(scope="module")
def exact():
    return calibrate_ferry(RUNS, seed=1)


def test_expected_objects_by_type_as_printed(model, scenes):
    labels, structure, _ = scenes
    expected = expected_objects_by_type(model, structure)
    np.testing.assert_allclose(expected, [0.765169, 0.763363, 0.795727, 0.849989], atol=5.1e-7)
    assert association_prior(model, structure).sum() == pytest.approx(1.0)


def test_the_exact_probabilities_pass(exact):
    passed, words = verdict(exact)
    assert passed, words
    assert words.startswith("calibrated: ")
    total, correct = from_published(exact)
    assert np.abs(total).max() < 4.0
    assert np.abs(correct).max() < 4.0


@pytest.mark.parametrize("variant", [NOISE_IGNORED, JUMP_IGNORED, BIAS_IGNORED])
def test_deliberately_wrong_variants_do_not(variant):
    passed, words = verdict(calibrate_ferry(RUNS, seed=1, variant=variant))
    assert not passed
    assert words.startswith("NOT calibrated: ")


def test_published_tables_add_up():
    assert PUBLISHED_TOTAL[:-1].sum() == 77_800_000
    assert PUBLISHED_CORRECT[:-1].sum() == 100_000


def test_tally_by_hand():
    share = np.array([[0.5, 5e-5], [0.3, 1.0 - 5e-5 - 5e-6], [0.2, 5e-6]])
    tally = tally_of(share, np.array([1, 1]))
    bins = {float(edge): k for k, edge in enumerate(EDGES)}
    assert tally.total.tolist()[bins[0.5]] == 1
    assert tally.total[bins[0.3]] == tally.correct[bins[0.3]] == 1
    assert tally.total[bins[0.0]] == 2
    assert tally.expected[bins[0.0]] == pytest.approx(5.5e-5)
    assert tally.variance[bins[0.2]] == pytest.approx(0.16)
    assert tally.correct[bins[0.999]] == 1
    assert tally.squares[bins[0.0]] == 4  # both in the second run
    assert tally.total[:-1].sum() == 6
    assert tally.correct[:-1].sum() == 2
    assert (tally.total[-1], tally.correct[-1]) == (2, 1)
    assert tally.expected[-1] == pytest.approx(1.5, abs=1e-4)
    assert tally.zeta[bins[0.5]] == pytest.approx(-1.0)


def test_few_associations_are_judged_as_poisson():
    # One of probability 1e-5 that came true: normal says 316 sigma, Poisson 4.3.
    tally = tally_of(np.array([[1e-5], [1.0 - 1e-5]]), np.array([0]))
    assert tally.zeta[0] > 300.0
    assert tally.deviation[0] == pytest.approx(4.265, abs=1e-3)
    assert tally.deviation[len(EDGES) - 2] == pytest.approx(-4.265, abs=1e-3)
    assert not np.any(tally.deviation[1 : len(EDGES) - 2])


def test_workers_change_nothing(monkeypatch):
    monkeypatch.setattr("gda_tracker.evaluation.calibration.CHUNK", 20)
    alone, together = (calibrate_ferry(50, 3, workers=workers) for workers in (1, 2))
    for name in ("total", "correct", "expected", "variance", "squares"):
        np.testing.assert_array_equal(getattr(alone, name), getattr(together, name))


def test_associations_are_drawn_from_their_prior(model, scenes):
    labels, structure, drawn = scenes
    prior = association_prior(model, structure)
    objects = labels.max(axis=1) + 1
    found = np.bincount(objects[drawn.truth], minlength=9) / len(drawn.truth)
    expected = np.bincount(objects, prior, minlength=9)
    spread = np.sqrt(expected * (1 - expected) / len(drawn.truth))
    assert np.all(np.abs(found - expected) <= 4.5 * spread + 1e-12)


def test_covariances_are_as_the_paper_draws_them(model):
    drawn = FERRY_6_2.draw(model.sensor_of, 4000, np.random.default_rng(2))
    for sensor in range(3):
        mine = drawn[model.sensor_of == sensor].reshape(-1, 2, 2)
        # E[e^x] = sqrt(gamma) for x normal of variance log gamma.
        mean = FERRY_6_2.baseline[sensor] * np.sqrt(FERRY_6_2.scale[sensor])
        error = mine.std(axis=0) / np.sqrt(len(mine))
        assert np.all(np.abs(mine.mean(axis=0) - mean) < 5 * error)


def test_positions_are_centred_and_spread_as_the_model_says(model, scenes):
    labels, _, drawn = scenes
    sensor = model.sensor_of
    for s in range(3):
        middle = drawn.data.positions[sensor == s].mean(axis=0)
        np.testing.assert_allclose(middle, 0.0, atol=1e-12)
    # Differences of two measurements of a sensor: 2 V_0 and their errors; whitened they are
    # standard normal.
    difference = drawn.data.positions[0] - drawn.data.positions[1]
    covariance = 2.0 * model.prior_covariance + drawn.data.covariances[:2].sum(axis=0)
    white = np.linalg.solve(np.linalg.cholesky(covariance), difference[..., None])
    assert kstest(white.reshape(-1), "norm").pvalue > 1e-4


def test_shares_of_missing_features(model, scenes):
    labels, structure, drawn = scenes
    feature, types = model.feature, model.types
    # Of single measurements of sensor 3: types given that it alone saw the object.
    alone = types.prior * types.detection[2] * (1 - types.detection[:2]).prod(axis=0)
    alone /= alone.sum()
    missing = 1 - feature.exists * feature.declared_if_present[2]
    missing -= (1 - feature.exists) * feature.declared_if_absent[2]
    rows = labels[drawn.truth]
    single = (rows == rows[:, [7]]).sum(axis=1) == 1
    share = np.isnan(drawn.data.features[7])[single]
    expected = float(alone @ missing)
    assert share.mean() == pytest.approx(
        expected, abs=5 * np.sqrt(expected * (1 - expected) / len(share))
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"runs": 0}, "runs = 0: allowed is an integer >= 1"),
        ({"runs": 1, "seed": -1}, "seed = -1"),
        ({"runs": 1, "workers": 0}, "workers = 0"),
        ({"runs": 1, "variant": "all"}, "variant = 'all': allowed are exact"),
    ],
)
def test_arguments_that_are_refused(arguments, words):
    with pytest.raises(ParameterError, match=words):
        calibrate_ferry(**arguments)


def test_the_command_writes_tables_picture_and_rows(tmp_path, capsys):
    plot, rows = tmp_path / "reliability.png", tmp_path / "rows.json"
    options = ["--runs", "60", "--workers", "1", "--plot", str(plot), "--json", str(rows)]
    assert main(["calibrate", "ferry", *options]) == 0
    out = capsys.readouterr().out
    assert "Table V" in out
    assert "Table VI" in out
    assert "calibrated: the largest deviation" in out
    assert plot.read_bytes().startswith(b"\x89PNG")
    content = json.loads(rows.read_text())
    assert content["calibrated"] is True
    assert sum(row["total"] for row in content["table_v"]) == 60 * 778
    assert content["table_vi"]["total"] == 60


def test_the_command_fails_where_the_probabilities_do(capsys):
    options = ["--runs", "200", "--workers", "1", "--variant", JUMP_IGNORED]
    assert main(["calibrate", "ferry", *options]) == 1
    assert "NOT calibrated" in capsys.readouterr().out


@pytest.mark.parametrize("option", ["--plot", "--json"])
def test_files_that_cannot_be_written_are_found_before_the_runs(option, tmp_path, capsys):
    for path, words in ((tmp_path, "is a folder"), (tmp_path / "no" / "f", "does not exist")):
        assert main(["calibrate", "ferry", option, str(path)]) == 2
        assert words in capsys.readouterr().err


def test_the_picture_has_a_point_per_bin(exact):
    figure = figures.reliability(exact, "title")
    above, below = figure.axes
    assert above.get_title(loc="left") == "title"
    (points,) = [line for line in below.lines if line.get_marker() == "o"]
    assert len(points.get_xdata()) == (exact.total[:-1] > 0).sum()
    assert "probability" in below.get_xlabel()
    assert len(format_tables(exact).splitlines()) == 3 + 17 + 3
