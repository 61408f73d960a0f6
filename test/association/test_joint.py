from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.association import joint, subsets
from gda_tracker.association.errors import ClusterTooLarge, NoFeasibleHypothesis
from gda_tracker.association.joint import (
    hypothesis_count,
    joint_log_partition,
    joint_marginals,
    joint_marginals_batch,
)

examples = settings(derandomize=True, deadline=None, max_examples=50)

TABLE_14_1 = {
    (2, 2): 7,
    (2, 3): 13,
    (3, 3): 34,
    (3, 4): 73,
    (4, 4): 209,
    (4, 5): 501,
    (5, 5): 1546,
    (5, 6): 4051,
    (6, 6): 13327,
    (7, 8): 394353,
    (10, 9): 58941091,
    (10, 10): 234662231,
}
SIZES_TO_5 = [(n, m) for n in range(1, 6) for m in range(1, 6)]
clusters = st.tuples(
    st.integers(1, 6),
    st.integers(1, 6),
    st.sampled_from([1.0, 40.0, 1500.0]),
    st.integers(0, 2**32),
)


@pytest.mark.parametrize(("size", "count"), TABLE_14_1.items())
def test_hypothesis_counts_of_table_14_1(size, count):
    n, m = size
    assert hypothesis_count(n, m) == count
    assert hypothesis_count(m, n) == count
    # The joint engine sums the same hypotheses, each with weight 1.
    partition = joint_log_partition(np.zeros((n, m)), np.zeros(n), np.zeros(m))
    assert round(np.exp(partition)) == count


def test_hypothesis_count_is_exact_far_beyond_doubles():
    # S(n, m) = sum over i of C(m, i) A(n, i), 14.4.
    assert hypothesis_count(10**4, 2) == 1 + 2 * 10**4 + 10**4 * (10**4 - 1)
    count = sum(math.comb(30, i) * math.perm(25, i) for i in range(26))
    assert hypothesis_count(25, 30) == count > 2**90
    assert hypothesis_count(0, 5) == hypothesis_count(5, 0) == 1


@pytest.mark.parametrize("size", [(-1, 2), (2, -1)])
def test_hypothesis_count_refuses_negative_sizes(size):
    with pytest.raises(ValueError, match=">= 0"):
        hypothesis_count(*size)


def test_table_14_2():
    g = np.array([[3.0e-4, 1.0e-4], [0.5e-4, 2.0e-4]])
    p_d, beta = 0.9, 1e-5
    miss = 1.0 - p_d
    weights = {
        (0, 0): miss**2 * beta**2,
        (1, 0): g[0, 0] * p_d * miss * beta,
        (2, 0): g[0, 1] * p_d * miss * beta,
        (0, 1): g[1, 0] * p_d * miss * beta,
        (0, 2): g[1, 1] * p_d * miss * beta,
        (1, 2): g[0, 0] * g[1, 1] * p_d**2,
        (2, 1): g[0, 1] * g[1, 0] * p_d**2,
    }
    total = sum(weights.values())
    expected = np.array(
        [
            [weights[1, 0] + weights[1, 2], weights[2, 0] + weights[2, 1]],
            [weights[0, 1] + weights[2, 1], weights[0, 2] + weights[1, 2]],
        ]
    )
    arguments = np.log(p_d * g), np.log([miss, miss]), np.log([beta, beta])
    np.testing.assert_allclose(joint_marginals(*arguments), expected / total, rtol=1e-13)
    assert joint_log_partition(*arguments) == pytest.approx(np.log(total), rel=1e-14)


@pytest.mark.parametrize("spread", [1.0, 30.0, 1000.0, 4000.0])
@pytest.mark.parametrize(("n", "m"), SIZES_TO_5)
def test_equals_brute_force(n, m, spread, brute_force, random_cluster):
    rng = np.random.default_rng([n, m, int(spread)])
    for zeros in (0.0, 0.4):
        cluster = random_cluster(rng, n, m, spread, zeros)
        expected = brute_force(*cluster)
        if not expected.feasible:
            with pytest.raises(NoFeasibleHypothesis):
                joint_marginals(*cluster)
            continue
        np.testing.assert_allclose(
            joint_marginals(*cluster), expected.marginals, rtol=0.0, atol=1e-12
        )
        assert joint_log_partition(*cluster) == pytest.approx(expected.log_partition, rel=1e-12)


@pytest.mark.parametrize(("n", "m"), SIZES_TO_5)
def test_certain_detection_and_no_clutter(n, m, brute_force, random_cluster):
    rng = np.random.default_rng([n, m])
    log_weight, log_idle_track, log_idle_measurement = random_cluster(rng, n, m, 5.0)
    none = -np.inf
    for r, c in (
        (np.full(n, none), log_idle_measurement),
        (log_idle_track, np.full(m, none)),
        (np.full(n, none), np.full(m, none)),
    ):
        expected = brute_force(log_weight, r, c)
        if expected.feasible:
            found = joint_marginals(log_weight, r, c)
            np.testing.assert_allclose(found, expected.marginals, rtol=0.0, atol=1e-12)
            if (r == none).all():
                np.testing.assert_allclose(found.sum(axis=1), 1.0, rtol=0.0, atol=1e-12)
        else:
            with pytest.raises(NoFeasibleHypothesis):
                joint_marginals(log_weight, r, c)


def test_log_weights_spread_over_2000_do_not_underflow(brute_force):
    rng = np.random.default_rng(8)
    # The best hypothesis is a permutation hidden behind rows and columns of wild scales; two
    # hypotheses compete within a factor of 2, everything else is negligible.
    rows, columns = rng.uniform(-2000, 2000, 5), rng.uniform(-2000, 2000, 5)
    core = np.full((5, 5), -900.0)
    core[np.arange(5), [1, 0, 2, 3, 4]] = 0.0
    core[[0, 1], [0, 1]] = [np.log(0.5), 0.0]
    cluster = (
        core + rows[:, None] + columns,
        rows - 700.0,
        columns - 700.0,
    )
    found = joint_marginals(*cluster)
    np.testing.assert_allclose(found, brute_force(*cluster).marginals, rtol=0.0, atol=1e-12)
    assert found[0, 1] == pytest.approx(2.0 / 3.0, abs=1e-9)
    assert found[0, 0] == pytest.approx(1.0 / 3.0, abs=1e-9)


def test_ten_by_ten_with_wild_weights_is_a_distribution(random_cluster):
    log_weight, r, c = random_cluster(np.random.default_rng(5), 10, 10, 2000.0)
    found = joint_marginals(log_weight, r, c)
    assert np.isfinite(found).all()
    assert found.min() >= 0.0
    assert found.max() == pytest.approx(1.0, abs=1e-9)
    assert found.sum(axis=1).max() <= 1.0 + 1e-12
    assert found.sum(axis=0).max() <= 1.0 + 1e-12


@examples
@given(clusters)
def test_rows_and_columns_sum_to_at_most_one(random_cluster, drawn):
    n, m, spread, seed = drawn
    found = joint_marginals(*random_cluster(np.random.default_rng(seed), n, m, spread))
    assert found.min() >= 0.0
    assert found.sum(axis=1).max() <= 1.0 + 1e-12
    assert found.sum(axis=0).max() <= 1.0 + 1e-12


@examples
@given(clusters)
def test_permuting_tracks_and_measurements_permutes_the_answer(random_cluster, drawn):
    n, m, spread, seed = drawn
    rng = np.random.default_rng(seed)
    log_weight, r, c = random_cluster(rng, n, m, spread)
    rows, columns = rng.permutation(n), rng.permutation(m)
    np.testing.assert_allclose(
        joint_marginals(log_weight[np.ix_(rows, columns)], r[rows], c[columns]),
        joint_marginals(log_weight, r, c)[np.ix_(rows, columns)],
        rtol=0.0,
        atol=1e-12,
    )


@examples
@given(clusters)
def test_tracks_and_measurements_play_the_same_part(random_cluster, drawn):
    n, m, spread, seed = drawn
    log_weight, r, c = random_cluster(np.random.default_rng(seed), n, m, spread)
    np.testing.assert_allclose(
        joint_marginals(log_weight.T, c, r).T,
        joint_marginals(log_weight, r, c),
        rtol=0.0,
        atol=1e-12,
    )


@examples
@given(clusters, st.floats(-300, 300))
def test_a_common_factor_of_a_track_or_measurement_changes_nothing(random_cluster, drawn, factor):
    n, m, spread, seed = drawn
    log_weight, r, c = random_cluster(np.random.default_rng(seed), n, m, min(spread, 40.0))
    expected = joint_marginals(log_weight, r, c)
    moved, moved_r, moved_c = log_weight.copy(), r.copy(), c.copy()
    moved[0] += factor
    moved_r[0] += factor
    np.testing.assert_allclose(joint_marginals(moved, moved_r, c), expected, rtol=0, atol=1e-10)
    moved = log_weight.copy()
    moved[:, -1] -= factor
    moved_c[-1] -= factor
    np.testing.assert_allclose(joint_marginals(moved, r, moved_c), expected, rtol=0, atol=1e-10)
    assert joint_log_partition(moved, r, moved_c) == pytest.approx(
        joint_log_partition(log_weight, r, c) - factor, abs=1e-9
    )


def test_independent_parts_factorise(random_cluster):
    rng = np.random.default_rng(4)
    one, two = random_cluster(rng, 3, 2, 3.0), random_cluster(rng, 2, 4, 3.0)
    log_weight = np.full((5, 6), -np.inf)
    log_weight[:3, :2], log_weight[3:, 2:] = one[0], two[0]
    both = log_weight, np.append(one[1], two[1]), np.append(one[2], two[2])
    found = joint_marginals(*both)
    np.testing.assert_allclose(found[:3, :2], joint_marginals(*one), atol=1e-13)
    np.testing.assert_allclose(found[3:, 2:], joint_marginals(*two), atol=1e-13)
    assert joint_log_partition(*both) == pytest.approx(
        joint_log_partition(*one) + joint_log_partition(*two), rel=1e-13
    )


def test_vanishing_detection_probability_leaves_every_track_idle():
    log_g = np.log(np.full((3, 3), 1e-4))
    for p_d in (1e-3, 1e-6, 1e-9):
        found = joint_marginals(np.log(p_d) + log_g, np.log1p(-np.full(3, p_d)), np.log([1e-6] * 3))
        np.testing.assert_allclose(found, p_d * 1e-4 / 1e-6, rtol=1e3 * p_d)
    nothing = joint_marginals(np.full((3, 3), -np.inf), np.zeros(3), np.log([1e-6] * 3))
    assert (nothing == 0.0).all()


def test_batch_equals_single(random_cluster):
    rng = np.random.default_rng(6)
    for n, m in ((1, 1), (2, 3), (4, 2), (3, 3), (5, 6)):
        drawn = [random_cluster(rng, n, m, spread, 0.2) for spread in (1, 20, 900, 3000) * 3]
        batch = joint_marginals_batch(*(np.array(part) for part in zip(*drawn, strict=True)))
        for index, cluster in enumerate(drawn):
            assert joint_log_partition(*cluster) == pytest.approx(
                batch.log_partition[index], rel=1e-13
            )
            if batch.feasible[index]:
                np.testing.assert_allclose(
                    batch.marginals[index], joint_marginals(*cluster), rtol=0, atol=1e-14
                )
            else:
                assert (batch.marginals[index] == 0.0).all()
                with pytest.raises(NoFeasibleHypothesis):
                    joint_marginals(*cluster)


def test_least_assigned_keeps_the_fuller_hypotheses(brute_force, random_cluster):
    rng = np.random.default_rng(7)
    for n, m in ((2, 2), (3, 4), (4, 3), (5, 5)):
        bounds = np.arange(min(n, m) + 1)
        drawn = [random_cluster(rng, n, m, 4.0, 0.2) for _ in bounds]
        stacked = [np.array(part) for part in zip(*drawn, strict=True)]
        found = joint_marginals_batch(*stacked, least_assigned=bounds)
        for index, cluster in enumerate(drawn):
            expected = brute_force(*cluster, least_assigned=index)
            assert found.feasible[index] == expected.feasible
            np.testing.assert_allclose(
                found.marginals[index], expected.marginals, rtol=0, atol=1e-12
            )


def test_sweep_with_and_without_tables_agree(monkeypatch, random_cluster):
    rng = np.random.default_rng(9)
    clusters = [random_cluster(rng, n, m, 5.0, 0.2) for n, m in ((1, 1), (3, 5), (5, 3), (7, 8))]
    by_tables = [joint_marginals(*cluster) for cluster in clusters]
    monkeypatch.setattr(subsets, "MAX_TABLE_ELEMENTS", 0)
    for cluster, expected in zip(clusters, by_tables, strict=True):
        np.testing.assert_allclose(joint_marginals(*cluster), expected, rtol=0, atol=1e-13)


def test_large_batches_go_in_pieces(monkeypatch, random_cluster):
    rng = np.random.default_rng(10)
    drawn = [random_cluster(rng, 3, 3, 5.0) for _ in range(17)]
    stacked = [np.array(part) for part in zip(*drawn, strict=True)]
    least = rng.integers(0, 4, 17)
    whole = joint_marginals_batch(*stacked, least)
    monkeypatch.setattr(joint, "CHUNK_ELEMENTS", 700)
    in_pieces = joint_marginals_batch(*stacked, least)
    np.testing.assert_allclose(in_pieces.marginals, whole.marginals, rtol=0, atol=1e-14)
    np.testing.assert_allclose(in_pieces.log_partition, whole.log_partition, rtol=1e-14)
    assert (in_pieces.feasible == whole.feasible).all()


def test_empty_sides():
    assert joint_marginals(np.zeros((0, 3)), [], np.zeros(3)).shape == (0, 3)
    assert joint_log_partition(np.zeros((2, 0)), [-1.0, -2.0], []) == -3.0
    assert joint_log_partition(np.zeros((0, 0)), [], []) == 0.0
    with pytest.raises(NoFeasibleHypothesis):
        joint_marginals(np.zeros((1, 0)), [-np.inf], [])


def test_no_feasible_hypothesis():
    impossible = np.zeros((2, 1)), [-np.inf, -np.inf], [0.0]  # two tracks must share one detection
    with pytest.raises(NoFeasibleHypothesis, match="2 tracks and 1 measurements"):
        joint_marginals(*impossible)
    assert joint_log_partition(*impossible) == -np.inf


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.zeros(3), np.zeros(3), np.zeros(3)), r"log_weight has shape \(3,\)"),
        ((np.zeros((2, 3)), np.zeros(3), np.zeros(3)), r"log_idle_track .*allowed is \(2,\)"),
        ((np.zeros((2, 3)), np.zeros(2), np.zeros(2)), r"log_idle_measurement .*\(3,\)"),
        (([[np.nan]], [0.0], [0.0]), "log_weight holds nan"),
        (([[0.0]], [np.inf], [0.0]), "log_idle_track holds inf"),
        (([[0.0]], [0.0], [-1e10]), "log_idle_measurement holds -1.*1e.09"),
    ],
)
@pytest.mark.parametrize("function", [joint_marginals, joint_log_partition])
def test_refused_input(function, arguments, message):
    with pytest.raises(ValueError, match=message):
        function(*arguments)


def test_a_cluster_beyond_the_exact_engine_is_refused_by_name():
    with pytest.raises(ClusterTooLarge, match="at most 20"):
        joint_marginals(np.zeros((21, 22)), np.zeros(21), np.zeros(22))


def test_clumps_and_chains_are_answered_in_one_call(chain, random_cluster):
    rng = np.random.default_rng(13)
    parts = [random_cluster(rng, n, m, 3.0) for n, m in ((6, 7), (12, 12), (1, 1), (8, 4))]
    parts += [chain(rng, 50, 3, 3.0), [np.full((1, 0), -np.inf), np.zeros(1) - 2.0, np.zeros(0)]]
    shape = [sum(part[0].shape[side] for part in parts) for side in (0, 1)]
    log_weight = np.full(shape, -np.inf)
    row = column = 0
    places = []
    for part in parts:
        n, m = part[0].shape
        places.append(np.s_[row : row + n, column : column + m])
        log_weight[places[-1]] = part[0]
        row, column = row + n, column + m
    both = log_weight, *(np.concatenate([part[side] for part in parts]) for side in (1, 2))
    found = joint_marginals(*both)
    for part, place in zip(parts, places, strict=True):
        np.testing.assert_allclose(found[place], joint_marginals(*part), rtol=0, atol=1e-13)
    assert (found[log_weight == -np.inf] == 0.0).all()
    partition = sum(joint_log_partition(*part) for part in parts)
    assert joint_log_partition(*both) == pytest.approx(partition, rel=1e-13)
    # One part without a feasible hypothesis spoils the whole.
    both[1][-1] = -np.inf
    assert joint_log_partition(*both) == -np.inf


def test_a_large_side_is_no_obstacle(random_cluster):
    log_weight, r, c = random_cluster(np.random.default_rng(11), 3, 200, 3.0)
    found = joint_marginals(log_weight, r, c)
    assert found.sum() <= 3.0
    assert found.sum(axis=1).min() > 0.5
