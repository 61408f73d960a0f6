"""Signal strength: worked values, integrals, Bayes on a grid, calibration on matched data."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import invgamma, kstest

from gda_tracker.kinematics.signal_strength import (
    Strengths,
    combine,
    detection_probability,
    log_clutter_density,
    log_scan_ratio,
    log_signal_density,
    predict_strength,
    swerling_detection_probability,
    threshold,
    update_detected,
    update_missed,
    update_strength,
)

A, B, LAMBDA = 3.0, 18.0, 4.0
ONE = Strengths(np.array([A]), np.array([B]))


def on_grid(likelihood):
    """Total, and mean and mean square of 1/theta, of prior times likelihood."""

    def integral(power):
        def density(t):
            return likelihood(t) * invgamma.pdf(t, A, scale=B) * t**-power

        return sum(quad(density, a, b, limit=100)[0] for a, b in ((0, 8), (8, np.inf)))

    total, first, second = (integral(power) for power in (0, 1, 2))
    return total, first / total, second / total


def inverse_moments(strengths):
    a, b = strengths.shape[0], strengths.scale[0]
    return a / b, a * (a + 1) / b**2


def test_swerlings_formula():
    assert swerling_detection_probability(np.array(9.0), 1e-4) == pytest.approx(1e-4**0.1)
    assert swerling_detection_probability(np.array(0.0), 1e-3) == pytest.approx(1e-3)
    assert threshold(np.exp(-5.0)) == pytest.approx(5.0)
    with pytest.raises(ValueError, match="false_alarm_probability = 0"):
        threshold(0.0)


def test_likelihoods_integrate_to_detection_and_miss():
    seen = quad(lambda z: np.exp(log_signal_density(ONE, np.array([z]))[0]), LAMBDA, np.inf)[0]
    assert seen == pytest.approx(detection_probability(ONE, LAMBDA)[0], rel=1e-8)
    exact = on_grid(lambda t: np.exp(-LAMBDA / t))[0]
    assert seen == pytest.approx(exact, rel=1e-6)
    for c in (0.0, 2.0):
        false = quad(lambda z, c=c: np.exp(log_clutter_density(z, LAMBDA, c)), LAMBDA, np.inf)[0]
        assert false == pytest.approx(1.0)
    # (2.49) over rho_F with one detection, where the target is as dense as the clutter.
    place = 0.2
    log_ratio = [
        log_scan_ratio(ONE, np.full((1, 1), np.log(place)), np.array([[z]]), place, LAMBDA)[0][0]
        for z in (5.0, 9.0, 30.0)
    ]
    for z, found in zip((5.0, 9.0, 30.0), log_ratio, strict=True):
        density = np.exp(log_signal_density(ONE, np.array([z]))[0] - (LAMBDA - z))
        assert np.exp(found) == pytest.approx(1.0 - seen + density)


def test_detections_and_misses_are_bayes():
    total, first, second = on_grid(lambda t: np.exp(-7.0 / t) / t)
    assert np.exp(log_signal_density(ONE, np.array([7.0])))[0] == pytest.approx(total, rel=1e-6)
    np.testing.assert_allclose(
        inverse_moments(update_detected(ONE, np.array([7.0]))), (first, second), rtol=1e-6
    )
    _, first, second = on_grid(lambda t: 1.0 - np.exp(-LAMBDA / t))
    np.testing.assert_allclose(
        inverse_moments(update_missed(ONE, LAMBDA)), (first, second), rtol=1e-6
    )


def test_ambiguous_detections_are_bayes():
    """Two detections and a miss, with the clutter's strength: moments by the grid."""
    near, signal, rho = np.log([[0.5, 0.1]]), np.array([[6.0, 15.0]]), 0.05
    log_ratio, weight = log_scan_ratio(ONE, near, signal, rho, LAMBDA, 1.0)

    def likelihood(t):
        value = 1.0 - np.exp(-LAMBDA / t)
        for g, z in zip(np.exp(near[0]), signal[0], strict=True):
            value += g / rho * np.exp(-z / t) / t / np.exp(log_clutter_density(z, LAMBDA, 1.0))
        return value

    total, first, second = on_grid(likelihood)
    assert np.exp(log_ratio[0]) == pytest.approx(total, rel=1e-6)
    assert weight.sum() == pytest.approx(1.0)
    found = update_strength(ONE, weight, signal, LAMBDA)
    np.testing.assert_allclose(inverse_moments(found), (first, second), rtol=1e-6)


def test_absent_detections_change_nothing():
    near = np.array([[np.log(0.5), -np.inf]])
    with_gap = log_scan_ratio(ONE, near, np.array([[6.0, 0.0]]), 0.05, LAMBDA)
    without = log_scan_ratio(ONE, near[:, :1], np.array([[6.0]]), 0.05, LAMBDA)
    assert with_gap[0] == without[0]
    assert with_gap[1][0, 2] == 0.0
    same = combine(np.array([[1.0], [0.0]]), Strengths(np.array([[A], [9]]), np.array([[B], [9]])))
    np.testing.assert_allclose([same.shape[0], same.scale[0]], [A, B])


@pytest.mark.parametrize("lambda_", [0.0, 3.0])
def test_the_filter_is_calibrated_on_matched_data(lambda_):
    """Strengths from the prior that wander as the prediction says; misses are approximated."""
    rng = np.random.default_rng(3)
    number, kept = 4000, np.exp(-0.05)
    known = Strengths(np.full(number, 6.0), np.full(number, 60.0))
    inverse = rng.gamma(6.0, 1.0 / 60.0, number)
    for _ in range(15):
        a = known.shape
        inverse = inverse * rng.beta(kept * a, (1.0 - kept) * a) / kept
        known = predict_strength(known, 0.5, 10.0)
        signal = rng.exponential(1.0 / inverse)
        seen, missed = update_detected(known, signal), update_missed(known, max(lambda_, 1e-9))
        hit = signal > lambda_
        known = Strengths(
            np.where(hit, seen.shape, missed.shape), np.where(hit, seen.scale, missed.scale)
        )
    mean, variance = known.log_moments()
    nees = np.mean((-np.log(inverse) - mean) ** 2 / variance)
    assert nees == pytest.approx(1.0, abs=0.12)
    place = invgamma.cdf(1.0 / inverse, known.shape, scale=known.scale)
    assert kstest(place, "uniform").pvalue > 1e-3


def test_forgetting_and_mean():
    ahead = predict_strength(ONE, 2.0, 4.0)
    assert ahead.shape[0] == pytest.approx(A * np.exp(-0.5))
    assert ahead.shape[0] / ahead.scale[0] == pytest.approx(A / B)
    assert predict_strength(ONE, 1e9, 4.0).shape[0] == pytest.approx(1.0)
    assert ONE.mean_strength()[0] == pytest.approx(B / 2.0 - 1.0)
    assert Strengths(np.array([0.5]), np.array([1.0])).mean_strength()[0] == np.inf
