"""Messages of odometry into a buffer; those of rclpy and of rosbags alike.

``nav_msgs/Odometry`` tells twist and pose, ``geometry_msgs/TwistStamped`` and
``TwistWithCovarianceStamped`` the twist alone. By REP 105 and the definition of the message the
twist is along the axes of the vehicle's own frame: ``child_frame_id``, or the header's of a twist.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from gda_tracker.io.fields import MessageError, stamp_from_time
from gda_tracker.io.radar.input_parameters import RadarInputParameters
from gda_tracker.io.radar.parameter_groups.motion import ODOMETRY, TWIST, TWIST_WITH_COVARIANCE
from gda_tracker.kinematics.odometry_buffer import Odometry, OdometryBuffer
from gda_tracker.kinematics.rigid_transforms import RigidTransform
from gda_tracker.vocabulary.arrays import FloatArray


def take_odometry(
    buffer: OdometryBuffer,
    message: Any,
    kind: str,
    parameters: RadarInputParameters,
    counters: Counter[str],
) -> str:
    """Put a message into the buffer; what is special is counted by name.

    Returns
    -------
    str
        Nothing, or why it was not taken, in a few words.
    """
    counters["odometry_received"] += 1
    try:
        stamp_ns = stamp_from_time(message.header.stamp, "header.stamp")
    except MessageError as error:
        counters["odometry_refused"] += 1
        return str(error)
    frame, parent = str(message.header.frame_id), ""
    pose = None
    if kind == ODOMETRY:
        twist = message.twist.twist
        frame, parent = str(message.child_frame_id), frame
        p, q = message.pose.pose.position, message.pose.pose.orientation
        pose = RigidTransform(_vector(p), np.array([q.x, q.y, q.z, q.w], dtype=np.float64))
    elif kind == TWIST_WITH_COVARIANCE:
        twist = message.twist.twist
    elif kind == TWIST:
        twist = message.twist
    else:
        raise MessageError(f"odometry of type {kind}")
    p = parameters
    elsewhere = parent.lstrip("/") != p.tracking_frame.lstrip("/")
    if p.pose_source == "odometry" and kind == ODOMETRY and elsewhere:
        counters["odometry_unknown_frame"] += 1
        return f"its pose is told in {parent or '(no frame)'}, tracks in {p.tracking_frame}"
    if p.odometry_frame and frame.lstrip("/") != p.odometry_frame.lstrip("/"):
        counters["odometry_unknown_frame"] += 1
        return f"it is of {frame or '(no frame)'}, parameter odometry_frame is {p.odometry_frame}"
    # Where only the speed is asked for, a pose that is none does no harm.
    if p.pose_source != "odometry":
        pose, parent = None, ""
    report = Odometry(_vector(twist.linear), _vector(twist.angular), pose)
    special = buffer.add(stamp_ns, frame, parent, report)
    if special == "jumped_back":
        counters["odometry_jumped_back"] += 1
        return ""
    if special == "other_frame":
        counters["odometry_unknown_frame"] += 1
        return f"it is of {frame}, those before were of {buffer.frame}"
    if special:
        counters["odometry_refused"] += 1
        return "no frame, or numbers that are none"
    return ""


def _vector(v: Any) -> FloatArray:
    return np.array([v.x, v.y, v.z], dtype=np.float64)
