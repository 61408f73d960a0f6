"""The tree of frames: chains, interpolation, and every reason for which it refuses."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gda_tracker.kinematics.rigid_transforms import (
    RigidTransform,
    quaternion_of_angles,
    rotation_matrix,
)
from gda_tracker.kinematics.transform_buffer import TransformBuffer, TransformError

S = 1_000_000_000


def at(x=0.0, y=0.0, z=0.0, yaw=0.0):
    return RigidTransform(np.array([x, y, z]), quaternion_of_angles(0.0, 0.0, yaw))


def ship():
    """A ship that sails East at 5 m/s and turns left by 0.1 rad/s, a radar on its mast."""
    buffer = TransformBuffer()
    buffer.add("ship", "mast", 0, at(x=2.0, z=12.0), fixed=True)
    buffer.add("mast", "radar", 0, at(yaw=math.pi), fixed=True)
    for k in range(6):
        assert buffer.add("map", "ship", k * S, at(x=5.0 * k, yaw=0.1 * k)) == ""
    return buffer


def refused(call):
    with pytest.raises(TransformError) as caught:
        call()
    assert "\n" not in str(caught.value)
    return caught.value.reason


def test_a_chain_at_a_time_between_two():
    found = ship().lookup("map", "radar", 2 * S + S // 4)
    yaw = 0.225
    expected = [5.0 * 2.25 + 2.0 * math.cos(yaw), 2.0 * math.sin(yaw), 12.0]
    np.testing.assert_allclose(found.translation, expected, atol=1e-12)
    ahead = rotation_matrix(found.rotation) @ [1.0, 0.0, 0.0]
    np.testing.assert_allclose(ahead, [-math.cos(yaw), -math.sin(yaw), 0.0], atol=1e-12)
    back = ship().lookup("radar", "map", 2 * S + S // 4)
    np.testing.assert_allclose(back.apply(found.translation), np.zeros(3), atol=1e-9)
    np.testing.assert_allclose(ship().lookup("/radar", "radar", 0).translation, np.zeros(3))


def test_frames_beside_each_other_need_no_root_and_no_time_of_it():
    buffer = ship()
    buffer.add("ship", "camera", 0, at(x=-3.0), fixed=True)
    found = buffer.lookup("camera", "mast", 99 * S)  # the way over the ship is all fixed
    np.testing.assert_allclose(found.translation, [5.0, 0.0, 12.0])


@given(st.integers(0, 5 * S - 1))
def test_interpolation_stays_between(stamp_ns):
    found = ship().lookup("map", "ship", stamp_ns)
    assert found.translation[0] == pytest.approx(5.0 * stamp_ns / S, abs=1e-6)
    assert 2.0 * math.asin(found.rotation[2]) == pytest.approx(0.1 * stamp_ns / S, abs=1e-9)


def test_every_refusal_has_a_reason():
    buffer = ship()
    assert refused(lambda: buffer.lookup("map", "radar", 5 * S + 1)) == "too_late"
    assert refused(lambda: buffer.lookup("map", "radar", -1)) == "too_early"
    assert refused(lambda: buffer.lookup("map", "sonar", S)) == "unknown_frame"
    assert refused(lambda: buffer.lookup("odom", "radar", S)) == "unknown_frame"
    assert refused(lambda: buffer.lookup("map", "", S)) == "unknown_frame"
    buffer.add("harbour", "crane", 0, at(), fixed=True)
    assert refused(lambda: buffer.lookup("crane", "radar", S)) == "not_connected"
    buffer.add("radar", "map", S, at())
    assert refused(lambda: buffer.lookup("map", "radar", S)) == "loop"
    assert refused(lambda: buffer.lookup("harbour", "radar", S)) == "loop"


def test_what_is_no_transform_is_not_taken():
    buffer = ship()
    bad = RigidTransform(np.array([0.0, np.nan, 0.0]))
    zero = RigidTransform(rotation=np.zeros(4))
    assert buffer.add("map", "ship", 6 * S, bad) == "tf_refused"
    assert buffer.add("map", "ship", 6 * S, zero) == "tf_refused"
    assert buffer.add("map", "map", 6 * S, at()) == "tf_refused"
    assert buffer.add("", "ship", 6 * S, at()) == "tf_refused"
    assert refused(lambda: buffer.lookup("map", "ship", 6 * S)) == "too_late"
    nearly = RigidTransform(rotation=np.array([0.0, 0.0, 0.0, 1.0005]))
    assert buffer.add("map", "ship", 6 * S, nearly) == ""
    assert np.linalg.norm(buffer.lookup("map", "ship", 6 * S).rotation) == pytest.approx(1.0)


def test_a_clock_that_is_set_back_begins_all_histories_anew():
    buffer = ship()
    buffer.add("map", "pier", 5 * S, at())
    assert buffer.add("map", "ship", 4 * S + S // 2, at(x=22.5, yaw=0.45)) == ""  # late, no jump
    assert buffer.add("map", "ship", S, at(x=100.0)) == "tf_jumped_back"
    assert refused(lambda: buffer.lookup("map", "ship", 2 * S)) == "too_late"
    assert refused(lambda: buffer.lookup("map", "pier", S)) == "unknown_frame"
    assert buffer.lookup("map", "radar", S).translation[0] == pytest.approx(102.0)


def test_a_frame_that_moves_to_another_parent():
    buffer = ship()
    assert buffer.add("dock", "ship", 6 * S, at()) == "tf_new_parent"
    assert refused(lambda: buffer.lookup("map", "ship", 5 * S)) == "unknown_frame"
    buffer.lookup("dock", "radar", 6 * S)
    assert buffer.add("dock", "ship", 0, at(), fixed=True) == ""
    buffer.lookup("dock", "radar", 123 * S)


def test_histories_end_after_a_while():
    buffer = TransformBuffer(keep_s=2.0)
    for k in range(10):
        buffer.add("map", "ship", k * S, at(x=float(k)))
    assert refused(lambda: buffer.lookup("map", "ship", 5 * S)) == "too_early"
    assert buffer.lookup("map", "ship", 7 * S).translation[0] == 7.0


def test_velocity_is_along_the_sensors_own_axes():
    buffer = TransformBuffer()
    buffer.add("base", "corner", 0, at(yaw=math.pi / 2), fixed=True)
    for k in range(5):
        buffer.add("odom", "base", k * S // 10, at(x=1.5 * k))
    found = buffer.velocity("odom", "corner", 4 * S // 10, 0.1)
    np.testing.assert_allclose(found, [0.0, -15.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(buffer.velocity("base", "corner", 4 * S // 10, 0.1), np.zeros(3))
    assert refused(lambda: buffer.velocity("odom", "corner", S // 20, 0.1)) == "too_early"
