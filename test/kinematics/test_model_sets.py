"""Sets of motion models in one state: against the models alone, differences, the whole filter."""

import dataclasses

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.kinematics.model_sets import (
    CONSTANT_ACCELERATION,
    CONSTANT_VELOCITY,
    COORDINATED_TURN,
    MODELS,
    SINGER,
    STANDSTILL,
    VAN_KEUK,
    WHITE_NOISE_ACCELERATION,
    ModelSet,
    follow_head,
)
from gda_tracker.kinematics.motion_models import constant_acceleration, constant_velocity, singer
from gda_tracker.kinematics.turn_models import coordinated_turn

examples = settings(derandomize=True, deadline=None, max_examples=40)


def set_of(*names, noise=None) -> ModelSet:
    noise = noise or tuple(0.5 + 0.5 * k for k in range(len(names)))
    return ModelSet(names, tuple(noise), 15.0, 8.0, 0.1, 0.01)


@pytest.mark.parametrize(
    ("names", "size"),
    [
        ((CONSTANT_VELOCITY,), 4),
        ((CONSTANT_VELOCITY, WHITE_NOISE_ACCELERATION), 4),
        ((CONSTANT_VELOCITY, COORDINATED_TURN), 5),
        ((SINGER, CONSTANT_VELOCITY), 6),
        ((VAN_KEUK, CONSTANT_ACCELERATION), 6),
        (MODELS, 7),
    ],
)
def test_the_state_has_what_some_model_knows(names, size):
    models = set_of(*names)
    assert models.size == size
    f, q = models.matrices(2.0)
    assert f.shape == q.shape == (len(names), size, size)
    np.linalg.cholesky(q + 1e-9 * np.eye(size))
    mean, covariance = models.extended(np.ones((3, 4)), np.tile(np.eye(4), (3, 1, 1)))
    assert mean.shape == (3, size)
    np.testing.assert_array_equal(mean[:, :4], 1.0)
    np.testing.assert_array_equal(mean[:, 4:], 0.0)
    np.testing.assert_array_equal(
        np.diagonal(covariance, axis1=1, axis2=2)[:, 4:], np.tile(models.tail_std**2, (3, 1))
    )


def test_models_are_those_of_the_library_and_draw_the_rest_anew():
    models = set_of(CONSTANT_VELOCITY, SINGER, CONSTANT_ACCELERATION, COORDINATED_TURN)
    f, q = models.matrices(3.0)
    whole = np.zeros((7, 7))
    for j, (part, noise) in enumerate(
        [constant_velocity(3.0, 0.5), singer(3.0, 1.0, 15.0), constant_acceleration(3.0, 1.5**2)]
    ):
        s = len(part)
        whole[:] = 0.0
        whole[:s, :s] = part
        np.testing.assert_array_equal(f[j], whole)
        whole[:s, :s] = noise
        whole[range(s, 7), range(s, 7)] = np.array([64.0, 64.0, 0.01])[s - 4 :]
        np.testing.assert_allclose(q[j], whole, rtol=1e-15)
    # The turn rate lives on in a turn, the acceleration does not.
    np.testing.assert_array_equal(f[3][4:], np.eye(7)[4:] * [0, 0, 0, 0, 0, 0, 1])
    np.testing.assert_allclose(np.diag(q[3])[4:], [64.0, 64.0, (0.01 * 3.0) ** 2], rtol=1e-12)


def test_what_stands_has_lost_its_speed():
    """Where it was, but for a speed drawn anew; a fast target is still at its place."""
    models = set_of(STANDSTILL, noise=(0.2,))
    f, q = models.matrices(3.0)
    moved = f[0] @ np.array([100.0, 200.0, 30.0, -40.0])
    np.testing.assert_array_equal(moved, [100.0, 200.0, 0.0, 0.0])
    velocity = np.array([[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]).T
    way = 3.0 * np.roll(velocity, -2, axis=0) + velocity
    np.testing.assert_allclose(q[0], 0.2**2 * way @ way.T, rtol=1e-12)


def test_no_time_changes_nothing():
    models, m = set_of(*MODELS), len(MODELS)
    mean = np.random.default_rng(0).normal(size=(2, m, 7))
    for moved, f in (models.moved(mean, 0.0), models.moved_pairs(mean, 0.0)):
        np.testing.assert_array_equal(f.reshape(m, 7, 7), np.tile(np.eye(7), (m, 1, 1)))
        np.testing.assert_array_equal(np.broadcast_to(mean[:, None], (2, m, m, 7))[:, 0], mean)
        np.testing.assert_array_equal(moved.reshape(2, -1, 7)[:, :m], mean)
    np.testing.assert_array_equal(models.matrices(0.0)[1], 0.0)


def test_states_on_a_turn_move_on_a_circle():
    """A quarter of a circle of 1000 m at 100 m/s; all pairs are moved by the model of their row."""
    models = set_of(CONSTANT_VELOCITY, COORDINATED_TURN)
    quarter = 1000.0 * np.pi / 2.0 / 100.0
    state = np.array([1000.0, 0.0, 0.0, 100.0, 0.1])
    moved, f = models.moved(np.tile(state, (1, 2, 1)), quarter)
    np.testing.assert_allclose(moved[0, 0], [1000.0, 100.0 * quarter, 0.0, 100.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(moved[0, 1], [0.0, 1000.0, -100.0, 0.0, 0.1], atol=1e-9)
    mean = np.random.default_rng(1).normal(size=(3, 2, 5)) * [900.0, 900.0, 80.0, 80.0, 0.1]
    moved, f = models.moved_pairs(mean, 2.5)
    assert moved.shape == (3, 2, 2, 5)
    for i in (0, 1):
        turned, slope, _ = coordinated_turn(mean[:, i], 2.5, 1.0, 0.01)
        np.testing.assert_allclose(moved[:, 1, i], turned, rtol=1e-13)
        np.testing.assert_allclose(f[:, 1, i], slope, rtol=1e-13)
        np.testing.assert_allclose(moved[:, 0, i], mean[:, i] @ models.matrices(2.5)[0][0].T)


@examples
@given(st.integers(0, 2**32))
def test_the_derivative_is_that_of_the_motion(seed):
    rng = np.random.default_rng(seed)
    models = set_of(COORDINATED_TURN, SINGER, CONSTANT_VELOCITY)
    scale = np.array([900.0, 900.0, 80.0, 80.0, 5.0, 5.0, 0.2])
    mean, dt_s = rng.normal(size=(1, 3, 7)) * scale, rng.uniform(0.1, 4.0)
    _, f = models.moved(mean, dt_s)
    for part in range(7):
        step = 1e-4 * scale[part] * np.eye(7)[part]
        ahead, back = models.moved(mean + step, dt_s)[0], models.moved(mean - step, dt_s)[0]
        slope = (ahead - back) / (2.0 * 1e-4 * scale[part])
        np.testing.assert_allclose(f[..., part], slope, rtol=1e-5, atol=1e-5)


@examples
@given(st.integers(0, 2**32), st.integers(1, 3))
def test_the_tail_follows_as_in_the_filter_of_the_whole_state(seed, extra):
    """Against filterpy, which updates all components at once."""
    rng = np.random.default_rng(seed)
    s = 4 + extra
    root = rng.normal(size=(s, s))
    whole = KalmanFilter(dim_x=s, dim_z=2)
    whole.x, whole.P = rng.normal(size=s), root @ root.T + 0.1 * np.eye(s)
    whole.H[:, :4], whole.R = rng.normal(size=(2, 4)), np.diag(rng.uniform(0.1, 2.0, 2))
    head = KalmanFilter(dim_x=4, dim_z=2)
    head.x, head.P, head.H, head.R = whole.x[:4], whole.P[:4, :4], whole.H[:, :4], whole.R
    mean, covariance = whole.x.copy(), whole.P.copy()
    z = rng.normal(size=2)
    head.update(z)
    whole.update(z)
    found = follow_head(mean[None], covariance[None], head.x[None], head.P[None])
    np.testing.assert_allclose(found[0][0], whole.x, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(found[1][0], whole.P, rtol=1e-7, atol=1e-9)


def test_a_head_that_stays_moves_nothing():
    rng = np.random.default_rng(3)
    root = rng.normal(size=(5, 7, 7))
    mean, covariance = rng.normal(size=(5, 7)), root @ root.transpose(0, 2, 1)
    same = follow_head(mean, covariance, mean[:, :4], covariance[:, :4, :4])
    np.testing.assert_allclose(same[0], mean, atol=1e-12)
    np.testing.assert_allclose(same[1], covariance, atol=1e-9)


@pytest.mark.parametrize(
    "change",
    [{"names": ()}, {"names": ("jerk", SINGER)}, {"noise_std_mps2": (1.0,)}],
)
def test_sets_that_are_none_are_refused(change):
    with pytest.raises(ValueError, match="allowed are one of constant_velocity, .* each model"):
        dataclasses.replace(set_of(CONSTANT_VELOCITY, SINGER), **change)
