"""The set-valued Kalman filter: a point is a Kalman filter, a set is many of them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from set_examples import random_sets

from gda_tracker.kinematics.motion_models import constant_velocity
from gda_tracker.kinematics.set_valued.filter import (
    TrackSets,
    predict_sets,
    squared_distances,
    update_sets,
)

H = np.eye(2, 4)
R = np.diag([2.0, 0.5])


def kalman_filter(mean, covariance, scans, dt_s=2.0, q=0.3):
    """filterpy's filter, an independent one."""
    from filterpy.kalman import KalmanFilter

    kf = KalmanFilter(4, 2)
    kf.F, kf.Q = (np.array(a) for a in constant_velocity(dt_s, q))
    kf.H, kf.R, kf.x, kf.P = H, R, mean[:, None].copy(), covariance.copy()
    for z in scans:
        kf.predict()
        kf.update(z[:, None])
    return kf.x[:, 0], kf.P


def filtered(sets, scans, dt_s=2.0, q=0.3):
    transition, noise = constant_velocity(dt_s, q)
    for z in scans:
        sets = predict_sets(sets, transition, noise)
        sets = update_sets(sets, np.broadcast_to(z, (len(sets), 2)), H, R)
    return sets


def test_a_point_is_a_kalman_filter():
    rng = np.random.default_rng(1)
    sets = random_sets(rng, 5, size=0.0)
    scans = rng.standard_normal((6, 2)) * 3.0
    after = filtered(sets, scans)
    assert np.array_equal(after.matrix, np.zeros((5, 4, 4)))
    for row in range(5):
        mean, covariance = kalman_filter(sets.centroid[row], sets.covariance[row], scans)
        np.testing.assert_allclose(after.centroid[row], mean, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(after.covariance[row], covariance, rtol=1e-8, atol=1e-10)


@given(seed=st.integers(0, 2**32 - 1), k=st.integers(1, 5))
@settings(max_examples=15, deadline=None)
def test_a_set_is_the_hull_of_the_filters_of_its_members(seed, k):
    rng = np.random.default_rng(seed)
    sets = random_sets(rng, 1, k=k)
    scans = rng.standard_normal((4, 2)) * 3.0
    after = filtered(sets, scans)
    u = rng.standard_normal((8, k))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    u[::2] *= rng.uniform(0.0, 1.0, (4, 1))
    for one in u:
        mean, covariance = kalman_filter(
            sets.centroid[0] + sets.matrix[0] @ one, sets.covariance[0], scans
        )
        # The member that u named at the start is named by u at the end, under the same P.
        expected = after.centroid[0] + after.matrix[0] @ one
        np.testing.assert_allclose(mean, expected, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(after.covariance[0], covariance, rtol=1e-8, atol=1e-10)


def test_an_observable_set_shrinks_to_a_point():
    rng = np.random.default_rng(3)
    sets = TrackSets(np.zeros((1, 4)), 100.0 * np.eye(4)[None], 1000.0 * np.eye(4)[None])
    radii = [filtered(sets, rng.standard_normal((n, 2))).radius(slice(0, 4)) for n in range(1, 25)]
    assert (np.diff(np.ravel(radii)[1:]) < 0.0).all()
    assert radii[-1] < 1.0


def test_each_set_with_its_own_observation_matrix():
    rng = np.random.default_rng(4)
    sets = random_sets(rng, 3)
    h = rng.standard_normal((3, 2, 4))
    z, noise = rng.standard_normal((3, 2)), np.stack([R, 2.0 * R, 3.0 * R])
    together = update_sets(sets, z, h, noise)
    for row in range(3):
        alone = update_sets(sets.select(slice(row, row + 1)), z[row : row + 1], h[row], noise[row])
        np.testing.assert_allclose(together.centroid[row], alone.centroid[0], rtol=1e-12)
        np.testing.assert_allclose(together.covariance[row], alone.covariance[0], rtol=1e-12)
        np.testing.assert_allclose(together.matrix[row], alone.matrix[0], rtol=1e-12)


def test_radius_is_the_longest_half_axis_of_the_projection():
    sets = TrackSets(np.zeros((1, 4)), np.eye(4)[None], np.diag([3.0, 4.0, 7.0, 1.0])[None])
    assert sets.radius(slice(0, 2)) == pytest.approx([4.0])
    assert sets.radius(slice(2, 4)) == pytest.approx([7.0])
    assert TrackSets(np.zeros((0, 4)), np.zeros((0, 4, 4)), np.zeros((0, 4, 4))).radius(
        slice(0, 2)
    ).shape == (0,)


@given(seed=st.integers(0, 2**32 - 1), d=st.integers(1, 3), k=st.integers(1, 4))
@settings(max_examples=30, deadline=None)
def test_distance_from_the_nearest_member_is_that_of_an_optimiser(seed, d, k):
    rng = np.random.default_rng(seed)
    residual = 4.0 * rng.standard_normal(d)
    spread = rng.standard_normal((d, k)) * rng.uniform(0.0, 2.0)
    factor = rng.standard_normal((d, d))
    noise = factor @ factor.T + 0.1 * np.eye(d)
    inverse = np.linalg.inv(noise)

    def distance(u):
        gap = residual - spread @ u
        return gap @ inverse @ gap

    inside = {"type": "ineq", "fun": lambda u: 1.0 - u @ u}
    best = minimize(
        distance, np.zeros(k), constraints=[inside], method="SLSQP", options={"ftol": 1e-12}
    )
    found = squared_distances(residual[None], spread[None], noise[None])[0]
    assert found == pytest.approx(best.fun, rel=1e-4, abs=1e-5)


def test_distance_is_zero_inside_and_without_extent_that_of_the_point():
    residual = np.array([[1.0, 2.0], [0.5, -0.5]])
    noise = np.broadcast_to(np.diag([4.0, 9.0]), (2, 2, 2))
    none = squared_distances(residual, np.zeros((2, 2, 3)), noise)
    np.testing.assert_allclose(none, [1.0 / 4.0 + 4.0 / 9.0, 0.25 / 4.0 + 0.25 / 9.0])
    wide = np.broadcast_to(3.0 * np.eye(2), (2, 2, 2))
    np.testing.assert_array_equal(squared_distances(residual, wide, noise), [0.0, 0.0])
    assert squared_distances(residual[:0], wide[:0], noise[:0]).shape == (0,)
