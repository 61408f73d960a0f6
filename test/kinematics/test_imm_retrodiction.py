"""Retrodiction with interacting models: plain loops, limiting cases, and what it must improve."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from imm_examples import H, R, kalman_update, loop_moments, random_mixture, random_models
from scipy.stats import chi2, multivariate_normal

from gda_tracker.kinematics import imm
from gda_tracker.kinematics.imm_retrodiction import (
    ModelMixtures,
    between_imm,
    fixed_interval_imm,
    fixed_lag_imm,
    retrodict_imm,
)
from gda_tracker.kinematics.motion_models import constant_velocity, white_noise_acceleration
from gda_tracker.kinematics.retrodiction import between, fixed_interval, retrodict

seeds = st.integers(0, 2**32 - 1)


def loop_retrodiction(filtered, later, switching, transition, noise):
    """The formulas of Koch 2014, (3.91)-(3.100) for one hypothesis, number by number."""
    (weight, mean, covariance), (late_weight, late_mean, late_covariance) = filtered, later
    count = len(weight)
    pairs = {}
    for j in range(count):
        share = []
        for i in range(count):
            s = transition[j] @ covariance[i] @ transition[j].T + noise[j]
            density = multivariate_normal(transition[j] @ mean[i], s).pdf(late_mean[j])
            share.append(switching[j, i] * weight[i] * density)
            w = covariance[i] @ transition[j].T @ np.linalg.inv(s)
            x = mean[i] + w @ (late_mean[j] - transition[j] @ mean[i])
            pairs[j, i] = x, covariance[i] + w @ (late_covariance[j] - s) @ w.T
        for i in range(count):
            pairs[j, i] = (share[i] / sum(share) * late_weight[j], *pairs[j, i])
    result = []
    for i in range(count):
        p = [pairs[j, i][0] for j in range(count)]
        share = [value / sum(p) for value in p]
        result.append(
            (
                sum(p),
                *loop_moments(share, *zip(*(pairs[j, i][1:] for j in range(count)), strict=True)),
            )
        )
    return result


@settings(derandomize=True, deadline=None, max_examples=30)
@given(seeds, st.integers(1, 3), st.integers(1, 3))
def test_equals_plain_loops(seed, count, hypotheses):
    rng = np.random.default_rng(seed)
    transition, noise, switching = random_models(rng, count)
    filtered = ModelMixtures(*random_mixture(rng, hypotheses, count))
    later = ModelMixtures(*random_mixture(rng, hypotheses, count))
    later.covariance *= 0.2
    got = retrodict_imm(filtered, later, switching, transition, noise)
    np.testing.assert_allclose(got.weight.sum(axis=1), 1.0, rtol=1e-12)
    for h in range(hypotheses):
        one = [(m.weight[h], m.mean[h], m.covariance[h]) for m in (filtered, later)]
        expected = loop_retrodiction(*one, switching, transition, noise)
        for i, (weight, mean, covariance) in enumerate(expected):
            assert got.weight[h, i] == pytest.approx(weight, rel=1e-8, abs=1e-14)
            np.testing.assert_allclose(got.mean[h, i], mean, rtol=1e-7, atol=1e-7)
            np.testing.assert_allclose(got.covariance[h, i], covariance, rtol=1e-7, atol=1e-6)


def filtered_imm(models, start, measured):
    """IMM over the scans with the linear measurement; one step of ``models`` between scans."""
    transition, noise, switching = models
    state, found = start, []
    for k, z in enumerate(measured):
        if k:
            weight, mean, covariance = imm.mix(*state, switching)
            state = weight, *imm.predict(mean, covariance, transition, noise)
        weight, mean, covariance = state
        mean, covariance, log_likelihood = kalman_update(mean, covariance, z[:, None])
        state = imm.reweight(weight, log_likelihood)[0], mean, covariance
        found.append(ModelMixtures(*state))
    return found


def repeated(models, steps):
    return [np.array([part] * steps) for part in (models[2], models[0], models[1])]


def test_identical_models_are_one_rauch_tung_striebel_smoother():
    rng = np.random.default_rng(3)
    f, q = constant_velocity(2.0, 3.0)
    models = np.stack([f, f]), np.stack([q, q]), np.array([[0.9, 0.3], [0.1, 0.7]])
    p0 = np.diag([400.0, 400.0, 100.0, 100.0])
    start = np.full((2, 2), 0.5), np.zeros((2, 2, 4)), np.broadcast_to(p0, (2, 2, 4, 4))
    found = filtered_imm(models, start, rng.normal(0, 20, (6, 2, 2)))
    back = fixed_interval_imm(found, *repeated(models, 5))
    mean = np.array([imm.combine(s.weight, s.mean, s.covariance)[0] for s in found])
    covariance = np.array([imm.combine(s.weight, s.mean, s.covariance)[1] for s in found])
    plain = fixed_interval(mean, covariance, np.array([f] * 5)[:, None], np.array([q] * 5)[:, None])
    for k, state in enumerate(back):
        combined = imm.combine(state.weight, state.mean, state.covariance)
        np.testing.assert_allclose(combined[0], plain[0][k], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(combined[1], plain[1][k], rtol=1e-9, atol=1e-9)
    step = [np.stack([a, a]) for a in white_noise_acceleration(0.8, 5.0)]
    rest = [np.stack([a, a]) for a in white_noise_acceleration(1.2, 5.0)]
    middle = between_imm(found[2], back[3], (models[2], *step), (models[2], *rest))
    combined = imm.combine(middle.weight, middle.mean, middle.covariance)
    expected = between(
        mean[2],
        covariance[2],
        plain[0][3],
        plain[1][3],
        (step[0][0], step[1][0]),
        (rest[0][0], rest[1][0]),
    )
    np.testing.assert_allclose(combined[0], expected[0], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(combined[1], expected[1], rtol=1e-9, atol=1e-9)


def test_models_that_never_change_are_smoothed_each_alone():
    """Exact here: the weights of the end, and a smoother for each model."""
    rng = np.random.default_rng(5)
    transition, noise, _ = random_models(rng, 2)
    filtered = ModelMixtures(*random_mixture(rng, 3, 2))
    later = ModelMixtures(*random_mixture(rng, 3, 2))
    got = retrodict_imm(filtered, later, np.eye(2), transition, noise)
    np.testing.assert_allclose(got.weight, later.weight, rtol=1e-12)
    alone = retrodict(
        filtered.mean, filtered.covariance, later.mean, later.covariance, transition, noise
    )
    np.testing.assert_allclose(got.mean, alone[0], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(got.covariance, alone[1], rtol=1e-12, atol=1e-10)


def test_no_later_scan_and_no_later_information_change_nothing():
    """A pure prediction tells nothing: mixture means and weights come back."""
    rng = np.random.default_rng(6)
    f, q = constant_velocity(2.0, 3.0)
    switching = np.array([[0.9, 0.2], [0.1, 0.8]])
    transition, noise = np.stack([f, f]), np.stack([q, 4 * q])
    weight, mean, covariance = random_mixture(rng, 2, 2)
    mean[:], covariance[:] = mean[:, :1], covariance[:, :1]  # nothing is lost in mixing
    predicted, mixed, spread = imm.mix(weight, mean, covariance, switching)
    later = ModelMixtures(predicted, *imm.predict(mixed, spread, transition, noise))
    got = retrodict_imm(
        ModelMixtures(weight, mean, covariance), later, switching, transition, noise
    )
    np.testing.assert_allclose(got.weight, weight, rtol=1e-10)
    np.testing.assert_allclose(got.mean, mean, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(got.covariance, covariance, rtol=1e-8, atol=1e-8)
    only = [ModelMixtures(weight, mean, covariance)]
    assert fixed_interval_imm(only, *repeated((transition, noise, switching), 0)) == only


@pytest.mark.parametrize("lag", [0, 2, 9])
def test_fixed_lag_equals_fixed_intervals_that_end_there(lag):
    rng = np.random.default_rng(7)
    models = random_models(rng, 2)
    found = filtered_imm(models, random_mixture(rng, 2, 2), rng.normal(0, 20, (5, 2, 2)))
    steps = repeated(models, 4)
    got = fixed_lag_imm(found, *steps, lag)
    for k, state in enumerate(got):
        end = min(k + lag, 4)
        part = fixed_interval_imm(found[: end + 1], *(s[:end] for s in steps))[k]
        np.testing.assert_allclose(state.weight, part.weight, rtol=1e-12)
        np.testing.assert_allclose(state.mean, part.mean, rtol=1e-12)
    with pytest.raises(ValueError, match="lag = -2"):
        fixed_lag_imm(found, *steps, -2)


def test_switching_targets_are_known_better_afterwards():
    """400 targets with a manoeuvre in the middle: state and model, against the filter (seeded)."""
    rng = np.random.default_rng(19)
    runs, scans, dt = 400, 14, 2.0
    sigma = np.array([0.5, 15.0])
    transition, noise = (
        np.stack(part) for part in zip(*(constant_velocity(dt, s) for s in sigma), strict=True)
    )
    switching = imm.sojourn_transition(dt, [20.0, 8.0])
    p0 = np.diag([100.0, 100.0, 25.0, 25.0])
    truth = rng.multivariate_normal(np.zeros(4), p0, runs)
    model = np.zeros(runs, dtype=int)
    states, modes, measured = [], [], []
    for k in range(scans):
        if k:
            stay = switching[model, model]
            model = np.where(rng.random(runs) < stay, model, 1 - model)
            a = rng.normal(size=(runs, 2)) * sigma[model, None]
            truth = truth @ transition[0].T + np.hstack([a * dt**2 / 2, a * dt])
        states.append(truth)
        modes.append(model)
        measured.append(truth @ H.T + rng.multivariate_normal(np.zeros(2), R, runs))
    start = (
        np.tile([0.99, 0.01], (runs, 1)),
        np.zeros((runs, 2, 4)),
        np.broadcast_to(p0, (runs, 2, 4, 4)),
    )
    models = transition, noise, switching
    found = filtered_imm(models, start, np.array(measured))
    back = fixed_interval_imm(found, *repeated(models, scans - 1))

    def scores(mixtures):
        error, log_score, nees = [], [], []
        for state, mode, s in list(zip(states, modes, mixtures, strict=True))[2:-2]:
            mean, covariance = imm.combine(s.weight, s.mean, s.covariance)
            gap = state - mean
            error.append(np.mean(gap**2))
            log_score.append(np.mean(np.log(s.weight[np.arange(runs), mode])))
            nees.append(
                np.mean(np.sum(gap * np.linalg.solve(covariance, gap[..., None])[..., 0], -1))
            )
        return np.mean(error), np.mean(log_score), np.mean(nees)

    before, after = scores(found), scores(back)
    assert after[0] < 0.6 * before[0]
    assert after[1] > before[1] + 0.05
    # Approximations are two: mixing, and c at the mean. It stays near consistent.
    low, high = chi2.ppf([0.025, 0.975], 4 * runs) / runs
    assert 0.85 * low < after[2] < 1.15 * high
