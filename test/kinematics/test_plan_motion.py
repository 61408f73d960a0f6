"""Waypoints as artificial measurements: the order of processing, joint Gaussians, Monte Carlo."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from gda_tracker.kinematics.context import Plan
from gda_tracker.kinematics.motion_models import white_noise_acceleration
from gda_tracker.kinematics.plan_motion import PlanCourse, waypoint_covariance

S = 1_000_000_000
Q = 0.7


def plan(times=(20.0, 45.0, 60.0), tolerance=30.0, late=0.0):
    points = np.array([[300.0, 50.0], [700.0, 10.0], [900.0, 200.0]])[: len(times)]
    return Plan(
        "p",
        1,
        np.array([round(t * S) for t in times], dtype=np.int64),
        points,
        np.full(len(times), tolerance),
        50.0,
        np.full(len(times), late),
    )


def turns(goal, t):
    """By how much the plan changes its velocity at a time: an input that keepers know."""
    number = np.flatnonzero(goal.time_ns[1:-1] == round(t * S))
    return np.diff(goal.velocity_mps, axis=0)[number[0]] if len(number) else np.zeros(2)


def joint(mean, covariance, times, goal):
    """Mean and covariance of the states at all times (K,), beginning with that given."""
    count = len(times)
    means, blocks = [mean], [covariance]
    full = np.zeros((4 * count, 4 * count))
    full[:4, :4] = covariance
    for k in range(1, count):
        f, q = white_noise_acceleration(times[k] - times[k - 1], Q)
        means.append(f @ means[-1] + np.append([0.0, 0.0], turns(goal, times[k])))
        blocks.append(f @ blocks[-1] @ f.T + q)
        full[4 * k : 4 * k + 4, : 4 * k] = f @ full[4 * k - 4 : 4 * k, : 4 * k]
        full[: 4 * k, 4 * k : 4 * k + 4] = full[4 * k : 4 * k + 4, : 4 * k].T
        full[4 * k : 4 * k + 4, 4 * k : 4 * k + 4] = blocks[-1]
    return np.concatenate(means), full


def conditioned(mean, covariance, rows, z, noise):
    """Of a joint Gaussian, given that ``rows`` of it were measured as z."""
    cross = covariance[:, rows]
    gain = cross @ np.linalg.inv(covariance[np.ix_(rows, rows)] + noise)
    return mean + gain @ (z - mean[rows]), covariance - gain @ cross.T


START = np.array([10.0, -20.0, 14.0, 2.0])
ROOT = np.array([[6.0, 0, 0, 0], [1.0, 8.0, 0, 0], [0.5, 0.2, 2.0, 0], [0.0, 0.6, 0.3, 2.5]])
SPREAD = ROOT @ ROOT.T


def test_worked_values_of_one_waypoint():
    """By hand: at rest at 0 exactly where the plan has 10 / 3 m/s, 3 s before it; q = 1, W = 1."""
    one = Plan(
        "p", 1, np.array([0, 3 * S]), np.array([[0.0, 0.0], [10.0, 0.0]]), np.array([1e6, 2.0]), 9.0
    )
    course = PlanCourse(one, 1.0)
    entry = course.ahead(0).entered(np.zeros((1, 4)), np.zeros((1, 4, 4)))
    # It would miss the waypoint by 10 m: exp(-100 / (2 (9 + 1))).
    assert entry.probability[0] == pytest.approx(math.exp(-5.0), rel=1e-6)
    after, spread = course.moved(np.zeros((1, 4)), np.zeros((1, 4, 4)), 0, 3 * S)
    # x(3) = 9 / (9 + 1) 10; v(3) = (cov(x, v) = 4.5) / 10 of 10; variance 9 - 81 / 10.
    np.testing.assert_allclose(after[0], [9.0, 0.0, 4.5, 0.0], atol=1e-9)
    np.testing.assert_allclose(spread[0, 0, 0], 0.9, atol=1e-9)
    np.testing.assert_allclose(spread[0, 2, 2], 3.0 - 4.5**2 / 10.0, atol=1e-9)


@given(st.lists(st.integers(1, 9), min_size=2, max_size=7), st.floats(5.0, 80.0))
@settings(max_examples=12, deadline=None)
def test_waypoints_first_and_scans_out_of_sequence(steps, tolerance):
    """After any scans the keeper is what the joint Gaussian of all states is, given waypoints."""
    goal = plan(tolerance=tolerance)
    course = PlanCourse(goal, Q)
    rng = np.random.default_rng(sum(steps))
    scans = np.cumsum(steps).astype(float)
    way = goal.time_ns / S
    times = np.unique(np.concatenate([[0.0], scans, way]))
    mean, covariance = joint(START, SPREAD, times, goal)
    for number, t in enumerate(way):
        rows = 4 * int(np.searchsorted(times, t)) + np.arange(2)
        mean, covariance = conditioned(
            mean, covariance, rows, goal.points[number], waypoint_covariance(goal, number)
        )
    entry = course.ahead(0).entered(START[None], SPREAD[None])
    x, p, before = entry.mean, entry.covariance, 0
    np.testing.assert_allclose(x[0], mean[:4], rtol=1e-7, atol=1e-6)
    for t in scans:
        x, p = course.moved(x, p, before, round(t * S))
        before = round(t * S)
        z, noise = rng.normal(0.0, 100.0, 2) + [400.0, 50.0], np.diag([90.0, 120.0])
        rows = 4 * int(np.searchsorted(times, t)) + np.arange(2)
        mean, covariance = conditioned(mean, covariance, rows, z, noise)
        updated = conditioned(x[0], p[0], np.arange(2), z, noise)
        x, p = updated[0][None], updated[1][None]
        here = slice(rows[0], rows[0] + 4)
        np.testing.assert_allclose(x[0], mean[here], rtol=1e-6, atol=1e-4)
        np.testing.assert_allclose(p[0], covariance[here, here], rtol=1e-5, atol=1e-4)


def test_the_share_is_the_density_of_the_waypoints():
    """Ratios of shares are those of the predictive density of all waypoints."""
    goal = plan()
    course = PlanCourse(goal, Q)
    way = goal.time_ns / S
    others = START + np.array([[0, 0, 0, 0], [40, 0, 0, 0], [0, 0, -4.0, 3.0], [5, 90, 1, -1.0]])
    found = course.ahead(0).entered(others, np.tile(SPREAD, (4, 1, 1)))
    logs = []
    for state in others:
        mean, covariance = joint(state, SPREAD, np.append(0.0, way), goal)
        rows = np.concatenate([4 * k + np.arange(2) for k in (1, 2, 3)])
        noise = np.kron(np.eye(3), waypoint_covariance(goal, 0))
        wanted = multivariate_normal(mean[rows], covariance[np.ix_(rows, rows)] + noise)
        logs.append(wanted.logpdf(goal.points.ravel()))
    np.testing.assert_allclose(
        np.diff(np.log(found.probability)), np.diff(logs), rtol=1e-6, atol=1e-6
    )
    # What is known exactly to be where the plan would have it takes it up for certain.
    ahead = course.ahead(0)
    assert ahead.entered(ahead.planned[None], np.zeros((1, 4, 4))).probability[0] == 1.0


def test_bridges_by_monte_carlo():
    """Moments of many that move freely, weighted by how well they meet the waypoint."""
    goal = plan(times=(20.0, 45.0), tolerance=60.0)
    course = PlanCourse(goal, Q)
    rng = np.random.default_rng(8)
    n = 60_000
    x = rng.multivariate_normal(START, SPREAD, n)
    at, weight = [], np.zeros(n)
    for t, dt in ((10.0, 10.0), (20.0, 10.0), (45.0, 25.0)):
        f, q = white_noise_acceleration(dt, Q)
        x = x @ f.T + rng.multivariate_normal(np.zeros(4), q, n)
        x[:, 2:] += turns(goal, t)
        at.append(x)
        for number in np.flatnonzero(goal.time_ns == round(t * S)):
            gap = x[:, :2] - goal.points[number]
            weight -= 0.5 * np.sum(gap**2, axis=1) / 30.0**2
    share = np.exp(weight - weight.max())
    share /= share.sum()
    entry = course.ahead(0).entered(START[None], SPREAD[None])
    mean, covariance = course.moved(entry.mean, entry.covariance, 0, 10 * S)
    centre = share @ at[0]
    spread = (share[:, None] * (at[0] - centre)).T @ (at[0] - centre)
    std = np.sqrt(np.diag(spread))
    few = math.sqrt(np.sum(share**2))  # one over the root of the effective number
    assert few < 0.04
    assert (np.abs(centre - mean[0]) < 5.0 * few * std).all()
    assert (np.abs(spread - covariance[0]) < 8.0 * few * np.outer(std, std)).all()


def test_early_and_late_arrivals_and_the_end_of_a_plan():
    goal = plan(late=6.0)
    speed = goal.velocity_mps
    np.testing.assert_allclose(speed[0], [16.0, -1.6])
    expected = np.eye(2) * 15.0**2 + 12.0 * np.outer(speed[0], speed[0])
    np.testing.assert_allclose(waypoint_covariance(goal, 0), expected)
    course = PlanCourse(goal, Q)
    x, p = course.moved(START[None], SPREAD[None], 60 * S, 70 * S)
    f, q = white_noise_acceleration(10.0, Q)
    np.testing.assert_allclose(x[0], f @ START, rtol=1e-9)
    np.testing.assert_allclose(p[0], f @ SPREAD @ f.T + q, rtol=1e-9)
    assert not course.ahead(60 * S).matrix.any()
    np.testing.assert_allclose(course.planned(50 * S)[:2], [700 + 1000 / 15, 10 + 190 / 3])
    # The tests of events allow as much: a distance that covers the time at the planned speed.
    assert goal.tolerance_along_m[0] == pytest.approx(30.0 + 6.0 * math.hypot(16.0, 1.6))
