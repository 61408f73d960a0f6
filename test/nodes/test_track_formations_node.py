"""The node ``track_formations`` beside a ring: formations as offline, a bag, bad input, live."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from gda_tracker_msgs.msg import FormationArray, Predictions, Scan, TrackArray
from graph_helpers import TIMEOUT_S
from rclpy.node import Node
from rclpy.parameter import Parameter

from gda_tracker.formations.parameters import FormationParameters
from gda_tracker.formations.tracker import FormationTracker
from gda_tracker.io.bags import read_bag
from gda_tracker.io.formation_messages import formations_from_message
from gda_tracker.io.messages import predictions_to_message, scan_to_message, tracks_to_message
from gda_tracker.nodes.qualities import latched, stream
from gda_tracker.nodes.recorder import RecorderNode
from gda_tracker.nodes.runner import Nodes, stage_nodes
from gda_tracker.nodes.scan_source import ScanSourceNode
from gda_tracker.nodes.track_formations import TrackFormationsNode
from gda_tracker.simulation.playback import of_scenario
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.tracking.ring import Ring

SCANS = 20


class Ear(Node):
    """Hears formations."""

    def __init__(self, **options):
        super().__init__("ear", **options)
        self.heard = []
        self.create_subscription(FormationArray, "track_formations", self.heard.append, stream())

    def autostart(self):
        pass


class Sender(Ear):
    """Publishes what a ring would."""

    def __init__(self, **options):
        super().__init__(**options)
        self.outputs = (
            self.create_publisher(Scan, "scans", latched()),
            self.create_publisher(Predictions, "predictions", latched()),
            self.create_publisher(TrackArray, "tracks", stream()),
        )

    def send(self, *messages):
        for publisher, message in zip(self.outputs, messages, strict=True):
            publisher.publish(message)


def same(one, other):
    assert one.key == other.key
    assert (one.frame_id, one.system_uuid) == (other.frame_id, other.system_uuid)
    for parts in ((one.formations, other.formations), (one.events, other.events)):
        for found, expected in zip(*parts, strict=True):
            for name in found.__slots__:
                np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


def test_beside_a_ring_formations_are_those_of_the_core(domain, tmp_path):
    scenario = load_scenario("formations")
    (play,) = of_scenario(scenario, 1, 3, "map/none/cv")
    play = replace(play, detections=play.detections[:SCANS], truth=play.truth[:SCANS])
    parameters = tracker_preset(scenario)
    parameters["track_manager"].update(decision="map", attribute_term="none")
    bag = tmp_path / "bag"
    with Nodes(
        lambda **o: [
            ScanSourceNode({}, plays=[play], collect=True, **o),
            TrackFormationsNode({}, **o),
            Ear(**o),
            RecorderNode({"bag": str(bag)}, **o),
            *stage_nodes(parameters, **o),
        ],
        domain,
    ) as nodes:
        source, node, ear, recorder, *_ = nodes.nodes
        wait = nodes.spin_until
        assert wait(lambda: source.finished, TIMEOUT_S)
        assert wait(lambda: len(ear.heard) == SCANS, TIMEOUT_S)
        core, ring, last = FormationTracker(), Ring(parameters), None
        ring.initialise(play.initial)
        for message, detections in zip(ear.heard, play.detections, strict=True):
            last = ring.process(detections)
            expected = core.take(last.tracks, last.scan, last.predictions)
            found = formations_from_message(message)
            # Two rings have two identities.
            same(replace(found, key=expected.key, system_uuid=expected.system_uuid), expected)
        assert sorted(one.number for one in expected.formations) == [1, 2, 3, 4, 5]
        assert node.figures() == {"formations": 5}

        assert wait(lambda: recorder.counters["recorded /track_formations"] == SCANS, TIMEOUT_S)
    written = [record for record in read_bag(bag) if record.topic == "/track_formations"]
    same(formations_from_message(written[-1].message()), formations_from_message(ear.heard[-1]))

    with Nodes(lambda **o: [TrackFormationsNode({}, **o), Sender(**o)], domain) as nodes:
        node, ear = nodes.nodes
        wait = nodes.spin_until
        assert wait(lambda: all(o.get_subscription_count() for o in ear.outputs), TIMEOUT_S)
        assert wait(lambda: node._formations.get_subscription_count(), TIMEOUT_S)
        good = (
            scan_to_message(last.scan),
            predictions_to_message(last.predictions),
            tracks_to_message(last.tracks),
        )
        # What cannot be used is counted, by reason; it goes on with what can.
        broken = tracks_to_message(last.tracks)
        broken.tracks[0].state = [1.0]
        ear.outputs[2].publish(broken)
        assert wait(lambda: node.counters["malformed_tracks"] == 1, TIMEOUT_S)
        ear.send(*good)
        assert wait(lambda: len(ear.heard) == 1, TIMEOUT_S)
        # An answer that comes again is not counted twice.
        ear.send(*good)
        assert wait(lambda: node.counters["formation_scan_repeated"] == 1, TIMEOUT_S)

        # Parameters may be changed while it runs, but for what does not go together.
        (result,) = node.set_parameters([Parameter("resolution_range_m", value=100.0)])
        assert not result.successful
        assert "resolution_azimuth_rad = 0.0: allowed are both" in result.reason
        (result,) = node.set_parameters([Parameter("largest_number", value=3)])
        assert result.successful, result.reason
        assert node._tracker.parameters == FormationParameters(largest_number=3)
