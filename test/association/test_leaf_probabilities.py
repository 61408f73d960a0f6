"""Marginal probabilities of leaves: against enumeration, and what any answer must satisfy."""

import doctest
import math

import numpy as np
import pytest
from leaf_examples import chain_leaves, enumerate_all, random_leaves

from gda_tracker.association import leaf_probabilities as module
from gda_tracker.association.errors import AssociationInputError, NoFeasibleHypothesis
from gda_tracker.association.global_hypotheses import (
    SearchLimits,
    best_global_hypothesis,
    k_best_global_hypotheses,
)
from gda_tracker.association.leaf_probabilities import leaf_probabilities


def draw(seed):
    random = np.random.default_rng(seed)
    return random_leaves(
        random,
        n_tracks=int(random.integers(1, 6)),
        most_leaves=5,
        window=int(random.integers(1, 4)),
        per_scan=int(random.integers(1, 6)),
        all_missed=bool(random.random() < 0.5),
    )


def by_enumeration(log_score, track, used):
    """Marginals (L,), probability of dropping by track, log partition by cluster."""
    marginals, dropped, log_partition = np.zeros(len(log_score)), {}, []
    for tracks, hypotheses in enumerate_all(log_score, track, used):
        best = hypotheses[0][0]
        weights = [math.exp(log_weight - best) for log_weight, _ in hypotheses]
        total = math.fsum(weights)
        log_partition.append(best + math.log(total))
        dropped |= dict.fromkeys(tracks, 0.0)
        for weight, (_, rows) in zip(weights, hypotheses, strict=True):
            for t, row in zip(tracks, rows, strict=True):
                if row is None:
                    dropped[t] += weight / total
                else:
                    marginals[row] += weight / total
    return marginals, [dropped[t] for t in sorted(dropped)], np.array(log_partition)


def check_sums(found, track):
    for t, dropped in zip(found.track, found.dropped, strict=True):
        # Where tracks are dropped, log weights near -1e6 have rounding errors of 1e-10.
        accuracy = 1e-12 if found.dropped.max() == 0.0 else 1e-8
        assert found.probability[track == t].sum() + dropped == pytest.approx(1.0, abs=accuracy)
    assert (found.probability >= 0.0).all()
    assert (found.probability <= 1.0 + 1e-8).all()


@pytest.mark.parametrize("seed", range(100))
def test_equal_to_enumeration(seed):
    log_score, track, used = draw(seed)
    marginals, dropped, log_partition = by_enumeration(log_score, track, used)
    found = leaf_probabilities(log_score, track, used)
    check_sums(found, track)
    assert found.exact.all()
    np.testing.assert_allclose(found.share, 1.0, rtol=0, atol=1e-12)
    # Where tracks are dropped, log weights near -1e6 have rounding errors of 1e-10.
    np.testing.assert_allclose(found.probability, marginals, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.dropped, dropped, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.log_partition, log_partition, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("seed", range(60))
@pytest.mark.parametrize("transitions", [1, 20])
def test_what_a_narrow_beam_covers_is_no_less_than_it_says(seed, transitions):
    log_score, track, used = draw(seed)
    marginals, _, log_partition = by_enumeration(log_score, track, used)
    found = leaf_probabilities(log_score, track, used, limits=SearchLimits(transitions=transitions))
    check_sums(found, track)
    covered = np.exp(found.log_partition - log_partition)
    assert (found.share <= covered + 1e-9).all()
    assert (covered <= 1.0 + 1e-9).all()
    # Marginals err by what is not covered at most.
    cluster = found.cluster[np.searchsorted(found.track, track)]
    error = np.abs(found.probability - marginals)
    assert (error <= (1.0 - covered)[cluster] + 1e-8).all()
    # The best hypothesis is among what is covered.
    best = best_global_hypothesis(log_score, track, used)
    assert (found.probability[best.chosen] > 0.0).all()


def test_a_narrow_beam_is_flagged_and_prices_widen_it():
    engines = set()
    for seed in range(30):
        found = leaf_probabilities(*draw(seed), limits=SearchLimits(transitions=10))
        engines |= set(zip(found.engine, found.exact.tolist(), strict=True))
    assert ("dynamic_programming", False) in engines
    assert ("dynamic_programming", True) in engines
    assert ("priced_dynamic_programming", False) in engines


@pytest.mark.parametrize("seed", [7, 8])
def test_prices_cover_more_of_a_dense_cluster(seed):
    random = np.random.default_rng(seed)
    leaves = random_leaves(random, 7, 15, window=4, per_scan=6, misses=0.1)
    exact = leaf_probabilities(*leaves)
    assert exact.exact.all()
    priced = leaf_probabilities(*leaves, limits=SearchLimits(transitions=300))
    plain = leaf_probabilities(*leaves, limits=SearchLimits(transitions=300, price_rounds=0))
    assert priced.engine == ("priced_dynamic_programming",)
    assert plain.engine == ("dynamic_programming",)
    assert 0.0 < plain.share[0] < priced.share[0] < 1.0
    for found in (priced, plain):
        covered = np.exp(found.log_partition - exact.log_partition)[0]
        assert found.share[0] <= covered <= 1.0
        assert np.abs(found.probability - exact.probability).max() <= 1.0 - covered + 1e-12


def test_a_long_chain_equals_sums_by_matrices():
    """Only neighbours compete: sums over pairs of them, forward and backward, are a check."""
    log_score, track, used = chain_leaves(np.random.default_rng(3), 50)
    rows = [(track == t).nonzero()[0] for t in range(50)]
    taken = [[set(used[r][used[r] >= 0].tolist()) for r in own] for own in rows]
    fits = [
        np.array([[not (a & b) for b in taken[t + 1]] for a in taken[t]], dtype=float)
        for t in range(49)
    ]
    weight = [np.exp(log_score[own] - log_score[own].max()) for own in rows]
    before = [weight[0] / weight[0].sum()]
    for t in range(49):
        ahead = (before[t] @ fits[t]) * weight[t + 1]
        before.append(ahead / ahead.sum())
    after = [np.ones(len(rows[-1]))]
    for t in range(48, -1, -1):
        behind = fits[t] @ (weight[t + 1] * after[0])
        after.insert(0, behind / behind.sum())
    found = leaf_probabilities(log_score, track, used)
    assert found.exact.tolist() == [True]
    for t in range(50):
        expected = before[t] * after[t]
        np.testing.assert_allclose(
            found.probability[rows[t]], expected / expected.sum(), rtol=0, atol=1e-12
        )


def test_k_best_hypotheses_explain_the_marginals():
    """Sums and search agree: all hypotheses of a cluster, listed and weighed."""
    random = np.random.default_rng(2)
    log_score, track, used = random_leaves(random, 4, 6, window=3, per_scan=4)
    expected = np.zeros(len(log_score))
    found = leaf_probabilities(log_score, track, used)
    for cluster in k_best_global_hypotheses(log_score, track, used, 10**4):
        weight = np.exp(cluster.log_weight - cluster.log_weight[0])
        np.add.at(expected, cluster.leaf, (weight / weight.sum())[:, None])
    np.testing.assert_allclose(found.probability, expected, rtol=0, atol=1e-12)


def test_spread_of_two_thousand():
    log_score = [0.0, -2000.0, 0.0, -2000.0 + math.log(3.0)]
    found = leaf_probabilities(log_score, [1, 1, 2, 2], [[5], [-1], [5], [-1]])
    np.testing.assert_allclose(found.probability, [0.75, 0.25, 0.25, 0.75], rtol=1e-9)
    assert found.log_partition[0] == pytest.approx(-2000.0 + math.log(4.0), rel=1e-12)


@pytest.mark.parametrize("offset", [-1e6, 1e6])
def test_a_common_factor_changes_nothing(offset):
    log_score, track, used = draw(4)
    found = leaf_probabilities(log_score, track, used)
    moved = leaf_probabilities(log_score + offset, track, used)
    np.testing.assert_allclose(moved.probability, found.probability, rtol=0, atol=1e-8)


@pytest.mark.parametrize("seed", range(20))
def test_order_of_the_leaves_does_not_matter(seed):
    log_score, track, used = draw(seed)
    order = np.random.default_rng(seed).permutation(len(track))
    found = leaf_probabilities(log_score, track, used)
    again = leaf_probabilities(log_score[order], track[order], used[order])
    np.testing.assert_allclose(again.probability, found.probability[order], rtol=0, atol=1e-9)


def test_the_best_hypothesis_may_be_given():
    for seed in range(20):
        leaves = draw(seed)
        best = best_global_hypothesis(*leaves)
        given = leaf_probabilities(*leaves, best=best)
        found = leaf_probabilities(*leaves)
        np.testing.assert_array_equal(given.probability, found.probability)
    with pytest.raises(AssociationInputError, match="best is of"):
        leaf_probabilities([1.0], [1], [[2]], best=best)


def test_dropped_tracks_have_a_probability():
    log_score, track, used = np.log([2.0, 3.0, 5.0]), [1, 2, 3], [[7], [7], [-1]]
    found = leaf_probabilities(log_score, track, used, log_dropped=0.0)
    # Weights: neither 1, the first 2, the second 3.
    np.testing.assert_allclose(found.probability, [2 / 6, 3 / 6, 1.0])
    np.testing.assert_allclose(found.dropped, [4 / 6, 3 / 6, 0.0])
    forbidden = leaf_probabilities([-np.inf, 0.0], [1, 2], [[-1], [-1]])
    assert forbidden.dropped.tolist() == [1.0, 0.0]
    assert forbidden.probability.tolist() == [0.0, 1.0]
    with pytest.raises(NoFeasibleHypothesis):
        leaf_probabilities(log_score, track, used, log_dropped=-np.inf)


def test_no_leaves():
    found = leaf_probabilities([], [], np.zeros((0, 3), dtype=int))
    assert found.probability.shape == (0,)
    assert found.engine == ()


def test_examples():
    result = doctest.testmod(module)
    assert result.attempted > 0
    assert result.failed == 0
