"""Bounds and parts that the choice of leaves relies on, against enumeration."""

import itertools
import math

import numpy as np
import pytest
from leaf_examples import chain_leaves, clusters_by_search, enumerate_hypotheses, random_leaves

from gda_tracker.association.leaf_probabilities import leaf_probabilities
from gda_tracker.association.leaves import fitting
from gda_tracker.association.leaves.outlook import last_affected, outlook
from gda_tracker.association.leaves.packing import pack
from gda_tracker.association.leaves.prices import price, with_prices
from gda_tracker.association.leaves.problem import check_leaves, usable_problem
from gda_tracker.association.leaves.stages import (
    batches,
    make_layout,
    make_stages,
    without_dominated,
)
from gda_tracker.association.leaves.sums import collapsed, log_sums


def one_cluster(seed, n_tracks=4, most_leaves=6):
    """(leaves, problem, stages) of the largest cluster, its tracks' ids."""
    random = np.random.default_rng(seed)
    leaves = random_leaves(random, n_tracks, most_leaves, window=3, per_scan=3)
    problem = usable_problem(check_leaves(*leaves, 0.0))
    largest = int(np.bincount(problem.cluster).argmax())
    stages = make_stages(problem, np.array([largest]), make_layout(problem))
    return leaves, problem, stages, clusters_by_search(*leaves[1:])[largest]


def masks(stages):
    """Detections of each leaf as a Python integer."""
    return [
        sum(int(word) << (64 * w) for w, word in enumerate(column))
        for column in stages.mask.T.tolist()
    ]


def choices(stages):
    """All (log weight, options) of a batch of one cluster."""
    own = masks(stages)
    steps = [
        range(first, first + count)
        for first, count in zip(stages.first[:, 0], stages.count[:, 0], strict=True)
    ]
    for options in itertools.product(*steps):
        if all(own[a] & own[b] == 0 for a, b in itertools.combinations(options, 2)):
            yield math.fsum(stages.log_score[list(options)]), options


@pytest.mark.parametrize("seed", range(30))
def test_stages_have_the_hypotheses_of_the_problem(seed):
    leaves, _, stages, tracks = one_cluster(seed)
    expected = [log_weight for log_weight, _ in enumerate_hypotheses(*leaves, tracks)]
    found = sorted((log_weight for log_weight, _ in choices(stages)), reverse=True)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("seed", range(30))
@pytest.mark.parametrize("k", [1, 3])
def test_dominated_leaves_are_not_among_the_k_best(seed, k):
    _, _, stages, _ = one_cluster(seed)
    fewer = without_dominated(stages, k)
    expected, found = (
        sorted((log_weight for log_weight, _ in choices(some)), reverse=True)[:k]
        for some in (stages, fewer)
    )
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_dominated_leaves_are_found():
    counts = []
    for seed in range(30):
        stages = one_cluster(seed)[2]
        counts.append(len(stages.leaf) - len(without_dominated(stages, 1).leaf))
    assert sum(counts) > 60


@pytest.mark.parametrize("seed", range(30))
def test_collapsed_leaves_weigh_the_same(seed):
    _, _, stages, _ = one_cluster(seed)
    united, union_of = collapsed(stages)
    weights, sums = ([log_weight for log_weight, _ in choices(some)] for some in (stages, united))
    assert len(sums) <= len(weights)
    assert np.logaddexp.reduce(sums) == pytest.approx(np.logaddexp.reduce(weights), abs=1e-10)
    np.testing.assert_array_equal(stages.mask, united.mask[:, union_of])
    np.testing.assert_array_equal(stages.step, united.step[union_of])


@pytest.mark.parametrize("seed", range(30))
def test_prices_bound_every_hypothesis_and_tighten(seed):
    _, problem, stages, _ = one_cluster(seed)
    best = max(log_weight for log_weight, _ in choices(stages))
    prices, bound = price(stages, problem, best, 100)
    assert (prices >= 0.0).all()
    total = stages.top().sum()
    assert best - 1e-9 <= bound <= total + 1e-9
    if total > best + 1e-6:
        assert bound < total
    # Every hypothesis: the bound, less its deficit, less the price of what it leaves unused.
    priced = with_prices(stages, problem, prices, np.inf)
    costs = {64 * word + bit: cost for closing in priced.closing for word, bit, cost in closing}
    own, top = masks(priced.stages), priced.stages.top()[:, 0]
    for _, options in choices(priced.stages):
        reduced = priced.stages.log_score[list(options)]
        used = sum(own[o] for o in options)
        unused = sum(cost for bit, cost in costs.items() if not used >> bit & 1)
        expected = stages.log_score[priced.order[list(options)]].sum()
        found = bound - (top - reduced).sum() - unused - priced.unused
        assert found == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("seed", range(30))
def test_integer_programming_finds_the_best(seed):
    _, problem, stages, _ = one_cluster(seed)
    best, options = max(choices(stages))
    found = pack(stages, problem, 1000)
    assert found.options.tolist() == list(options)
    assert stages.log_score[found.options].sum() == pytest.approx(best, abs=1e-9)
    assert found.bound == pytest.approx(best, abs=1e-9)


def test_integer_programming_knows_that_there_is_no_hypothesis():
    problem = usable_problem(check_leaves([1.0, 2.0], [1, 2], [[7], [7]], 0.0))
    found = pack(make_stages(problem, np.array([0]), make_layout(problem)), problem, 1000)
    assert found.options is None
    assert found.bound == -np.inf


@pytest.mark.parametrize("dense", [1, 12, 10**9], ids=["matrices", "both", "pair by pair"])
def test_fitting_leaves_share_no_detection(monkeypatch, dense):
    """Of clusters of several sizes, large and small ones in any order, some of them done."""
    monkeypatch.setattr(fitting, "DENSE", dense)
    random = np.random.default_rng(5)
    for _ in range(20):
        leaves = random_leaves(random, 14, 7, window=2, per_scan=9)
        problem = usable_problem(check_leaves(*leaves, 0.0))
        stages = make_stages(problem, np.arange(problem.n_clusters), make_layout(problem))
        own = masks(stages)
        for step in range(stages.n_steps + 1):
            slot = np.sort(random.integers(0, problem.n_clusters, 12))
            bits = random.integers(0, 2**16, (1, 12)).astype(np.uint64)
            if step == stages.n_steps:
                slot, bits = slot[:0], bits[:, :0]
            expected = [
                (row, leaf)
                for row in range(len(slot))
                for leaf in np.flatnonzero((stages.step == step) & (stages.slot == slot[row]))
                if own[leaf] & int(bits[0, row]) == 0
            ]
            found = fitting.fitting_leaves(stages, min(step, stages.n_steps - 1), slot, bits)
            assert list(zip(*(part.tolist() for part in found), strict=True)) == expected


def test_fitting_leaves_of_many_words(monkeypatch):
    leaves = chain_leaves(np.random.default_rng(1), 30)
    found = []
    for dense in (1, 10**9):
        monkeypatch.setattr(fitting, "DENSE", dense)
        found.append(leaf_probabilities(*leaves).probability)
    np.testing.assert_array_equal(*found)


@pytest.mark.parametrize("many", [1, 10**9], ids=["equal ones once", "one by one"])
@pytest.mark.parametrize("seed", range(30))
def test_outlook_is_the_sum_of_the_best_leaves_that_fit(monkeypatch, seed, many):
    monkeypatch.setattr("gda_tracker.association.leaves.outlook.MANY", many)
    monkeypatch.setattr("gda_tracker.association.leaves.outlook.FIRST_BLOCK", 1 + seed % 3)
    _, _, stages, _ = one_cluster(seed)
    own, last = masks(stages), last_affected(stages)
    gain = -(stages.top()[stages.step, stages.slot] - stages.log_score)
    for step in range(stages.n_steps):
        used = (stages.mask[:, stages.step <= step]) & stages.open_after[:, step]
        found = outlook(stages, gain, step, last[step], np.zeros(used.shape[1], dtype=int), used)
        for mask, value in zip(used[0].tolist(), found, strict=True):
            expected = 0.0
            for later in range(step + 1, stages.n_steps):
                fitting = [
                    gain[o] for o in (stages.step == later).nonzero()[0] if own[o] & mask == 0
                ]
                expected += max(fitting, default=-np.inf)
            assert value == pytest.approx(expected, abs=1e-12)


def test_log_sums_of_segments():
    values = np.array([0.0, 0.0, -np.inf, -np.inf, -2000.0, 700.0, 800.0])
    found = log_sums(values, np.array([0, 2, 4, 5]))
    np.testing.assert_allclose(found, [np.log(2.0), -np.inf, -2000.0, 800.0], rtol=1e-15)


def test_clusters_of_more_than_a_word_are_laid_out_alone():
    n = 40
    track = np.repeat(np.arange(n + 2), 2)
    used = np.full((len(track), 2), -1)
    used[::2, 0] = np.arange(n + 2)
    used[1::2, 1] = 1000
    used[-4:, 1] = [2000, 2001, 2000, 2001]
    used[:-4, 0] = np.repeat(np.arange(n), 2) // 2
    problem = usable_problem(check_leaves(np.zeros(len(track)), track, used, 0.0))
    layout = make_layout(problem)
    assert layout.n_bits.tolist() == [n // 2 + 1, 2]
    assert [b.tolist() for b in batches(layout, np.arange(2))] == [[0, 1]]
    wide = layout.n_bits.copy()
    wide[0] = 65
    alone = batches(type(layout)(layout.rank, layout.bit, wide), np.arange(2))
    assert [b.tolist() for b in alone] == [[1], [0]]
