"""The bound against the linear Kalman filter, and against the score of simulated measurements."""

from __future__ import annotations

import numpy as np
import pytest
from measurement_examples import MODELS, noise_of, sites_of

from gda_tracker.kinematics.cramer_rao import Look, cramer_rao_bounds
from gda_tracker.kinematics.measurement_models import derivatives, measure
from gda_tracker.kinematics.motion_models import constant_velocity

START = np.array([14_000.0, 9_000.0, -120.0, 70.0])
PRIOR = np.diag(1.0 / np.array([4_000.0, 4_000.0, 60.0, 60.0]) ** 2)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_it_is_the_covariance_of_a_kalman_filter_that_knows_the_slopes(model):
    looks = [Look(3.0 * k, model, sites_of(model), noise_of(model)) for k in range(6)]
    found = cramer_rao_bounds(START, looks, PRIOR)
    covariance, state = np.linalg.inv(PRIOR), START
    step, _ = constant_velocity(3.0, 1.0)
    for k, look in enumerate(looks):
        if k:
            covariance, state = step @ covariance @ step.T, step @ state
        h = derivatives(model, look.sites, state[None])[0][0]
        gain = covariance @ h.T @ np.linalg.inv(h @ covariance @ h.T + look.noise)
        covariance = covariance - gain @ h @ covariance
        np.testing.assert_allclose(found[k], covariance, rtol=1e-6, atol=1e-8)


def test_the_information_is_the_spread_of_the_score():
    """Fisher's definition, by Monte Carlo over the noise and differences of the likelihood."""
    model = next(model for model in MODELS if model.name == "tdoa_fdoa")
    rng = np.random.default_rng(4)
    sites, noise = sites_of(model), noise_of(model)
    error = rng.multivariate_normal(np.zeros(2), noise, 40_000)
    value = measure(model, sites, START) + error
    inverse = np.linalg.inv(noise)

    def log_likelihood(state):
        gap = value - measure(model, sites, state)
        return -0.5 * np.einsum("ni,ij,nj->n", gap, inverse, gap)

    step = np.array([1.0, 1.0, 0.1, 0.1])
    score = np.stack(
        [
            (log_likelihood(START + d) - log_likelihood(START - d)) / (2.0 * d.sum())
            for d in np.diag(step)
        ],
        axis=1,
    )
    information = score.T @ score / len(score)
    bound = cramer_rao_bounds(START, [Look(0.0, model, sites, noise)], PRIOR)[0]
    np.testing.assert_allclose(np.linalg.inv(information + PRIOR), bound, rtol=0.05, atol=1.0)


def test_what_the_looks_do_not_tell_has_no_bound():
    model = next(model for model in MODELS if model.name == "range")
    look = Look(0.0, model, sites_of(model), noise_of(model))
    assert np.isinf(cramer_rao_bounds(START, [look], np.zeros((4, 4)))).all()
