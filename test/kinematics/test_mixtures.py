"""Mixtures against loops over components; what must be kept when they shrink."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.kinematics.mixtures import (
    GaussianMixtures,
    cap,
    detection_weights,
    merge,
    moments,
    prune,
)

seeds = st.integers(0, 2**32 - 1)
sizes = st.lists(st.integers(1, 7), min_size=1, max_size=5)


def random_mixtures(seed, counts, size=3, spread=2.0):
    rng = np.random.default_rng(seed)
    start = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    k = start[-1]
    root = rng.normal(size=(k, size, size))
    weight = np.concatenate([rng.dirichlet(np.full(n, 0.4)) for n in counts])
    return GaussianMixtures(
        start,
        weight,
        rng.normal(0, spread, (k, size)),
        root @ root.transpose(0, 2, 1) + 0.1 * np.eye(size),
    )


def loop_moments(weight, mean, covariance):
    total = sum(weight)
    centre = sum(w * m for w, m in zip(weight, mean, strict=True)) / total
    spread = sum(
        w * (c + np.outer(m - centre, m - centre))
        for w, m, c in zip(weight, mean, covariance, strict=True)
    )
    return centre, spread / total


def loop_merge(weight, mean, covariance, threshold):
    """Salmond's greedy clustering of one mixture, written out."""
    left, found = list(np.argsort(-np.abs(weight), kind="stable")), []
    while left:
        c = left[0]
        inverse = np.linalg.inv(covariance[c])
        near = [
            i
            for i in left
            if i == c
            or (
                (mean[i] - mean[c]) @ inverse @ (mean[i] - mean[c]) <= threshold
                and np.sign(weight[i]) == np.sign(weight[c])
            )
        ]
        found.append(
            (weight[near].sum(), *loop_moments(weight[near], mean[near], covariance[near]))
        )
        left = [i for i in left if i not in near]
    return found


@settings(derandomize=True, deadline=None, max_examples=40)
@given(seeds, sizes)
def test_moments_equal_loops(seed, counts):
    mixtures = random_mixtures(seed, counts)
    mean, covariance = mixtures.moments()
    for h in range(len(counts)):
        rows = slice(mixtures.start[h], mixtures.start[h + 1])
        expected = loop_moments(
            mixtures.weight[rows], mixtures.mean[rows], mixtures.covariance[rows]
        )
        np.testing.assert_allclose(mean[h], expected[0], rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(covariance[h], expected[1], rtol=1e-12, atol=1e-12)
        one = moments(mixtures.weight[rows], mixtures.mean[rows], mixtures.covariance[rows])
        np.testing.assert_allclose(one[0], expected[0], rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(one[1], expected[1], rtol=1e-12, atol=1e-12)


@settings(derandomize=True, deadline=None, max_examples=60)
@given(seeds, sizes, st.sampled_from([0.5, 3.0, 20.0, np.inf]), st.booleans())
def test_merging_equals_the_loop_and_keeps_the_moments(seed, counts, threshold, negative):
    mixtures = random_mixtures(seed, counts)
    if negative:
        mixtures.weight[np.random.default_rng(seed).random(len(mixtures.weight)) < 0.3] *= -1.0
    merged = merge(mixtures, threshold)
    assert len(merged) == len(counts)
    for h in range(len(counts)):
        rows = slice(mixtures.start[h], mixtures.start[h + 1])
        expected = loop_merge(
            mixtures.weight[rows], mixtures.mean[rows], mixtures.covariance[rows], threshold
        )
        got = slice(merged.start[h], merged.start[h + 1])
        assert got.stop - got.start == len(expected)
        for k, (weight, mean, covariance) in enumerate(expected, got.start):
            assert merged.weight[k] == pytest.approx(weight, rel=1e-12)
            np.testing.assert_allclose(merged.mean[k], mean, rtol=1e-9, atol=1e-12)
            np.testing.assert_allclose(merged.covariance[k], covariance, rtol=1e-9, atol=1e-12)
            np.linalg.cholesky(merged.covariance[k])  # of either sign: positive definite
    np.testing.assert_allclose(merged.totals(), mixtures.totals(), rtol=1e-12, atol=1e-14)
    if not negative:
        for one, other in zip(merged.moments(), mixtures.moments(), strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-10)


@settings(derandomize=True, deadline=None, max_examples=40)
@given(seeds, sizes, st.integers(1, 4), st.sampled_from([0.0, 0.05, 0.3, 2.0]))
def test_cap_and_prune_keep_the_heaviest_and_the_sum(seed, counts, most, share):
    mixtures = random_mixtures(seed, counts)
    capped, pruned = cap(mixtures, most), prune(mixtures, share)
    for h, count in enumerate(counts):
        rows = slice(mixtures.start[h], mixtures.start[h + 1])
        weight = mixtures.weight[rows]
        kept = np.sort(np.argsort(-weight, kind="stable")[:most])
        got = slice(capped.start[h], capped.start[h + 1])
        np.testing.assert_array_equal(capped.mean[got], mixtures.mean[rows][kept])
        np.testing.assert_allclose(capped.weight[got], weight[kept] / weight[kept].sum())
        kept = (weight >= share * weight.sum()) | (np.arange(count) == np.argmax(weight))
        got = slice(pruned.start[h], pruned.start[h + 1])
        np.testing.assert_array_equal(pruned.covariance[got], mixtures.covariance[rows][kept])
        np.testing.assert_allclose(pruned.weight[got], weight[kept] / weight[kept].sum())


def test_negative_weights_survive_pruning_and_capping():
    """An unresolved pair: 1 - P_u brings a negative component (Koch and van Keuk)."""
    mixtures = GaussianMixtures(
        np.array([0, 4]),
        np.array([1.2, -0.4, 0.15, 0.05]),
        np.arange(4.0)[:, None],
        np.ones((4, 1, 1)),
    )
    pruned = prune(mixtures, 0.1)
    assert pruned.mean[:, 0].tolist() == [0.0, 1.0]
    np.testing.assert_allclose(pruned.weight, [1.2 / 0.8, -0.4 / 0.8])
    assert cap(mixtures, 3).mean[:, 0].tolist() == [0.0, 1.0, 2.0]


def test_empty_mixtures_stay_and_have_no_moments():
    empty = GaussianMixtures(
        np.array([0, 0, 2, 2]), np.array([0.5, 0.5]), np.zeros((2, 1)), np.ones((2, 1, 1))
    )
    for shrunk in (merge(empty, 1.0), prune(empty, 0.1), cap(empty, 1)):
        assert np.diff(shrunk.start).tolist() == [0, len(shrunk.weight), 0]
    with pytest.raises(ValueError, match="mixture 0 has no weight"):
        empty.moments()
    with pytest.raises(ValueError, match="most = 0"):
        cap(empty, 0)


def test_normalised_weights_sum_to_one():
    mixtures = random_mixtures(3, [2, 5])
    mixtures.weight *= 7.0
    np.testing.assert_allclose(mixtures.normalised().totals(), 1.0, rtol=1e-14)


@pytest.mark.parametrize("detections", [0, 1, 4])
def test_merging_all_is_probabilistic_data_association(detections):
    """Against the textbook form with combined innovation (Bar-Shalom), for a linear measurement."""
    rng = np.random.default_rng(detections)
    x, root = rng.normal(size=4), rng.normal(size=(4, 4))
    p, r = root @ root.T + np.eye(4), np.diag([0.5, 0.8])
    h = np.eye(2, 4)
    s = h @ p @ h.T + r
    w = p @ h.T @ np.linalg.inv(s)
    z = h @ x + rng.multivariate_normal(np.zeros(2), s, detections)
    residual = z - h @ x
    squared = np.einsum("di,ij,dj->d", residual, np.linalg.inv(s), residual)
    log_likelihood = -0.5 * squared - 0.5 * np.log(np.linalg.det(2 * np.pi * s))
    beta = detection_weights(log_likelihood, 0.9, 0.02)

    odds = np.append(0.1 * 0.02, 0.9 * np.exp(log_likelihood))
    np.testing.assert_allclose(beta, odds / odds.sum(), rtol=1e-12)

    updated = p - w @ s @ w.T
    mixture = GaussianMixtures(
        np.array([0, detections + 1]),
        beta,
        np.vstack([x, x + residual @ w.T]),
        np.concatenate([p[None], np.tile(updated, (detections, 1, 1))]),
    )
    one = merge(mixture, np.inf)
    combined = beta[1:] @ residual
    spread = np.einsum("d,di,dj->ij", beta[1:], residual, residual) - np.outer(combined, combined)
    assert len(one.weight) == 1
    np.testing.assert_allclose(one.mean[0], x + w @ combined, rtol=1e-10)
    expected = beta[0] * p + (1 - beta[0]) * updated + w @ spread @ w.T
    np.testing.assert_allclose(one.covariance[0], expected, rtol=1e-10, atol=1e-10)


def test_detection_weights_at_the_ends():
    np.testing.assert_array_equal(detection_weights(np.array([-3.0]), 1.0, 1e-6), [0.0, 1.0])
    np.testing.assert_array_equal(detection_weights(np.array([-3.0]), 0.0, 1e-6), [1.0, 0.0])
    far = detection_weights(np.array([-5000.0, -5001.0]), 1.0, 1e-6)
    np.testing.assert_allclose(far[1] / far[2], np.e, rtol=1e-12)
    with pytest.raises(ValueError, match="no outcome"):
        detection_weights(np.zeros(0), 1.0, 1e-6)
