"""Every live parameter of ``radar_input`` acts on the next message of the radar."""

from __future__ import annotations

from contextlib import contextmanager

import numpy as np
import pytest
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2

from gda_tracker.io.bag_types import serialize
from gda_tracker.io.messages import detections_from_message
from gda_tracker.io.radar.input_parameters import RadarInputParameters
from gda_tracker.io.radar.parameter_groups.source import POINT_CLOUD
from gda_tracker.io.radar.point_cloud import point_cloud_of_columns
from gda_tracker.kinematics.odometry_buffer import Odometry
from gda_tracker.kinematics.rigid_transforms import RigidTransform
from gda_tracker.nodes.radar_input import RadarInputNode
from gda_tracker.nodes.runner import Nodes, private_environment, use_environment
from gda_tracker.parameters import specifications

GROUPED = {"cluster_distance_m": 3.0}
MOVING = {"sensor_motion": "declared", "range_rate_reference": "ground"}
DBSM = {"rcs_unit": "dbsm"}
CARTESIAN = {"position_source": "cartesian"}

# The new value, and what holds from the beginning.
CASES = {
    "stamp_source": ("received", {}),
    "position_source": ("cartesian", {}),
    "field_names": (["range=x"], {}),
    "field_types": (["rcs=int32"], DBSM),
    "angle_unit": ("deg", {}),
    "azimuth_sign": (-1, {}),
    "azimuth_zero_deg": (90.0, {}),
    "cartesian_yaw_deg": (90.0, CARTESIAN),
    "elevation_used": (False, {}),
    "range_rate_sign": (-1, {}),
    "range_rate_used": (False, {}),
    "sensor_speed_mps": (5.0, MOVING),
    "sensor_speed_left_mps": (5.0, MOVING),
    "sensor_position_m": ([100.0, 50.0, 0.0], {}),
    "sensor_roll_pitch_yaw_deg": ([0.0, 0.0, 30.0], {}),
    "sensor_motion": ("estimated", {**MOVING, "sensor_speed_mps": 3.0}),
    "range_rate_reference": ("ground", {"sensor_speed_mps": 5.0}),
    "rcs_unit": ("m2", DBSM),
    "rcs_scale": (0.5, DBSM),
    "rcs_offset": (3.0, DBSM),
    "rcs_minimum": (2.0, DBSM),
    "rcs_maximum": (2.0, DBSM),
    "attribute_fields": (["snr_db=snr"], {}),
    "minimum_range_m": (20.0, {}),
    "maximum_range_m": (20.0, {}),
    "minimum_snr_db": (8.0, {}),
    "moving_above_mps": (3.0, {}),
    "padding_zeros": (True, {"minimum_range_m": 0.0}),
    "cluster_distance_m": (3.0, {}),
    "cluster_range_rate_mps": (0.01, GROUPED),
    "cluster_minimum_points": (2, GROUPED),
    "cluster_extent_m": (2.0, GROUPED),
    "cluster_range_rate_std_mps": (2.0, GROUPED),
}
# Tested one by one at the end.
OTHERS = ("maximum_tilt_deg", "motion_interval_s", "odometry_gap_s", "tf_timeout_s")
FIELDS = ("x", "y", "z", "range", "azimuth", "elevation", "range_rate", "rcs", "snr")


def columns():
    """Twelve points of four objects, one point of padding."""
    rng = np.random.default_rng(4)
    centre = np.repeat([[10.0, 1.0], [14.0, -6.0], [30.0, 12.0], [50.0, -20.0]], 3, axis=0)
    x, y = (centre + rng.normal(0.0, 0.3, centre.shape)).T
    x[0] = 60.0  # alone
    z = rng.normal(0.0, 0.2, 12)
    found = {
        "x": x,
        "y": y,
        "z": z,
        "range": np.sqrt(x**2 + y**2 + z**2),
        "azimuth": np.arctan2(y, x),
        "elevation": np.arctan2(z, np.hypot(x, y)),
        "range_rate": rng.normal(0.0, 4.0, 12) - 2.0 * np.cos(np.arctan2(y, x)),
        "rcs": rng.uniform(1.0, 12.0, 12),
        "snr": rng.uniform(5.0, 20.0, 12),
    }
    return {name: np.append(values, 0.0) for name, values in found.items()}


def cloud(stamp_ns):
    types = dict.fromkeys(FIELDS, "float32")
    message = point_cloud_of_columns(columns(), types, stamp_ns, "radar")
    return deserialize_message(serialize(message), PointCloud2)


class Kept:
    """Stands in for the publisher."""

    def __init__(self):
        self.messages = []

    def publish(self, message):
        self.messages.append(detections_from_message(message))


@contextmanager
def radar_with(**parameters):
    """The node, with what it publishes kept, in a domain of its own."""
    use_environment(private_environment())
    made = {"input_type": POINT_CLOUD, **parameters}
    with Nodes(lambda **o: [RadarInputNode(made, **o)]) as nodes:
        (node,) = nodes.nodes
        publisher, node._detections = node._detections, Kept()
        yield node
        node._detections = publisher


@pytest.fixture(scope="module")
def radar():
    with radar_with() as node:
        yield node


def set_all(radar, values):
    """Set values, all others to their defaults."""
    declared = specifications(RadarInputParameters)
    live = {name: item.default for name, item in declared.items() if item.live}
    kinds = {float: Parameter.Type.DOUBLE_ARRAY, str: Parameter.Type.STRING_ARRAY}
    parameters = []
    for name, value in {**live, **values}.items():
        kind = kinds[declared[name].element_kind] if declared[name].is_list else None
        parameters.append(Parameter(name, kind, value))
    result = radar.set_parameters_atomically(parameters)
    assert result.successful, result.reason


def plain(detections):
    """Everything but the stamp and the number, to compare bit for bit."""
    found = {}
    for name in detections.__slots__:
        value = getattr(detections, name)
        if name not in ("stamp_ns", "sequence"):
            found[name] = value.tobytes() if isinstance(value, np.ndarray) else value
    return found


def send(radar):
    """What the node makes of the next message, and its stamp's distance from the driver's."""
    count = len(radar._detections.messages)
    stamp_ns = 10**18 + count * 10**9
    radar._on_message(cloud(stamp_ns))
    (found,) = radar._detections.messages[count:]
    return plain(found), found.stamp_ns - stamp_ns


def test_every_live_parameter_has_a_case():
    declared = specifications(RadarInputParameters)
    assert sorted((*CASES, *OTHERS)) == sorted(n for n, item in declared.items() if item.live)


@pytest.mark.parametrize("name", CASES)
def test_a_change_acts_on_the_next_message(name, radar):
    value, base = CASES[name]
    set_all(radar, base)
    before, again = send(radar), send(radar)
    assert before == again
    set_all(radar, {**base, name: value})
    after = send(radar)
    assert after != before, f"{name} = {value} changes nothing"
    assert (after[1] != 0) == (name == "stamp_source")
    set_all(radar, base)
    assert send(radar) == before


def test_a_smaller_tilt_is_allowed_from_the_next_message_on(radar):
    tilted = {"sensor_roll_pitch_yaw_deg": [0.0, 20.0, 0.0], "elevation_used": False}
    set_all(radar, tilted)
    send(radar)
    count = len(radar._detections.messages)
    set_all(radar, {**tilted, "maximum_tilt_deg": 10.0})
    radar._on_message(cloud(2 * 10**18))
    assert len(radar._detections.messages) == count
    assert radar.counters["tilted_too_far"] == 1
    set_all(radar, tilted)
    send(radar)


def test_the_radars_own_speed_is_that_of_the_new_interval():
    moving = {"sensor_motion": "tf", "pose_source": "tf", "range_rate_reference": "ground"}
    with radar_with(**moving) as node:
        buffer = node._listener.buffer
        begin_ns = 10**18
        for step in range(-20, 41):
            # Ever faster along x: 0.5 m/s2 times the square of the time.
            seconds = step / 10
            moved = RigidTransform(np.array([0.5 * (seconds + 3.0) ** 2, 0.0, 0.0]))
            buffer.add("map", "radar", begin_ns + step * 10**8, moved)

        def rates(stamp_ns):
            node._on_message(cloud(stamp_ns))
            return node._detections.messages[-1].range_rate_mps

        short = rates(begin_ns + 10**9)
        node.set_parameters([Parameter("motion_interval_s", value=2.0)])
        long = rates(begin_ns + 2 * 10**9)
        node.set_parameters([Parameter("motion_interval_s", value=0.1)])
        again = rates(begin_ns + 3 * 10**9)
        # The speed at 1, 2 and 3 s is 4, 5 and 6 m/s; over 2 s before it is 1 m/s less.
        assert np.abs(again - short).max() > 0.5
        assert np.abs(long - short).max() < 0.2


def test_odometry_is_taken_from_the_next_message_on_and_so_is_its_gap():
    with radar_with(range_rate_reference="ground", tf_timeout_s=0.0) as node:
        begin_ns = 10**18
        node._on_message(cloud(begin_ns))
        assert node._odometry is None
        node.set_parameters([Parameter("sensor_motion", value="odometry")])
        for step in (0, 1):
            ahead = Odometry(np.array([5.0 + 2.0 * step, 0.0, 0.0]), np.zeros(3))
            node._odometry.buffer.add(begin_ns + step * 10**9, "car", "", ahead)
        # Half way between 5 and 7 m/s, but the reports are a second apart.
        node._on_message(cloud(begin_ns + 5 * 10**8))
        assert node.counters["odometry_gap"] == 1
        assert len(node._detections.messages) == 1
        assert "lie between two reports" in node.health()[1]
        node.set_parameters([Parameter("odometry_gap_s", value=2.0)])
        node._on_message(cloud(begin_ns + 5 * 10**8))
        before, after = node._detections.messages
        added = after.range_rate_mps - before.range_rate_mps
        expected = 6.0 * np.cos(after.azimuth_rad) * np.cos(after.elevation_rad)
        np.testing.assert_allclose(added, expected, atol=1e-5)
        assert node.health()[1] == "active"


def test_a_scan_waits_no_longer_than_the_new_time_out():
    with radar_with(pose_source="tf", tf_timeout_s=60.0) as node:
        node._on_message(cloud(10**18))
        assert len(node._waiting) == 1
        node.set_parameters([Parameter("tf_timeout_s", value=0.0)])
        node._work_off()
        assert not node._waiting
        assert sum(n for name, n in node.counters.items() if name.startswith("tf_")) == 1
