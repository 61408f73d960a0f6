"""The node ``track_events`` in the graph: events as offline, bad input, live parameters, a bag."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from event_examples import on_lane_then_off, tracks, walk
from gda_tracker_msgs.msg import TrackArray, TrackEventArray
from graph_helpers import TIMEOUT_S
from rclpy.node import Node
from rclpy.parameter import Parameter

from gda_tracker.events.detector import TrackEventDetector
from gda_tracker.events.parameters import EventParameters
from gda_tracker.io.bags import read_bag
from gda_tracker.io.context_files import read_context_file
from gda_tracker.io.event_messages import events_from_message
from gda_tracker.io.messages import tracks_to_message
from gda_tracker.nodes.qualities import stream
from gda_tracker.nodes.recorder import RecorderNode
from gda_tracker.nodes.runner import Nodes
from gda_tracker.nodes.track_events import TrackEventsNode

FILE = """
frame_id: map
lanes:
  - {name: fairway, direction: forward, width_m: 40, margin_m: 20, points_m: [[0, 0], [3000, 0]]}
"""


class Other(Node):
    """Publishes tracks and hears events."""

    def __init__(self, **options):
        super().__init__("other", **options)
        self.tracks = self.create_publisher(TrackArray, "tracks", stream())
        self.heard = []
        self.create_subscription(TrackEventArray, "track_events", self.heard.append, stream())

    def autostart(self):
        pass

    def send(self, scans):
        for scan in scans:
            self.tracks.publish(tracks_to_message(scan))


def tracks_on_course_that_vanish():
    return [
        tracks(
            2.0 * k, [1], [9000.0 - 20.0 * min(k, 10), 0.0, -10.0, 0.0], detected=k < 10, epoch=3
        )
        for k in range(20)
    ]


def same(one, other):
    assert one.key == other.key
    assert (one.frame_id, one.system_uuid) == (other.frame_id, other.system_uuid)
    for event, expected in zip(one.events, other.events, strict=True):
        for name in event.__slots__:
            np.testing.assert_array_equal(getattr(event, name), getattr(expected, name))


def test_events_are_those_of_the_core_and_bad_input_is_counted(domain, tmp_path):
    file = tmp_path / "lanes.yaml"
    file.write_text(FILE)
    bag = tmp_path / "bag"
    scans = walk(on_lane_then_off())
    detector = TrackEventDetector(EventParameters(), read_context_file(file))
    expected = [found for found in map(detector.take, scans) if len(found)]
    kinds = [[event.kind for event in found.events] for found in expected]
    assert kinds == [["keeps_lane"], ["leaves_lane"]]
    with Nodes(
        lambda **o: [
            TrackEventsNode({"context_file": str(file)}, **o),
            RecorderNode({"bag": str(bag)}, **o),
            Other(**o),
        ],
        domain,
    ) as nodes:
        node, recorder, other = nodes.nodes
        wait = nodes.spin_until
        assert wait(lambda: other.tracks.get_subscription_count() == 2, TIMEOUT_S)
        assert wait(lambda: node._events.get_subscription_count() == 2, TIMEOUT_S)
        assert node.figures() == {"lanes": 1, "plans": 0}
        other.send(scans)
        assert wait(lambda: len(other.heard) == 2, TIMEOUT_S)
        for message, wanted in zip(other.heard, expected, strict=True):
            same(events_from_message(message), wanted)

        # A tracker that was restarted begins anew; what cannot be used is counted, by reason.
        unreadable = tracks_to_message(scans[0])
        unreadable.tracks[0].state = [1.0]
        other.tracks.publish(unreadable)
        old, new = walk(on_lane_then_off(), epoch=0), walk(on_lane_then_off(), epoch=2)
        other.send([old[0], scans[0], replace(scans[-1], frame_id="odom"), *new])
        assert wait(lambda: len(other.heard) == 4, TIMEOUT_S)
        for reason in ("malformed_tracks", "older_epoch", "tracks_time_backwards"):
            assert node.counters[reason] == 1
        assert node.counters["tracks_other_frame"] == 1
        assert node.counters["began_anew"] == 1
        assert node.counters["event leaves_lane"] == 2

        # The file and all else may be changed while it runs, but for what cannot be used.
        for name, value, reason in (
            ("context_file", str(tmp_path / "absent"), "absent: No such file"),
            ("moving_speed_mps", 0.1, "parameter moving_speed_mps = 0.1: allowed is"),
        ):
            (result,) = node.set_parameters([Parameter(name, value=value)])
            assert not result.successful
            assert reason in result.reason
        (result,) = node.set_parameters([Parameter("context_file", value="")])
        assert result.successful, result.reason
        assert node.figures() == {"lanes": 0, "plans": 0}
        # A stop that is not seen: the blind zone of the radar.
        told = {"blind_speed_mps": 2.0, "moving_speed_mps": 6.0}
        for name, value in told.items():
            (result,) = node.set_parameters([Parameter(name, value=value)])
            assert result.successful, result.reason
        gone = tracks_on_course_that_vanish()
        core = TrackEventDetector(EventParameters(**told))
        (stop,) = [found for found in map(core.take, gone) if len(found)]
        assert [event.kind for event in stop.events] == ["stopped"]
        other.send(gone)
        assert wait(lambda: len(other.heard) == 5, TIMEOUT_S)
        same(events_from_message(other.heard[4]), stop)
        assert wait(lambda: recorder.counters["recorded /track_events"] == 5, TIMEOUT_S)
    written = [record for record in read_bag(bag) if record.topic == "/track_events"]
    same(events_from_message(written[1].message()), expected[1])
