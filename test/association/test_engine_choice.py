from __future__ import annotations

import numpy as np
import pytest

from gda_tracker.association import engine_choice
from gda_tracker.association.choices import (
    ENGINES,
    FRONTIER_DYNAMIC_PROGRAMMING,
    LOOPY_BELIEF_PROPAGATION,
    SUBSET_DYNAMIC_PROGRAMMING,
)
from gda_tracker.association.cluster_marginals import (
    EngineLimits,
    cluster_marginals,
)
from gda_tracker.association.clustering import find_clusters
from gda_tracker.association.engine_choice import always_subsets, choose_engine
from gda_tracker.association.subsets import operations
from gda_tracker.association.weightings import JointWeights


def choice(gate, max_exact_size, least_assigned=(0,)):
    gate = gate if gate.shape[0] >= gate.shape[1] else gate.T
    return choose_engine(*np.nonzero(gate), *gate.shape, max_exact_size, least_assigned)[0]


def band(n, reach):
    return np.array([[0 <= j - i < reach for j in range(n + reach - 1)] for i in range(n)])


def test_dense_clusters_go_over_subsets_up_to_the_bound():
    for n in (1, 5, 12, 14):
        assert choice(np.ones((n, n)), 14) == SUBSET_DYNAMIC_PROGRAMMING
    assert choice(np.ones((15, 15)), 14) == LOOPY_BELIEF_PROPAGATION
    assert choice(np.ones((15, 15)), 15) == SUBSET_DYNAMIC_PROGRAMMING
    assert choice(np.ones((200, 14)), 14) == SUBSET_DYNAMIC_PROGRAMMING


def test_sparse_clusters_are_exact_whatever_their_length():
    for n in (15, 50, 400):
        assert choice(band(n, 4), 14) == FRONTIER_DYNAMIC_PROGRAMMING
    # Inside the bound, but dear over subsets.
    assert choice(band(14, 3), 14) == FRONTIER_DYNAMIC_PROGRAMMING
    assert choice(band(8, 3), 14) == SUBSET_DYNAMIC_PROGRAMMING


def test_max_exact_size_bounds_the_operations():
    gate = np.random.default_rng(1).random((40, 40)) < 0.04
    gate |= np.eye(40, dtype=bool)
    chosen = []
    for size in range(1, 21):
        engine, order = choose_engine(*np.nonzero(gate), 40, 40, size)
        chosen.append(engine)
        if engine == FRONTIER_DYNAMIC_PROGRAMMING:
            assert order.operations <= operations(size, size)
    first = chosen.index(FRONTIER_DYNAMIC_PROGRAMMING)
    assert set(chosen[:first]) == {LOOPY_BELIEF_PROPAGATION}
    assert set(chosen[first:]) == {FRONTIER_DYNAMIC_PROGRAMMING}
    assert 5 < first < 19


def test_counting_pairs_counts_as_cost():
    gate = band(30, 5)
    assert choice(gate, 9) == FRONTIER_DYNAMIC_PROGRAMMING
    assert choice(gate, 9, (0, 1, 30)) == FRONTIER_DYNAMIC_PROGRAMMING
    assert choice(gate, 9, (0, 15)) == LOOPY_BELIEF_PROPAGATION


def test_memory_is_bounded(monkeypatch):
    gate = band(50, 6)
    assert choice(gate, 14) == FRONTIER_DYNAMIC_PROGRAMMING
    monkeypatch.setattr(engine_choice, "MAX_KEPT_ENTRIES", 100)
    assert choice(gate, 14) == LOOPY_BELIEF_PROPAGATION


def test_cheap_clusters_are_not_looked_at():
    assert always_subsets(10, 10, 14)
    assert not always_subsets(10, 10, 9)
    assert not always_subsets(12, 12, 14)


@pytest.fixture
def mixed_scan():
    """One cluster for every engine at size 10, with its three weightings."""
    rng = np.random.default_rng(2)
    parts = [np.ones((3, 2)), band(40, 3), np.ones((11, 11)), np.ones((9, 8)), band(12, 2).T]
    gate = np.zeros((sum(p.shape[0] for p in parts), sum(p.shape[1] for p in parts)), dtype=bool)
    row = column = 0
    for part in parts:
        gate[row : row + part.shape[0], column : column + part.shape[1]] = part
        row, column = row + part.shape[0], column + part.shape[1]
    rows, columns = (index.astype(np.int32) for index in np.nonzero(gate))
    clusters = find_clusters(rows, columns, *gate.shape)
    idle = np.append(rng.normal(-1.0, 1.0, sum(gate.shape)), 0.0)
    least = [None, np.array([1, 1, 1, 1, 1]), np.array([2, 40, 2, 7, 12])]
    weightings = [JointWeights(rng.normal(size=len(rows)), idle, bound) for bound in least]
    return clusters, weightings


def test_the_result_names_the_engine_of_every_cluster(mixed_scan):
    clusters, weightings = mixed_scan
    found = cluster_marginals(clusters, weightings, EngineLimits(max_exact_size=10))
    assert [ENGINES[engine] for engine in found.engine] == [
        SUBSET_DYNAMIC_PROGRAMMING,
        FRONTIER_DYNAMIC_PROGRAMMING,
        LOOPY_BELIEF_PROPAGATION,
        SUBSET_DYNAMIC_PROGRAMMING,
        FRONTIER_DYNAMIC_PROGRAMMING,
    ]


def test_engines_agree_cluster_by_cluster(mixed_scan, monkeypatch):
    clusters, weightings = mixed_scan
    usual = cluster_marginals(clusters, weightings, EngineLimits(max_exact_size=14))
    exact = clusters.pair_cluster != 1  # 40 x 42 is beyond subsets
    assert usual.converged.all()
    # Subsets wherever they can, then the frontier wherever it can.
    monkeypatch.setattr(engine_choice, "OPERATIONS_WORTH_AN_ORDER", np.inf)
    subsets = cluster_marginals(clusters, weightings, EngineLimits(max_exact_size=14))
    assert [ENGINES[engine] for engine in subsets.engine].count(SUBSET_DYNAMIC_PROGRAMMING) == 4
    monkeypatch.setattr(engine_choice, "OPERATIONS_WORTH_AN_ORDER", 0.0)
    monkeypatch.setattr(engine_choice, "DENSE", np.inf)
    monkeypatch.setattr(engine_choice.subsets, "operations", lambda steps, elements: np.inf)
    ordered = cluster_marginals(clusters, weightings, EngineLimits(max_exact_size=14))
    assert (ordered.engine == ENGINES.index(FRONTIER_DYNAMIC_PROGRAMMING)).all()
    for other, mine in ((subsets, exact), (ordered, slice(None))):
        np.testing.assert_allclose(
            other.marginals[:, mine], usual.marginals[:, mine], rtol=0, atol=1e-12
        )
