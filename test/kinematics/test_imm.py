"""IMM and GPB2 against filterpy, enumeration of model histories, and what must hold always."""

import itertools

import numpy as np
import pytest
from filterpy.kalman import IMMEstimator, KalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st
from imm_examples import H, R, kalman_update, loop_moments, random_mixture, random_models
from scipy.stats import chi2

from gda_tracker.kinematics import imm
from gda_tracker.kinematics.motion_models import constant_velocity

seeds = st.integers(0, 2**32 - 1)


def cycle(weight, mean, covariance, models, z):
    """One IMM cycle with the linear measurement of the examples."""
    transition, noise, switching = models
    weight, mean, covariance = imm.mix(weight, mean, covariance, switching)
    mean, covariance = imm.predict(mean, covariance, transition, noise)
    mean, covariance, log_likelihood = kalman_update(mean, covariance, z[:, None])
    weight, evidence = imm.reweight(weight, log_likelihood)
    return weight, mean, covariance, evidence


@pytest.mark.parametrize("count", [2, 3])
def test_equals_filterpy_over_many_scans(count):
    rng = np.random.default_rng(count)
    transition, noise, switching = random_models(rng, count)
    weight, mean, covariance = random_mixture(rng, 1, count)
    filters = []
    for m in range(count):
        peer = KalmanFilter(dim_x=4, dim_z=2)
        peer.x, peer.P = mean[0, m].copy(), covariance[0, m].copy()
        peer.F, peer.Q, peer.H, peer.R = transition[m], noise[m], H, R
        filters.append(peer)
    # filterpy's rows sum to one.
    peer = IMMEstimator(filters, weight[0].copy(), switching.T.copy())
    for _ in range(15):
        z = rng.normal(0, 15, 2)
        peer.predict()
        predicted = imm.mix(weight, mean, covariance, switching)
        prior = imm.combine(weight, *imm.predict(predicted[1], predicted[2], transition, noise))
        np.testing.assert_allclose(prior[0][0], peer.x_prior, rtol=1e-9)
        weight, mean, covariance, _ = cycle(
            weight, mean, covariance, (transition, noise, switching), z[None]
        )
        peer.update(z)
        np.testing.assert_allclose(weight[0], peer.mu, rtol=1e-9)
        for m in range(count):
            np.testing.assert_allclose(mean[0, m], filters[m].x, rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(covariance[0, m], filters[m].P, rtol=1e-9, atol=1e-9)
        combined = imm.combine(weight, mean, covariance)
        np.testing.assert_allclose(combined[0][0], peer.x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(combined[1][0], peer.P, rtol=1e-9, atol=1e-9)


@settings(derandomize=True, deadline=None, max_examples=25)
@given(seeds, st.integers(1, 4), st.integers(0, 4), st.booleans())
def test_mixing_and_prediction_equal_moments_after_the_prediction(seed, count, hypotheses, own):
    """Koch 2014, (3.28)-(3.35) as written: predict every pair, then match moments."""
    rng = np.random.default_rng(seed)
    transition, noise, switching = random_models(rng, count)
    weight, mean, covariance = random_mixture(rng, hypotheses, count)
    if own:  # one transition matrix for each hypothesis
        switching = rng.dirichlet(np.ones(count), (hypotheses, count)).transpose(0, 2, 1)
    new_weight, mixed, mixed_covariance = imm.mix(weight, mean, covariance, switching)
    got, got_covariance = imm.predict(mixed, mixed_covariance, transition, noise)
    for h in range(hypotheses):
        p = switching[h] if own else switching
        for j in range(count):
            total = sum(p[j, i] * weight[h, i] for i in range(count))
            assert new_weight[h, j] == pytest.approx(total, rel=1e-12)
            share = [p[j, i] * weight[h, i] / total for i in range(count)]
            moved = [transition[j] @ mean[h, i] for i in range(count)]
            spread = [
                transition[j] @ covariance[h, i] @ transition[j].T + noise[j] for i in range(count)
            ]
            centre, width = loop_moments(share, moved, spread)
            np.testing.assert_allclose(got[h, j], centre, rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(got_covariance[h, j], width, rtol=1e-9, atol=1e-9)


@settings(derandomize=True, deadline=None, max_examples=25)
@given(seeds, st.integers(2, 4), st.integers(1, 4))
def test_weights_sum_to_one_and_covariances_are_definite(seed, count, hypotheses):
    rng = np.random.default_rng(seed)
    models = random_models(rng, count)
    state = random_mixture(rng, hypotheses, count)
    for _ in range(5):
        *state, evidence = cycle(*state, models, rng.normal(0, 20, (hypotheses, 2)))
        np.testing.assert_allclose(state[0].sum(axis=1), 1.0, rtol=1e-12)
        assert (state[0] >= 0.0).all()
        np.linalg.cholesky(state[2])
        np.linalg.cholesky(imm.combine(*state)[1])
        assert np.isfinite(evidence).all()


def test_identical_models_are_one_kalman_filter():
    rng = np.random.default_rng(8)
    f, q = (np.array(a) for a in constant_velocity(2.0, 3.0))
    models = (np.stack([f] * 3), np.stack([q] * 3), rng.dirichlet(np.ones(3), 3).T)
    _, mean, covariance = random_mixture(rng, 2, 1)
    weight = np.full((2, 3), 1 / 3)
    many = np.repeat(mean, 3, axis=1), np.repeat(covariance, 3, axis=1)
    one, one_covariance = mean[:, 0], covariance[:, 0]
    for _ in range(6):
        z = rng.normal(0, 10, (2, 2))
        weight, *many, evidence = cycle(weight, *many, models, z)
        one, one_covariance = imm.predict(one, one_covariance, f, q)
        one, one_covariance, log_likelihood = kalman_update(one, one_covariance, z)
        combined = imm.combine(weight, *many)
        np.testing.assert_allclose(combined[0], one, rtol=1e-11, atol=1e-11)
        np.testing.assert_allclose(combined[1], one_covariance, rtol=1e-11, atol=1e-11)
        np.testing.assert_allclose(evidence, log_likelihood, rtol=1e-11)


def enumerate_histories(models, start_weight, start, measurements):
    """Weight, mean and covariance of every history of models, exactly, and the evidence.

    ``start_weight`` (M,) is p(i_0); all start from the one Gaussian ``start``.
    """
    transition, noise, switching = models
    count, found = len(transition), {}
    for history in itertools.product(range(count), repeat=len(measurements) + 1):
        weight, (mean, covariance) = start_weight[history[0]], start
        for z, before, now in zip(measurements, history[:-1], history[1:], strict=True):
            mean = transition[now] @ mean
            covariance = transition[now] @ covariance @ transition[now].T + noise[now]
            mean, covariance, log_likelihood = kalman_update(mean, covariance, z)
            weight = weight * switching[now, before] * np.exp(log_likelihood)
        found[history] = weight, mean, covariance
    return found


def test_one_step_evidence_and_gpb2_over_two_steps_are_the_full_mixture():
    """From one Gaussian GPB2 loses nothing in two steps; the IMM does, but not in one."""
    rng = np.random.default_rng(4)
    models = random_models(rng, 3)
    start_weight, mean, covariance = random_mixture(rng, 1, 3)
    mean[:], covariance[:] = mean[:, :1], covariance[:, :1]
    z = rng.normal(0, 12, (2, 2))
    transition, noise, switching = models

    weight, m, c = start_weight, mean, covariance
    evidence = []
    for step in range(2):
        weight, m, c = imm.branch(weight, m, c, switching, transition, noise)
        m, c, log_likelihood = kalman_update(m, c, z[step])
        weight, log_evidence = imm.reweight(weight, log_likelihood)
        evidence.append(log_evidence[0])
        if step == 0:
            weight, m, c = imm.merge_branches(weight, m, c)

    full = enumerate_histories(models, start_weight[0], (mean[0, 0], covariance[0, 0]), z)
    total = sum(w for w, _, _ in full.values())
    assert sum(evidence) == pytest.approx(np.log(total), rel=1e-12)
    for j in range(3):
        for i in range(3):
            same = [v for history, v in full.items() if history[1:] == (i, j)]
            share = sum(w for w, _, _ in same) / total
            assert weight[0, j, i] == pytest.approx(share, rel=1e-9)
            np.testing.assert_allclose(m[0, j, i], same[0][1], rtol=1e-9)
            np.testing.assert_allclose(c[0, j, i], same[0][2], rtol=1e-9)
    merged = imm.combine(*imm.merge_branches(weight, m, c))
    values = list(full.values())
    exact = loop_moments(
        [w / total for w, _, _ in values], *zip(*((m, c) for _, m, c in values), strict=True)
    )
    np.testing.assert_allclose(merged[0][0], exact[0], rtol=1e-9)
    np.testing.assert_allclose(merged[1][0], exact[1], rtol=1e-9)

    state = cycle(start_weight, mean, covariance, models, z[:1])
    one = enumerate_histories(models, start_weight[0], (mean[0, 0], covariance[0, 0]), z[:1])
    assert state[3][0] == pytest.approx(np.log(sum(w for w, _, _ in one.values())), rel=1e-12)
    second = cycle(*state[:3], models, z[1:])
    assert second[3][0] != pytest.approx(evidence[1], rel=1e-6)


def test_likelihoods_may_be_too_small_for_numbers():
    weight, evidence = imm.reweight(np.array([[0.5, 0.5], [1.0, 0.0]]), np.full((2, 2), -5000.0))
    np.testing.assert_array_equal(weight, [[0.5, 0.5], [1.0, 0.0]])
    np.testing.assert_allclose(evidence, -5000.0)


def test_an_unreachable_model_gets_no_weight_and_a_proper_state():
    rng = np.random.default_rng(2)
    state = random_mixture(rng, 1, 2)
    weight, mean, covariance = imm.mix(*state, np.array([[1.0, 1.0], [0.0, 0.0]]))
    np.testing.assert_array_equal(weight, [[1.0, 0.0]])
    whole = imm.combine(*state)
    for j in (0, 1):
        np.testing.assert_allclose(mean[:, j], whole[0], rtol=1e-12)
        np.testing.assert_allclose(covariance[:, j], whole[1], rtol=1e-12)


@settings(derandomize=True, deadline=None)
@given(
    st.floats(0.0, 100.0),
    st.floats(0.0, 100.0),
    st.lists(st.floats(1.0, 1e4), min_size=1, max_size=4),
)
def test_sojourn_transitions_compose_and_their_columns_sum_to_one(first, second, sojourn):
    one, other = imm.sojourn_transition(first, sojourn), imm.sojourn_transition(second, sojourn)
    np.testing.assert_allclose(one.sum(axis=0), 1.0, rtol=1e-12)
    assert (one >= 0.0).all()
    np.testing.assert_allclose(
        other @ one, imm.sojourn_transition(first + second, sojourn), atol=1e-12
    )


def test_sojourn_transition_worked():
    """Two models: p(1|1) = (a2 + a1 exp(-(a1 + a2) t)) / (a1 + a2), rates a = 1/sojourn."""
    a1, a2, t = 0.1, 0.25, 3.0
    transition = imm.sojourn_transition(t, [1 / a1, 1 / a2])
    e = np.exp(-(a1 + a2) * t)
    assert transition[0, 0] == pytest.approx((a2 + a1 * e) / (a1 + a2), rel=1e-12)
    assert transition[0, 1] == pytest.approx(a2 * (1 - e) / (a1 + a2), rel=1e-12)
    np.testing.assert_array_equal(imm.sojourn_transition(5.0, [np.inf, np.inf]), np.eye(2))
    np.testing.assert_array_equal(imm.sojourn_transition(5.0, [7.0]), [[1.0]])
    for dt, sojourn in ((-1.0, [1.0]), (1.0, [0.0]), (1.0, [])):
        with pytest.raises(ValueError, match="mean_sojourn_s"):
            imm.sojourn_transition(dt, sojourn)


def test_acceleration_dependent_transition_is_koch_2_12():
    acceleration = np.array([[0.0, 0.0], [3.0, 4.0], [1e3, 0.0]])
    transition = imm.acceleration_dependent_transition((0.9, 0.8), acceleration, 5.0)
    np.testing.assert_allclose(transition.sum(axis=1), 1.0, rtol=1e-14)
    e = np.exp(-0.5)
    np.testing.assert_allclose(
        transition[1], [[0.9 * e, 1 - 0.8 * (1 - e)], [1 - 0.9 * e, 0.8 * (1 - e)]], rtol=1e-14
    )
    # No acceleration: the calm model; a huge one: the other.
    np.testing.assert_allclose(transition[0], [[0.9, 1.0], [0.1, 0.0]], atol=1e-14)
    np.testing.assert_allclose(transition[2], [[0.0, 0.2], [1.0, 0.8]], atol=1e-14)
    each = imm.acceleration_dependent_transition(
        (0.9, 0.8), np.stack([acceleration, acceleration[::-1]], axis=1), 5.0
    )
    np.testing.assert_array_equal(each[:, :, 0], transition[:, :, 0])
    np.testing.assert_array_equal(each[:, :, 1], transition[::-1, :, 1])


def test_shapes_that_do_not_fit_are_refused():
    rng = np.random.default_rng(0)
    weight, mean, covariance = random_mixture(rng, 2, 2)
    with pytest.raises(ValueError, match="one state for all models"):
        imm.mix(weight, mean[..., :3], covariance, np.eye(2))
    with pytest.raises(ValueError, match="transition"):
        imm.mix(weight, mean, covariance, np.eye(3))


def test_matched_models_are_consistent():
    """NEES of 400 switching targets over 30 scans inside its 95 % bounds (seeded).

    The models differ little, so that matching moments costs next to nothing: a matched filter must
    be consistent. With the noise of one model stated three times too small it is not.
    """
    runs, scans = 400, 30
    made = [constant_velocity(2.0, sigma) for sigma in (2.0, 6.0)]
    transition, noise = (np.stack(list(part)) for part in zip(*made, strict=True))
    switching = imm.sojourn_transition(2.0, [20.0, 20.0])
    root = np.array([[[2.0], [2.0]], [[6.0], [6.0]]])[..., 0]  # acceleration std (M, 2)

    def nees(models):
        generator = np.random.default_rng(32)
        p0 = np.diag([100.0, 100.0, 25.0, 25.0])
        truth = generator.multivariate_normal(np.zeros(4), p0, runs)
        model = generator.integers(0, 2, runs)
        state = (
            np.full((runs, 2), 0.5),
            np.zeros((runs, 2, 4)),
            np.broadcast_to(p0, (runs, 2, 4, 4)),
        )
        found = []
        for _ in range(scans):
            model = np.where(generator.random(runs) < switching[model, model], model, 1 - model)
            acceleration = generator.normal(size=(runs, 2)) * root[model]
            truth = truth @ transition[0].T + np.hstack([2.0 * acceleration, 2.0 * acceleration])
            z = truth[:, :2] + generator.multivariate_normal(np.zeros(2), R, runs)
            *state, _ = cycle(*state, models, z)
            mean, covariance = imm.combine(*state)
            error = truth - mean
            found.append(np.sum(error * np.linalg.solve(covariance, error[..., None])[..., 0], -1))
        # The last scan alone: runs are independent, scans are not.
        return np.mean(found[-1]), np.mean(found)

    low, high = chi2.ppf([0.025, 0.975], 4 * runs) / runs
    last, overall = nees((transition, noise, switching))
    assert low < last < high
    assert low < overall < high
    wrong = noise.copy()
    wrong[1] = wrong[0] = noise[0] / 9.0
    assert nees((transition, wrong, switching))[0] > high
