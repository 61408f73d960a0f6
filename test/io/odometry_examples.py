"""A car that drives past posts that stand, with a radar that looks ahead and to the left."""

from __future__ import annotations

import math

import numpy as np

from gda_tracker.io.bag_types import type_store
from gda_tracker.kinematics.rigid_transforms import quaternion_of_angles

S = 1_000_000_000
SPEED_MPS, TURN_RADPS = 12.0, 0.25
# Of the radar on the car: position and yaw.
MOUNTING_M, MOUNTING_YAW_DEG = (2.0, 0.8, 0.5), 40.0
MOUNTING = {
    "sensor_position_m": list(MOUNTING_M),
    "sensor_roll_pitch_yaw_deg": [0.0, 0.0, MOUNTING_YAW_DEG],
}
POSTS = np.random.default_rng(5).uniform([-20.0, 20.0], [100.0, 130.0], (60, 2))
WALKER = np.array([45.0, 35.0])  # moves East at this speed
WALKER_MPS = 3.0


def car_at(seconds):
    """Position and yaw of the car: it begins at the origin and drives a circle to the left."""
    yaw = TURN_RADPS * seconds
    radius = SPEED_MPS / TURN_RADPS
    return np.array([radius * math.sin(yaw), radius * (1.0 - math.cos(yaw))]), yaw


def _turn(yaw):
    return np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])


def columns_at(seconds):
    """What the radar sees of the posts and of the walker (last): range, azimuth, range rate."""
    position, yaw = car_at(seconds)
    sensor = position + _turn(yaw) @ np.array(MOUNTING_M[:2])
    step = 1e-6
    before, after = (
        car_at(t)[0] + _turn(car_at(t)[1]) @ np.array(MOUNTING_M[:2])
        for t in (seconds - step, seconds + step)
    )
    own = (after - before) / (2.0 * step)
    targets = np.concatenate([POSTS, [WALKER + [WALKER_MPS * seconds, 0.0]]])
    velocity = np.zeros_like(targets)
    velocity[-1, 0] = WALKER_MPS
    seen = (targets - sensor) @ _turn(yaw + math.radians(MOUNTING_YAW_DEG))
    sight = (targets - sensor) / np.linalg.norm(targets - sensor, axis=1)[:, None]
    return {
        "range": np.hypot(*seen.T),
        "azimuth": np.arctan2(seen[:, 1], seen[:, 0]),
        "range_rate": np.einsum("ni,ni->n", sight, velocity - own),
    }


def _header(stamp_ns, frame, types):
    time = types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, S))
    return types["std_msgs/msg/Header"](time, frame)


def _twist(types):
    vector = types["geometry_msgs/msg/Vector3"]
    return types["geometry_msgs/msg/Twist"](
        vector(SPEED_MPS, 0.0, 0.0), vector(0.0, 0.0, TURN_RADPS)
    )


def odometry_message(seconds, kind="nav_msgs/msg/Odometry", child="base_link", parent="map"):
    """What the car tells at a time, as a message of rosbags."""
    types = type_store().types
    stamp_ns = round(seconds * S)
    if kind == "geometry_msgs/msg/TwistStamped":
        return types[kind](_header(stamp_ns, child, types), _twist(types))
    with_covariance = types["geometry_msgs/msg/TwistWithCovariance"](_twist(types), np.zeros(36))
    if kind == "geometry_msgs/msg/TwistWithCovarianceStamped":
        return types[kind](_header(stamp_ns, child, types), with_covariance)
    position, yaw = car_at(seconds)
    pose = types["geometry_msgs/msg/Pose"](
        types["geometry_msgs/msg/Point"](float(position[0]), float(position[1]), 0.0),
        types["geometry_msgs/msg/Quaternion"](*quaternion_of_angles(0.0, 0.0, yaw).tolist()),
    )
    return types[kind](
        _header(stamp_ns, parent, types),
        child,
        types["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36)),
        with_covariance,
    )
