"""Poses and speeds of radars: declared, from transforms, and what is refused."""

import math

import numpy as np
import pytest

from gda_tracker.io.radar.conversion import detections_of_fields
from gda_tracker.io.radar.ego_motion import static_range_rate
from gda_tracker.io.radar.frames import detections_of_frame, frame_of_columns
from gda_tracker.io.radar.input_parameters import RadarInputParameters
from gda_tracker.io.radar.parameter_groups.source import POINT_CLOUD
from gda_tracker.io.radar.sensor_pose import TiltError, sensor_pose
from gda_tracker.kinematics.rigid_transforms import RigidTransform, quaternion_of_angles
from gda_tracker.kinematics.sensor_models import cartesian_positions, polar_measurements
from gda_tracker.kinematics.transform_buffer import TransformBuffer, TransformError
from gda_tracker.parameters import ParameterError, from_mapping
from gda_tracker.tracking.door import DefaultNoise, validate

S = 1_000_000_000
NOISE = DefaultNoise(1.0, 0.01, 0.01, 0.1)


def table(**values):
    return from_mapping(RadarInputParameters, values)


def car(speed_mps=(20.0, 0.0, 0.0), yaw=0.5, seconds=3):
    """A car with a radar at its left front corner, looking to the left."""
    buffer = TransformBuffer()
    corner = RigidTransform(np.array([3.5, 0.8, 0.5]), quaternion_of_angles(0.0, 0.0, math.pi / 2))
    buffer.add("base_link", "corner", 0, corner, fixed=True)
    rotation = quaternion_of_angles(0.0, 0.0, yaw)
    for k in range(10 * seconds + 1):
        position = 0.1 * k * np.array(speed_mps)
        buffer.add("map", "base_link", k * S // 10, RigidTransform(position, rotation))
    return buffer


def positions(detections):
    scan, _ = validate(detections, NOISE, "map", 1000)
    return cartesian_positions(polar_measurements(scan))[0]


def test_a_declared_pose_puts_detections_where_they_are():
    parameters = table(
        sensor_position_m=[100.0, 50.0, 3.0], sensor_roll_pitch_yaw_deg=[0.0, 0.0, 90.0]
    )
    fields = {"range": np.array([10.0]), "azimuth": np.array([0.0])}
    found = detections_of_fields(fields, parameters, 1).detections
    np.testing.assert_allclose(positions(found), [[100.0, 60.0]], atol=1e-9)


def test_a_pose_from_transforms_is_that_of_the_scans_own_time():
    parameters = table(pose_source="tf")
    frame = frame_of_columns(
        POINT_CLOUD, S + S // 20, "corner", {"x": np.array([5.0]), "y": np.array([1.0])}
    )
    found = detections_of_frame(frame, parameters, transforms=car()).detections
    forward, left = (
        np.array([math.cos(0.5), math.sin(0.5)]),
        np.array([-math.sin(0.5), math.cos(0.5)]),
    )
    # Of the radar 5 m ahead is to the car's left, 1 m left is behind.
    expected = [21.0, 0.0] + (3.5 - 1.0) * forward + (0.8 + 5.0) * left
    np.testing.assert_allclose(positions(found), [expected], atol=1e-6)
    named = table(pose_source="tf", sensor_frame="base_link", tracking_frame="/map")
    pose = sensor_pose(named, car(), "", S)
    np.testing.assert_allclose(pose.transform.translation, [20.0, 0.0, 0.0], atol=1e-9)


@pytest.mark.parametrize("reference", ["sensor", "ground"])
def test_speed_from_transforms_tells_what_stands_still(reference):
    """In a vehicle's own frame the speed comes from a frame that stands still."""
    rng = np.random.default_rng(3)
    azimuth, elevation = rng.uniform(-1.2, 1.2, 40), rng.uniform(-0.3, 0.3, 40)
    buffer = car(speed_mps=(20.0 * math.cos(0.5), 20.0 * math.sin(0.5), 1.0))
    # The radar looks left of a car that drives ahead: it moves to its own right, and up.
    rate = static_range_rate(azimuth, elevation, 0.0, -20.0, 1.0)
    rate[:4] += 6.0
    fields = {
        "range": np.full(40, 50.0),
        "azimuth": azimuth,
        "elevation": elevation,
        "range_rate": rate,
    }
    parameters = table(
        pose_source="tf",
        tracking_frame="base_link",
        motion_frame="map",
        sensor_motion="tf",
        moving_above_mps=0.5,
        range_rate_reference=reference,
    )
    pose = sensor_pose(parameters, buffer, "corner", 2 * S)
    np.testing.assert_allclose(pose.velocity_mps, [0.0, -20.0, 1.0], atol=1e-6)
    scan = detections_of_fields(fields, parameters, 2 * S, "corner", pose=pose)
    assert scan.counts["standing_still"] == 36
    assert scan.still.tolist() == [False] * 4 + [True] * 36
    expected = rate[:4] if reference == "sensor" else np.full(4, 6.0)
    np.testing.assert_allclose(scan.detections.range_rate_mps, expected, atol=1e-6)
    np.testing.assert_allclose(scan.detections.sensor_position_m, [3.5, 0.8, 0.5])


def test_a_velocity_straight_up_is_seen_by_elevation_alone():
    angle = np.array([0.0, 0.3])
    np.testing.assert_allclose(
        static_range_rate(np.zeros(2), angle, 0.0, 0.0, 2.0), -2.0 * np.sin(angle)
    )
    np.testing.assert_allclose(static_range_rate(angle, None, 1.0, 0.0, 9.0), -np.cos(angle))


def test_a_tilted_radar_needs_an_elevation():
    plane = {"range": np.array([10.0]), "azimuth": np.array([0.1])}
    space = {**plane, "elevation": np.array([0.2])}
    tilted = {"sensor_roll_pitch_yaw_deg": [0.0, 45.0, 0.0]}
    with pytest.raises(TiltError, match=r"no elevation and is tilted by 45 deg, more than .* = 30"):
        detections_of_fields(plane, table(**tilted), 1)
    with pytest.raises(TiltError):
        detections_of_fields(space, table(**tilted, elevation_used=False), 1)
    detections_of_fields(plane, table(**tilted, maximum_tilt_deg=50.0), 1)
    found = detections_of_fields(space, table(**tilted), 1).detections
    # A positive pitch looks down: the elevation counts against it.
    x = 10.0 * math.cos(0.2) * math.cos(0.1) * math.cos(math.pi / 4)
    x += 10.0 * math.sin(0.2) * math.sin(math.pi / 4)
    np.testing.assert_allclose(positions(found), [[x, 10.0 * math.cos(0.2) * math.sin(0.1)]])


def test_what_does_not_go_together_is_refused():
    for values, text in (
        ({"sensor_position_m": [1.0, 2.0]}, "sensor_position_m = .*allowed are 3 numbers"),
        ({"sensor_motion": "tf"}, "allowed with pose_source tf, or with motion_frame"),
        ({"pose_source": "tf", "tracking_frame": ""}, "tracking_frame is empty"),
    ):
        with pytest.raises(ParameterError, match=text):
            table(**values)
    with pytest.raises(TransformError, match="no transforms are listened to"):
        sensor_pose(table(pose_source="tf"), None, "corner", S)
    with pytest.raises(TransformError, match=r"frame \(empty\)"):
        sensor_pose(table(pose_source="tf"), car(), "", S)
