"""Constant velocity: F and Q of the 2004 chapter, and what they must do together."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.kinematics.motion_models import constant_velocity

steps = st.floats(0.0, 100.0)
# The chapter writes a state as [x, vx, y, vy].
CHAPTER_ORDER = [0, 2, 1, 3]


def chapter_matrices(t, sigma):
    """F and Q as printed in section 14.2.2, blkdiag over the coordinates."""
    f = np.array([[1.0, t], [0.0, 1.0]])
    q = sigma**2 * np.array([[t**4 / 4, t**3 / 2], [t**3 / 2, t**2]])
    zero = np.zeros((2, 2))
    return np.block([[f, zero], [zero, f]]), np.block([[q, zero], [zero, q]])


def test_worked_values_of_the_crossing_scenario():
    transition, noise = constant_velocity(5.0, 18.0)
    np.testing.assert_array_equal(
        transition, [[1, 0, 5, 0], [0, 1, 0, 5], [0, 0, 1, 0], [0, 0, 0, 1]]
    )
    # 18^2 (625/4, 125/2, 25)
    np.testing.assert_allclose(
        noise,
        [[50625, 0, 20250, 0], [0, 50625, 0, 20250], [20250, 0, 8100, 0], [0, 20250, 0, 8100]],
        rtol=1e-14,
    )


@pytest.mark.parametrize(("t", "sigma"), [(0.1, 0.5), (1.0, 1.0), (5.0, 18.0), (12.5, 3.0)])
def test_equals_the_chapter_in_its_own_order(t, sigma):
    transition, noise = constant_velocity(t, sigma)
    f, q = chapter_matrices(t, sigma)
    np.testing.assert_allclose(transition[np.ix_(CHAPTER_ORDER, CHAPTER_ORDER)], f, rtol=1e-15)
    np.testing.assert_allclose(noise[np.ix_(CHAPTER_ORDER, CHAPTER_ORDER)], q, rtol=1e-13)


def test_the_noise_is_that_of_a_constant_random_acceleration():
    rng = np.random.default_rng(3)
    acceleration = rng.normal(0.0, 2.0, (400_000, 2))
    moved = np.hstack([acceleration * 4.0**2 / 2, acceleration * 4.0])
    _, noise = constant_velocity(4.0, 2.0)
    scale = np.sqrt(np.outer(np.diag(noise), np.diag(noise)))
    np.testing.assert_allclose(np.cov(moved.T) / scale, noise / scale, atol=0.01)


@settings(derandomize=True, deadline=None)
@given(steps, steps)
def test_transitions_compose(first, second):
    one, _ = constant_velocity(first, 1.0)
    other, _ = constant_velocity(second, 1.0)
    both, _ = constant_velocity(first + second, 1.0)
    np.testing.assert_allclose(other @ one, both, rtol=1e-14)


@settings(derandomize=True, deadline=None)
@given(steps, st.floats(1e-3, 100.0), st.integers(1, 3))
def test_noise_is_symmetric_and_semidefinite_of_rank_dimension(dt_s, sigma, dimension):
    transition, noise = constant_velocity(dt_s, sigma, dimension)
    assert transition.shape == noise.shape == (2 * dimension, 2 * dimension)
    np.testing.assert_array_equal(noise, noise.T)
    eigenvalues = np.linalg.eigvalsh(noise)
    assert eigenvalues.min() >= -1e-13 * max(eigenvalues.max(), 1e-300)
    # One acceleration per coordinate moves position and velocity together.
    assert np.all(np.abs(eigenvalues[:dimension]) <= 1e-12 * max(eigenvalues.max(), 1e-300))


def test_no_time_no_change():
    transition, noise = constant_velocity(0.0, 5.0)
    np.testing.assert_array_equal(transition, np.eye(4))
    np.testing.assert_array_equal(noise, np.zeros((4, 4)))


def test_cached_matrices_cannot_be_changed():
    transition, noise = constant_velocity(1.0, 1.0)
    with pytest.raises(ValueError, match="read-only"):
        transition[0, 0] = 2.0
    with pytest.raises(ValueError, match="read-only"):
        noise[0, 0] = 2.0
