"""Poses of radars from ``/tf`` in the graph: waiting for them, refusing them, time set back."""

from __future__ import annotations

import numpy as np
import pytest
from geometry_msgs.msg import TransformStamped
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2
from test_radar_input import WAIT_S, Driver, matched
from tf2_msgs.msg import TFMessage

from gda_tracker.io.bag_types import serialize
from gda_tracker.io.messages import stamp_to_time
from gda_tracker.io.radar.point_cloud import point_cloud_of_columns
from gda_tracker.kinematics.rigid_transforms import quaternion_of_angles
from gda_tracker.nodes import transform_listener
from gda_tracker.nodes.qualities import latched, stream
from gda_tracker.nodes.radar_input import RadarInputNode
from gda_tracker.nodes.runner import Nodes
from gda_tracker.parameters import ParameterError

S = 1_000_000_000
SETTINGS = {"pose_source": "tf", "tf_timeout_s": 5.0}


def cloud(stamp_ns, frame="radar"):
    columns = {"x": np.array([10.0, 20.0]), "y": np.array([1.0, -3.0])}
    message = point_cloud_of_columns(columns, dict.fromkeys("xy", "float32"), stamp_ns, frame)
    return deserialize_message(serialize(message), PointCloud2)


def transform(parent, child, stamp_ns, x=0.0, y=0.0, yaw=0.0):
    found = TransformStamped()
    found.header.stamp = stamp_to_time(stamp_ns)
    found.header.frame_id, found.child_frame_id = parent, child
    found.transform.translation.x, found.transform.translation.y = x, y
    q = found.transform.rotation
    q.x, q.y, q.z, q.w = quaternion_of_angles(0.0, 0.0, yaw).tolist()
    return found


class Ship(Driver):
    """A driver whose radar is on a ship that tells where it is."""

    def __init__(self, **options):
        super().__init__(**options)
        self.tf = self.create_publisher(TFMessage, "/tf", stream())
        self.static = self.create_publisher(TFMessage, "/tf_static", latched())
        self.static.publish(TFMessage(transforms=[transform("ship", "radar", 0, x=2.0, yaw=1.0)]))

    def at(self, *seconds):
        """Say where the ship was: it sails East at 4 m/s."""
        told = [transform("map", "ship", round(s * S), x=4.0 * s) for s in seconds]
        self.tf.publish(TFMessage(transforms=told))


@pytest.fixture
def graph(domain):
    with Nodes(lambda **o: [RadarInputNode(SETTINGS, **o), Ship(**o)], domain) as nodes:
        radar, ship = nodes.nodes
        matched(nodes, ship)
        assert nodes.spin_until(lambda: radar.counters["tf_received"] >= 1, WAIT_S)
        assert nodes.spin_until(lambda: ship.tf.get_subscription_count() == 1, WAIT_S)
        yield nodes


def received(nodes, number):
    radar = nodes.nodes[0]
    assert nodes.spin_until(lambda: radar.counters["received"] == number, WAIT_S)


def published(nodes, number):
    ship = nodes.nodes[1]
    assert nodes.spin_until(lambda: len(ship.detections) == number, WAIT_S), len(ship.detections)


def test_scans_wait_for_their_transforms_and_go_on_in_order(graph):
    radar, ship = graph.nodes
    for number, stamp in enumerate((1.25, 1.5, 2.0), 1):
        ship.clouds.publish(cloud(round(stamp * S)))
        received(graph, number)
    assert not ship.detections
    ship.at(1.0)
    ship.at(1.5)
    published(graph, 2)
    ship.at(2.5)
    published(graph, 3)
    assert [scan.sequence for scan in ship.detections] == [1, 2, 3]
    for scan, east in zip(ship.detections, (7.0, 8.0, 10.0), strict=True):
        np.testing.assert_allclose(scan.sensor_position_m, [east, 0.0, 0.0], atol=1e-9)
        np.testing.assert_allclose(
            scan.sensor_orientation_xyzw, quaternion_of_angles(0.0, 0.0, 1.0), atol=1e-12
        )
        assert scan.frame_id == "radar"
    assert radar.health()[1] == "active"


def test_what_cannot_be_had_is_refused_with_its_reason(graph):
    radar, ship = graph.nodes
    (result,) = radar.set_parameters([Parameter("tf_timeout_s", value=0.1)])
    assert result.successful
    ship.at(1.0, 2.0)
    assert graph.spin_until(lambda: radar.counters["tf_received"] == 3, WAIT_S)
    for reason, message in (
        ("tf_too_late", cloud(3 * S)),
        ("tf_unknown_frame", cloud(3 * S + 1, "sonar")),
        ("tf_too_early", cloud(S // 2)),
    ):
        ship.clouds.publish(message)
        assert graph.spin_until(lambda r=reason: radar.counters[r] == 1, WAIT_S), reason
    assert "before the first known" in radar.health()[1]
    ship.clouds.publish(cloud(S + S // 2))
    published(graph, 1)
    assert radar.health()[1] == "active"


def test_time_that_is_set_back_begins_the_histories_anew(graph):
    """A bag loops: of its first lap nothing is left."""
    radar, ship = graph.nodes
    ship.at(10.0, 11.0)
    ship.clouds.publish(cloud(10 * S + S // 2))
    published(graph, 1)
    ship.at(2.0, 3.0)
    ship.clouds.publish(cloud(2 * S + S // 4))
    published(graph, 2)
    assert radar.counters["tf_jumped_back"] == 1
    assert radar.counters["stamp_stepped_back"] == 1
    east = [scan.sensor_position_m[0] for scan in ship.detections]
    np.testing.assert_allclose(east, [44.0, 11.0], atol=1e-9)


def test_without_the_package_the_node_says_what_to_install(monkeypatch, domain):
    def absent(kind):
        raise ImportError(kind)

    monkeypatch.setattr(transform_listener, "message_class", absent)
    with pytest.raises(ParameterError, match=r"pose_source .* tf2_msgs, which is not installed"):
        Nodes(lambda **o: [RadarInputNode(SETTINGS, **o)], domain)
    table = {"motion_frame": "odom"}
    with Nodes(lambda **o: [RadarInputNode(table, **o)], domain) as nodes:
        (result,) = nodes.nodes[0].set_parameters([Parameter("sensor_motion", value="tf")])
        assert not result.successful
        assert "tf2_msgs" in result.reason
