"""The node ``track_output`` in the graph and in a bag, and packages that are absent."""

from __future__ import annotations

import numpy as np
from autoware_perception_msgs.msg import TrackedObjects
from gda_tracker_msgs.msg import TrackArray
from graph_helpers import TIMEOUT_S
from radar_msgs.msg import RadarTracks
from rclpy.node import Node
from vision_msgs.msg import Detection3DArray

from gda_tracker.io.bag_types import serialize
from gda_tracker.io.bags import read_bag
from gda_tracker.io.messages import tracks_to_message
from gda_tracker.io.track_outputs import FORMATS, bag_message
from gda_tracker.nodes import track_output
from gda_tracker.nodes.qualities import stream
from gda_tracker.nodes.recorder import RecorderNode
from gda_tracker.nodes.runner import Nodes
from gda_tracker.nodes.track_output import TrackOutputNode
from gda_tracker.vocabulary.scans import ScanKey
from gda_tracker.vocabulary.tracks import Tracks

TABLE = {name: f"out/{name}" for name in FORMATS} | {"tentative": True, "object_size_m": [4, 2, 1]}
TYPES = {
    "radar_tracks": RadarTracks,
    "detections_3d": Detection3DArray,
    "tracked_objects": TrackedObjects,
}


def example_tracks():
    return Tracks(
        key=ScanKey(1, "radar", 12_345_678_901),
        frame_id="map",
        system_uuid=bytes(range(16)),
        track_id=np.array([5, 6]),
        hypothesis_id=np.array([7, 8]),
        status=np.array([1, 0]),
        mean=np.array([[100.0, -50.0, 3.0, 4.0], [7.0, 8.0, 0.1, 0.0]]),
        covariance=np.tile(np.diag([4.0, 9.0, 0.2, 0.1]), (2, 1, 1)),
        class_names=("false_alarm", "cargo"),
        class_probability=np.array([[0.25, 0.75], [0.5, 0.5]]),
        masses=np.zeros((2, 0)),
        conflict=np.zeros(2),
        existence_probability=np.array([0.95, 0.5]),
        hits=np.array([3, 1]),
        misses=np.zeros(2, dtype=np.int64),
        coasted_scans=np.zeros(2, dtype=np.int64),
        first_detection_ns=np.array([1, 2]),
        last_detection_ns=np.array([3, 4]),
        detection_index=np.array([0, 1], dtype=np.int32),
    )


class Other(Node):
    """Publishes tracks and reads the formats of others."""

    def __init__(self, **options):
        super().__init__("other", **options)
        self.tracks = self.create_publisher(TrackArray, "tracks", stream())
        self.heard = {}
        for name, kind in TYPES.items():
            self.create_subscription(
                kind, f"out/{name}", lambda m, name=name: self.heard.update({name: m}), stream()
            )

    def autostart(self):
        pass

    def matched(self, formats):
        return self.tracks.get_subscription_count() > 0 and all(
            self.count_publishers(f"out/{name}") == 1 for name in formats
        )


def test_all_formats_come_as_they_are_converted_and_go_into_a_bag(domain, tmp_path):
    also = [f"out/{name}={kind}" for name, (kind, _) in FORMATS.items()]
    bag = tmp_path / "bag"
    with Nodes(
        lambda **o: [
            TrackOutputNode(TABLE, **o),
            RecorderNode({"bag": str(bag), "also": also}, **o),
            Other(**o),
        ],
        domain,
    ) as nodes:
        node, recorder, other = nodes.nodes
        assert nodes.spin_until(lambda: other.matched(FORMATS), TIMEOUT_S)
        assert nodes.spin_until(
            lambda: all(p.get_subscription_count() == 2 for _, p, _ in node._formats), TIMEOUT_S
        )
        sent = example_tracks()
        other.tracks.publish(tracks_to_message(sent))
        assert nodes.spin_until(
            lambda: (
                len(other.heard) == 3
                and all(recorder.counters[f"recorded /out/{name}"] == 1 for name in FORMATS)
            ),
            TIMEOUT_S,
        )
        assert node.health()[1] == "active"
        table = node.parameters
    written = {record.topic: record for record in read_bag(bag)}
    for name, (kind, convert) in FORMATS.items():
        expected = serialize(convert(sent, table, bag_message))
        assert serialize(other.heard[name]) == expected
        assert written[f"/out/{name}"].type == kind
        assert serialize(written[f"/out/{name}"].message()) == expected


def test_a_package_that_is_absent_is_said_and_the_others_go_on(domain, monkeypatch):
    there = track_output.message_class

    def message_class(kind):
        if kind.startswith("vision_msgs/"):
            raise ImportError(kind)
        return there(kind)

    monkeypatch.setattr(track_output, "message_class", message_class)
    with Nodes(lambda **o: [TrackOutputNode(TABLE, **o), Other(**o)], domain) as nodes:
        node, other = nodes.nodes
        assert node.health() == (b"\x02", "not installed: vision_msgs")
        formats = ("radar_tracks", "tracked_objects")
        assert nodes.spin_until(lambda: other.matched(formats), TIMEOUT_S)
        other.tracks.publish(tracks_to_message(example_tracks()))
        assert nodes.spin_until(lambda: set(other.heard) == set(formats), TIMEOUT_S)


def test_without_a_format_diagnostics_say_which_there_are(domain):
    with Nodes(lambda **o: [TrackOutputNode({}, **o)], domain) as nodes:
        level, text = nodes.nodes[0].health()
        assert (level, text) == (b"\x01", f"no format is chosen: {', '.join(FORMATS)}")
