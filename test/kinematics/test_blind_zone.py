"""The Doppler blind zone: against quadrature, Monte Carlo, a grid filter, and total probability."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.kinematics.blind_zone import (
    SMALLEST_VISIBLE_SHARE,
    BlindZone,
    after_hit,
    after_miss,
    detection_probability_at,
    notched,
    notched_share,
)

FAR_M = 1e8  # There the range rate is the velocity along x, and nothing is bent.
ZONE = BlindZone(2.0, 0.9, np.zeros(2))
GRID = np.linspace(-60.0, 60.0, 240_001)


def density(at, mean, variance):
    return np.exp(-0.5 * (at - mean) ** 2 / variance) / np.sqrt(2.0 * np.pi * variance)


def far_state(speed, variance):
    covariance = np.diag([1.0, 1.0, variance, 1.0])
    return np.array([[FAR_M, 0.0, speed, 1.0]]), covariance[None]


def test_half_of_the_detections_are_left_at_the_blind_speed():
    rates = np.array([0.0, 2.0, -2.0, 6.0, 100.0])
    expected = 0.9 * (1.0 - 0.5 ** np.square(rates / 2.0))
    np.testing.assert_allclose(detection_probability_at(rates, ZONE), expected, atol=1e-15)


def test_a_miss_is_the_sum_of_nothing_and_a_fictitious_measurement():
    """1 - P_D = 1 - P_d + P_d c N(0; r', s^2), integrating to c P_d over the notch."""
    gaussian = np.sqrt(2.0 * np.pi * ZONE.variance) * density(GRID, 0.0, ZONE.variance)
    seen = detection_probability_at(GRID, ZONE)
    np.testing.assert_allclose(1.0 - seen, 0.1 + 0.9 * gaussian, atol=1e-14)
    notch = (0.9 - seen).sum() * (GRID[1] - GRID[0])
    assert notch == pytest.approx(0.9 * np.sqrt(2.0 * np.pi * ZONE.variance), rel=1e-9)


@pytest.mark.parametrize("speed", [0.0, 1.0, 3.0, 8.0])
@pytest.mark.parametrize("variance", [0.01, 1.0, 20.0])
def test_miss_and_hit_equal_quadrature(speed, variance):
    mean, covariance = far_state(speed, variance)
    prior = density(GRID, speed, variance)
    seen = detection_probability_at(GRID, ZONE)
    step = GRID[1] - GRID[0]
    for after, likelihood, scale in (
        (after_miss, 1.0 - seen, 1.0),
        (after_hit, seen, ZONE.detection_probability),
    ):
        factor, updated, spread = after(mean, covariance, ZONE)
        total = (prior * likelihood).sum() * step
        assert scale * factor[0] == pytest.approx(total, rel=1e-6)
        if after is after_hit and factor[0] < SMALLEST_VISIBLE_SHARE:
            np.testing.assert_array_equal(updated, mean)
            continue
        centre = (prior * likelihood * GRID).sum() * step / total
        second = (prior * likelihood * (GRID - centre) ** 2).sum() * step / total
        assert updated[0, 2] == pytest.approx(centre, rel=1e-6, abs=1e-6)
        assert spread[0, 2, 2] == pytest.approx(second, rel=1e-5)


@pytest.mark.parametrize("after", [after_miss, after_hit])
def test_moments_equal_monte_carlo_where_the_line_of_sight_turns(after):
    """A near target moving across, its place uncertain by a tenth of the distance."""
    rng = np.random.default_rng(3)
    root = np.diag([8.0, 12.0, 1.5, 2.0]) @ (np.eye(4) + 0.3 * rng.normal(size=(4, 4)))
    mean, covariance = np.array([[180.0, 90.0, 0.5, 6.0]]), (root @ root.T)[None]
    zone = BlindZone(3.0, 0.8, np.array([20.0, -10.0]))
    drawn = mean[0] + rng.standard_normal((200_000, 4)) @ root.T
    p = drawn[:, :2] - zone.sensor_xy_m
    rate = np.sum(p * drawn[:, 2:], axis=1) / np.hypot(p[:, 0], p[:, 1])
    weight = detection_probability_at(rate, zone)
    weight = weight / 0.8 if after is after_hit else 1.0 - weight
    factor, updated, spread = after(mean, covariance, zone)
    assert factor[0] == pytest.approx(weight.mean(), abs=0.01)
    centre = np.average(drawn, axis=0, weights=weight)
    deviation = np.sqrt(np.diag(covariance[0]))
    np.testing.assert_allclose((updated[0] - centre) / deviation, 0.0, atol=0.02)
    gap = drawn - centre
    second = (weight[:, None] * gap).T @ gap / weight.sum()
    scale = deviation[:, None] * deviation
    np.testing.assert_allclose((spread[0] - second) / scale, 0.0, atol=0.05)


@settings(derandomize=True, deadline=None, max_examples=60)
@given(
    st.lists(st.floats(-30.0, 30.0), min_size=2, max_size=2),
    st.floats(0.05, 20.0),
    st.floats(0.2, 15.0),
    st.floats(0.0, 1.0),
    st.integers(0, 1000),
)
def test_hit_and_miss_together_are_the_prediction(velocity, spread, speed, seen, seed):
    """Total probability: weighted by their probabilities the moments are those before the scan."""
    rng = np.random.default_rng(seed)
    root = np.diag([20.0, 20.0, spread, spread]) @ (np.eye(4) + 0.3 * rng.normal(size=(4, 4)))
    mean, covariance = np.array([[900.0, -400.0, *velocity]]), (root @ root.T)[None]
    zone = BlindZone(speed, seen, np.zeros(2))
    missed, *miss = after_miss(mean, covariance, zone)
    share = notched_share(mean, covariance, zone)
    visible, *hit = after_hit(mean, covariance, zone)
    np.testing.assert_array_equal(visible, 1.0 - share)
    np.testing.assert_array_equal(notched(mean, covariance, zone).share, share)
    assert missed[0] + seen * visible[0] == pytest.approx(1.0, abs=1e-12)
    for _, second in (miss, hit):
        assert np.linalg.eigvalsh(second[0]).min() > -1e-9
    if visible[0] < SMALLEST_VISIBLE_SHARE or missed[0] < 1e-9:
        return
    parts = [(missed[0], *miss), (seen * visible[0], *hit)]
    centre = sum(w * m[0] for w, m, _ in parts)
    np.testing.assert_allclose(centre, mean[0], rtol=1e-9, atol=1e-6)
    total = sum(w * (c[0] + np.outer(m[0] - centre, m[0] - centre)) for w, m, c in parts)
    np.testing.assert_allclose(total, covariance[0], rtol=1e-6, atol=1e-6)


def test_several_misses_follow_a_grid_filter():
    """A random walk of the speed that is missed again and again, as a grid has it."""
    at = np.linspace(-20.0, 30.0, 1001)
    step = at[1] - at[0]
    grid = density(at, 5.0, 1.0)
    kernel = density(at[:, None] - at, 0.0, 0.8**2) * step
    likelihood = 1.0 - detection_probability_at(at, ZONE)
    mean, covariance = far_state(5.0, 1.0)
    for k in range(8):
        covariance = covariance + np.diag([0.0, 0.0, 0.8**2, 0.0])
        factor, mean, covariance = after_miss(mean, covariance, ZONE)
        moved = kernel @ grid
        told = (moved * likelihood).sum() * step
        grid = moved * likelihood / told
        centre = (at * grid).sum() * step
        deviation = np.sqrt(((at - centre) ** 2 * grid).sum() * step)
        # One Gaussian for a density of two humps: exact at first, near afterwards.
        assert factor[0] == pytest.approx(told, rel=1e-6 if k == 0 else 0.35)
        assert abs(mean[0, 2] - centre) < (1e-6 if k == 0 else 0.5) * deviation
        assert np.sqrt(covariance[0, 2, 2]) == pytest.approx(deviation, rel=0.35)
    assert abs(mean[0, 2]) < 0.3


def test_what_could_not_be_missed_stays():
    """P_d = 1 and a speed far beyond the notch: the miss has no probability, and no effect."""
    mean, covariance = far_state(300.0, 0.01)
    factor, updated, spread = after_miss(mean, covariance, BlindZone(0.5, 1.0, np.zeros(2)))
    assert factor[0] == 0.0
    np.testing.assert_array_equal(updated, mean)
    np.testing.assert_array_equal(spread, covariance)
