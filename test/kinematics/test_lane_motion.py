"""Keepers of lanes: closed forms, stationarity, entries by quadrature, bends by Monte Carlo."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm, solve_continuous_lyapunov

from gda_tracker.kinematics.context import FORWARD, Lane
from gda_tracker.kinematics.lane_motion import OF_WIDTH, LaneCourse, offset_motion, rounded

STRAIGHT = Lane("road", np.array([[0.0, 0.0], [5000.0, 0.0]]), 12.0, 5.0)
BEND = Lane("bend", np.array([[0.0, 0.0], [1000.0, 0.0], [1700.0, 700.0]]), 12.0, 5.0)
TIMES = st.floats(0.01, 30.0)


def states(course, lane_states, way_from=0.0):
    """Ground states of (way, offset, speed, rate) along the first lane, by walking its pieces."""
    way = np.asarray(lane_states)[:, 0] - way_from
    piece = np.clip(np.searchsorted(course.way, way, side="right") - 1, 0, course.last[0])
    t = course.along[piece]
    n = np.stack([-t[:, 1], t[:, 0]], axis=1)
    _, offset, speed, rate = np.asarray(lane_states).T
    place = course.start[piece] + (way - course.way[piece])[:, None] * t + offset[:, None] * n
    return np.hstack([place, speed[:, None] * t + rate[:, None] * n])


def test_worked_values_of_the_offset():
    """a dt = 1: F = [[2, 1/a], [-a, 0]] / e; the correlation of offsets is 2 / e."""
    step, noise = offset_motion(4.0, 4.0)
    np.testing.assert_allclose(step * math.e, [[2.0, 4.0], [-0.25, 0.0]], atol=1e-15)
    e2 = math.exp(-2.0)
    # P - F P F' by hand, with P = diag(1, 1/16).
    by_hand = [[1.0 - 5.0 * e2, 0.5 * e2], [0.5 * e2, (1.0 - e2) / 16.0]]
    np.testing.assert_allclose(noise, by_hand, atol=1e-15)


@given(st.floats(0.5, 100.0), TIMES, TIMES)
@settings(max_examples=20, deadline=None)
def test_offsets_are_stationary_and_steps_compose(correlation, one, two):
    a = 1.0 / correlation
    drift = np.array([[0.0, 1.0], [-(a**2), -2.0 * a]])
    step, noise = offset_motion(one, correlation)
    np.testing.assert_allclose(step, expm(drift * one), atol=1e-12)
    # The stationary covariance is that of the white noise with the density 4 a^3.
    density = np.diag([0.0, 4.0 * a**3])
    stationary = solve_continuous_lyapunov(drift, -density)
    np.testing.assert_allclose(stationary, np.diag([1.0, a**2]), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(step @ stationary @ step.T + noise, stationary, atol=1e-12)
    second, second_noise = offset_motion(two, correlation)
    both, both_noise = offset_motion(one + two, correlation)
    np.testing.assert_allclose(second @ step, both, atol=1e-12)
    np.testing.assert_allclose(second @ noise @ second.T + second_noise, both_noise, atol=1e-12)


@given(st.floats(-3.0, 3.0), st.floats(-1e5, 1e5), st.floats(0.2, 20.0))
@settings(max_examples=12, deadline=None)
def test_motion_turns_and_shifts_with_the_map(angle, shift, dt):
    rng = np.random.default_rng(5)
    mean = np.array([[400.0, 2.0, 14.0, 0.3]])
    root = rng.normal(size=(4, 4))
    covariance = (root @ root.T)[None]
    c, s = math.cos(angle), math.sin(angle)
    turn = np.kron(np.eye(2), np.array([[c, -s], [s, c]]))
    moved_map = Lane("x", BEND.points @ turn[:2, :2].T + shift, 12.0, 5.0)
    one, other = LaneCourse((BEND,), 10.0), LaneCourse((moved_map,), 10.0)
    moved = mean @ turn.T
    moved[:, :2] += shift
    turned = turn @ covariance @ turn.T
    pieces = one.piece_of(mean, covariance), other.piece_of(moved, turned)
    expected = one.moved(mean, covariance, pieces[0], dt, 1.0)
    found = other.moved(moved, turned, pieces[1], dt, 1.0)
    back = expected[0] @ turn.T
    back[:, :2] += shift
    np.testing.assert_allclose(found[0], back, rtol=1e-6, atol=1e-4)
    np.testing.assert_allclose(found[1], turn @ expected[1] @ turn.T, rtol=1e-5, atol=1e-3)
    a, b = one.entered(mean, covariance, pieces[0]), other.entered(moved, turned, pieces[1])
    np.testing.assert_allclose(a.probability, b.probability, rtol=1e-5)


def test_no_number_of_scans_tells_the_offset_better_than_the_lane_does():
    """Without detections the covariance across becomes that of the lane, and stays it."""
    course = LaneCourse((STRAIGHT,), 10.0)
    mean, covariance = np.array([[500.0, 9.0, 10.0, -1.0]]), np.diag([9.0, 400.0, 4.0, 9.0])[None]
    for _ in range(200):
        mean, covariance = course.moved(
            mean, covariance, course.piece_of(mean, covariance), 1.0, 1e-6
        )
    std = 12.0 * OF_WIDTH
    np.testing.assert_allclose(mean[0, 1], 0.0, atol=1e-6)
    np.testing.assert_allclose(mean[0, 0], 500.0 + 10.0 * 200, rtol=1e-6)
    expected = np.diag([std**2, (std / 10.0) ** 2])
    np.testing.assert_allclose(covariance[0][1::2, 1::2], expected, rtol=1e-6, atol=1e-6)


def test_on_a_straight_lane_the_motion_is_that_of_its_matrices():
    course = LaneCourse((STRAIGHT,), 7.0)
    rng = np.random.default_rng(2)
    root = rng.normal(size=(20, 4, 4))
    covariance = root @ np.swapaxes(root, 1, 2)
    mean = np.column_stack([np.linspace(900, 3000, 20), rng.normal(size=(20, 3))])
    mean[:, 2] += 12.0
    step, noise = np.zeros((4, 4)), np.zeros((4, 4))
    aside, aside_noise = offset_motion(3.0, 7.0)
    step[0::2, 0::2], step[1::2, 1::2] = [[1.0, 3.0], [0.0, 1.0]], aside
    noise[0::2, 0::2] = 2.0 * np.array([[9.0, 4.5], [4.5, 3.0]])
    noise[1::2, 1::2] = (12.0 * OF_WIDTH) ** 2 * aside_noise
    after, spread = course.moved(mean, covariance, course.piece_of(mean, covariance), 3.0, 2.0)
    np.testing.assert_allclose(after, mean @ step.T, rtol=1e-10, atol=1e-9)
    np.testing.assert_allclose(spread, step @ covariance @ step.T + noise, rtol=1e-8, atol=1e-8)


def test_bends_by_monte_carlo():
    """Keepers that are spread over a bend: moments of the cloud that has gone round it."""
    course = LaneCourse((BEND,), 10.0)
    rng = np.random.default_rng(4)
    mean = np.array([[870.0, 1.0, 15.0, 0.1]])
    spread = np.diag([400.0, 4.0, 4.0, 0.04])[None]
    dt, density, n = 8.0, 0.5, 60_000
    piece = course.piece_of(mean, spread)
    after, covariance = course.moved(mean, spread, piece, dt, density)
    local = rng.multivariate_normal(mean[0], spread[0], n)
    step, noise = np.zeros((4, 4)), np.zeros((4, 4))
    aside, aside_noise = offset_motion(dt, 10.0)
    step[0::2, 0::2], step[1::2, 1::2] = [[1.0, dt], [0.0, 1.0]], aside
    noise[0::2, 0::2] = density * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    noise[1::2, 1::2] = (12.0 * OF_WIDTH) ** 2 * aside_noise
    cloud = states(course, local @ step.T + rng.multivariate_normal(np.zeros(4), noise, n))
    std = np.sqrt(np.diag(covariance[0]))
    # Half of the cloud has turned by 45 degrees, half has not.
    assert 3.0 < cloud[:, 3].mean() < 7.0
    assert (np.abs(cloud.mean(axis=0) - after[0]) < 0.05 * std).all()
    assert (np.abs(np.cov(cloud.T) - covariance[0]) < 0.1 * np.outer(std, std)).all()


def test_keepers_are_tracked_consistently_round_bends():
    """NEES of a Kalman filter with this motion, on vehicles that move so: 4."""
    lane = Lane("s", np.array([[0, 0], [700, 0], [1200, 500], [2400, 500.0]]), 12.0, 5.0)
    course, n, density = LaneCourse((lane,), 10.0), 200, 0.25
    rng = np.random.default_rng(6)
    std = 12.0 * OF_WIDTH
    first = np.diag([400.0, std**2, 4.0, (std / 10.0) ** 2])
    x = rng.multivariate_normal([150.0, 0.0, 15.0, 0.0], first, n)
    mean, covariance = np.tile([150.0, 0.0, 15.0, 0.0], (n, 1)), np.tile(first, (n, 1, 1))
    aside, aside_noise = offset_motion(2.0, 10.0)
    ahead_noise = density * np.array([[8.0 / 3.0, 2.0], [2.0, 2.0]])
    squared = []
    for _ in range(40):
        x[:, 0] += 2.0 * x[:, 2]
        x[:, 0::2] += rng.multivariate_normal([0.0, 0.0], ahead_noise, n)
        x[:, 1::2] = x[:, 1::2] @ aside.T
        x[:, 1::2] += rng.multivariate_normal([0.0, 0.0], std**2 * aside_noise, n)
        truth = states(course, x)
        piece = course.piece_of(mean, covariance)
        assert (piece >= 0).all()
        mean, covariance = course.moved(mean, covariance, piece, 2.0, density)
        z = truth[:, :2] + rng.normal(0.0, 10.0, (n, 2))
        gain = covariance[:, :, :2] @ np.linalg.inv(covariance[:, :2, :2] + 100.0 * np.eye(2))
        mean = mean + (gain @ (z - mean[:, :2])[..., None])[..., 0]
        covariance = covariance - gain @ covariance[:, :2]
        gap = mean - truth
        squared.append(np.sum(gap * np.linalg.solve(covariance, gap[..., None])[..., 0], axis=1))
    each = np.mean(squared, axis=0)
    error = each.std(ddof=1) / math.sqrt(n)
    assert error < 0.08
    assert each.mean() == pytest.approx(4.0, abs=0.2)


def test_entries_by_quadrature():
    """Share, mean and covariance of g N over a lattice across the lane."""
    course = LaneCourse((STRAIGHT,), 10.0)
    std, rate = 12.0 * OF_WIDTH, 12.0 * OF_WIDTH / 10.0
    mean = np.array([[900.0, 4.0, 15.0, 0.5]])
    root = np.array([[5.0, 0, 0, 0], [1.0, 4.0, 0, 0], [0.2, 0.1, 1.0, 0], [0.1, 0.4, 0.2, 0.8]])
    covariance = (root @ root.T)[None]
    entry = course.entered(mean, covariance, np.array([0]))
    d, r = np.meshgrid(np.linspace(-25.0, 30.0, 401), np.linspace(-4.5, 5.5, 401), indexing="ij")
    points = np.stack([d.ravel(), r.ravel()], axis=1)
    own = covariance[0][1::2, 1::2]
    gap = points - mean[0, 1::2]
    density = np.exp(-0.5 * np.sum(gap @ np.linalg.inv(own) * gap, axis=1))
    density /= 2 * math.pi * math.sqrt(np.linalg.det(own))
    cell = (d[1, 0] - d[0, 0]) * (r[0, 1] - r[0, 0])
    weight = density * np.exp(-0.5 * ((d.ravel() / std) ** 2 + (r.ravel() / rate) ** 2)) * cell
    assert weight.sum() == pytest.approx(float(entry.probability[0]), rel=1e-6)
    share = weight / weight.sum()
    centre = share @ points
    np.testing.assert_allclose(centre, entry.mean[0, 1::2], rtol=1e-6)
    spread = (share[:, None] * (points - centre)).T @ (points - centre)
    np.testing.assert_allclose(spread, entry.covariance[0][1::2, 1::2], rtol=1e-6, atol=1e-9)
    # What is along the lane follows by regression: the same as a Kalman update by d = d' = 0.
    h = np.eye(4)[1::2]
    gain = covariance[0] @ h.T @ np.linalg.inv(h @ covariance[0] @ h.T + np.diag([std, rate]) ** 2)
    np.testing.assert_allclose(entry.mean[0], mean[0] - gain @ h @ mean[0], rtol=1e-10)


def test_of_those_who_might_be_anywhere_keepers_have_the_distribution_of_keepers():
    course = LaneCourse((STRAIGHT,), 10.0)
    wide = np.diag([100.0, 1e8, 4.0, 1e6])[None]
    entry = course.entered(np.array([[900.0, 0.0, 15.0, 0.0]]), wide, np.array([0]))
    std = 12.0 * OF_WIDTH
    found = entry.covariance[0][1::2, 1::2]
    np.testing.assert_allclose(found, np.diag([std**2, (std / 10) ** 2]), rtol=1e-6, atol=1e-9)
    assert entry.probability[0] == pytest.approx(std / 1e4 * std / 10 / 1e3, rel=1e-6)


def test_lanes_are_chosen_by_place_heading_and_direction():
    lanes = (
        Lane("east", np.array([[0.0, 0.0], [1000.0, 0.0]]), 8.0, 4.0, FORWARD),
        Lane("west", np.array([[1000.0, 5.0], [0.0, 5.0]]), 8.0, 4.0, FORWARD),
        Lane("north", np.array([[500.0, -500.0], [500.0, 500.0]]), 8.0, 4.0),
    )
    course = LaneCourse(lanes, 10.0)
    mean = np.array(
        [
            [300.0, 2.4, 15.0, 0.0],  # nearer to the west lane's middle, but eastbound
            [300.0, 2.4, -15.0, 0.0],
            [501.0, 1.0, 0.0, -15.0],
            [-50.0, 0.0, 15.0, 0.0],  # before its beginning
        ]
    )
    covariance = np.tile(np.diag([4.0, 4.0, 1.0, 1.0]), (4, 1, 1))
    piece = course.piece_of(mean, covariance)
    assert course.lane[piece[:3]].tolist() == [0, 1, 2]
    assert piece[3] == -1
    assert course.entered(mean, covariance, piece).probability[3] == 0.0


def test_the_nearest_piece_is_that_of_a_search_through_all():
    rng = np.random.default_rng(3)
    lanes = tuple(
        Lane(f"{k}", 2000.0 * rng.random((5, 2)), 8.0 + k, 4.0, (FORWARD, "both")[k % 2])
        for k in range(4)
    )
    course = LaneCourse(lanes, 5.0)
    mean = np.hstack([2000.0 * rng.random((30, 2)), rng.normal(0.0, 8.0, (30, 2))])
    spread, fast = rng.uniform(1.0, 900.0, 30), rng.uniform(0.1, 4.0, 30)
    covariance = np.zeros((30, 4, 4))
    covariance[:, range(4), range(4)] = np.stack([spread, spread, fast, fast], axis=1)
    found = course.piece_of(mean, covariance)
    assert 4 < np.count_nonzero(found >= 0) < 27
    for x, p, v, piece in zip(mean, spread, fast, found, strict=True):
        costs = []
        for k in range(len(course.lane)):
            t, length = course.along[k], course.length[k]
            way = (x[:2] - course.start[k]) @ t
            gap = x[:2] - course.start[k] - min(max(way, 0.0), length) * t
            cost = gap @ gap / (course.std_m[k] ** 2 + p)
            rate = course.std_m[k] / 5.0
            cost += (t[0] * x[3] - t[1] * x[2]) ** 2 / (rate**2 + v)
            past = (way < 0 and k == course.first[k]) or (way > length and k == course.last[k])
            against = course.one_way[k] and t @ x[2:] < -math.sqrt(v)
            costs.append(math.inf if past or against else cost)
        best = int(np.argmin(costs))
        assert piece == (best if costs[best] <= 36.0 else -1)


def test_corners_are_rounded_and_ends_stay():
    course = rounded(BEND.points, 24.0)
    np.testing.assert_array_equal(course[[0, -1]], BEND.points[[0, -1]])
    step = np.diff(course, axis=0)
    heading = np.arctan2(step[:, 1], step[:, 0])
    assert np.diff(heading).max() < math.radians(2.5)
    assert np.diff(heading).min() >= -1e-12
    assert np.hypot(*(course - BEND.points[1]).T).min() < 5.0
    # Points close together: never past the middle between two corners.
    angle = np.linspace(0.0, 1.5, 16)
    arc = 100.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    smooth = rounded(arc, 1000.0)
    assert np.abs(np.hypot(*smooth.T) - 100.0).max() < 0.15
    assert np.hypot(*np.diff(smooth, axis=0).T).min() > 1e-3
