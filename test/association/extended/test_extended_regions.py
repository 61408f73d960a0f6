"""Partitions region by region: the best of all combinations."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from gda_tracker.association.extended.hypotheses import ExtendedSensor, explain, explain_partition
from gda_tracker.association.extended.regions import explain_by_region
from gda_tracker.kinematics.extended.partitions import by_appearance, distance_partitions
from gda_tracker.kinematics.extended.random_matrix import ExtendedStates

SENSOR = ExtendedSensor(clutter_density=1e-3, birth_density=1e-4, birth_radius_m=1.0)


def states_at(places, radius):
    n = len(places)
    mean = np.concatenate([np.asarray(places, dtype=float), np.zeros((n, 2))], axis=1)
    return ExtendedStates(
        mean,
        np.tile(np.diag([0.05, 0.05, 1.0, 1.0]), (n, 1, 1)),
        np.square(radius)[:, None, None] * np.eye(2),
        np.full(n, 60.0),
    )


def scene(seed):
    """A wide object, and far away two small ones side by side."""
    rng = np.random.default_rng(seed)
    wide = rng.uniform(-3.0, 3.0, (8, 2))
    small = rng.normal(0.0, 0.15, (10, 2)) + np.repeat([[0.0, 0.0], [1.5, 0.0]], 5, axis=0)
    points = np.concatenate([wide, small + [60.0, 0.0]])
    states = states_at([(0, 0), (60, 0), (61.5, 0)], np.array([3.5, 0.35, 0.35]))
    return points, states, np.tile(1e-3 * np.eye(2), (len(points), 1, 1))


def combined(points, partitions, pick):
    """The label of one partition for each region, and the region of each detection."""
    region = partitions[-1]
    own = partitions[np.asarray(pick)[region], np.arange(len(points))]
    return by_appearance(region * 1000 + own)


@pytest.mark.parametrize("seed", range(4))
def test_it_is_the_best_of_all_combinations(seed):
    points, states, noise = scene(seed)
    partitions = distance_partitions(points, 0.2, 5.0, 5)
    rate = np.full(3, 10.0), np.full(3, 1.5)
    found, probability = explain_by_region(states, *rate, points, noise, partitions, SENSOR)
    regions = int(partitions[-1].max()) + 1
    labels = {
        combined(points, partitions, pick).tobytes()
        for pick in itertools.product(range(len(partitions)), repeat=regions)
    }
    weights = np.array(
        [
            explain_partition(
                states, *rate, points, noise, np.frombuffer(label, dtype=np.int64), SENSOR
            ).log_weight
            for label in sorted(labels)
        ]
    )
    assert found.log_weight == pytest.approx(weights.max())
    assert probability == pytest.approx(np.exp(weights.max() - np.logaddexp.reduce(weights)))
    whole, _ = explain(states, *rate, points, noise, partitions, SENSOR)
    assert found.log_weight >= whole[0].log_weight - 1e-9


def test_objects_of_different_size_need_not_agree_on_a_distance():
    points, states, noise = scene(1)
    partitions = distance_partitions(points, 0.2, 5.0, 8)
    found, _ = explain_by_region(
        states, np.full(3, 10.0), np.full(3, 1.5), points, noise, partitions, SENSOR
    )
    assert sorted(found.cells.count[found.cell_of].tolist()) == [5, 5, 8]


def test_densities_scale_by_detection():
    points, states, noise = scene(2)
    label = distance_partitions(points, 0.2, 5.0, 1)[0]
    args = (states, np.full(3, 10.0), np.full(3, 1.5), points, noise, label)
    half = ExtendedSensor(clutter_density=5e-4, birth_density=5e-5, birth_radius_m=1.0)
    scaled = explain_partition(*args, SENSOR, relative_density=np.full(len(points), 0.5))
    assert scaled.log_weight == pytest.approx(explain_partition(*args, half).log_weight)


def test_a_scan_without_detections():
    _, states, _ = scene(0)
    found, probability = explain_by_region(
        states, np.full(3, 10.0), np.full(3, 1.5), np.empty((0, 2)), np.empty((0, 2, 2)),
        np.zeros((1, 0), dtype=np.int64), SENSOR,
    )  # fmt: skip
    assert (found.cell_of == -1).all()
    assert probability == 1.0
