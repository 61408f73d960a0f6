"""Range rate in the plane: against the general polar filter, Monte Carlo, tilted sensors."""

import math
from dataclasses import replace

import numpy as np
import pytest
from kinematic_examples import quaternion, random_states, scan_of
from scipy.stats import chi2

from gda_tracker.kinematics.polar_filters import PolarSensor, extended_update
from gda_tracker.kinematics.range_rate import (
    VERTICAL_SPEED_STD_MPS,
    range_rates,
    update_with_range_rate,
)
from gda_tracker.kinematics.sensor_models import innovations, polar_measurements

R = np.diag([400.0, 4e-6, 0.25])
SENSOR = PolarSensor(np.array([300.0, -200.0]), range_rate=True)


def updated(mean, covariance, z, noise, offset=None):
    """One update of each state with its own detection."""
    scan = scan_of(z[:, 0], z[:, 1], noise, (300.0, -200.0, 0.0), time_offset_s=offset)
    scan = replace(scan, range_rate_mps=z[:, 2])
    measurements = polar_measurements(scan)
    rows = np.arange(len(mean), dtype=np.int32)
    pairs = innovations(measurements, mean, covariance, rows)
    return update_with_range_rate(
        mean, covariance, pairs, measurements, range_rates(scan, measurements), rows
    )


def test_narrow_states_equal_the_general_filter_also_with_correlated_noise():
    """Second-order terms vanish; a linear frequency sweep correlates range and range rate."""
    rng = np.random.default_rng(1)
    mean, covariance = random_states(rng, 6, spread_m=0.5)
    noise = np.diag([1.0, 1e-8, 0.01])
    noise[0, 2] = noise[2, 0] = 0.05
    noise[1, 2] = noise[2, 1] = -3e-6
    z = SENSOR.measure(mean) + rng.multivariate_normal(np.zeros(3), noise, 6)
    got = updated(mean, covariance, z, noise)
    expected = extended_update(mean, covariance, z, np.tile(noise, (6, 1, 1)), SENSOR)
    np.testing.assert_allclose(got.mean, expected.mean, rtol=1e-7)
    scale = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    gap = (got.covariance - expected.covariance) / (scale[:, :, None] * scale[:, None])
    np.testing.assert_allclose(gap, 0.0, atol=1e-5)
    np.testing.assert_allclose(got.log_likelihood, expected.log_likelihood, atol=1e-5)


@pytest.mark.parametrize("offset", [None, 1.5])
@pytest.mark.parametrize("speed_std", [3.0, 60.0])
def test_consistent_however_little_of_the_velocity_is_known(offset, speed_std):
    """NEES of 4,000 updates within 2 % of its expectation, where a first-order update fails."""
    rng = np.random.default_rng(7)
    runs = 4000
    mean = np.tile([3000.0, 1500.0, -80.0, 120.0], (runs, 1))
    covariance = np.tile(np.diag([40.0**2, 40.0**2, speed_std**2, speed_std**2]), (runs, 1, 1))
    truth = mean + rng.normal(size=(runs, 4)) * np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    at = truth.copy()
    if offset is not None:
        at[:, :2] += offset * truth[:, 2:]
    z = SENSOR.measure(at) + rng.normal(size=(runs, 3)) * np.sqrt(np.diag(R))
    got = updated(mean, covariance, z, R, offset)
    error = truth - got.mean
    nees = np.mean(np.sum(error * np.linalg.solve(got.covariance, error[:, :, None])[:, :, 0], -1))
    low, high = chi2.ppf([0.025, 0.975], 4 * runs) / runs
    assert 0.98 * low < nees < 1.02 * high
    if offset is None and speed_std > 10.0:
        first = extended_update(mean, covariance, z, np.tile(R, (runs, 1, 1)), SENSOR)
        error = truth - first.mean
        squared = np.sum(error * np.linalg.solve(first.covariance, error[:, :, None])[:, :, 0], -1)
        assert np.mean(squared) > 1.4 * high
    # Along the line of sight the speed is known at once.
    u = np.array([2700.0, 1700.0]) / math.hypot(2700.0, 1700.0)
    assert np.std((truth - got.mean)[:, 2:] @ u) < 0.7 * speed_std


def test_a_scan_without_range_rates_has_none():
    scan = scan_of([1e3], 0.1, np.diag([400.0, 4e-6]))
    assert range_rates(scan, polar_measurements(scan)) is None


@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_elevation_is_taken_out(tilt):
    """A level flight seen from below: the rate in the plane comes back, whatever the tilt."""
    position, velocity = np.array([4000.0, 1000.0, 3000.0]), np.array([-150.0, 60.0, 0.0])
    distance = np.linalg.norm(position)
    turn = np.array(
        [[1, 0, 0], [0, math.cos(tilt), -math.sin(tilt)], [0, math.sin(tilt), math.cos(tilt)]]
    )
    local = turn.T @ position
    scan = scan_of(
        [distance],
        math.atan2(local[1], local[0]),
        np.diag([400.0, 4e-6, 1e-6, 0.25]),
        orientation=quaternion((1.0, 0.0, 0.0), tilt),
        elevation_rad=math.asin(local[2] / distance),
    )
    scan = replace(scan, range_rate_mps=np.array([position @ velocity / distance]))
    found = range_rates(scan, polar_measurements(scan))
    ground = math.hypot(*position[:2])
    expected = position[:2] @ velocity[:2] / ground
    assert found.value_mps[0] == pytest.approx(expected, rel=1e-9)
    cosine, tangent = ground / distance, 3000.0 / ground
    variance = (
        0.25 / cosine**2 + tangent**2 * VERTICAL_SPEED_STD_MPS**2 + (tangent * expected) ** 2 * 1e-6
    )
    assert found.covariance[0].tolist() == [0.0, 0.0, pytest.approx(variance, rel=1e-9)]


def test_straight_above_the_rate_says_nothing():
    noise = np.diag([400.0, 4e-6, 1e-6, 0.25])
    scan = replace(
        scan_of([3000.0], 0.2, noise, elevation_rad=math.pi / 2), range_rate_mps=np.array([5.0])
    )
    found = range_rates(scan, polar_measurements(scan))
    assert np.isfinite(found.value_mps).all()
    assert found.covariance[0, 2] > 1e11
