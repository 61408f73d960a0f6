from __future__ import annotations

import numpy as np
import pytest

from gda_tracker.association.belief_propagation import loopy_marginals
from gda_tracker.association.errors import NoFeasibleHypothesis
from gda_tracker.association.joint import joint_log_partition, joint_marginals

ITERATIONS, TOLERANCE = 500, 1e-9


def sparse_cluster(rng, n, m, share):
    """Radar-like weights: P_d g around 1e-4 with gates, P_d = 0.9, beta = 1e-6."""
    log_weight = np.log(0.9e-4) - 0.5 * rng.uniform(0.0, 9.2, (n, m))
    log_weight[rng.random((n, m)) > share] = -np.inf
    return log_weight, np.full(n, np.log(0.1)), np.full(m, np.log(1e-6))


def test_exact_on_a_chain():
    # Track i sees measurements i and i + 1: no cycle.
    rng = np.random.default_rng(1)
    log_weight = np.full((8, 9), -np.inf)
    for i in range(8):
        log_weight[i, i : i + 2] = rng.normal(0.0, 2.0, 2)
    cluster = log_weight, rng.normal(size=8), rng.normal(size=9)
    found = loopy_marginals(*cluster, ITERATIONS, TOLERANCE)
    assert found.converged
    np.testing.assert_allclose(found.marginals, joint_marginals(*cluster), atol=1e-9)
    assert found.log_partition == pytest.approx(joint_log_partition(*cluster), abs=1e-9)


def test_exact_on_a_chain_with_certain_detection():
    log_weight = np.full((4, 5), -np.inf)
    for i in range(4):
        log_weight[i, i : i + 2] = [0.3 * i, -0.2]
    cluster = log_weight, np.full(4, -np.inf), np.zeros(5)
    found = loopy_marginals(*cluster, ITERATIONS, TOLERANCE)
    assert found.converged
    np.testing.assert_allclose(found.marginals, joint_marginals(*cluster), atol=1e-9)


def test_weights_of_any_scale(random_cluster):
    log_weight = np.full((5, 6), -np.inf)
    rng = np.random.default_rng(2)
    for i in range(5):
        log_weight[i, i : i + 2] = rng.uniform(-1000, 1000, 2)
    cluster = log_weight, rng.uniform(-1000, 1000, 5), rng.uniform(-1000, 1000, 6)
    found = loopy_marginals(*cluster, ITERATIONS, TOLERANCE)
    np.testing.assert_allclose(found.marginals, joint_marginals(*cluster), atol=1e-9)


def test_close_to_exact_on_sparse_clusters():
    """Stated tolerance: every marginal within 0.3, the gated ones within 0.03 on the average."""
    rng = np.random.default_rng(3)
    errors = []
    for _ in range(10):
        cluster = sparse_cluster(rng, 9, 10, 0.25)
        found = loopy_marginals(*cluster, ITERATIONS, TOLERANCE)
        assert found.converged
        errors.append(np.abs(found.marginals - joint_marginals(*cluster))[cluster[0] > -np.inf])
        # The Bethe partition function of matchings is a lower bound.
        exact = joint_log_partition(*cluster)
        assert exact - 1.0 < found.log_partition <= exact + 1e-9
    assert max(error.max() for error in errors) < 0.3
    assert np.concatenate(errors).mean() < 0.03


def test_is_a_distribution_and_permutes(random_cluster):
    rng = np.random.default_rng(4)
    log_weight, r, c = sparse_cluster(rng, 30, 35, 0.1)
    found = loopy_marginals(log_weight, r, c, ITERATIONS, TOLERANCE)
    assert found.converged
    assert found.marginals.min() >= 0.0
    assert found.marginals.sum(axis=1).max() <= 1.0 + 1e-9
    assert found.marginals.sum(axis=0).max() <= 1.0 + 1e-6
    assert (found.marginals[log_weight == -np.inf] == 0.0).all()
    rows, columns = rng.permutation(30), rng.permutation(35)
    again = loopy_marginals(
        log_weight[np.ix_(rows, columns)], r[rows], c[columns], ITERATIONS, TOLERANCE
    )
    np.testing.assert_allclose(again.marginals, found.marginals[np.ix_(rows, columns)], atol=1e-9)


def test_says_when_it_did_not_converge():
    cluster = sparse_cluster(np.random.default_rng(5), 12, 12, 0.5)
    found = loopy_marginals(*cluster, 2, TOLERANCE)
    assert not found.converged
    assert found.iterations == 2
    assert loopy_marginals(*cluster, ITERATIONS, TOLERANCE).converged


def test_without_pairs():
    found = loopy_marginals(
        np.full((2, 2), -np.inf), np.log([0.1, 0.2]), np.log([0.5, 0.5]), ITERATIONS, TOLERANCE
    )
    assert found.converged
    assert (found.marginals == 0.0).all()
    assert found.log_partition == pytest.approx(np.log(0.1 * 0.2 * 0.25))


def test_no_feasible_hypothesis_is_named():
    with pytest.raises(NoFeasibleHypothesis, match="track 1"):
        loopy_marginals(
            np.array([[0.0], [-np.inf]]), np.array([0.0, -np.inf]), np.zeros(1), 10, TOLERANCE
        )
    with pytest.raises(NoFeasibleHypothesis, match="measurement 0"):
        loopy_marginals(np.array([[-np.inf]]), np.zeros(1), np.array([-np.inf]), 10, TOLERANCE)
