"""The node ``set_valued_tracker`` in the graph: fed by a source, recorded, fed with rubbish."""

from __future__ import annotations

import dataclasses

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from gda_tracker_msgs import msg
from graph_helpers import TIMEOUT_S
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from gda_tracker.io.bags import read_bag
from gda_tracker.io.messages import (
    detections_to_message,
    scan_report_from_message,
    track_sets_from_message,
)
from gda_tracker.nodes.qualities import stream
from gda_tracker.nodes.recorder import RecorderNode
from gda_tracker.nodes.runner import Nodes
from gda_tracker.nodes.scan_source import ScanSourceNode
from gda_tracker.nodes.set_valued_tracker import SetValuedTrackerNode
from gda_tracker.parameters import from_mapping
from gda_tracker.simulation.crossing_tracks import (
    CrossingTracks,
    set_valued_preset,
    simulate_crossing_tracks,
)
from gda_tracker.simulation.playback import Playback
from gda_tracker.tracking.set_valued.parameters import SetValuedParameters
from gda_tracker.tracking.set_valued.tracker import SetValuedTracker

MODEL = CrossingTracks(detection_probability=0.95, clutter=3.0, samples=16)
TABLE = {**set_valued_preset(MODEL), "scan_reports": True}
# These differ from run to run.
OF_THE_RUN = {"key", "system_uuid"}


class Other(Node):
    """Publishes detections, hears sets, markers, reports and diagnostics."""

    def __init__(self, **options):
        super().__init__("other", **options)
        self.detections = self.create_publisher(msg.DetectionArray, "detections", stream())
        self.sets, self.markers, self.reports, self.counts = [], [], [], {}
        self.create_subscription(msg.TrackSetArray, "track_sets", self._on_sets, stream())
        self.create_subscription(MarkerArray, "track_set_markers", self.markers.append, stream())
        self.create_subscription(msg.ScanReport, "scan_reports", self._on_report, stream())
        self.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, stream())
        self.resetter = self.create_client(Trigger, "set_valued_tracker/reset")

    def _on_sets(self, message):
        self.sets.append(track_sets_from_message(message))

    def _on_report(self, message):
        self.reports.append(scan_report_from_message(message))

    def _on_diagnostics(self, message):
        for status in message.status:
            if status.name == "/set_valued_tracker":
                self.counts = {v.key: v.value for v in status.values}

    def autostart(self):
        pass

    def matched(self):
        return self.detections.get_subscription_count() > 0 and all(
            self.count_publishers(topic) == 1
            for topic in ("track_sets", "track_set_markers", "scan_reports")
        )


def offline():
    tracker = SetValuedTracker(from_mapping(SetValuedParameters, TABLE))
    detections, truth = simulate_crossing_tracks(MODEL, 4)
    return [tracker.process(scan)[0] for scan in detections], detections, truth


def assert_same(heard, expected):
    assert len(heard) == len(expected)
    for one, other in zip(heard, expected, strict=True):
        for field in dataclasses.fields(one):
            if field.name not in OF_THE_RUN:
                left, right = getattr(one, field.name), getattr(other, field.name)
                np.testing.assert_array_equal(left, right, err_msg=field.name)


def test_a_source_plays_into_it_and_the_recorder_has_it_all(domain, tmp_path):
    expected, detections, truth = offline()
    bag = tmp_path / "bag"
    play = Playback("crossing tracks", detections, truth)
    with Nodes(
        lambda **o: [
            SetValuedTrackerNode(TABLE, **o),
            RecorderNode({"bag": str(bag)}, **o),
            Other(**o),
        ],
        domain,
    ) as nodes:
        tracker, recorder, other = nodes.nodes
        for publisher in (tracker._track_sets, tracker._markers):
            assert nodes.spin_until(lambda p=publisher: p.get_subscription_count() == 2, TIMEOUT_S)
        source = ScanSourceNode({}, plays=[play], context=nodes.context)
        nodes.nodes.append(source)
        nodes.executor.add_node(source)
        source.autostart()
        assert nodes.spin_until(
            lambda: (
                source.finished
                and len(other.sets) == len(detections)
                and recorder.counters["recorded /track_sets"] == len(detections)
            ),
            TIMEOUT_S,
        )
        assert source.exit_code == 0
        assert {r.outcome for r in source.progress.reports} == {"tracked"}
        assert_same(other.sets, expected)
        assert {(s.key.epoch, s.system_uuid) for s in other.sets} == {
            (tracker.tracker.epoch, tracker.tracker.system_uuid)
        }
        assert nodes.spin_until(lambda: len(other.markers) == len(detections), TIMEOUT_S)
        # Of the diagnostics those that come after the last scan.
        started, living = str(tracker.counters["tracks_started"]), str(len(expected[-1]))
        assert nodes.spin_until(
            lambda: (
                other.counts.get("tracks_started") == started and other.counts.get("sets") == living
            ),
            TIMEOUT_S,
        )
        assert tracker.health()[1] == "active"
        # Another one begins anew, under another identity.
        again = SetValuedTrackerNode({**TABLE, "scan_reports": False}, context=nodes.context)
        assert again.tracker.epoch > tracker.tracker.epoch
        assert again.tracker.system_uuid != tracker.tracker.system_uuid
        again.destroy_node()
    recorded = [r.message() for r in read_bag(bag) if r.topic == "/track_sets"]
    assert_same([track_sets_from_message(m) for m in recorded], expected)


def test_rubbish_is_refused_by_name_and_parameters_change_live(domain):
    _, detections, _ = offline()
    with Nodes(lambda **o: [SetValuedTrackerNode(TABLE, **o), Other(**o)], domain) as nodes:
        node, other = nodes.nodes
        assert nodes.spin_until(other.matched, TIMEOUT_S)

        def send(message):
            before = len(other.reports)
            other.detections.publish(message)
            assert nodes.spin_until(lambda: len(other.reports) > before, TIMEOUT_S)
            return other.reports[-1]

        for scan in detections[:5]:
            assert send(detections_to_message(scan)).outcome == "tracked"
        lived = len(node.tracker.branches)
        bad = detections_to_message(detections[5])
        bad.azimuth_rad = bad.azimuth_rad[1:]
        assert send(bad).reason == "array_length_mismatch"
        bad = detections_to_message(detections[5])
        bad.attribute_names, bad.attribute_values = ["length_m"], [1.0]
        assert send(bad).outcome == "rejected"
        nobody = detections_to_message(dataclasses.replace(detections[5], sensor_id=""))
        assert send(nobody).reason == "missing_sensor_id"
        late = dataclasses.replace(detections[2], sensor_id="other")
        assert send(detections_to_message(late)).reason == "late"
        assert len(node.tracker.branches) == lived
        # The last scan again is answered again.
        assert send(detections_to_message(detections[4])).repeated

        refused = node.set_parameters([Parameter("theta", value=-1.0)])
        assert not refused[0].successful
        assert "allowed is a number > 0" in refused[0].reason
        assert node.set_parameters([Parameter("theta", value=1e-3)])[0].successful
        report = send(detections_to_message(detections[5]))
        # Nothing is possible any more: every detection starts a track.
        assert report.outcome == "tracked"
        assert (other.sets[-1].hits == 1).sum() == len(detections[5].range_m)

        reset = other.resetter.call_async(Trigger.Request())
        assert nodes.spin_until(reset.done, TIMEOUT_S)
        assert reset.result().success
        report = send(detections_to_message(detections[0]))
        assert (report.outcome, report.tracks_tentative) == (
            "tracked",
            len(detections[0].range_m),
        )
        assert nodes.spin_until(
            lambda: (
                other.counts.get("rejected_late") == "1" and other.counts.get("reset_reset") == "1"
            ),
            TIMEOUT_S,
        )
        assert other.counts["rejected_array_length_mismatch"] >= "1"
