"""The own motion of a radar from odometry in the graph: waiting for it, refusing it, time back."""

from __future__ import annotations

import numpy as np
from nav_msgs.msg import Odometry
from odometry_examples import MOUNTING, WALKER_MPS, S, columns_at, odometry_message
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2
from test_radar_input import WAIT_S, Driver, matched

from gda_tracker.io.bag_types import serialize
from gda_tracker.io.radar.point_cloud import point_cloud_of_columns
from gda_tracker.nodes.qualities import stream
from gda_tracker.nodes.radar_input import RadarInputNode
from gda_tracker.nodes.runner import Nodes

SETTINGS = {
    **MOUNTING,
    "sensor_motion": "odometry",
    "pose_source": "odometry",
    "range_rate_reference": "ground",
    "moving_above_mps": 0.2,
    "tf_timeout_s": 10.0,
}


class Car(Driver):
    """A driver whose radar is on a car that tells how it moves."""

    def __init__(self, **options):
        super().__init__(**options)
        self.odometry = self.create_publisher(Odometry, "odom", stream())

    def tell(self, seconds, **frames):
        message = odometry_message(seconds, **frames)
        self.odometry.publish(deserialize_message(serialize(message), Odometry))

    def see(self, seconds):
        columns = columns_at(seconds)
        types = dict.fromkeys(columns, "float32")
        message = point_cloud_of_columns(columns, types, round(seconds * S), "radar")
        self.clouds.publish(deserialize_message(serialize(message), PointCloud2))


def test_a_driving_car_sees_what_moves(domain):
    with Nodes(lambda **o: [RadarInputNode(SETTINGS, **o), Car(**o)], domain) as nodes:
        radar, car = nodes.nodes
        wait, counters = nodes.spin_until, radar.counters
        matched(nodes, car)
        assert wait(lambda: car.odometry.get_subscription_count() == 1, WAIT_S)

        # A scan waits for odometry on both sides of it.
        car.see(10.05)
        assert wait(lambda: counters["received"] == 1, WAIT_S)
        car.tell(10.0)
        assert wait(lambda: counters["odometry_received"] == 1, WAIT_S)
        assert not car.detections
        car.tell(10.1)
        assert wait(lambda: len(car.detections) == 1, WAIT_S)
        (scan,) = car.detections
        # Of 60 posts and a walker only he is left, at the speed that he has over ground.
        (rate,) = scan.range_rate_mps
        assert 0.2 < abs(rate) <= WALKER_MPS
        assert scan.sensor_position_m[2] == MOUNTING["sensor_position_m"][2]
        assert radar.figures()["standing_still"] > 0.98
        assert radar.health()[1] == "active"

        # What does not belong here is counted, and does no harm.
        car.tell(10.15, parent="odom")
        car.tell(10.15, child="")
        assert wait(lambda: counters["odometry_unknown_frame"] == 1, WAIT_S)
        assert wait(lambda: counters["odometry_refused"] == 1, WAIT_S)
        (result,) = radar.set_parameters([Parameter("tf_timeout_s", value=0.05)])
        assert result.successful
        car.see(10.3)
        assert wait(lambda: counters["odometry_too_late"] == 1, WAIT_S)
        assert "after the last known" in radar.health()[1]

        # A bag loops: of its first lap nothing is left.
        car.tell(2.0)
        car.tell(2.1)
        assert wait(lambda: counters["odometry_received"] == 6, WAIT_S)
        assert counters["odometry_jumped_back"] == 1
        car.see(2.05)
        assert wait(lambda: len(car.detections) == 2, WAIT_S)
        np.testing.assert_allclose(car.detections[1].stamp_ns, 2.05 * S)
        assert radar.health()[1] == "active"


def test_without_odometry_diagnostics_say_what_is_missing(domain):
    settings = {**SETTINGS, "tf_timeout_s": 0.0, "odometry_topic": "wheels"}
    with Nodes(lambda **o: [RadarInputNode(settings, **o), Car(**o)], domain) as nodes:
        radar, car = nodes.nodes
        matched(nodes, car)
        car.see(1.0)
        assert nodes.spin_until(lambda: radar.counters["odometry_missing"] == 1, WAIT_S)
        text = radar.health()[1]
        assert text == "no odometry has come yet; nobody publishes the odometry wheels"
        # Somebody does, but it is no odometry.
        strange = car.create_publisher(PointCloud2, "wheels", stream())
        wrong = "odometry wheels is of type sensor_msgs/msg/PointCloud2: allowed is one of nav_msgs"
        assert nodes.spin_until(lambda: wrong in radar.health()[1], WAIT_S)
        car.destroy_publisher(strange)
