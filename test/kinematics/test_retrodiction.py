"""Retrodiction against filterpy, the joint Gaussian of all states, and trees of hypotheses."""

import numpy as np
import pytest
from filterpy.kalman import rts_smoother
from hypothesis import given, settings
from hypothesis import strategies as st
from imm_examples import H, R, kalman_update, random_models
from scipy.stats import chi2

from gda_tracker.kinematics.motion_models import constant_velocity, singer, white_noise_acceleration
from gda_tracker.kinematics.retrodiction import (
    between,
    fixed_interval,
    fixed_lag,
    retrodict,
    retrodicted_weights,
)


def filtered(rng, transition, noise, measured, batch=()):
    """Kalman filter over the scans; ``measured`` (K, ..., 2), NaN for none; (K, ..., s) results."""
    size = transition.shape[-1]
    h = np.eye(2, size)
    mean = np.zeros((*batch, size))
    covariance = np.broadcast_to(np.diag(np.full(size, 400.0)), (*batch, size, size)).copy()
    means, covariances = [], []
    for k, z in enumerate(measured):
        if k:
            mean = mean @ transition[k - 1].T
            covariance = transition[k - 1] @ covariance @ transition[k - 1].T + noise[k - 1]
        if not np.isnan(z).any():
            mean, covariance, _ = kalman_update(mean, covariance, z, h)
        means.append(mean)
        covariances.append(covariance)
    return np.array(means), np.array(covariances)


def joint_posterior(transition, noise, measured):
    """All states at once from the joint Gaussian of states and measurements: (K, s), (K, s, s)."""
    count, size = len(measured), transition.shape[-1]
    cov = np.zeros((count * size, count * size))
    marginal = np.diag(np.full(size, 400.0))
    for k in range(count):
        if k:
            marginal = transition[k - 1] @ marginal @ transition[k - 1].T + noise[k - 1]
        cross = marginal
        cov[k * size : (k + 1) * size, k * size : (k + 1) * size] = cross
        for later in range(k + 1, count):
            cross = cross @ transition[later - 1].T
            cov[k * size : (k + 1) * size, later * size : (later + 1) * size] = cross
            cov[later * size : (later + 1) * size, k * size : (k + 1) * size] = cross.T
    seen = [k for k in range(count) if not np.isnan(measured[k]).any()]
    h = np.zeros((2 * len(seen), count * size))
    for row, k in enumerate(seen):
        h[2 * row : 2 * row + 2, k * size : (k + 1) * size] = np.eye(2, size)
    z = np.concatenate([measured[k] for k in seen])
    s = h @ cov @ h.T + np.kron(np.eye(len(seen)), R)
    gain = cov @ h.T @ np.linalg.inv(s)
    mean = (gain @ z).reshape(count, size)
    posterior = cov - gain @ s @ gain.T
    blocks = [posterior[k * size : (k + 1) * size, k * size : (k + 1) * size] for k in range(count)]
    return mean, np.array(blocks)


def example(seed, scans=8):
    rng = np.random.default_rng(seed)
    transition, noise, _ = random_models(rng, scans - 1)
    measured = rng.normal(0, 20, (scans, 2))
    measured[3] = np.nan  # a miss
    return rng, transition, noise, measured


@pytest.mark.parametrize("seed", [1, 2])
def test_fixed_interval_equals_filterpy_and_the_joint_gaussian(seed):
    rng, transition, noise, measured = example(seed)
    mean, covariance = filtered(rng, transition, noise, measured)
    got, spread = fixed_interval(mean, covariance, transition, noise)
    # filterpy takes one matrix for each scan; its last one is not used.
    repeat = [*range(len(transition)), len(transition) - 1]
    peer, peer_spread, _, _ = rts_smoother(mean, covariance, transition[repeat], noise[repeat])
    np.testing.assert_allclose(got, peer, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(spread, peer_spread, rtol=1e-9, atol=1e-9)
    exact, exact_spread = joint_posterior(transition, noise, measured)
    np.testing.assert_allclose(got, exact, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(spread, exact_spread, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("lag", [0, 1, 3, 20])
def test_fixed_lag_equals_fixed_intervals_that_end_there(lag):
    rng, transition, noise, measured = example(3)
    mean, covariance = filtered(rng, transition, noise, measured)
    got, spread = fixed_lag(mean, covariance, transition, noise, lag)
    for k in range(len(mean)):
        end = min(k + lag, len(mean) - 1) + 1
        part = fixed_interval(mean[:end], covariance[:end], transition[: end - 1], noise[: end - 1])
        np.testing.assert_allclose(got[k], part[0][k], rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(spread[k], part[1][k], rtol=1e-12, atol=1e-12)
    with pytest.raises(ValueError, match="lag = -1"):
        fixed_lag(mean, covariance, transition, noise, -1)


def test_many_targets_at_once_are_each_alone():
    rng, transition, noise, _ = example(5)
    measured = rng.normal(0, 20, (8, 3, 2))
    mean, covariance = filtered(rng, transition, noise, measured, batch=(3,))
    both = fixed_interval(mean, covariance, transition[:, None], noise[:, None])
    lagged = fixed_lag(mean, covariance, transition[:, None], noise[:, None], 2)
    for t in range(3):
        alone = fixed_interval(mean[:, t], covariance[:, t], transition, noise)
        np.testing.assert_allclose(both[0][:, t], alone[0], rtol=1e-12)
        np.testing.assert_allclose(both[1][:, t], alone[1], rtol=1e-12, atol=1e-12)
        alone = fixed_lag(mean[:, t], covariance[:, t], transition, noise, 2)
        np.testing.assert_allclose(lagged[0][:, t], alone[0], rtol=1e-12)


@settings(derandomize=True, deadline=None, max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_retrodiction_never_widens_and_stays_definite(seed):
    rng, transition, noise, measured = example(seed)
    mean, covariance = filtered(rng, transition, noise, measured)
    _, spread = fixed_interval(mean, covariance, transition, noise)
    for before, after in zip(covariance, spread, strict=True):
        scale = np.trace(before)
        assert np.linalg.eigvalsh(after).min() > 0.0
        assert np.linalg.eigvalsh(before - after).min() > -1e-9 * scale


def continuous(dt):
    return singer(dt, 3.0, 9.0)


@pytest.mark.parametrize("model", [continuous, lambda dt: white_noise_acceleration(dt, 5.0)])
@pytest.mark.parametrize("share", [0.0, 0.2, 0.7, 1.0])
def test_between_scans_equals_a_scan_without_a_detection(model, share):
    """With steps that compose: as if a scan without detections had been there all along."""
    rng, dt = np.random.default_rng(9), 5.0
    measured = rng.normal(0, 50, (6, 2))
    whole = [np.array([model(dt)[part]] * 5) for part in (0, 1)]
    mean, covariance = filtered(rng, *whole, measured)
    back, spread = fixed_interval(mean, covariance, *whole)
    first, second = model(share * dt), model((1.0 - share) * dt)
    got = between(mean[2], covariance[2], back[3], spread[3], first, second)

    with_empty = np.insert(measured, 3, np.nan, axis=0)
    steps = [np.array([*w[:2], a, b, *w[3:]]) for w, a, b in zip(whole, first, second, strict=True)]
    mean, covariance = filtered(rng, *steps, with_empty)
    expected = fixed_interval(mean, covariance, *steps)
    np.testing.assert_allclose(got[0], expected[0][3], rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(got[1], expected[1][3], rtol=1e-7, atol=1e-6)
    assert np.linalg.eigvalsh(got[1]).min() > 0.0
    if share == 1.0:
        np.testing.assert_allclose(got[0], back[3], rtol=1e-9, atol=1e-9)


def test_nothing_to_go_back_to():
    one = fixed_interval(np.ones((1, 4)), np.eye(4)[None], np.zeros((0, 4, 4)), np.zeros((0, 4, 4)))
    np.testing.assert_array_equal(one[0], np.ones((1, 4)))
    lagged = fixed_lag(
        np.ones((1, 4)), np.eye(4)[None], np.zeros((0, 4, 4)), np.zeros((0, 4, 4)), 3
    )
    np.testing.assert_array_equal(lagged[1], np.eye(4)[None])


def test_perfect_knowledge_of_the_later_state_worked():
    """Standing target without noise: what is known later was known before."""
    mean, covariance = retrodict(
        np.array([3.0]),
        np.array([[4.0]]),
        np.array([5.0]),
        np.array([[0.5]]),
        np.eye(1),
        np.zeros((1, 1)),
    )
    np.testing.assert_allclose(mean, [5.0])
    np.testing.assert_allclose(covariance, [[0.5]])


def test_matched_models_are_consistent():
    """NEES of retrodicted states, scan by scan: inside the 95 % bounds on nearly all (seeded)."""
    rng = np.random.default_rng(17)
    runs, scans = 300, 12
    f, q = constant_velocity(2.0, 3.0)
    truth = rng.normal(0, 20, (runs, 4))
    states, measured = [truth], []
    for k in range(scans):
        if k:
            acceleration = rng.normal(0, 3.0, (runs, 2))
            truth = truth @ f.T + np.hstack([2.0 * acceleration, 2.0 * acceleration])
            states.append(truth)
        measured.append(truth @ H.T + rng.multivariate_normal(np.zeros(2), R, runs))
    steps = np.array([f] * (scans - 1)), np.array([q] * (scans - 1))
    mean, covariance = filtered(rng, *steps, np.array(measured), batch=(runs,))
    back, spread = fixed_interval(mean, covariance, steps[0][:, None], steps[1][:, None])
    error = np.array(states) - back
    nees = np.mean(np.sum(error * np.linalg.solve(spread, error[..., None])[..., 0], -1), axis=1)
    low, high = chi2.ppf([0.025, 0.975], 4 * runs) / runs
    assert np.count_nonzero((nees > low) & (nees < high)) >= scans - 2
    squared = lambda guess: np.mean((np.array(states) - guess)[:-1] ** 2)  # noqa: E731
    assert squared(back) < 0.75 * squared(mean)


def test_weights_of_parents_are_the_sums_of_their_children():
    """Two roots; root 1 dies out; (3.107)."""
    weights = retrodicted_weights(
        np.array([2.0, 3.0, 5.0]), [np.array([0, 2, 2]), np.array([0, 1, 0, 1])]
    )
    np.testing.assert_allclose(weights[0], [0.2, 0.3, 0.5])
    np.testing.assert_allclose(weights[1], [0.2, 0.0, 0.8, 0.0])
    np.testing.assert_allclose(weights[2], [1.0, 0.0])


@settings(derandomize=True, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_retrodicted_weights_equal_sums_over_paths(seed):
    rng = np.random.default_rng(seed)
    sizes = rng.integers(1, 8, 4)
    leaf = rng.random(sizes[0]) + 0.01
    parents = [rng.integers(0, sizes[k + 1], sizes[k]) for k in range(3)]
    got = retrodicted_weights(leaf, parents)
    row = np.arange(sizes[0])
    for level, weights in enumerate(got):
        expected = np.zeros(len(weights))
        for l, r in zip(leaf / leaf.sum(), row, strict=True):
            expected[r] += l
        np.testing.assert_allclose(weights, expected, rtol=1e-12)
        assert weights.sum() == pytest.approx(1.0)
        if level < 3:
            row = parents[level][row]


def test_weights_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match=r"parents\[0\]"):
        retrodicted_weights(np.ones(2), [np.array([0])])
    with pytest.raises(ValueError, match=r"parents\[0\]"):
        retrodicted_weights(np.ones(2), [np.array([0, 3]), np.array([0, 0])])
    with pytest.raises(ValueError, match="leaf_weight"):
        retrodicted_weights(np.zeros(2), [np.array([0, 0])])
