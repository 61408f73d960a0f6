"""Sampling against enumeration, and its parts against sums over everything."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest
from xmap_references import random_covariance, random_scene

from gda_tracker.association.xmap.gibbs import Sampler, sample_chains
from gda_tracker.association.xmap.json_values import ProblemError
from gda_tracker.association.xmap.matching_sampler import (
    draw_conditional_bernoulli,
    draw_matching,
)
from gda_tracker.association.xmap.model import CountPrior
from gda_tracker.association.xmap.neighbours import explore, neighbours
from gda_tracker.association.xmap.partitions import enumerate_associations
from gda_tracker.association.xmap.problem import example, read_problem
from gda_tracker.association.xmap.solution import Sampling, is_among, solve
from gda_tracker.association.xmap.starts import drawn_starts, fitted_associations


def exact_matchings(log_weight, log_matched):
    """Probability of every row of partners, by enumeration."""
    n, m = log_weight.shape
    found = {}
    for partner in itertools.product(range(-1, n), repeat=m):
        pairs = [(i, j) for j, i in enumerate(partner) if i >= 0]
        if len({i for i, _ in pairs}) == len(pairs):
            total = log_matched[len(pairs)] + sum(log_weight[i, j] for i, j in pairs)
            found[partner] = total
    values = np.array(list(found.values()))
    share = np.exp(values - values.max())
    return dict(zip(found, share / share.sum(), strict=True))


def agree(counts, exact, draws):
    """Frequencies within five standard deviations of the probabilities."""
    assert set(counts) <= {key for key, p in exact.items() if p > 0}
    for key, p in exact.items():
        assert abs(counts.get(key, 0) - draws * p) < 5 * np.sqrt(draws * p * (1 - p)) + 3


@pytest.mark.parametrize("offset", [0.0, -400.0, 400.0])
def test_matchings_are_drawn_with_their_probability(offset):
    rng = np.random.default_rng(1)
    weight = rng.normal(size=(3, 3)) * 1.5
    weight[0, 1] = -np.inf
    # An offset that the number of pairs takes back changes nothing, but doubles overflow.
    matched = rng.normal(size=4) - offset * np.arange(4)
    exact = exact_matchings(weight + offset, matched)
    draws = 4000
    counts = {}
    for _ in range(draws):
        key = tuple(draw_matching(weight + offset, matched, rng).tolist())
        counts[key] = counts.get(key, 0) + 1
    agree(counts, exact, draws)


def test_matchings_beyond_the_range_of_doubles():
    """Both want the same object, and the loser's other choice is 800 orders of e worse."""
    rng = np.random.default_rng(2)
    weight = np.array([[0.0, 0.0], [-800.0, -801.0]])
    matched = np.array([-np.inf, -np.inf, 0.0])  # both must be matched
    exact = exact_matchings(weight, matched)
    counts = {}
    for _ in range(1500):
        key = tuple(draw_matching(weight, matched, rng).tolist())
        counts[key] = counts.get(key, 0) + 1
    agree(counts, exact, 1500)


def test_conditional_bernoulli():
    rng = np.random.default_rng(3)
    odds, number = np.log([0.5, 2.0, 1.0]), np.log([1.0, 3.0, 0.5, 2.0])
    exact = {}
    for flags in itertools.product((False, True), repeat=3):
        exact[flags] = np.exp(number[sum(flags)] + sum(odds[list(flags)]))
    total = sum(exact.values())
    exact = {key: value / total for key, value in exact.items()}
    counts = {}
    for _ in range(4000):
        key = tuple(draw_conditional_bernoulli(odds, number, rng).tolist())
        counts[key] = counts.get(key, 0) + 1
    agree(counts, exact, 4000)


def test_too_many_measurements_for_a_block_are_refused():
    with pytest.raises(ValueError, match="m = 13: allowed"):
        draw_matching(np.zeros((1, 13)), np.zeros(14), np.random.default_rng(0))


CASES = {
    "poisson, diffuse biases": (CountPrior("poisson", 3.0), [None] * 3, [0.0, 0.0, 0.0]),
    "false alarms, unbiased": (
        CountPrior("diffuse"),
        [np.zeros((2, 2))] * 3,
        [1.0, 0.5, 2.0],
    ),
    "log-diffuse, false alarms, mixed": (
        CountPrior("log_diffuse"),
        [np.eye(2) * 4.0, None, np.eye(2)],
        [0.5, 0.5, 0.0],
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_samples_have_the_exact_probabilities(case):
    """Not the scores, the samples themselves: every conditional is right."""
    prior, biases, false_alarms = CASES[case]
    rng = np.random.default_rng(len(case))
    model, data = random_scene(
        rng, (2, 1, 1), biases, spread=2.0, prior=prior, false_alarms=false_alarms
    )
    exact = solve(model, data)
    sweeps = 200
    start = enumerate_associations(model.sizes)[:1]
    samples = sample_chains(model, data, start, sweeps, seed=1)
    frequency = {}
    for row in samples.labels.tolist():
        frequency[tuple(row)] = frequency.get(tuple(row), 0) + 1
    total = len(samples.labels)
    for row, p in zip(exact.labels.tolist(), exact.probability, strict=True):
        # Neighbours are correlated: as if one sample in six were new.
        spread = np.sqrt(6.0 * p * (1 - p) / total)
        assert abs(frequency.get(tuple(row), 0) / total - p) < 4.5 * spread + 0.01


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("biased", [True, False])
def test_the_most_probable_and_the_pairs_are_those_of_enumeration(seed, biased):
    rng = np.random.default_rng(seed)
    biases = [None] * 3 if biased else [random_covariance(rng, 2, 1.0) for _ in range(3)]
    model, data = random_scene(rng, (3, 3, 2), biases, spread=5.0, false_alarms=[0.3, 0.0, 0.6])
    exact = solve(model, data)
    found = solve(model, data, "gibbs", Sampling(sweeps=25, seed=seed))
    assert found.method == "gibbs"
    np.testing.assert_array_equal(found.labels[0], exact.labels[0])
    np.testing.assert_allclose(found.pairs, exact.pairs, atol=0.01)
    assert found.probability.sum() == pytest.approx(found.covered)
    # What was visited, scored exactly, against what it is worth in truth.
    order = {tuple(row): p for row, p in zip(exact.labels.tolist(), exact.probability, strict=True)}
    truly = sum(order[tuple(row)] for row in found.labels.tolist())
    assert found.covered <= truly + 0.02
    np.testing.assert_allclose(found.bias.relative_mean, exact.bias.relative_mean, atol=0.05)


def test_the_example_by_samples():
    problem = read_problem(example("ferry_6_1"))
    exact = solve(problem.model, problem.data)
    found = solve(problem.model, problem.data, "gibbs", Sampling(sweeps=25))
    np.testing.assert_array_equal(found.labels[:3], exact.labels[:3])
    np.testing.assert_allclose(found.pairs, exact.pairs, atol=0.01)


@pytest.mark.slow
def test_four_sensors_of_twelve_objects():
    rng = np.random.default_rng(0)
    model, data = random_scene(rng, (12,) * 4, [None] * 4, spread=30.0)
    found = solve(model, data, sampling=Sampling(sweeps=15))
    assert found.method == "gibbs"
    assert found.covered > 0.5
    # The same from other random numbers: it is the scene that speaks.
    again = solve(model, data, sampling=Sampling(sweeps=15, seed=5))
    np.testing.assert_array_equal(again.labels[0], found.labels[0])
    np.testing.assert_allclose(again.pairs, found.pairs, atol=0.1)


def test_samples_repeat_with_the_seed():
    rng = np.random.default_rng(4)
    model, data = random_scene(rng, (3, 3), [None] * 2)
    first, second = (solve(model, data, "gibbs", Sampling(sweeps=5, seed=3)) for _ in range(2))
    np.testing.assert_array_equal(first.labels, second.labels)
    assert first.covered == second.covered


def test_the_density_of_large_problems_is_worked_out_on_the_way(monkeypatch):
    problem = read_problem(example("ferry_6_1"))
    with_table = Sampler(problem.model, problem.data)
    monkeypatch.setattr("gda_tracker.association.xmap.gibbs.LARGEST_DENSITY_TABLE", 0)
    without = Sampler(problem.model, problem.data)
    members = np.array([[0, 1, -1], [-1, -1, 0], [2, 2, 1]])
    np.testing.assert_allclose(with_table._density(members), without._density(members))


def test_rows_that_are_among_others():
    known = np.array([[0, 0, 1], [0, 1, 2]])
    asked = np.array([[0, 1, 2], [0, 1, 1], [0, 0, 1], [0, 1, 2]])
    assert is_among(asked, known).tolist() == [True, False, True, True]


def test_neighbours_are_one_move_or_one_swap_away():
    sensor = np.array([0, 0, 1, 1])
    found = neighbours(np.array([[0, 1, 0, 1]]), sensor)
    expected = {
        (0, 1, 2, 1),  # one of the first pair alone
        (0, 1, 0, 2),
        (0, 1, 1, 0),  # the two of a sensor change places
        (0, 1, 0, 1),  # moved to where it is
    }
    assert {tuple(row) for row in found.tolist()} == expected
    found = neighbours(np.array([[0, 1, 0, 2]]), sensor)
    assert (0, 1, 0, 1) in {tuple(row) for row in found.tolist()}


def test_exploration_from_one_association_finds_what_counts():
    rng = np.random.default_rng(6)
    model, data = random_scene(rng, (3, 3, 2), [np.eye(2)] * 3, spread=3.0)
    exact = solve(model, data)
    labels, weight = explore(model, data, np.arange(8)[None])
    assert len(np.unique(labels, axis=0)) == len(labels)
    order = {tuple(row): p for row, p in zip(exact.labels.tolist(), exact.probability, strict=True)}
    found = np.array([order[tuple(row)] for row in labels.tolist()])
    assert found.sum() > 0.99
    np.testing.assert_allclose(weight - weight.max(), np.log(found / found.max()), atol=1e-9)


def test_starts_find_a_large_relative_bias():
    rng = np.random.default_rng(5)
    model, data = random_scene(rng, (4, 4, 4), [None] * 3, spread=30.0)
    candidates = fitted_associations(model, data, rng)
    exact_best = solve(model, data, "gibbs", Sampling(sweeps=10)).labels[0]
    assert (candidates == exact_best).all(axis=1).any()
    weight = np.where((candidates == exact_best).all(axis=1), 0.0, -50.0)
    starts = drawn_starts(candidates, weight, 3, rng)
    assert (starts == exact_best).all()


def test_methods_and_sizes_that_are_refused():
    problem = read_problem(example("ferry_6_1"))
    with pytest.raises(ProblemError, match="method = 'exact': allowed are auto"):
        solve(problem.model, problem.data, "exact")
    many = json.loads(example("ferry_6_1"))
    many["sensors"][0]["measurements"] *= 400
    large = read_problem(json.dumps(many))
    with pytest.raises(ProblemError, match="1205 measurements: allowed are 1000"):
        solve(large.model, large.data)
