"""Two-point differencing by hand and by Monte Carlo, the pairs made, and how long one waits."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.kinematics.sensor_models import PolarMeasurements, cartesian_positions
from gda_tracker.tracking import initiation
from gda_tracker.tracking.initiation import (
    StartPoints,
    bounded_speed,
    start_tracks,
    two_point_states,
)

SECOND = 1_000_000_000
R = np.diag([10.0**2, 0.001**2])


def measurements_of(positions, offsets=None, covariance=R):
    """Measurements of a sensor at the origin that see exactly these positions."""
    positions = np.asarray(positions, dtype=float).reshape(-1, 2)
    n = len(positions)
    return PolarMeasurements(
        np.hypot(positions[:, 0], positions[:, 1]),
        np.arctan2(positions[:, 1], positions[:, 0]),
        np.tile(covariance, (n, 1, 1)),
        np.zeros(2),
        None if offsets is None else np.asarray(offsets, dtype=float),
    )


def run(scans, period_s=1.0, max_speed_mps=50.0, memory_scans=2, offsets=None):
    """Start tracks on scan after scan of positions; return what started, per scan."""
    points, started = StartPoints(), []
    for k, positions in enumerate(scans):
        z = measurements_of(positions, None if offsets is None else offsets[k])
        new, points = start_tracks(
            points,
            z,
            np.arange(len(z)),
            round(k * period_s * SECOND),
            max_speed_mps=max_speed_mps,
            memory_scans=memory_scans,
        )
        started.append(new)
    return started, points


# --- states


def test_two_points_worked():
    mean, covariance = two_point_states(
        np.array([[1000.0, 2000.0]]),
        np.array([[[4.0, 1.0], [1.0, 9.0]]]),
        np.array([[1100.0, 1950.0]]),
        np.array([[[16.0, 2.0], [2.0, 25.0]]]),
        np.array([5.0]),
    )
    np.testing.assert_allclose(mean, [[1100.0, 1950.0, 20.0, -10.0]])
    np.testing.assert_allclose(
        covariance[0],
        [
            [16.0, 2.0, 16 / 5, 2 / 5],
            [2.0, 25.0, 2 / 5, 25 / 5],
            [16 / 5, 2 / 5, 20 / 25, 3 / 25],
            [2 / 5, 25 / 5, 3 / 25, 34 / 25],
        ],
    )


def test_equal_noise_gives_the_chapters_p0():
    """P0 of section 14.2.2, p(s) = s^2 [[1, 1/T], [1/T, 2/T^2]] per coordinate."""
    t, sx, sy = 5.0, 30.0, 70.0
    noise = np.diag([sx**2, sy**2])[None]
    _, covariance = two_point_states(np.zeros((1, 2)), noise, np.ones((1, 2)), noise, np.array([t]))

    def p(s):
        return s**2 * np.array([[1, 1 / t], [1 / t, 2 / t**2]])

    chapter_order = np.ix_([0, 2, 1, 3], [0, 2, 1, 3])
    expected = np.block([[p(sx), np.zeros((2, 2))], [np.zeros((2, 2)), p(sy)]])
    np.testing.assert_allclose(covariance[0][chapter_order], expected)


@pytest.mark.parametrize("offset_s", [0.0, 0.8], ids=["one_time", "time_offset"])
def test_covariance_is_that_of_simulated_starts(offset_s):
    """Detections of one moving target, drawn many times: the errors have the stated covariance."""
    rng = np.random.default_rng(5)
    n, t = 100_000, 4.0
    state = np.array([6e3, 8e3, 30.0, -80.0])
    root = np.linalg.cholesky(np.array([[20.0**2, 0.02], [0.02, 0.004**2]]))

    def seen(at, count):
        x, y = state[:2] + at * state[2:]
        noise = rng.normal(size=(count, 2)) @ root.T
        return PolarMeasurements(
            math.hypot(x, y) + noise[:, 0],
            math.atan2(y, x) + noise[:, 1],
            np.tile(root @ root.T, (count, 1, 1)),
            np.zeros(2),
            None,
        )

    first, _ = cartesian_positions(seen(offset_s - t, n))
    second, _ = cartesian_positions(seen(offset_s, n))
    velocity = (second - first) / t
    errors = np.hstack([second - offset_s * velocity, velocity]) - state
    exact = np.array([state[:2] + at * state[2:] for at in (offset_s - t, offset_s)])
    started, _ = start_two(exact, t, offset_s, root @ root.T)
    np.testing.assert_allclose(started.mean[0], state, rtol=1e-9)
    sample = np.cov(errors.T)
    scale = np.sqrt(np.outer(np.diag(sample), np.diag(sample)))
    np.testing.assert_allclose(started.covariance[0] / scale, sample / scale, atol=0.02)


def start_two(positions, t, offset_s, covariance):
    """One track from two positions ``t`` apart, both ``offset_s`` after their scan's stamp."""
    points = StartPoints()
    for k, position in enumerate(positions):
        z = measurements_of([position], [offset_s], covariance)
        new, points = start_tracks(
            points, z, np.arange(1), round(k * t * SECOND), max_speed_mps=500.0, memory_scans=2
        )
    return new, points


# --- pairs


def test_a_target_starts_on_its_second_detection():
    started, points = run([[[1000.0, 0.0]], [[1010.0, 5.0]]])
    assert [len(new.detection) for new in started] == [0, 1]
    np.testing.assert_allclose(started[1].mean, [[1010.0, 5.0, 10.0, 5.0]])
    assert started[1].first_stamp_ns.tolist() == [0]
    assert started[1].gap_scans.tolist() == [1]
    assert len(points) == 0


def test_only_unassigned_detections_take_part():
    _, points = run([[[1000.0, 0.0], [5000.0, 0.0]]])
    z = measurements_of([[3000.0, 0.0], [5005.0, 0.0], [1005.0, 0.0]])
    new, points = start_tracks(points, z, np.array([1]), SECOND, max_speed_mps=50.0, memory_scans=2)
    assert new.detection.tolist() == [1]
    np.testing.assert_allclose(points.position, [[1000.0, 0.0]])


def test_speed_limit_with_three_standard_deviations():
    # At 1 km the noise is 10 m along and 1 m across, for both: sqrt(2 * 101).
    reach = 50.0 + 3.0 * math.sqrt(2 * 101.0)
    for factor, count in ((0.999, 1), (1.001, 0)):
        started, _ = run([[[1000.0, 0.0]], [[1000.0 + factor * reach, 0.0]]])
        assert len(started[1].detection) == count


def test_no_start_from_one_instant():
    """Two sensors at once give no velocity; the points wait."""
    points = StartPoints()
    for _ in range(2):
        new, points = start_tracks(
            points,
            measurements_of([[1000.0, 0.0]]),
            np.arange(1),
            SECOND,
            max_speed_mps=50.0,
            memory_scans=3,
        )
        assert len(new.detection) == 0
    assert len(points) == 2


def test_the_most_pairs_win_over_the_nearest():
    """1045 is nearest to 1000, but only 1000 reaches 910: 1100 takes it, and two tracks start."""
    scans = [[[1000.0, 0.0], [1100.0, 0.0]], [[1045.0, 0.0], [910.0, 0.0]]]
    started, points = run(scans)
    np.testing.assert_allclose(started[1].mean[:, 2], [-90.0, -55.0])
    assert len(points) == 0


@pytest.mark.parametrize(
    ("memory", "gap", "count"), [(1, 1, 1), (1, 2, 0), (2, 2, 1), (2, 3, 0), (5, 5, 1), (5, 6, 0)]
)
def test_a_point_waits_for_as_many_scans_as_stated(memory, gap, count):
    scans = [[[1000.0, 0.0]], *[[] for _ in range(gap - 1)], [[1000.0 + gap, 0.0]]]
    started, _ = run(scans, memory_scans=memory)
    assert len(started[-1].detection) == count
    if count:
        assert started[-1].gap_scans.tolist() == [gap]
        np.testing.assert_allclose(started[-1].mean[0, 2:], [1.0, 0.0], atol=1e-9)


def test_a_used_detection_starts_no_second_track():
    scans = [[[1000.0, 0.0]], [[1001.0, 0.0]], [[1002.0, 0.0]], [[1003.0, 0.0]]]
    started, _ = run(scans, memory_scans=5)
    assert [len(new.detection) for new in started] == [0, 1, 0, 1]


def test_time_offsets_count_in_the_time_between():
    """A target at 100 m/s seen 0.4 s after the first stamp and 0.9 s after the second."""
    started, _ = run(
        [[[1040.0, 0.0]], [[1190.0, 0.0]]], max_speed_mps=150.0, offsets=[[0.4], [0.9]]
    )
    # State at the second stamp: 1040 + 0.6 * 100.
    np.testing.assert_allclose(started[1].mean, [[1100.0, 0.0, 100.0, 0.0]], atol=1e-6)
    assert started[1].first_stamp_ns.tolist() == [400_000_000]


# --- the assignment against brute force and against its own second way


def brute_force(points, z, stamp_ns, max_speed):
    """Best assignment by trying all: most pairs, then the least sum of distance over reach."""
    position, covariance = cartesian_positions(z)
    cost = {}
    for i, j in itertools.product(range(len(points)), range(len(z))):
        dt = (stamp_ns - points.stamp_ns[i]) / 1e9
        sigma = math.sqrt(np.trace(points.covariance[i]) + np.trace(covariance[j]))
        distance = math.dist(points.position[i], position[j])
        if dt > 0 and distance <= max_speed * dt + 3 * sigma:
            cost[i, j] = distance / (max_speed * dt + 3 * sigma)
    best = (0, 0.0)
    for size in range(1, min(len(points), len(z)) + 1):
        for rows in itertools.combinations(range(len(points)), size):
            for columns in itertools.permutations(range(len(z)), size):
                pairs = list(zip(rows, columns, strict=True))
                if all(pair in cost for pair in pairs):
                    best = max(best, (size, -sum(cost[pair] for pair in pairs)))
    return best


@settings(derandomize=True, deadline=None, max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(0, 4), st.integers(0, 4))
def test_pairs_equal_brute_force(seed, n_points, n_fresh):
    rng = np.random.default_rng(seed)
    _, points = run([1000.0 + 150.0 * rng.random((n_points, 2))])
    z = measurements_of(1000.0 + 150.0 * rng.random((n_fresh, 2)))
    new, left = start_tracks(
        points, z, np.arange(n_fresh), SECOND, max_speed_mps=50.0, memory_scans=2
    )
    count, negative_cost = brute_force(points, z, SECOND, 50.0)
    assert len(new.detection) == count
    assert len(left) == n_points + n_fresh - 2 * count
    position, covariance = cartesian_positions(z)
    total = 0.0
    for state, j in zip(new.mean, new.detection, strict=True):
        origin = state[:2] - state[2:]
        i = int(np.argmin(np.linalg.norm(points.position - origin, axis=1)))
        sigma = math.sqrt(np.trace(points.covariance[i]) + np.trace(covariance[j]))
        total += math.dist(points.position[i], position[j]) / (50.0 + 3 * sigma)
    assert total == pytest.approx(-negative_cost, abs=1e-6)


def test_full_matrix_and_sparse_graph_agree(monkeypatch):
    """Both ways of assigning, on clutter dense enough for chains of alternatives."""
    rng = np.random.default_rng(7)
    scans = [3000.0 + 1500.0 * rng.random((250, 2)) for _ in range(3)]
    results = []
    for cells in (0, 10**9):
        monkeypatch.setattr(initiation, "DENSE_CELLS", cells)
        results.append(run(scans, memory_scans=2))
    for sparse, dense in zip(results[0][0], results[1][0], strict=True):
        np.testing.assert_array_equal(sparse.detection, dense.detection)
        np.testing.assert_array_equal(sparse.mean, dense.mean)
    np.testing.assert_array_equal(results[0][1].position, results[1][1].position)
    assert len(results[0][0][1].detection) > 100


def test_five_thousand_detections_in_a_scan_are_no_stall():
    """No matrix of all pairs: 25 million cells would take a gigabyte and many seconds."""
    rng = np.random.default_rng(1)
    radius, angle = 1e5 * np.sqrt(rng.random((2, 5000))), rng.uniform(-np.pi, np.pi, (2, 5000))
    scans = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=2)
    started, _ = run(scans, period_s=5.0, max_speed_mps=100.0)
    assert len(started[1].detection) > 500
    z = measurements_of(scans[1])
    position, _ = cartesian_positions(z)
    speeds = np.linalg.norm(started[1].mean[:, 2:], axis=1)
    assert (5.0 * speeds <= 500.0 + 3.0 * math.sqrt(2 * (100.0 + 1e10 * 1e-6))).all()
    assert len(set(started[1].detection.tolist())) == len(started[1].detection)
    assert len(position) == 5000


# --- the bound on the speed


def test_bounded_speed_is_the_kalman_update_with_a_measured_velocity_of_zero():
    from filterpy.kalman import KalmanFilter

    rng = np.random.default_rng(5)
    root = rng.normal(size=(3, 4, 4))
    covariance = root @ root.transpose(0, 2, 1)
    mean = rng.normal(scale=30.0, size=(3, 4))
    bounded, reduced = bounded_speed(mean, covariance, 8.0)
    for i in range(3):
        peer = KalmanFilter(dim_x=4, dim_z=2)
        peer.x, peer.P = mean[i].copy(), covariance[i].copy()
        peer.H = np.hstack([np.zeros((2, 2)), np.eye(2)])
        peer.R = 16.0 * np.eye(2)
        peer.update(np.zeros(2))
        np.testing.assert_allclose(bounded[i], peer.x, rtol=1e-9)
        np.testing.assert_allclose(reduced[i], peer.P, rtol=1e-9, atol=1e-12)


def test_bounded_speed_matters_only_where_speeds_are_unknown():
    """Precise positions keep their velocity; two echoes at 40 m/s with 30 m of noise lose it."""
    state = np.array([[0.0, 0.0, 40.0, 0.0]])
    for std_m, low, high in ((0.01, 39.9, 40.0), (30.0, 0.0, 2.0)):
        noise = std_m**2 * np.eye(2)[None]
        _, covariance = two_point_states(
            np.zeros((1, 2)), noise, state[:, 2:] * 1.68, noise, np.array([1.68])
        )
        bounded, _ = bounded_speed(state, covariance, 10.0)
        assert low <= bounded[0, 2] <= high


def test_rows_are_numbered_as_by_unique():
    rng = np.random.default_rng(0)
    for _ in range(200):
        values = rng.integers(0, rng.integers(1, 30), rng.integers(1, 40))
        distinct, place = initiation._numbered(values)
        expected, inverse = np.unique(values, return_inverse=True)
        assert np.array_equal(distinct, expected)
        assert np.array_equal(place, inverse.ravel())
