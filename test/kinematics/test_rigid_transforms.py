"""Rigid transforms against matrices and against scipy's rotations."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from gda_tracker.kinematics.rigid_transforms import (
    RigidTransform,
    interpolate,
    multiply_quaternions,
    quaternion_of_angles,
    rotation_matrix,
)

seeds = st.integers(0, 2**32 - 1)


def random_transform(rng):
    quaternion = rng.normal(size=4)
    return RigidTransform(rng.normal(0.0, 100.0, 3), quaternion / np.linalg.norm(quaternion))


def matrix(transform):
    found = np.eye(4)
    found[:3, :3] = Rotation.from_quat(transform.rotation).as_matrix()
    found[:3, 3] = transform.translation
    return found


@given(seeds)
def test_chains_and_inverses_are_those_of_matrices(seed):
    rng = np.random.default_rng(seed)
    one, other = random_transform(rng), random_transform(rng)
    np.testing.assert_allclose(matrix(one.after(other)), matrix(one) @ matrix(other), atol=1e-9)
    np.testing.assert_allclose(matrix(one.inverse()), np.linalg.inv(matrix(one)), atol=1e-9)
    point = rng.normal(size=3)
    np.testing.assert_allclose(one.inverse().apply(one.apply(point)), point, atol=1e-9)
    np.testing.assert_allclose(rotation_matrix(one.rotation), matrix(one)[:3, :3], atol=1e-12)


@given(seeds, st.floats(0.0, 1.0))
def test_interpolation_agrees_with_scipy(seed, share):
    rng = np.random.default_rng(seed)
    one, other = random_transform(rng), random_transform(rng)
    found = interpolate(one, other, share)
    both = Rotation.from_quat([one.rotation, other.rotation])
    expected = Slerp([0.0, 1.0], both)(share)
    assert (expected.inv() * Rotation.from_quat(found.rotation)).magnitude() < 1e-6
    straight = one.translation + share * (other.translation - one.translation)
    np.testing.assert_allclose(found.translation, straight, atol=1e-9)


@given(st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3))
def test_angles_are_turns_about_fixed_axes(angles):
    found = Rotation.from_quat(quaternion_of_angles(*angles))
    assert (Rotation.from_euler("xyz", angles).inv() * found).magnitude() < 1e-7


def test_a_quarter_turn_to_the_left():
    left = RigidTransform(np.array([1.0, 2.0, 3.0]), quaternion_of_angles(0.0, 0.0, math.pi / 2))
    np.testing.assert_allclose(left.apply(np.array([1.0, 0.0, 0.0])), [1.0, 3.0, 3.0], atol=1e-12)
    half = multiply_quaternions(left.rotation, left.rotation)
    np.testing.assert_allclose(rotation_matrix(half), np.diag([-1.0, -1.0, 1.0]), atol=1e-12)


def test_nearly_equal_rotations_and_the_shorter_way_round():
    one = RigidTransform(rotation=quaternion_of_angles(0.0, 0.0, 1.0))
    other = RigidTransform(rotation=-quaternion_of_angles(0.0, 0.0, 1.0 + 1e-7))
    found = interpolate(one, other, 0.5).rotation
    assert 2.0 * math.atan2(found[2], found[3]) == pytest.approx(1.0 + 5e-8, abs=1e-12)
