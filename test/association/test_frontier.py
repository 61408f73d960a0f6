from __future__ import annotations

import math
from decimal import Decimal, localcontext
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.association import frontier
from gda_tracker.association.elimination import find_elimination
from gda_tracker.association.frontier import frontier_marginals, layers_of
from gda_tracker.association.joint import joint_log_partition, joint_marginals

examples = settings(derandomize=True, deadline=None, max_examples=60)
clusters = st.tuples(
    st.integers(1, 9),
    st.integers(1, 9),
    st.sampled_from([1.0, 40.0, 2000.0]),
    st.sampled_from([0.0, 0.3, 0.7]),
    st.integers(0, 2**32),
)


def by_frontier(cluster, least_assigned=0):
    """Marginals (n, m), log partition and feasibility of one cluster."""
    log_weight, log_idle_track, log_idle_measurement = cluster
    n, m = log_weight.shape
    bordered = np.zeros((1, n + 1, m + 1))
    bordered[0, :n, :m], bordered[0, :n, m] = log_weight, log_idle_track
    bordered[0, n, :m] = log_idle_measurement
    place = np.nonzero(log_weight > -np.inf)
    order = find_elimination(*place, n, m, math.inf)
    found = frontier_marginals(order, *place, bordered, least_assigned)
    marginals = np.zeros((n, m))
    marginals[place] = found.marginals[0]
    return marginals, found.log_partition[0], found.feasible[0]


def partition_in_decimals(weight, track, measurement):
    """Sum over all joint hypotheses, track by track, exact to 60 digits."""
    n, m = len(track), len(measurement)
    ahead = [{j for i in range(k, n) for j in weight[i]} for k in range(n + 1)]

    @cache
    def go_on(k, used):
        # Measurements that no later track sees are settled as soon as that is so.
        if k == n:
            return Decimal(1)
        settled = [j for j in range(m) if j in ahead[k] and j not in ahead[k + 1]]
        total = Decimal(0)
        for j in (None, *weight[k]):
            if j in used:
                continue
            now = used | {j} if j is not None else used
            factor = track[k] if j is None else weight[k][j]
            for other in settled:
                if other not in now:
                    factor *= measurement[other]
            total += factor * go_on(k + 1, frozenset(now & ahead[k + 1]))
        return total

    unseen = math.prod((measurement[j] for j in range(m) if j not in ahead[0]), start=Decimal(1))
    return unseen * go_on(0, frozenset())


def marginals_in_decimals(cluster):
    """w_ij times the partition without i and j, over the partition: no forward or backward."""
    log_weight, log_track, log_measurement = cluster
    n, m = log_weight.shape
    with localcontext() as context:
        context.prec = 60
        weight = [
            {j: Decimal(log_weight[i, j]).exp() for j in range(m) if log_weight[i, j] > -np.inf}
            for i in range(n)
        ]
        track = [Decimal(x).exp() for x in log_track]
        measurement = [Decimal(x).exp() for x in log_measurement]
        total = partition_in_decimals(weight, track, measurement)
        found = np.zeros((n, m))
        for i in range(n):
            for j in weight[i]:
                # Without the two: the others' pairs with j go, and j itself weighs 1.
                others = [
                    {k: w for k, w in row.items() if k != j} for row in weight[:i] + weight[i + 1 :]
                ]
                alone = [*measurement]
                alone[j] = Decimal(1)
                rest = partition_in_decimals(others, track[:i] + track[i + 1 :], alone)
                found[i, j] = float(weight[i][j] * rest / total)
        return found, float(total.ln())


@examples
@given(clusters)
def test_equals_the_subset_engine(random_cluster, drawn):
    n, m, spread, zeros, seed = drawn
    cluster = random_cluster(np.random.default_rng(seed), n, m, spread)
    cluster[0][np.random.default_rng(seed).random((n, m)) < zeros] = -np.inf
    marginals, log_partition, feasible = by_frontier(cluster)
    assert feasible
    np.testing.assert_allclose(marginals, joint_marginals(*cluster), rtol=0, atol=1e-12)
    assert log_partition == pytest.approx(joint_log_partition(*cluster), rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("least_assigned", range(6))
def test_equals_brute_force_with_zero_weights_and_bounds(
    least_assigned, brute_force, random_cluster
):
    rng = np.random.default_rng([7, least_assigned])
    kinds = set()
    for n, m in ((1, 1), (1, 4), (4, 1), (2, 3), (3, 2), (4, 4), (3, 5), (5, 5)) * 4:
        cluster = random_cluster(rng, n, m, rng.choice([1.0, 30.0, 2000.0]), 0.35)
        expected = brute_force(*cluster, least_assigned=least_assigned)
        marginals, log_partition, feasible = by_frontier(cluster, least_assigned)
        kinds.add(bool(feasible))
        np.testing.assert_allclose(marginals, expected.marginals, rtol=0, atol=1e-12)
        if not expected.feasible:
            assert (log_partition, feasible) == (-np.inf, False)
        elif expected.log_partition - brute_force(*cluster).log_partition > -600.0:
            assert feasible
            assert log_partition == pytest.approx(expected.log_partition, rel=1e-12, abs=1e-12)
    assert kinds == {True, False}


@pytest.mark.parametrize("spread", [2.0, 2000.0])
@pytest.mark.parametrize(("n", "reach"), [(24, 2), (14, 4)])
def test_long_chains_equal_sixty_digit_arithmetic(n, reach, spread, chain):
    rng = np.random.default_rng([n, int(spread)])
    log_weight, r, c = chain(rng, n, reach, spread, shuffled=False)
    expected, log_partition = marginals_in_decimals((log_weight, r, c))
    rows, columns = rng.permutation(n), rng.permutation(n + reach - 1)
    found = by_frontier((log_weight[np.ix_(rows, columns)], r[rows], c[columns]))
    np.testing.assert_allclose(found[0], expected[np.ix_(rows, columns)], rtol=0, atol=1e-12)
    assert found[1] == pytest.approx(log_partition, rel=1e-13)


@pytest.mark.parametrize("least_assigned", [0, 1])
def test_a_chain_of_1500_neither_overflows_nor_underflows(chain, least_assigned):
    # All weights 1: some 1e600 hypotheses. In the middle of the chain both ends are forgotten.
    log_weight, r, c = chain(np.random.default_rng(1), 1500, 2, 0.0)
    marginals, log_partition, feasible = by_frontier((log_weight, r, c), least_assigned)
    assert feasible
    assert log_partition > 1400.0
    assert marginals.sum(axis=1).max() <= 1.0 + 1e-12
    # A path of matchings: an edge in the bulk has probability (1 - 1/sqrt 5)/2.
    middle = np.sort(marginals[log_weight > -np.inf])[1000:2000]
    np.testing.assert_allclose(middle, (1.0 - 1.0 / math.sqrt(5.0)) / 2.0, rtol=0, atol=1e-12)


def test_certain_detection_and_no_clutter(chain):
    log_weight, r, c = chain(np.random.default_rng(3), 13, 3, 4.0)
    none = np.full(13, -np.inf)
    marginals, _, _ = by_frontier((log_weight, none, c))
    np.testing.assert_allclose(marginals.sum(axis=1), 1.0, rtol=0, atol=1e-12)
    np.testing.assert_allclose(marginals, joint_marginals(log_weight, none, c), rtol=0, atol=1e-12)
    # No clutter and 15 measurements for 13 tracks: nothing is possible; for 15 tracks it is.
    silence = np.full(15, -np.inf)
    assert not by_frontier((log_weight, r, silence))[2]
    turned = by_frontier((log_weight.T, c, np.full(13, -np.inf)))
    np.testing.assert_allclose(turned[0].sum(axis=0), 1.0, rtol=0, atol=1e-12)


def test_permuting_tracks_and_measurements_permutes_the_answer(chain):
    rng = np.random.default_rng(4)
    log_weight, r, c = chain(rng, 40, 4, 5.0)
    rows, columns = rng.permutation(40), rng.permutation(43)
    expected = by_frontier((log_weight, r, c))[0]
    permuted = by_frontier((log_weight[np.ix_(rows, columns)], r[rows], c[columns]))[0]
    np.testing.assert_allclose(permuted, expected[np.ix_(rows, columns)], rtol=0, atol=1e-12)
    turned = by_frontier((log_weight.T, c, r))[0]
    np.testing.assert_allclose(turned.T, expected, rtol=0, atol=1e-12)


def test_weightings_do_not_mix(chain):
    rng = np.random.default_rng(5)
    log_weight, r, c = chain(rng, 12, 3, 1.0)
    place = np.nonzero(log_weight > -np.inf)
    layers = []
    for spread in (1.0, 2000.0, 30.0):
        bordered = rng.uniform(-spread, spread, (13, 15))
        bordered[12, 14] = 0.0
        layers.append(bordered)
    layers[2][place[0][0]] = -np.inf  # a track that can do nothing
    stacked = np.array(layers)
    stacked[:, :12, :14][:, log_weight == -np.inf] = -np.inf
    order = find_elimination(*place, 12, 14, math.inf)
    together = frontier_marginals(order, *place, stacked.copy())
    assert together.feasible.tolist() == [True, True, False]
    for layer in range(3):
        alone = frontier_marginals(order, *place, stacked[layer : layer + 1].copy())
        np.testing.assert_array_equal(together.marginals[layer], alone.marginals[0])
        assert together.log_partition[layer] == alone.log_partition[0]


def test_scaling_on_the_way_changes_nothing(monkeypatch, chain):
    cluster = chain(np.random.default_rng(6), 20, 4, 30.0)
    expected = [by_frontier(cluster, least) for least in (0, 1, 19)]
    monkeypatch.setattr(frontier, "ACTIONS_PER_SCALING", 3)
    for least, (marginals, log_partition, _) in zip((0, 1, 19), expected, strict=True):
        found = by_frontier(cluster, least)
        np.testing.assert_allclose(found[0], marginals, rtol=0, atol=1e-14)
        assert found[1] == pytest.approx(log_partition, rel=1e-14)


def test_layers_that_counting_takes():
    assert [layers_of(least, 5) for least in (0, 1, 2, 4, 5, 6)] == [1, 1, 4, 2, 1, 1]
