from __future__ import annotations

import numpy as np
import pytest

from gda_tracker.association.best_hypothesis import best_hypothesis
from gda_tracker.association.scaling import dual_potentials, scale


def bordered(cluster):
    log_weight, r, c = cluster
    n, m = log_weight.shape
    array = np.zeros((n + 1, m + 1))
    array[:n, :m], array[:n, m], array[n, :m] = log_weight, r, c
    return array


@pytest.mark.parametrize("zeros", [0.0, 0.4])
def test_dual_potentials_bound_every_weight_and_meet_on_the_best_hypothesis(
    zeros, brute_force, random_cluster
):
    rng = np.random.default_rng(1)
    feasible = 0
    for n, m in [(1, 1), (1, 4), (4, 1), (2, 3), (3, 2), (4, 4), (5, 5)] * 6:
        cluster = random_cluster(rng, n, m, 1000.0, zeros)
        potentials = dual_potentials(bordered(cluster))
        expected = brute_force(*cluster)
        if potentials is None:
            assert not expected.feasible
            continue
        feasible += 1
        a, b = potentials
        log_weight, r, c = cluster
        assert (log_weight + a[:, None] + b).max() <= 1e-9
        assert (r + a).max() <= 1e-9
        assert (c + b).max() <= 1e-9
        assert expected.best + a.sum() + b.sum() == pytest.approx(0.0, abs=1e-9)
        # The same on every factor of the best hypothesis.
        best = best_hypothesis(*cluster)
        for i, j in enumerate(best):
            factor = r[i] + a[i] if j < 0 else log_weight[i, j] + a[i] + b[j]
            assert factor == pytest.approx(0.0, abs=1e-9)
    assert feasible > 20


def test_moderate_weights_are_left_alone(random_cluster):
    array = bordered(random_cluster(np.random.default_rng(2), 3, 3, 50.0, 0.2))[None]
    before = array.copy()
    assert (scale(array) == 0.0).all()
    np.testing.assert_array_equal(array, before)


def test_scaling_is_exact_and_accounted_for(random_cluster):
    rng = np.random.default_rng(3)
    arrays = np.array([bordered(random_cluster(rng, 4, 3, 2000.0)) for _ in range(8)])
    before = arrays.copy()
    taken = scale(arrays)
    assert arrays.max() <= 1e-5
    # Entries of one row and one column lose the same: all second differences stay, to the last bit
    # of what is not negligible.
    change = arrays - before
    np.testing.assert_allclose(
        change[:, :-1, :-1],
        change[:, :-1, -1:] + change[:, -1:, :-1],
        rtol=0,
        atol=2e-12,
    )
    np.testing.assert_allclose(
        taken, -(change[:, :-1, -1].sum(axis=1) + change[:, -1, :-1].sum(axis=1)), atol=1e-9
    )


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_a_weight_spoils_its_own_cluster_only(value, random_cluster):
    rng = np.random.default_rng(4)
    arrays = np.array([bordered(random_cluster(rng, 2, 2, 2000.0)) for _ in range(2)])
    alone = arrays[1:].copy()
    scale(alone)
    arrays[0, 0, 0] = value
    scale(arrays)
    assert (arrays[0].ravel()[:-1] == -np.inf).all()
    np.testing.assert_array_equal(arrays[1], alone[0])
