"""Polar measurements: the chapter's H and P0, turned and tilted sensors, time offsets."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kinematic_examples import (
    LEVEL,
    quaternion,
    random_measurements,
    random_states,
    scan_of,
)

from gda_tracker.kinematics.sensor_models import (
    PolarMeasurements,
    cartesian_positions,
    innovations,
    polar_measurements,
    wrap_angle,
)

R = np.diag([60.0**2, 0.005**2])
R3 = np.diag([60.0**2, 0.005**2, 0.008**2])
FIRST = np.zeros(1, dtype=np.int32)


def rotation(q):
    """Rotation matrix of a quaternion by its definition q v q*."""

    def product(a, b):
        av, aw, bv, bw = a[:3], a[3], b[:3], b[3]
        return np.append(aw * bv + bw * av + np.cross(av, bv), aw * bw - av @ bv)

    conjugate = np.array([-q[0], -q[1], -q[2], q[3]])
    return np.array([product(product(q, np.append(e, 0.0)), conjugate)[:3] for e in np.eye(3)]).T


def direct(r, a, e, q):
    """Horizontal range and azimuth of one detection, written out."""
    v = rotation(q) @ (r * np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)]))
    return np.array([np.hypot(v[0], v[1]), np.arctan2(v[1], v[0])])


# --- angles --------------------------------------------------------------------------------------


@settings(derandomize=True, deadline=None)
@given(st.floats(-1e4, 1e4))
def test_wrapped_angles_point_the_same_way(angle):
    wrapped = float(wrap_angle(np.array(angle)))
    assert abs(wrapped) <= math.pi
    assert math.cos(wrapped - angle) == pytest.approx(1.0, abs=1e-12)
    turns = (angle - wrapped) / (2 * math.pi)
    assert turns == pytest.approx(round(turns), abs=1e-9)


def test_small_angles_stay_as_they_are():
    angles = np.array([-3.0, -1e-3, 0.0, 1e-3, 3.0])
    np.testing.assert_allclose(wrap_angle(angles), angles, atol=1e-15)


# --- the chapter's formulas ----------------------------------------------------------------------


def test_jacobian_is_the_chapters_in_its_own_axes():
    """Section 14.2.1.1: azimuth b = atan2(x, y) from North, state [x, vx, y, vy], h = [b, r]."""
    x, y = -3000.0, 25000.0
    r = math.hypot(x, y)
    chapter = np.array([[y / r**2, 0, -x / r**2, 0], [x / r, 0, y / r, 0]])
    mean = np.array([[x, y, 100.0, -200.0]])
    z = PolarMeasurements(np.array([r]), np.array([0.0]), R[None], np.zeros(2), None)
    h = innovations(z, mean, np.eye(4)[None], FIRST).jacobian(4)[0]
    # Ours counts counter-clockwise from x: a = pi/2 - b, hence the sign.
    np.testing.assert_allclose(h[:, [0, 2, 1, 3]], [chapter[1], -chapter[0]], rtol=1e-13)


def test_worked_innovation():
    mean = np.array([[3000.0, 4000.0, 0.0, 0.0]])
    covariance = np.diag([10000.0, 10000.0, 1.0, 1.0])[None]
    z = PolarMeasurements(
        np.array([5060.0]), np.array([math.atan2(4, 3) + 0.02]), R[None], np.zeros(2), None
    )
    got = innovations(z, mean, covariance, FIRST)
    np.testing.assert_allclose(got.residual, [[60.0, 0.02]], rtol=1e-12)
    np.testing.assert_allclose(got.jacobian(4)[0, :, :2], [[0.6, 0.8], [-0.8 / 5e3, 0.6 / 5e3]])
    # 100^2 + 60^2; (100/5000)^2 + 0.005^2
    np.testing.assert_allclose(got.covariance[0], np.diag([13600.0, 4.25e-4]), atol=1e-12)
    squared, determinant = got.mahalanobis_squared()
    assert squared[0] == pytest.approx(3600 / 13600 + 4e-4 / 4.25e-4, rel=1e-12)
    assert determinant[0] == pytest.approx(13600 * 4.25e-4, rel=1e-12)


def test_position_covariance_is_the_chapters_with_the_xy_term():
    """P0 of section 14.2.2: sx^2 = sD^2 sin^2 b + D^2 sb^2 cos^2 b, and the dropped xy term."""
    d, b, s_d, s_b = 30e3, 0.4, 60.0, 0.005
    z = PolarMeasurements(
        np.array([d]),
        np.array([math.pi / 2 - b]),
        np.diag([s_d**2, s_b**2])[None],
        np.ones(2),
        None,
    )
    position, covariance = cartesian_positions(z)
    np.testing.assert_allclose(position[0], [1 + d * math.sin(b), 1 + d * math.cos(b)])
    sin, cos = math.sin(b), math.cos(b)
    x2 = s_d**2 * sin**2 + d**2 * s_b**2 * cos**2
    y2 = s_d**2 * cos**2 + d**2 * s_b**2 * sin**2
    xy = (s_d**2 - d**2 * s_b**2) * sin * cos
    np.testing.assert_allclose(covariance[0], [[x2, xy], [xy, y2]], rtol=1e-12)


# --- innovations ---------------------------------------------------------------------------------


def test_azimuth_residual_is_short_across_the_cut():
    mean = np.array([[-1000.0, -1.0, 0.0, 0.0], [-1000.0, 1.0, 0.0, 0.0]])
    z = PolarMeasurements(
        np.array([1000.0, 1000.0]),
        np.array([math.pi - 0.001, -math.pi + 0.001]),
        np.tile(R, (2, 1, 1)),
        np.zeros(2),
        None,
    )
    got = innovations(z, mean, np.tile(np.eye(4), (2, 1, 1)), np.arange(2, dtype=np.int32))
    np.testing.assert_allclose(got.residual[:, 1], [-0.002, 0.002], rtol=1e-6)


@settings(derandomize=True, deadline=None, max_examples=50)
@given(st.integers(0, 2**32 - 1), st.floats(-10.0, 10.0), st.booleans())
def test_turning_and_moving_the_world_changes_no_innovation(seed, angle, offsets):
    rng = np.random.default_rng(seed)
    mean, covariance = random_states(rng, 6)
    z = random_measurements(rng, 6, offsets)
    rows = np.arange(6, dtype=np.int32)
    before = innovations(z, mean, covariance, rows)
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    both = np.kron(np.eye(2), turn)
    shift = rng.normal(0.0, 1e4, 2)
    moved = mean @ both.T + np.concatenate([shift, [0.0, 0.0]])
    turned = PolarMeasurements(
        z.range_m,
        z.azimuth_rad + angle,
        z.covariance,
        turn @ z.sensor_xy_m + shift,
        z.time_offset_s,
    )
    after = innovations(turned, moved, both @ covariance @ both.T, rows)
    np.testing.assert_allclose(after.residual[:, 0], before.residual[:, 0], atol=1e-7)
    gap = wrap_angle(after.residual[:, 1] - before.residual[:, 1])
    np.testing.assert_allclose(gap, 0.0, atol=1e-10)
    for one, other in zip(after.mahalanobis_squared(), before.mahalanobis_squared(), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6)


@settings(derandomize=True, deadline=None, max_examples=50)
@given(st.integers(0, 2**32 - 1))
def test_a_time_offset_is_a_prediction_without_noise(seed):
    rng = np.random.default_rng(seed)
    mean, covariance = random_states(rng, 6)
    z = random_measurements(rng, 6, offsets=True)
    rows = np.arange(6, dtype=np.int32)
    with_offset = innovations(z, mean, covariance, rows)
    z_now = PolarMeasurements(z.range_m, z.azimuth_rad, z.covariance, z.sensor_xy_m, None)
    for i, tau in enumerate(z.time_offset_s):
        f = np.eye(4)
        f[0, 2] = f[1, 3] = tau
        moved = innovations(z_now, (f @ mean[i])[None], (f @ covariance[i] @ f.T)[None], rows[[i]])
        np.testing.assert_allclose(with_offset.residual[i], moved.residual[0], atol=1e-8)
        np.testing.assert_allclose(with_offset.covariance[i], moved.covariance[0], rtol=1e-9)
        np.testing.assert_allclose(
            with_offset.jacobian(4)[i], moved.jacobian(4)[0] @ f, rtol=1e-9, atol=1e-15
        )


def test_a_state_on_the_sensor_gives_finite_numbers():
    mean = np.zeros((1, 4))
    z = PolarMeasurements(np.array([10.0]), np.array([1.0]), R[None], np.zeros(2), None)
    got = innovations(z, mean, np.diag([1e4, 1e4, 1.0, 1.0])[None], FIRST)
    for values in (got.residual, got.covariance, *got.mahalanobis_squared()):
        assert np.isfinite(values).all()


# --- turned and tilted sensors -------------------------------------------------------------------


def test_a_level_sensor_keeps_range_and_noise():
    scan = scan_of([1000.0, 2000.0], [0.5, -3.0], R, position=(5.0, 6.0, 7.0))
    z = polar_measurements(scan)
    np.testing.assert_array_equal(z.range_m, [1000.0, 2000.0])
    np.testing.assert_array_equal(z.azimuth_rad, [0.5, -3.0])
    np.testing.assert_array_equal(z.covariance, scan.noise_covariance)
    np.testing.assert_array_equal(z.sensor_xy_m, [5.0, 6.0])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_yaw_turns_the_azimuth_whatever_the_sign_of_the_quaternion(sign):
    scan = scan_of([1000.0, 2000.0], [0.5, 3.0], R, orientation=sign * quaternion((0, 0, 1), 1.0))
    z = polar_measurements(scan)
    np.testing.assert_allclose(z.azimuth_rad, [1.5, 4.0 - 2 * math.pi], rtol=1e-12)
    np.testing.assert_array_equal(z.covariance, scan.noise_covariance)


def test_elevation_of_a_level_sensor_worked():
    r, a, e = 2000.0, 0.7, 0.3
    z = polar_measurements(scan_of([r], a, R3, elevation_rad=e))
    assert z.range_m[0] == pytest.approx(r * math.cos(e))
    assert z.azimuth_rad[0] == pytest.approx(a)
    expected = [(60 * math.cos(e)) ** 2 + (r * math.sin(e) * 0.008) ** 2, 0.005**2]
    np.testing.assert_allclose(z.covariance[0], np.diag(expected), atol=1e-9)


@settings(derandomize=True, deadline=None, max_examples=60)
@given(
    st.floats(-math.pi, math.pi),
    st.floats(-1.0, 1.0),
    st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(0.1, 1)),
    st.floats(-0.6, 0.6),
    st.booleans(),
)
def test_tilted_sensors_against_the_rotation_and_its_numeric_jacobian(a, e, axis, angle, measured):
    r, e = 8000.0, e if measured else 0.0
    q = quaternion(axis, angle)
    noise = R3 if measured else R
    z = polar_measurements(
        scan_of([r], a, noise, orientation=q, elevation_rad=e if measured else None)
    )
    expected = direct(r, a, e, q)
    assert z.range_m[0] == pytest.approx(expected[0], rel=1e-10)
    assert math.cos(z.azimuth_rad[0] - expected[1]) == pytest.approx(1.0, abs=1e-12)
    columns = []
    for step in np.diag([1.0, 1e-5, 1e-5])[: len(noise)]:
        up, down = np.array([r, a, e]) + step, np.array([r, a, e]) - step
        difference = direct(*up, q) - direct(*down, q)
        difference[1] = wrap_angle(difference[1])
        columns.append(difference / (2 * step.sum()))
    jacobian = np.array(columns).T
    expected_covariance = jacobian @ noise @ jacobian.T
    scale = np.sqrt(np.outer(np.diag(expected_covariance), np.diag(expected_covariance)))
    np.testing.assert_allclose(z.covariance[0] / scale, expected_covariance / scale, atol=1e-5)


def test_a_tilted_sensor_against_monte_carlo():
    rng = np.random.default_rng(4)
    q = quaternion((1.0, 2.0, 0.5), 0.4)
    truth = np.array([9000.0, 0.8, 0.35])
    draws = truth + rng.normal(size=(200_000, 3)) * np.sqrt(np.diag(R3))
    z = polar_measurements(
        scan_of(draws[:, 0], draws[:, 1], R3, orientation=q, elevation_rad=draws[:, 2])
    )
    centre = polar_measurements(
        scan_of(truth[:1], truth[1], R3, orientation=q, elevation_rad=truth[2])
    )
    sample = np.cov(np.stack([z.range_m, z.azimuth_rad]))
    scale = np.sqrt(np.outer(np.diag(sample), np.diag(sample)))
    np.testing.assert_allclose(centre.covariance[0] / scale, sample / scale, atol=0.01)


def test_a_range_rate_beside_it_changes_nothing():
    wide = np.diag([60.0**2, 0.005**2, 1.0])
    z = polar_measurements(scan_of([1000.0], 0.5, wide))
    np.testing.assert_array_equal(z.covariance, R[None])
    wide = np.diag([60.0**2, 0.005**2, 0.008**2, 1.0])
    with_rate = polar_measurements(scan_of([1000.0], 0.5, wide, elevation_rad=0.2))
    without = polar_measurements(scan_of([1000.0], 0.5, R3, elevation_rad=0.2))
    np.testing.assert_array_equal(with_rate.covariance, without.covariance)


@pytest.mark.parametrize("orientation", [LEVEL, quaternion((0.0, 0.0, 1.0), 2.0)])
def test_straight_above_the_sensor_the_azimuth_is_open_and_the_range_is_not(orientation):
    z = polar_measurements(
        scan_of(
            [1000.0, 1000.0], 0.5, R3, elevation_rad=[math.pi / 2, 0.0], orientation=orientation
        )
    )
    assert z.range_m[0] < 1e-6
    # Across the line of sight: 1000 m times 0.008 rad.
    np.testing.assert_allclose(z.covariance[0], np.diag([8.0**2, math.pi**2]), rtol=1e-6)
    np.testing.assert_allclose(z.covariance[1], R, atol=1e-9)


def test_almost_above_a_tilted_sensor_the_azimuth_is_nearly_open():
    tilt = quaternion((0.0, 1.0, 0.0), -math.pi / 2 + 1e-4)
    z = polar_measurements(scan_of([1000.0], 0.0, R, orientation=tilt))
    assert z.range_m[0] == pytest.approx(0.1)
    # 0.005 rad at 1000 m are 5 m across, seen from 0.1 m.
    assert z.covariance[0, 1, 1] == pytest.approx(50.0**2, rel=1e-4)


def test_empty_scans():
    for orientation in (LEVEL, quaternion((1, 0, 0), 0.1)):
        z = polar_measurements(scan_of([], 0.0, R, orientation=orientation))
        assert len(z) == 0
        position, covariance = cartesian_positions(z)
        assert position.shape == (0, 2)
        assert covariance.shape == (0, 2, 2)


def test_positions_against_monte_carlo():
    rng = np.random.default_rng(8)
    root = np.linalg.cholesky(np.array([[50.0**2, 0.1], [0.1, 0.004**2]]))
    truth = np.array([20e3, 2.2])
    draws = truth + rng.normal(size=(200_000, 2)) @ root.T
    cloud, _ = cartesian_positions(
        PolarMeasurements(draws[:, 0], draws[:, 1], np.zeros((200_000, 2, 2)), np.zeros(2), None)
    )
    _, covariance = cartesian_positions(
        PolarMeasurements(truth[:1], truth[1:], (root @ root.T)[None], np.zeros(2), None)
    )
    sample = np.cov(cloud.T)
    scale = np.sqrt(np.outer(np.diag(sample), np.diag(sample)))
    np.testing.assert_allclose(covariance[0] / scale, sample / scale, atol=0.01)
