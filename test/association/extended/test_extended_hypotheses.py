"""Hypotheses of extended objects against brute force, and the tracker on simulated objects."""

import itertools

import numpy as np
import pytest
from scipy.special import gammaln

from gda_tracker.association.extended.hypotheses import (
    ExtendedSensor,
    explain,
    new_object_log_weight,
)
from gda_tracker.association.extended.tracker import ExtendedTracker, ExtendedTrackerParameters
from gda_tracker.kinematics.extended.detection_rate import log_count_probability
from gda_tracker.kinematics.extended.ellipses import extent_of, semi_axes
from gda_tracker.kinematics.extended.partitions import distance_partitions
from gda_tracker.kinematics.extended.random_matrix import (
    ExtendedStates,
    cells_of,
    feldmann_log_likelihood,
)

SENSOR = ExtendedSensor(detection_probability=0.9, ghost_density=2e-4)


def two_objects():
    return (
        ExtendedStates(
            np.array([[0.0, 0.0, 0.0, 0.0], [3.0, 0.0, 0.0, 0.0]]),
            np.tile(0.05 * np.eye(4), (2, 1, 1)),
            np.tile(np.eye(2), (2, 1, 1)),
            np.array([20.0, 20.0]),
        ),
        np.array([10.0, 10.0]),
        np.array([2.0, 2.0]),
    )


def test_hypotheses_are_the_best_of_all_assignments():
    rng = np.random.default_rng(3)
    states, shape, rate = two_objects()
    points = np.concatenate([rng.normal([0, 0], 0.5, (4, 2)), rng.normal([3, 0], 0.5, (5, 2))])
    points = np.vstack([points, [[8.0, 8.0]]])
    noise = np.tile(0.01 * np.eye(2), (10, 1, 1))
    partitions = distance_partitions(points, 0.3, 3.0)
    found, probability = explain(states, shape, rate, points, noise, partitions, SENSOR, 1e9)
    assert probability.sum() == pytest.approx(1.0)
    assert (np.diff(probability) <= 0).all()
    assert len(found) == len(partitions) > 2
    for one in found:
        cells = cells_of(points, one.label, noise)
        count = len(cells.count)
        alone = np.logaddexp(
            cells.count * np.log(SENSOR.clutter_density),
            new_object_log_weight(cells, SENSOR) + np.log(1.2),
        )
        best = -np.inf
        for choice in itertools.product(range(-1, count), repeat=2):
            if choice[0] == choice[1] != -1:
                continue
            weight = sum(alone[c] for c in range(count) if c not in choice)
            for i, c in enumerate(choice):
                row = np.array([i])
                n = np.array([0 if c < 0 else cells.count[c]])
                log_count = log_count_probability(shape[row], rate[row], n)[0]
                if c < 0:
                    weight += np.log(0.1 + 0.9 * np.exp(log_count))
                else:
                    own = cells.select(np.array([c]))
                    weight += np.log(0.9) + log_count + gammaln(n[0] + 1.0)
                    weight += feldmann_log_likelihood(states.select(row), own)[0]
            best = max(best, weight)
        assert one.log_weight == pytest.approx(best)


def test_the_right_partition_wins_where_one_threshold_fails():
    """Objects 2.2 m apart, one with a gap inside: joined by far, torn by near thresholds."""
    rng = np.random.default_rng(1)
    states, shape, rate = two_objects()
    right = 0
    for _ in range(20):
        points = np.concatenate(
            [rng.uniform(-0.8, 0.8, (6, 2)), rng.uniform(-0.8, 0.8, (6, 2)) + [3.0, 0.0]]
        )
        partitions = distance_partitions(points, 0.2, 4.0)
        noise = np.tile(0.01 * np.eye(2), (12, 1, 1))
        found, _ = explain(states, shape, rate, points, noise, partitions, SENSOR)
        right += found[0].label.tolist() == [0] * 6 + [1] * 6
    assert right >= 18


def simulate(rng, time_s):
    """Two ellipses on crossing courses, 2 m apart at the nearest, and two false alarms a scan."""
    points = []
    for way, angle in (([-6 + time_s, 1.5], 0.0), ([6 - time_s, -1.5], 0.6)):
        n = rng.poisson(9.0)
        radius, turn = np.sqrt(rng.uniform(0, 1, n)), rng.uniform(0, 2 * np.pi, n)
        disc = radius[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        root = np.linalg.cholesky(extent_of(np.array([1.2, 0.5]), angle))
        points.append(way + disc @ root.T)
    points.append(rng.uniform(-20, 20, (rng.poisson(2.0), 2)))
    every = np.concatenate(points)
    return every + rng.normal(0, 0.1, every.shape)


def test_two_objects_are_followed_with_their_extents():
    rng = np.random.default_rng(5)
    tracker = ExtendedTracker(
        ExtendedTrackerParameters(SENSOR, extent_memory_s=20.0, acceleration_density_m2ps3=0.1)
    )
    seen = []
    for k in range(60):
        points = simulate(rng, 0.2 * k)
        tracks = tracker.process(0.2 * k, points, np.tile(0.01 * np.eye(2), (len(points), 1, 1)))
        assert tracks.partition_probability.sum() == pytest.approx(1.0)
        seen.append(tracks.track_id[tracks.confirmed].tolist())
    assert seen[-1] == seen[10]
    assert len(seen[-1]) == 2
    final = tracks.states.select(np.flatnonzero(tracks.confirmed))
    order = np.argsort(final.mean[:, 1])[::-1]
    length, angle = semi_axes(final.extent[order])
    np.testing.assert_allclose(length, [[1.2, 0.5]] * 2, atol=0.25)
    np.testing.assert_allclose(angle, [0.0, 0.6], atol=0.25)
    np.testing.assert_allclose(final.mean[order, 2], [1.0, -1.0], atol=0.3)
    expected = tracks.expected_detections()[tracks.confirmed]
    np.testing.assert_allclose(expected, 9.0, rtol=0.35)
    for k in range(60, 90):
        tracks = tracker.process(0.2 * k, np.empty((0, 2)), np.empty((0, 2, 2)))
    assert not len(tracks.track_id)


def test_wrong_input_changes_nothing():
    tracker = ExtendedTracker()
    points, noise = np.zeros((4, 2)), np.tile(0.01 * np.eye(2), (4, 1, 1))
    before = tracker.process(1.0, points, noise)
    for time_s, at, spread, why in (
        (0.5, points, noise, "time_s = 0.5"),
        (2.0, points[:, :1], noise, r"positions have the shape \(4, 1\)"),
        (2.0, points, noise[:2], "noise"),
        (2.0, points * np.nan, noise, "finite"),
    ):
        with pytest.raises(ValueError, match=why):
            tracker.process(time_s, at, spread)
        assert tracker.tracks is before
    with pytest.raises(ValueError, match="detection_probability = 1"):
        ExtendedSensor(detection_probability=1.0)
    with pytest.raises(ValueError, match="birth_weight = 2"):
        ExtendedSensor(birth_weight=2.0)
    with pytest.raises(ValueError, match="ghost_density"):
        ExtendedSensor(ghost_density=-1.0)
    with pytest.raises(ValueError, match="clutter_density"):
        ExtendedSensor(clutter_density=0.0)
