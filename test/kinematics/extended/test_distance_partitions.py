"""Partitions by distance against connected components of the graph of near pairs."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import cdist

from gda_tracker.kinematics.extended.partitions import distance_partitions


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(2, 25))
def test_partitions_are_those_of_the_graph(seed, n):
    rng = np.random.default_rng(seed)
    points = rng.uniform(0, 10, (n, 2))
    found = distance_partitions(points, 0.5, 4.0, most=1000)
    distance = cdist(points, points)
    edges = np.concatenate([[0.5], np.sort(distance[(distance > 0.5) & (distance <= 4.0)])])
    expected = {tuple(connected_components(distance <= e + 1e-12)[1]) for e in edges}
    assert {tuple(row) for row in found.tolist()} == expected
    assert len(found) == len(expected)
    cells = found.max(axis=1)
    assert (np.diff(cells) < 0).all()


def test_few_partitions_are_those_that_last():
    """Two pairs, 1 m within, 3 m apart: at 1.0-3.0 two cells, at 3.0-3.2 one."""
    points = np.array([[0.0, 0.0], [1.0, 0.0], [4.0, 0.0], [5.05, 0.0]])
    assert distance_partitions(points, 0.5, 3.2, most=1).tolist() == [[0, 0, 1, 1]]
    assert distance_partitions(points, 0.5, 3.2, most=2).tolist() == [[0, 1, 2, 3], [0, 0, 1, 1]]
    assert len(distance_partitions(points, 0.5, 3.2)) == 4


def test_small_and_wrong_input():
    assert distance_partitions(np.empty((0, 2)), 1.0, 2.0).shape == (1, 0)
    assert distance_partitions(np.zeros((1, 2)), 1.0, 2.0).tolist() == [[0]]
    assert distance_partitions(np.zeros((3, 2)), 1.0, 1.0).tolist() == [[0, 0, 0]]
    with pytest.raises(ValueError, match="finite"):
        distance_partitions(np.array([[np.inf, 0.0]]), 1.0, 2.0)
    with pytest.raises(ValueError, match="least_m = 3"):
        distance_partitions(np.zeros((3, 2)), 3.0, 2.0)
    with pytest.raises(ValueError, match="most = 0"):
        distance_partitions(np.zeros((3, 2)), 1.0, 2.0, most=0)
    with pytest.raises(ValueError, match="5001 detections"):
        distance_partitions(np.zeros((5001, 2)), 1.0, 2.0)
