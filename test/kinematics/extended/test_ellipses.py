"""Ellipses: axes, powers and the Wasserstein distance of Gaussians."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import sqrtm

from gda_tracker.kinematics.extended.ellipses import (
    extent_of,
    gaussian_wasserstein,
    outline,
    semi_axes,
    symmetric_power,
)

lengths = st.floats(0.1, 100.0)


@given(lengths, lengths, st.floats(-1.5, 1.5))
def test_axes_come_back(a, b, angle):
    long, short = max(a, b) + 0.01, min(a, b)
    length, orientation = semi_axes(extent_of(np.array([long, short]), angle))
    np.testing.assert_allclose(length, [long, short], rtol=1e-6)
    if long > 1.01 * short:
        assert np.sin(orientation - angle) == pytest.approx(0.0, abs=1e-6)


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_distance_against_matrix_roots(seed):
    rng = np.random.default_rng(seed)
    centre = rng.normal(size=(2, 3, 2))
    root = rng.normal(size=(2, 3, 2, 2))
    extent = root @ np.swapaxes(root, -1, -2) + 0.01 * np.eye(2)
    found = gaussian_wasserstein(centre[0], extent[0], centre[1], extent[1])
    for i in range(3):
        first = sqrtm(extent[0, i])
        inner = np.trace(extent[0, i] + extent[1, i] - 2 * sqrtm(first @ extent[1, i] @ first).real)
        expected = np.sqrt(np.sum((centre[0, i] - centre[1, i]) ** 2) + inner)
        assert found[i] == pytest.approx(expected, rel=1e-6, abs=1e-6)
    again = gaussian_wasserstein(centre[1], extent[1], centre[0], extent[0])
    np.testing.assert_allclose(found, again, rtol=1e-6, atol=1e-9)


def test_circles_differ_by_their_radii():
    here = np.zeros(2)
    found = gaussian_wasserstein(here, 9.0 * np.eye(2), here, 4.0 * np.eye(2))
    assert found == pytest.approx(np.sqrt(2.0))
    assert gaussian_wasserstein(here, np.eye(2), here, np.eye(2)) == pytest.approx(0.0, abs=1e-7)


def test_powers_and_outlines():
    extent = extent_of(np.array([3.0, 1.0]), 0.4)
    np.testing.assert_allclose(
        symmetric_power(extent, -0.5) @ extent @ symmetric_power(extent, -0.5),
        np.eye(2),
        atol=1e-12,
    )
    way = outline(np.array([1.0, 2.0]), extent) - [1.0, 2.0]
    np.testing.assert_allclose(np.einsum("nd,de,ne->n", way, np.linalg.inv(extent), way), 1.0)
    with pytest.raises(ValueError, match="positive definite"):
        symmetric_power(np.diag([1.0, -1.0]), 0.5)
    with pytest.raises(ValueError, match="positive definite"):
        symmetric_power(np.diag([1.0, 0.0]), -0.5)
