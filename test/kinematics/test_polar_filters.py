"""EKF, UKF and converted measurements for polar sensors: derivatives, filterpy, Monte Carlo."""

import numpy as np
import pytest
from filterpy.kalman import JulierSigmaPoints, UnscentedKalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st
from kinematic_examples import quaternion, scan_of
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from gda_tracker.kinematics.converted_measurements import converted_update, unbiased_positions
from gda_tracker.kinematics.gaussian_filters import update
from gda_tracker.kinematics.polar_filters import PolarSensor, extended_update, unscented_update
from gda_tracker.kinematics.sensor_models import innovations, polar_measurements, wrap_angle

UPDATES = {
    "extended": extended_update,
    "unscented": unscented_update,
    "converted": converted_update,
}


def sensor_of(dimension, range_rate, turned=True):
    rotation = None
    if turned:
        rotation = Rotation.from_euler("zyx", [0.7, 0.1, -0.2]).as_matrix()
        if dimension == 2:
            rotation = Rotation.from_euler("z", 0.7).as_matrix()[:2, :2]
    return PolarSensor(
        np.array([500.0, -300.0, 40.0][:dimension]),
        rotation,
        np.array([5.0, -8.0, 1.0][:dimension]) if turned else None,
        range_rate,
    )


def states_of(rng, count, dimension, spread=1.0):
    """States 5 to 20 km away with speeds near 150 m/s and full covariances."""
    mean = rng.normal(0.0, 150.0, (count, 2 * dimension))
    angle, distance = rng.uniform(-np.pi, np.pi, count), rng.uniform(5e3, 2e4, count)
    mean[:, 0], mean[:, 1] = distance * np.cos(angle), distance * np.sin(angle)
    if dimension == 3:
        mean[:, 2] = rng.uniform(0.0, 4e3, count)
    scale = np.repeat([100.0 * spread, 8.0 * spread], dimension)
    root = rng.normal(size=(count, len(scale), len(scale))) * scale[:, None]
    return mean, root @ root.transpose(0, 2, 1) + np.diag((0.2 * scale) ** 2)


def noise_of(dimension, range_rate, angle_std=0.003):
    deviations = [20.0] + [angle_std] * (dimension - 1) + [0.7] * range_rate
    return np.diag(np.square(deviations))


def written_out(state, sensor):
    """h(x) of one state, coordinate by coordinate."""
    d = sensor.dimension
    p, v = state[:d] - sensor.position_m, state[d : 2 * d]
    if sensor.velocity_mps is not None:
        v = v - sensor.velocity_mps
    if sensor.rotation is not None:
        p, v = sensor.rotation.T @ p, sensor.rotation.T @ v
    r = np.linalg.norm(p)
    found = [r, np.arctan2(p[1], p[0])]
    if d == 3:
        found.append(np.arcsin(p[2] / r))
    if sensor.range_rate:
        found.append((np.linalg.norm(p + 1e-4 * v) - np.linalg.norm(p - 1e-4 * v)) / 2e-4)
    return np.array(found)


@settings(derandomize=True, deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 3]), st.booleans(), st.booleans())
def test_measurement_and_jacobian_equal_differences(seed, dimension, range_rate, turned):
    sensor = sensor_of(dimension, range_rate, turned)
    mean, _ = states_of(np.random.default_rng(seed), 3, dimension)
    got, jacobian = sensor.measure(mean), sensor.jacobian(mean)
    assert got.shape == (3, sensor.measured)
    for i in range(3):
        np.testing.assert_allclose(got[i], written_out(mean[i], sensor), rtol=1e-6, atol=1e-6)
        for c in range(2 * dimension):
            step = np.zeros(2 * dimension)
            step[c] = 0.5
            pair = sensor.measure(np.stack([mean[i] + step, mean[i] - step]))
            numeric = sensor.residual(pair[0], pair[1])
            np.testing.assert_allclose(jacobian[i, :, c], numeric, rtol=1e-4, atol=1e-7)


def test_extended_update_equals_the_ring_s_own_in_the_plane():
    """Two implementations: that of the ring in range and azimuth, and this one."""
    rng = np.random.default_rng(1)
    mean, covariance = states_of(rng, 8, 2)
    sensor = PolarSensor(
        np.array([300.0, 100.0]), Rotation.from_euler("z", 0.4).as_matrix()[:2, :2]
    )
    z = sensor.measure(mean) + rng.normal(size=(8, 2)) * [20.0, 0.003]
    noise = np.tile(np.diag([400.0, 9e-6]), (8, 1, 1))
    scan = scan_of(z[:, 0], z[:, 1], noise, (300.0, 100.0, 9.0), quaternion((0, 0, 1), 0.4))
    pairs = innovations(polar_measurements(scan), mean, covariance, np.arange(8, dtype=np.int32))
    expected = update(mean, covariance, pairs)
    got = extended_update(mean, covariance, z, noise, sensor)
    np.testing.assert_allclose(got.mean, expected[0], rtol=1e-9)
    np.testing.assert_allclose(got.covariance, expected[1], rtol=1e-7, atol=1e-6)
    squared, determinant = pairs.mahalanobis_squared()
    density = -0.5 * (squared + np.log(determinant)) - np.log(2.0 * np.pi)
    np.testing.assert_allclose(got.log_likelihood, density, rtol=1e-9)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("range_rate", [False, True])
@pytest.mark.parametrize("kappa", [0.0, 1.5])
def test_unscented_update_equals_filterpy(dimension, range_rate, kappa):
    rng = np.random.default_rng(dimension)
    sensor = sensor_of(dimension, range_rate)
    mean, covariance = states_of(rng, 4, dimension)
    noise = noise_of(dimension, range_rate)
    z = sensor.measure(mean) + rng.multivariate_normal(np.zeros(len(noise)), noise, 4)
    got = unscented_update(mean, covariance, z, np.tile(noise, (4, 1, 1)), sensor, kappa)
    for i in range(4):
        cut = sensor.measure(mean[i])[1]  # put the cut of the azimuth opposite

        def measure(x, cut=cut):
            value = sensor.measure(x)
            value[1] = cut + wrap_angle(value[1] - cut)
            return value

        size = 2 * dimension
        points = JulierSigmaPoints(size, kappa=kappa)
        peer = UnscentedKalmanFilter(size, len(noise), 1.0, measure, lambda x, dt: x, points)
        peer.x, peer.P, peer.R, peer.Q = mean[i], covariance[i], noise, np.zeros((size, size))
        peer.predict()
        near = z[i].copy()
        near[1] = cut + wrap_angle(near[1] - cut)
        peer.update(near)
        np.testing.assert_allclose(got.mean[i], peer.x, rtol=1e-7, atol=1e-6)
        np.testing.assert_allclose(got.covariance[i], peer.P, rtol=1e-6, atol=1e-5)
        assert got.log_likelihood[i] == pytest.approx(peer.log_likelihood, rel=1e-6)


@pytest.mark.parametrize("name", sorted(UPDATES))
@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("range_rate", [False, True])
def test_small_errors_agree_with_the_linear_filter(name, dimension, range_rate):
    """A narrow prior: all three are the Kalman filter of the linearised sensor."""
    rng = np.random.default_rng(5)
    sensor = sensor_of(dimension, range_rate)
    mean, covariance = states_of(rng, 5, dimension, spread=0.01)
    noise = np.tile(noise_of(dimension, range_rate, 1e-4), (5, 1, 1))
    z = (
        sensor.measure(mean)
        + rng.normal(size=(5, sensor.measured)) * np.sqrt(np.diag(noise[0])) / 5
    )
    got = UPDATES[name](mean, covariance, z, noise, sensor)
    expected = extended_update(mean, covariance, z, noise, sensor)
    scale = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    np.testing.assert_allclose((got.mean - expected.mean) / scale, 0.0, atol=0.01)
    np.testing.assert_allclose(
        (got.covariance - expected.covariance) / (scale[:, :, None] * scale[:, None]), 0, atol=0.01
    )
    np.testing.assert_allclose(got.log_likelihood, expected.log_likelihood, atol=0.02)
    np.linalg.cholesky(got.covariance)


@pytest.mark.parametrize("name", sorted(UPDATES))
@pytest.mark.parametrize("dimension", [2, 3])
def test_posterior_is_consistent_and_range_rate_sharpens_the_speed(name, dimension):
    """NEES of 4,000 updates inside its 95 % bounds (seeded), with and without range rate."""
    rng = np.random.default_rng(23)
    runs, traces = 4000, []
    for range_rate in (False, True):
        sensor = sensor_of(dimension, range_rate)
        mean, covariance = states_of(rng, runs, dimension, spread=0.3)
        root = np.linalg.cholesky(covariance)
        truth = mean + (root @ rng.normal(size=(runs, 2 * dimension, 1)))[:, :, 0]
        noise = noise_of(dimension, range_rate)
        z = sensor.measure(truth) + rng.multivariate_normal(np.zeros(len(noise)), noise, runs)
        got = UPDATES[name](mean, covariance, z, np.tile(noise, (runs, 1, 1)), sensor)
        error = truth - got.mean
        nees = np.sum(error * np.linalg.solve(got.covariance, error[:, :, None])[:, :, 0], axis=1)
        low, high = chi2.ppf([0.025, 0.975], 2 * dimension * runs) / runs
        assert low < nees.mean() < high
        v = slice(dimension, 2 * dimension)
        traces.append(np.mean(np.trace(got.covariance[:, v, v], axis1=1, axis2=2)))
    assert traces[1] < traces[0]


@pytest.mark.parametrize("dimension", [2, 3])
def test_converted_positions_are_unbiased_with_the_stated_covariance(dimension):
    """Coarse angles far away, where the plain conversion is 1.1 % short: Monte Carlo, seeded."""
    rng = np.random.default_rng(2)
    runs = 400_000
    truth = np.array([50e3, 0.8, 0.3][:dimension])
    variance = np.square([30.0, 0.15, 0.1][:dimension])
    z = truth + rng.normal(size=(runs, dimension)) * np.sqrt(variance)
    noise = np.broadcast_to(np.diag(variance), (runs, dimension, dimension))
    at = np.broadcast_to(truth, z.shape)
    position, covariance = unbiased_positions(z, noise, at)
    ground = truth[0] * (np.cos(truth[2]) if dimension == 3 else 1.0)
    x = [ground * np.cos(truth[1]), ground * np.sin(truth[1])]
    if dimension == 3:
        x.append(truth[0] * np.sin(truth[2]))
    sample = np.cov(position.T)
    deviation = np.sqrt(np.diag(sample))
    assert np.abs(position.mean(axis=0) - x).max() < 4 * deviation.max() / np.sqrt(runs)
    np.testing.assert_allclose(
        sample / np.outer(deviation, deviation),
        covariance[0] / np.outer(deviation, deviation),
        atol=0.01,
    )
    # Given the measurement: on average over measurements the same squared error.
    _, conditional = unbiased_positions(z, noise)
    np.testing.assert_allclose(
        np.trace(conditional, axis1=1, axis2=2).mean(), np.trace(sample), rtol=0.05
    )
    np.linalg.cholesky(covariance[:1])
    np.linalg.cholesky(conditional[:100])


def test_converted_in_the_plane_worked():
    """Mo et al.: R_xx = (lambda^-2 - 2) r^2 cos^2 + (r^2 + s^2)(1 + lambda^4 cos 2a)/2."""
    r, a, s2, v = 1e4, 0.5, 900.0, 0.01
    lam = np.exp(-v / 2)
    position, covariance = unbiased_positions(np.array([[r, a]]), np.diag([s2, v])[None])
    np.testing.assert_allclose(position[0], [r * np.cos(a) / lam, r * np.sin(a) / lam], rtol=1e-14)
    xx = (lam**-2 - 2) * (r * np.cos(a)) ** 2 + (r * r + s2) * (1 + lam**4 * np.cos(2 * a)) / 2
    xy = (lam**-2 - 2) * r * r * np.cos(a) * np.sin(a) + (r * r + s2) * lam**4 * np.sin(2 * a) / 2
    assert covariance[0, 0, 0] == pytest.approx(xx, rel=1e-9)
    assert covariance[0, 0, 1] == pytest.approx(xy, rel=1e-9)


@pytest.mark.parametrize("name", sorted(UPDATES))
def test_detections_across_the_azimuth_cut(name):
    mean = np.array([[-20e3, 5.0, 100.0, 0.0]])
    covariance = np.diag([1e4, 1e4, 25.0, 25.0])[None]
    sensor = PolarSensor(np.zeros(2))
    z = np.array([[20e3, -np.pi + 1e-4]])
    got = UPDATES[name](mean, covariance, z, np.diag([400.0, 1e-6])[None], sensor)
    assert abs(got.mean[0, 0] + 20e3) < 10.0
    assert abs(got.mean[0, 1] + 2.0) < 2.0


def test_what_does_not_fit_is_refused():
    with pytest.raises(ValueError, match="position_m of 1"):
        PolarSensor(np.zeros(1))
    mean, covariance = states_of(np.random.default_rng(0), 1, 2)
    sensor = PolarSensor(np.zeros(2))
    z, noise = sensor.measure(mean), np.array([[[400.0, 0.01], [0.01, 1e-6]]])
    with pytest.raises(ValueError, match="correlations"):
        converted_update(mean, covariance, z, noise, sensor)
    with pytest.raises(ValueError, match="correlations"):
        unbiased_positions(z, noise)
    with pytest.raises(ValueError, match="kappa = -4"):
        unscented_update(mean, covariance, z, noise, sensor, -4.0)
