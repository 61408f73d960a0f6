"""Odometry as it comes, and what it says of a time: how a vehicle moves, and where it is.

Between two reports the twist is interpolated linearly and the pose along a straight line; beyond
the first and the last nothing is made up, and no gap is bridged that is longer than allowed.
"""

from __future__ import annotations

import math
from bisect import bisect_left, insort
from dataclasses import dataclass

import numpy as np

from gda_tracker.errors import UserError
from gda_tracker.kinematics.rigid_transforms import RigidTransform, interpolate, rotation_matrix
from gda_tracker.kinematics.transform_buffer import JUMP_NS, NANOSECONDS, QUATERNION_TOLERANCE
from gda_tracker.vocabulary.arrays import FloatArray

# However fast odometry comes: reports that are kept at most of a history that is not unbounded.
MOST_KEPT = 20_000
# Reasons that time may mend: the report may still be on its way.
ODOMETRY_MAY_STILL_COME = ("missing", "too_late")


class OdometryError(UserError):
    """Odometry is not to be had for a time; ``reason`` is one word for counters.

    ``missing`` (nothing has come yet), ``too_early`` and ``too_late`` (would have to be
    extrapolated), ``gap`` (its neighbours in time are too far apart), ``no_pose`` (only twists
    come).
    """

    def __init__(self, reason: str, text: str) -> None:
        super().__init__(text)
        self.reason = reason


@dataclass(frozen=True, slots=True)
class Odometry:
    """One report of a vehicle's motion.

    ``velocity_mps`` and ``turn_rate_radps`` (3,) are along the axes of the vehicle's own frame
    (``child_frame_id`` of ``nav_msgs/Odometry``), at its origin; ``pose`` takes points of that
    frame into the one in which the odometry is told, ``None`` where it is not.
    """

    velocity_mps: FloatArray
    turn_rate_radps: FloatArray
    pose: RigidTransform | None = None


def velocity_at(odometry: Odometry, mounting: RigidTransform) -> FloatArray:
    """Return the velocity (3,) [m/s] of a sensor on the vehicle, along the sensor's own axes.

    The lever arm turns with the vehicle: v_s = R' (v + w x t), with the mounting pose R, t of the
    sensor in the vehicle's frame.
    """
    at_sensor = odometry.velocity_mps + np.cross(odometry.turn_rate_radps, mounting.translation)
    return np.asarray(rotation_matrix(mounting.rotation).T @ at_sensor)


class OdometryBuffer:
    """The reports of one vehicle by time.

    Parameters
    ----------
    keep_s
        How long the history reaches back from its last report [s].
    """

    def __init__(self, keep_s: float = 10.0) -> None:
        self._keep_ns = math.inf if math.isinf(keep_s) else round(keep_s * NANOSECONDS)
        self._stamps: list[int] = []
        self._reports: dict[int, Odometry] = {}
        # The vehicle's own frame, and the one its pose is told in.
        self.frame = self.parent = ""

    def __len__(self) -> int:
        return len(self._stamps)

    def clear(self) -> None:
        """Forget all reports, and whose they are."""
        self._stamps.clear()
        self._reports.clear()
        self.frame = self.parent = ""

    def add(self, stamp_ns: int, frame: str, parent: str, odometry: Odometry) -> str:
        """Take a report in.

        Parameters
        ----------
        stamp_ns
            Its time.
        frame, parent
            The vehicle's own frame, and the one of the pose.
        odometry
            What it says.

        Returns
        -------
        str
            Nothing, or what was special: ``refused`` (no frame, or numbers that are none),
            ``other_frame`` (of another vehicle than the first one: not taken) or ``jumped_back``
            (the clock was set back: the history begins anew).
        """
        frame, parent = frame.lstrip("/"), parent.lstrip("/")
        sound = _sound(odometry)
        if not frame or sound is None or (sound.pose is not None and not parent):
            return "refused"
        if self._stamps and (frame, parent) != (self.frame, self.parent):
            return "other_frame"
        special = ""
        if self._stamps and stamp_ns < self._stamps[-1] - JUMP_NS:
            self.clear()
            special = "jumped_back"
        self.frame, self.parent = frame, parent
        if stamp_ns not in self._reports:
            insort(self._stamps, stamp_ns)
        self._reports[stamp_ns] = sound
        self._prune()
        return special

    def _prune(self) -> None:
        if math.isinf(self._keep_ns):
            return
        oldest = self._stamps[-1] - self._keep_ns
        # One report before the oldest stays, to interpolate from.
        first = max(bisect_left(self._stamps, oldest) - 1, len(self._stamps) - MOST_KEPT, 0)
        for stamp_ns in self._stamps[:first]:
            del self._reports[stamp_ns]
        del self._stamps[:first]

    def at(self, stamp_ns: int, largest_gap_s: float = math.inf) -> Odometry:
        """Return the motion at a time.

        Raises
        ------
        OdometryError
            If it is not known for this time.
        """
        if not self._stamps:
            raise OdometryError("missing", "no odometry has come yet")
        found = self._reports.get(stamp_ns)
        if found is not None:
            return found
        place = bisect_left(self._stamps, stamp_ns)
        if place == 0:
            early = (self._stamps[0] - stamp_ns) / NANOSECONDS
            raise OdometryError(
                "too_early", f"odometry: asked for {early:.3f} s before the first known"
            )
        if place == len(self._stamps):
            late = (stamp_ns - self._stamps[-1]) / NANOSECONDS
            raise OdometryError(
                "too_late", f"odometry: asked for {late:.3f} s after the last known"
            )
        before, after = self._stamps[place - 1], self._stamps[place]
        if after - before > largest_gap_s * NANOSECONDS:
            raise OdometryError(
                "gap",
                f"odometry: {(after - before) / NANOSECONDS:.3f} s lie between two reports, more "
                f"than {largest_gap_s:g} s",
            )
        return _between(
            self._reports[before], self._reports[after], (stamp_ns - before) / (after - before)
        )


def _sound(odometry: Odometry) -> Odometry | None:
    """Return the report with a rotation of length one, ``None`` if its numbers are none."""
    if not (
        np.isfinite(odometry.velocity_mps).all() and np.isfinite(odometry.turn_rate_radps).all()
    ):
        return None
    pose = odometry.pose
    if pose is None:
        return odometry
    length = float(np.linalg.norm(pose.rotation))
    # NaN fails the comparison.
    if not (abs(length - 1.0) <= QUATERNION_TOLERANCE and np.isfinite(pose.translation).all()):
        return None
    turned = RigidTransform(pose.translation, pose.rotation / length)
    return Odometry(odometry.velocity_mps, odometry.turn_rate_radps, turned)


def _between(one: Odometry, other: Odometry, share: float) -> Odometry:
    pose = None
    if one.pose is not None and other.pose is not None:
        pose = interpolate(one.pose, other.pose, share)
    return Odometry(
        (1.0 - share) * one.velocity_mps + share * other.velocity_mps,
        (1.0 - share) * one.turn_rate_radps + share * other.turn_rate_radps,
        pose,
    )
