"""Prediction and update against filterpy, numeric Jacobians and what a covariance must be."""

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter, KalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st
from kinematic_examples import random_measurements, random_states

from gda_tracker.kinematics.gaussian_filters import predict, update
from gda_tracker.kinematics.motion_models import constant_velocity
from gda_tracker.kinematics.sensor_models import PolarMeasurements, innovations, wrap_angle

STATES = 12


def measure(state, sensor, offset):
    """h(x) of one state, written out."""
    s = len(state) // 2
    x = state[0] + offset * state[s] - sensor[0]
    y = state[1] + offset * state[s + 1] - sensor[1]
    return np.array([np.sqrt(x * x + y * y), np.arctan2(y, x)])


def numeric_jacobian(state, sensor, offset):
    """Central differences of h."""
    columns = []
    for i in range(len(state)):
        step = np.zeros(len(state))
        step[i] = 0.1
        difference = measure(state + step, sensor, offset) - measure(state - step, sensor, offset)
        difference[1] = wrap_angle(difference[1])
        columns.append(difference / 0.2)
    return np.array(columns).T


def near(rng, measurements, mean):
    """Turn random measurements into ones near their states, pair by pair."""
    for i, state in enumerate(mean):
        offset = 0.0 if measurements.time_offset_s is None else measurements.time_offset_s[i]
        distance, angle = measure(state, measurements.sensor_xy_m, offset)
        measurements.range_m[i] = distance + rng.normal(0.0, 50.0)
        measurements.azimuth_rad[i] = wrap_angle(angle + rng.normal(0.0, 0.01))
    return measurements


@pytest.mark.parametrize("dt_s", [0.5, 5.0])
def test_prediction_equals_filterpy(dt_s):
    rng = np.random.default_rng(1)
    mean, covariance = random_states(rng, STATES)
    transition, noise = constant_velocity(dt_s, 3.0)
    got_mean, got_covariance = predict(mean, covariance, transition, noise)
    for i in range(STATES):
        peer = KalmanFilter(dim_x=4, dim_z=2)
        peer.x, peer.P = mean[i].copy(), covariance[i].copy()
        peer.F, peer.Q = np.array(transition), np.array(noise)
        peer.predict()
        np.testing.assert_allclose(got_mean[i], peer.x, rtol=1e-13)
        np.testing.assert_allclose(got_covariance[i], peer.P, rtol=1e-11, atol=1e-9)


@pytest.mark.parametrize("offsets", [False, True], ids=["one_time", "time_offsets"])
@pytest.mark.parametrize("size", [4, 6])
def test_update_equals_filterpy_with_a_numeric_jacobian(size, offsets):
    rng = np.random.default_rng(2)
    mean, covariance = random_states(rng, STATES, size)
    z = near(rng, random_measurements(rng, STATES, offsets), mean)
    innovation = innovations(z, mean, covariance, np.arange(STATES, dtype=np.int32))
    got_mean, got_covariance = update(mean, covariance, innovation)
    jacobian = innovation.jacobian(size)
    for i in range(STATES):
        offset = z.time_offset_s[i] if offsets else 0.0
        peer_jacobian = numeric_jacobian(mean[i], z.sensor_xy_m, offset)
        np.testing.assert_allclose(jacobian[i], peer_jacobian, rtol=1e-6, atol=1e-11)
        peer = ExtendedKalmanFilter(dim_x=size, dim_z=2)
        peer.x, peer.P, peer.R = mean[i].copy(), covariance[i].copy(), z.covariance[i]
        peer.update(
            np.array([z.range_m[i], z.azimuth_rad[i]]),
            HJacobian=lambda x, h=jacobian[i]: h,
            Hx=lambda x, tau=offset: measure(x, z.sensor_xy_m, tau),
            residual=lambda a, b: np.array([a[0] - b[0], wrap_angle(a[1] - b[1])]),
        )
        np.testing.assert_allclose(innovation.residual[i], peer.y, rtol=1e-7, atol=1e-9)
        np.testing.assert_allclose(innovation.covariance[i], peer.S, rtol=1e-9)
        np.testing.assert_allclose(got_mean[i], peer.x, rtol=1e-9, atol=1e-6)
        scale = np.sqrt(np.outer(np.diag(peer.P), np.diag(peer.P)))
        np.testing.assert_allclose(got_covariance[i] / scale, peer.P / scale, atol=1e-6)


def test_a_linear_case_equals_the_kalman_filter():
    """Far away on the x axis range and azimuth measure x and y/x: worked by hand."""
    mean = np.array([[1e6, 0.0, 0.0, 0.0]])
    covariance = np.diag([400.0, 400.0, 25.0, 25.0])[None]
    z = PolarMeasurements(
        np.array([1e6 + 10.0]),
        np.array([20.0 / 1e6]),
        np.diag([100.0, 300.0 / 1e12])[None],
        np.zeros(2),
        None,
    )
    innovation = innovations(z, mean, covariance, np.zeros(1, dtype=np.int32))
    new_mean, new_covariance = update(mean, covariance, innovation)
    # gains 400/500 and 400/700, variances 400 * 100/500 and 400 * 300/700
    np.testing.assert_allclose(new_mean[0], [1e6 + 8.0, 20.0 * 400 / 700, 0, 0], rtol=1e-9)
    np.testing.assert_allclose(np.diag(new_covariance[0])[:2], [80.0, 400 * 300 / 700], rtol=1e-9)
    np.testing.assert_allclose(np.diag(new_covariance[0])[2:], [25.0, 25.0], rtol=1e-12)


def test_a_measurement_where_it_was_expected_moves_nothing():
    rng = np.random.default_rng(5)
    mean, covariance = random_states(rng, STATES)
    z = random_measurements(rng, STATES)
    for i, state in enumerate(mean):
        z.range_m[i], z.azimuth_rad[i] = measure(state, z.sensor_xy_m, 0.0)
    innovation = innovations(z, mean, covariance, np.arange(STATES, dtype=np.int32))
    new_mean, _ = update(mean, covariance, innovation)
    np.testing.assert_allclose(new_mean, mean, rtol=1e-12, atol=1e-9)


@settings(derandomize=True, deadline=None, max_examples=200)
@given(
    st.integers(0, 2**32 - 1),
    st.floats(-1.0, 6.0),
    st.floats(-1.0, 3.0),
    st.floats(-5.0, -1.0),
    st.booleans(),
)
def test_covariances_stay_symmetric_and_positive(seed, spread, noise_m, noise_rad, offsets):
    """Priors of 0.1 m to 1000 km, noise of 0.1 m to 1 km and 1e-5 to 0.1 rad, in any mixture."""
    rng = np.random.default_rng(seed)
    mean, covariance = random_states(rng, 5, spread_m=10.0**spread)
    z = random_measurements(rng, 5, offsets)
    z.covariance[:] = np.diag([10.0**noise_m, 10.0**noise_rad]) ** 2
    innovation = innovations(z, mean, covariance, np.arange(5, dtype=np.int32))
    _, updated = update(mean, covariance, innovation)
    np.testing.assert_array_equal(updated, updated.transpose(0, 2, 1))
    # Scaled to unit prior variances, so that metres and metres per second weigh the same.
    scale = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    unit = updated / (scale[:, :, None] * scale[:, None, :])
    assert np.linalg.eigvalsh(unit).min() > -1e-12
    assert (np.diagonal(unit, axis1=1, axis2=2) <= 1.0 + 1e-12).all()
    assert (np.diagonal(updated, axis1=1, axis2=2) > 0.0).all()


def test_covariances_stay_positive_over_a_long_life():
    rng = np.random.default_rng(9)
    state = np.array([20e3, 5e3, -40.0, 90.0])
    mean, covariance = state[None] + 10.0, np.diag([1e8, 1e8, 1e6, 1e6])[None]
    transition, noise = constant_velocity(1.0, 1e-3)
    r = np.diag([1.0, 1e-4]) ** 2
    for _ in range(500):
        state = transition @ state
        distance, angle = measure(state, np.zeros(2), 0.0)
        z = PolarMeasurements(
            np.array([distance + rng.normal(0, 1.0)]),
            np.array([angle + rng.normal(0, 1e-4)]),
            r[None],
            np.zeros(2),
            None,
        )
        mean, covariance = predict(mean, covariance, transition, noise)
        innovation = innovations(z, mean, covariance, np.zeros(1, dtype=np.int32))
        mean, covariance = update(mean, covariance, innovation)
        np.linalg.cholesky(covariance[0])
    assert np.linalg.norm(mean[0, :2] - state[:2]) < 5.0


def test_no_states_no_work():
    none = np.zeros(0, dtype=np.int32)
    mean, covariance = np.zeros((0, 4)), np.zeros((0, 4, 4))
    transition, noise = constant_velocity(1.0, 1.0)
    assert predict(mean, covariance, transition, noise)[1].shape == (0, 4, 4)
    z = random_measurements(np.random.default_rng(0), 3)
    assert update(mean, covariance, innovations(z, mean, covariance, none))[0].shape == (0, 4)
