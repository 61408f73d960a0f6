"""Rigid transforms: chained, inverted, and interpolated between two times."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from gda_tracker.vocabulary.arrays import FloatArray

# Quaternions that are so close are interpolated along the chord: the sine of the angle vanishes.
NEARLY_EQUAL = 1.0 - 1e-9


def multiply_quaternions(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the Hamilton product of quaternions (4,) x, y, z, w: first ``other``, then ``one``."""
    x1, y1, z1, w1 = one
    x2, y2, z2, w2 = other
    return np.array(
        [
            w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
            w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
            w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
            w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2,
        ]
    )


def rotation_matrix(quaternion: FloatArray) -> FloatArray:
    """Return the rotation matrix (3, 3) of a unit quaternion (4,) x, y, z, w."""
    x, y, z, w = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_of_angles(roll_rad: float, pitch_rad: float, yaw_rad: float) -> FloatArray:
    """Return the quaternion (4,) of turns about the fixed axes x, then y, then z (REP 103)."""

    def about(axis: int, angle: float) -> FloatArray:
        quaternion = np.array([0.0, 0.0, 0.0, math.cos(0.5 * angle)])
        quaternion[axis] = math.sin(0.5 * angle)
        return quaternion

    turned = multiply_quaternions(about(1, pitch_rad), about(0, roll_rad))
    return multiply_quaternions(about(2, yaw_rad), turned)


@dataclass(frozen=True, slots=True)
class RigidTransform:
    """Takes points of a frame into another one: p' = R p + t.

    ``translation`` (3,) [m], ``rotation`` (4,) unit quaternion x, y, z, w.
    """

    translation: FloatArray = field(default_factory=lambda: np.zeros(3))
    rotation: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, 0.0, 1.0]))

    def apply(self, point: FloatArray) -> FloatArray:
        """Return the point (3,) in the other frame."""
        return rotation_matrix(self.rotation) @ point + self.translation

    def after(self, first: RigidTransform) -> RigidTransform:
        """Return the transform that does ``first``, then this one."""
        rotation = multiply_quaternions(self.rotation, first.rotation)
        # Long chains would drift away from unit length.
        return RigidTransform(self.apply(first.translation), rotation / np.linalg.norm(rotation))

    def inverse(self) -> RigidTransform:
        """Return the transform back."""
        back = self.rotation * np.array([-1.0, -1.0, -1.0, 1.0])
        return RigidTransform(-rotation_matrix(back) @ self.translation, back)


def interpolate(one: RigidTransform, other: RigidTransform, share: float) -> RigidTransform:
    """Return the transform between two, ``share`` (0 to 1) of the way from ``one`` to ``other``.

    The translation goes along a straight line, the rotation at constant speed about one axis, the
    shorter way round (spherical linear interpolation, Shoemake 1985).
    """
    start, end = one.rotation, other.rotation
    cosine = float(start @ end)
    if cosine < 0.0:
        end, cosine = -end, -cosine
    if cosine > NEARLY_EQUAL:
        rotation = (1.0 - share) * start + share * end
    else:
        angle = math.acos(cosine)
        rotation = (
            math.sin((1.0 - share) * angle) * start + math.sin(share * angle) * end
        ) / math.sin(angle)
    translation = (1.0 - share) * one.translation + share * other.translation
    return RigidTransform(translation, rotation / np.linalg.norm(rotation))
