"""Odometry by time: interpolation, what is refused, the lever arm against a rigid body's path."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gda_tracker.kinematics import odometry_buffer
from gda_tracker.kinematics.odometry_buffer import (
    Odometry,
    OdometryBuffer,
    OdometryError,
    velocity_at,
)
from gda_tracker.kinematics.rigid_transforms import (
    RigidTransform,
    quaternion_of_angles,
    rotation_matrix,
)

S = 1_000_000_000


def report(ahead=0.0, turn=0.0, x=0.0, yaw=0.0, pose=True):
    placed = RigidTransform(np.array([x, 0.0, 0.0]), quaternion_of_angles(0.0, 0.0, yaw))
    return Odometry(
        np.array([ahead, 0.0, 0.0]), np.array([0.0, 0.0, turn]), placed if pose else None
    )


def filled(*entries, keep_s=10.0):
    buffer = OdometryBuffer(keep_s)
    for seconds, one in entries:
        assert buffer.add(round(seconds * S), "base", "odom", one) == ""
    return buffer


def refused(buffer, seconds, gap_s=math.inf):
    with pytest.raises(OdometryError) as caught:
        buffer.at(round(seconds * S), gap_s)
    assert "\n" not in str(caught.value)
    return caught.value.reason


def test_between_two_reports_twist_and_pose_are_interpolated():
    buffer = filled((1.0, report(4.0, 0.2, 10.0, 0.0)), (2.0, report(8.0, 0.6, 16.0, 1.0)))
    found = buffer.at(round(1.25 * S))
    np.testing.assert_allclose(found.velocity_mps, [5.0, 0.0, 0.0], rtol=1e-12)
    np.testing.assert_allclose(found.turn_rate_radps, [0.0, 0.0, 0.3], rtol=1e-12)
    np.testing.assert_allclose(found.pose.translation, [11.5, 0.0, 0.0], rtol=1e-12)
    np.testing.assert_allclose(found.pose.rotation, quaternion_of_angles(0, 0, 0.25), atol=1e-12)
    assert buffer.at(2 * S).velocity_mps[0] == 8.0


def test_what_is_not_known_is_refused_with_its_reason():
    buffer = OdometryBuffer()
    assert refused(buffer, 1.0) == "missing"
    buffer = filled((1.0, report()), (2.0, report()), (2.1, report()))
    assert refused(buffer, 0.999) == "too_early"
    assert refused(buffer, 2.101) == "too_late"
    assert refused(buffer, 1.5, gap_s=0.99) == "gap"
    assert buffer.at(round(1.5 * S), 1.0).pose is not None
    assert buffer.at(round(2.05 * S), 0.2).pose is not None
    # At a report itself there is no gap.
    assert buffer.at(S, 0.01).pose is not None


def test_reports_out_of_order_are_sorted_in_and_a_clock_set_back_begins_anew():
    mixed = filled((2.0, report(2.0)), (1.5, report(1.5)), (3.0, report(3.0)))
    assert mixed.at(round(1.75 * S)).velocity_mps[0] == pytest.approx(1.75)
    assert mixed.add(round(2.5 * S), "base", "odom", report(2.5)) == ""
    assert mixed.add(S // 2, "base", "odom", report(9.0)) == "jumped_back"
    assert len(mixed) == 1
    assert refused(mixed, 2.0) == "too_late"


def test_numbers_that_are_none_are_refused():
    buffer = OdometryBuffer()
    nan = float("nan")
    long = Odometry(np.zeros(3), np.zeros(3), RigidTransform(np.zeros(3), 1.1 * np.ones(4)))
    for bad in (report(nan), report(1.0, math.inf), report(x=nan), long):
        assert buffer.add(S, "base", "odom", bad) == "refused"
    assert buffer.add(S, "", "odom", report()) == "refused"
    assert buffer.add(S, "base", "", report()) == "refused"
    assert len(buffer) == 0
    assert buffer.add(S, "/base", "", report(pose=False)) == ""
    assert buffer.frame == "base"
    assert buffer.at(S).pose is None


def test_another_vehicle_is_not_mixed_in():
    buffer = filled((1.0, report(1.0)))
    assert buffer.add(2 * S, "trailer", "odom", report(9.0)) == "other_frame"
    assert buffer.add(2 * S, "base", "map", report(9.0)) == "other_frame"
    assert len(buffer) == 1
    buffer.clear()
    assert buffer.add(2 * S, "trailer", "odom", report(9.0)) == ""


def test_the_history_is_bounded(monkeypatch):
    buffer = filled(*((0.1 * k, report(k)) for k in range(500)), keep_s=2.0)
    assert len(buffer) <= 22
    assert buffer.at(round(48.0 * S)).velocity_mps[0] == pytest.approx(480.0)
    assert refused(buffer, 40.0) == "too_early"
    monkeypatch.setattr(odometry_buffer, "MOST_KEPT", 200)
    flood = OdometryBuffer(1e4)
    for k in range(300):
        flood.add(k, "base", "odom", report(1.0))
    assert len(flood) == 200
    assert len(filled(*((k, report(k)) for k in range(300)), keep_s=math.inf)) == 300


def test_a_lever_arm_by_hand():
    # 3 m ahead and 1 m left on a car that drives at 10 m/s and turns left at 0.5 rad/s.
    mounting = RigidTransform(np.array([3.0, 1.0, 0.5]), quaternion_of_angles(0, 0, math.pi / 2))
    found = velocity_at(report(10.0, 0.5), mounting)
    # In the car's frame 10 - 0.5 and 1.5; the sensor's x axis looks left, its y axis back.
    np.testing.assert_allclose(found, [1.5, -9.5, 0.0], atol=1e-12)


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.floats(-20.0, 20.0), min_size=3, max_size=3),
    st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3),
    st.lists(st.floats(-5.0, 5.0), min_size=3, max_size=3),
    st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3),
)
def test_the_lever_arm_is_the_difference_of_two_positions(velocity, turn, arm, angles):
    """Against the path of the sensor's origin, by central differences."""
    mounting = RigidTransform(np.array(arm), quaternion_of_angles(*angles))
    moved = Odometry(np.array(velocity), np.array(turn))
    step = 1e-5

    def sensor(t):
        # To first order in t, which is all that a central difference sees.
        return np.array(velocity) * t + Rotation.from_rotvec(np.array(turn) * t).apply(arm)

    over_ground = (sensor(step) - sensor(-step)) / (2.0 * step)
    expected = rotation_matrix(mounting.rotation).T @ over_ground
    np.testing.assert_allclose(velocity_at(moved, mounting), expected, atol=1e-6)
