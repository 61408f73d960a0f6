"""Where a radar is and how it moves at the time of a scan: declared, from transforms, odometry."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gda_tracker.errors import UserError
from gda_tracker.io.radar.input_parameters import RadarInputParameters
from gda_tracker.kinematics.odometry_buffer import (
    ODOMETRY_MAY_STILL_COME,
    OdometryBuffer,
    OdometryError,
    velocity_at,
)
from gda_tracker.kinematics.rigid_transforms import (
    RigidTransform,
    quaternion_of_angles,
    rotation_matrix,
)
from gda_tracker.kinematics.transform_buffer import (
    MAY_STILL_COME,
    TransformBuffer,
    TransformError,
)
from gda_tracker.vocabulary.arrays import FloatArray


class TiltError(UserError):
    """A radar without elevation is tilted too far for its detections to be put into the plane."""


@dataclass(frozen=True, slots=True)
class SensorPose:
    """Pose of a radar in the tracking frame, and its own velocity.

    ``transform`` takes points of the radar into the tracking frame. ``velocity_mps`` (3,) is that
    of the radar over ground along its own axes, ``None`` where nothing tells it.
    """

    transform: RigidTransform
    velocity_mps: FloatArray | None = None

    def tilt_deg(self) -> float:
        """Angle between the radar's z axis and that of the tracking frame [deg]."""
        upright = float(rotation_matrix(self.transform.rotation)[2, 2])
        return math.degrees(math.acos(min(max(upright, -1.0), 1.0)))


def declared_pose(parameters: RadarInputParameters) -> SensorPose:
    """Return the pose that the parameters declare."""
    roll, pitch, yaw = np.deg2rad(parameters.sensor_roll_pitch_yaw_deg).tolist()
    position = np.array(parameters.sensor_position_m, dtype=np.float64)
    return SensorPose(RigidTransform(position, quaternion_of_angles(roll, pitch, yaw)))


def sensor_pose(
    parameters: RadarInputParameters,
    transforms: TransformBuffer | None,
    frame_id: str,
    stamp_ns: int,
    odometry: OdometryBuffer | None = None,
) -> SensorPose:
    """Return pose and velocity of the radar at the time of a scan.

    Parameters
    ----------
    parameters
        Where they come from.
    transforms
        Needed only if they come from transforms.
    frame_id, stamp_ns
        Of the radar's message.
    odometry
        Needed only if they come from odometry.

    Raises
    ------
    TransformError
        If a transform is not known for this time.
    OdometryError
        If odometry is not known for this time.
    """
    pose = declared_pose(parameters)
    if parameters.uses_transforms:
        pose = _pose_of_transforms(parameters, transforms, frame_id, stamp_ns, pose)
    if parameters.uses_odometry:
        pose = _pose_of_odometry(parameters, transforms, frame_id, stamp_ns, odometry, pose)
    return pose


def counted_reason(error: UserError) -> tuple[str, bool]:
    """Return the name under which a pose that is not to be had counts, and whether time may help.

    ``error`` is what :func:`sensor_pose` has raised.
    """
    if isinstance(error, OdometryError):
        return f"odometry_{error.reason}", error.reason in ODOMETRY_MAY_STILL_COME
    if isinstance(error, TransformError):
        return f"tf_{error.reason}", error.reason in MAY_STILL_COME
    raise TypeError(f"{type(error).__name__} is neither of transforms nor of odometry")


def _pose_of_transforms(
    parameters: RadarInputParameters,
    transforms: TransformBuffer | None,
    frame_id: str,
    stamp_ns: int,
    pose: SensorPose,
) -> SensorPose:
    """Pose and velocity as far as transforms tell them."""
    if transforms is None:
        raise TransformError("unavailable", "no transforms are listened to")
    frame = parameters.sensor_frame or frame_id
    transform, velocity = pose.transform, None
    if parameters.pose_source == "tf":
        transform = transforms.lookup(parameters.tracking_frame, frame, stamp_ns)
    if parameters.sensor_motion == "tf":
        ground = parameters.motion_frame or parameters.tracking_frame
        velocity = transforms.velocity(ground, frame, stamp_ns, parameters.motion_interval_s)
    return SensorPose(transform, velocity)


def _pose_of_odometry(
    parameters: RadarInputParameters,
    transforms: TransformBuffer | None,
    frame_id: str,
    stamp_ns: int,
    odometry: OdometryBuffer | None,
    pose: SensorPose,
) -> SensorPose:
    """Pose and velocity as far as odometry tells them.

    The radar's mounting pose on the vehicle is the declared one, or that of transforms where these
    give the pose.
    """
    if odometry is None:
        raise OdometryError("missing", "no odometry is listened to")
    now = odometry.at(stamp_ns, parameters.odometry_gap_s)
    mounting = declared_pose(parameters).transform
    if parameters.pose_source == "tf" and transforms is not None:
        frame = parameters.sensor_frame or frame_id
        mounting = transforms.lookup(odometry.frame, frame, stamp_ns)
    transform, velocity = pose.transform, pose.velocity_mps
    if parameters.pose_source == "odometry":
        if now.pose is None:
            raise OdometryError("no_pose", "pose_source is odometry, but only twists come")
        transform = now.pose.after(mounting)
    if parameters.sensor_motion == "odometry":
        velocity = velocity_at(now, mounting)
    return SensorPose(transform, velocity)


def require_elevation(pose: SensorPose, elevation: FloatArray | None, limit_deg: float) -> None:
    """Refuse a radar in the plane that does not lie in it.

    Raises
    ------
    TiltError
        If no elevation is measured and the tilt is above the limit.
    """
    if elevation is not None:
        return
    tilt = pose.tilt_deg()
    if tilt > limit_deg:
        raise TiltError(
            f"the radar measures no elevation and is tilted by {tilt:.0f} deg, more than "
            f"maximum_tilt_deg = {limit_deg:g}"
        )
