"""The rate of detections: conjugate, sums to one, forgets."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import gamma, poisson

from gda_tracker.kinematics.extended.detection_rate import (
    log_count_probability,
    log_unseen_probability,
    predict_rate,
    update_rate,
    update_rate_unseen,
)

A, B = np.array([3.5]), np.array([0.7])


def test_counts_are_an_integral_over_the_rate_and_sum_to_one():
    counts = np.arange(200)
    probability = np.exp(log_count_probability(A, B, counts))
    assert probability.sum() == pytest.approx(1.0, abs=1e-9)
    for n in (0, 1, 7):
        exact = quad(lambda g, n=n: poisson.pmf(n, g) * gamma.pdf(g, 3.5, scale=1 / 0.7), 0, 80)[0]
        assert probability[n] == pytest.approx(exact, rel=1e-7)


def test_posterior_is_bayes():
    a, b = update_rate(A, B, np.array([4]))
    grid = np.linspace(0.001, 60.0, 200_001)
    weight = gamma.pdf(grid, 3.5, scale=1 / 0.7) * poisson.pmf(4, grid)
    assert a[0] / b[0] == pytest.approx(np.sum(grid * weight) / weight.sum(), rel=1e-6)


@pytest.mark.parametrize("seen", [0.3, 0.95, 1.0])
def test_unseen_by_moments(seen):
    grid = np.linspace(0.001, 90.0, 200_001)
    prior = gamma.pdf(grid, 3.5, scale=1 / 0.7)
    weight = prior * (1.0 - seen + seen * np.exp(-grid))
    mean = np.sum(grid * weight) / weight.sum()
    variance = np.sum((grid - mean) ** 2 * weight) / weight.sum()
    a, b = update_rate_unseen(A, B, seen)
    assert a[0] / b[0] == pytest.approx(mean, rel=1e-5)
    assert a[0] / b[0] ** 2 == pytest.approx(variance, rel=1e-4)
    exact = np.log(weight.sum() / prior.sum())
    assert log_unseen_probability(A, B, seen)[0] == pytest.approx(exact, rel=1e-5)


def test_forgetting_keeps_the_mean():
    a, b = predict_rate(A, B, 2.0, 4.0)
    assert a[0] / b[0] == pytest.approx(5.0)
    assert a[0] / b[0] ** 2 == pytest.approx(5.0 / 0.7 * np.exp(0.5))
    a, b = predict_rate(A, B, 1e6, 1.0)
    assert (a[0], a[0] / b[0]) == pytest.approx((1.0, 5.0))
    few = np.array([0.4])
    assert predict_rate(few, B, 5.0, 1.0)[0] == few
