from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.association.assignment import (
    best_hypothesis,
    choose_by_probability,
    choose_most_probable,
)

examples = settings(derandomize=True, deadline=None, max_examples=50)

shapes = st.tuples(st.integers(1, 4), st.integers(1, 4), st.integers(0, 2**32))


def is_matching(chosen):
    return (chosen.sum(axis=0) <= 1).all() and (chosen.sum(axis=1) <= 1).all()


@examples
@given(shapes, st.sampled_from([0.0, 0.4]))
def test_best_hypothesis_has_the_largest_weight(brute_force, random_cluster, drawn, zeros):
    n, m, seed = drawn
    cluster = random_cluster(np.random.default_rng(seed), n, m, 10.0, zeros)
    expected = brute_force(*cluster)
    found = best_hypothesis(*cluster)
    if found is None:
        assert not expected.feasible
        return
    weight = expected.log_weights[expected.hypotheses.index(tuple(found.tolist()))]
    assert weight == pytest.approx(expected.best, abs=1e-9)


@examples
@given(shapes)
def test_map_equals_brute_force(brute_force, random_cluster, drawn):
    n, m, seed = drawn
    if m > n:
        n, m = m, n
    rng = np.random.default_rng(seed)
    clusters = [random_cluster(rng, n, m, 10.0) for _ in range(3)]
    for cluster in clusters:
        cluster[0][rng.random((n, m)) < 0.3] = -np.inf
    chosen = choose_most_probable(
        *(np.array(part) for part in zip(*clusters, strict=True)), np.full(3, m)
    )
    for cluster, found in zip(clusters, chosen, strict=True):
        assert is_matching(found)
        expected = brute_force(*cluster)
        hypothesis = tuple(np.where(found.any(axis=1), found.argmax(axis=1), -1).tolist())
        weight = expected.log_weights[expected.hypotheses.index(hypothesis)]
        assert weight == pytest.approx(expected.best, abs=1e-9)


@pytest.mark.parametrize("m", [1, 2])
def test_map_with_certain_detection_and_without_clutter(m):
    # Two tracks that must be detected and m measurements that must be explained.
    log_weight = np.array([[[-3.0, -9.0], [-1.0, -2.0]]])[:, :, :m]
    nothing = np.full((1, 2), -np.inf)
    chosen = choose_most_probable(log_weight, nothing, nothing[:, :m], np.array([m]))
    # With m = 1 one track has to be missed all the same: the limit of vanishing weights decides.
    expected = {1: [[False], [True]], 2: [[True, False], [False, True]]}[m]
    assert chosen[0].tolist() == expected


def test_map_leaves_a_detection_that_clutter_explains_better():
    sizes = np.array([1, 1])
    log_weight = np.array([[[-5.0]], [[-5.0]]])
    chosen = choose_most_probable(
        log_weight, np.array([[-2.0], [-2.0]]), np.array([[-2.0], [-4.0]]), sizes
    )
    assert chosen[:, 0, 0].tolist() == [False, True]


def largest_matchings(inside):
    """All assignments with as many pairs inside the gate as possible."""
    n, m = inside.shape
    best, found = -1, []
    for columns in itertools.permutations(range(max(n, m)), n):
        pairs = [(i, j) for i, j in enumerate(columns) if j < m and inside[i, j]]
        if len(pairs) > best:
            best, found = len(pairs), []
        if len(pairs) == best:
            found.append(pairs)
    return found


@examples
@given(shapes)
def test_gda_is_the_largest_assignment_of_smallest_cost(drawn):
    n, m, seed = drawn
    if m > n:
        n, m = m, n
    rng = np.random.default_rng(seed)
    probability = rng.random((2, n, m))
    inside = rng.random((2, n, m)) < 0.6
    chosen = choose_by_probability(np.where(inside, probability, -1.0 - m), np.full(2, m))
    for p, gate, found in zip(probability, inside, chosen, strict=True):
        assert is_matching(found)
        assert not (found & ~gate).any()
        candidates = largest_matchings(gate)
        assert found.sum() == len(candidates[0])
        cost = min(sum(1.0 - p[pair] for pair in pairs) for pairs in candidates)
        assert (1.0 - p[found]).sum() == pytest.approx(cost, abs=1e-12)


def test_gda_tells_tiny_probabilities_apart():
    p = np.array([[[1e-20, 3e-20], [2e-20, 1e-20]]])
    assert choose_by_probability(p, np.array([2]))[0].tolist() == [[False, True], [True, False]]


def test_gda_takes_what_is_in_the_gate_however_improbable():
    p = np.array([[[0.0]], [[-2.0]]])  # the second has no pair inside
    assert choose_by_probability(p, np.array([1, 1]))[:, 0, 0].tolist() == [True, False]


def test_padding_changes_nothing():
    rng = np.random.default_rng(3)
    p = rng.random((1, 3, 2))
    padded = np.full((1, 5, 4), -5.0)
    padded[:, :3, :2] = p
    np.testing.assert_array_equal(
        choose_by_probability(padded, np.array([2]))[:, :3, :2],
        choose_by_probability(p, np.array([2])),
    )
    log_weight, r, c = rng.normal(size=(1, 3, 2)), rng.normal(size=(1, 3)), rng.normal(size=(1, 2))
    wide = np.full((1, 5, 4), -np.inf)
    wide[:, :3, :2] = log_weight
    np.testing.assert_array_equal(
        choose_most_probable(
            wide, np.pad(r, ((0, 0), (0, 2))), np.pad(c, ((0, 0), (0, 2))), np.array([2])
        )[:, :3, :2],
        choose_most_probable(log_weight, r, c, np.array([2])),
    )
