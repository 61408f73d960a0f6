"""The node ``markers`` in the graph: beside a ring, into a bag, on bad messages."""

from __future__ import annotations

from gda_tracker_msgs.msg import Formation, FormationArray, Scan, TrackArray
from graph_helpers import TIMEOUT_S, scenario_plays
from marker_viewer import Viewer
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from gda_tracker.io.bags import read_bag
from gda_tracker.io.markers.parameters import LAYERS, MARKER_ARRAY, marker_topic, marker_topics
from gda_tracker.io.messages import tracks_from_message
from gda_tracker.nodes.markers import MarkersNode
from gda_tracker.nodes.qualities import latched, stream
from gda_tracker.nodes.recorder import RecorderNode
from gda_tracker.nodes.runner import Nodes, stage_nodes
from gda_tracker.nodes.scan_source import ScanSourceNode

METHOD = "map/bayes/cv"
LOOKED_AT = ("tracks", "gates")


class Screen(Node):
    """Looks at two layers, as RViz does."""

    def __init__(self, **options):
        super().__init__("screen", **options)
        self.viewers = {name: Viewer(from_the_start=False) for name in LOOKED_AT}
        for name, viewer in self.viewers.items():
            self.create_subscription(MarkerArray, marker_topic(name), viewer.take, stream())
        self.reset = self.create_client(Trigger, "markers/reset")

    def autostart(self):
        pass


class Sender(Screen):
    """Publishes tracks and scans as a ring would."""

    def __init__(self, **options):
        super().__init__(**options)
        self.tracks = self.create_publisher(TrackArray, "tracks", stream())
        self.scans = self.create_publisher(Scan, "scans", latched())
        self.formations = self.create_publisher(FormationArray, "track_formations", stream())


def test_beside_a_ring_only_what_is_looked_at_is_made(domain):
    plays, parameters = scenario_plays("crossing_targets", METHOD)
    with Nodes(
        lambda **o: [
            ScanSourceNode({}, plays=plays, collect=True, **o),
            MarkersNode({}, **o),
            Screen(**o),
            *stage_nodes(parameters, **o),
        ],
        domain,
    ) as nodes:
        source, markers, screen, *_ = nodes.nodes
        assert nodes.spin_until(lambda: source.finished, TIMEOUT_S)
        last = list(source.progress.tracks.values())[-1]
        shown = screen.viewers["tracks"]
        stamp_ns = last.key.stamp_ns

        def complete():
            stamps = {m.header.stamp.sec * 10**9 + m.header.stamp.nanosec
                      for v in screen.viewers.values() for m in v.shown.values()}  # fmt: skip
            return stamps == {stamp_ns}

        assert nodes.spin_until(complete, TIMEOUT_S)
        assert shown.ids() == last.track_id.tolist()
        assert screen.viewers["gates"].ids() == last.track_id.tolist()
        published = {name for name in markers.counters if name.startswith("published ")}
        assert published == {f"published {name}" for name in LOOKED_AT}
        assert markers.figures() == {"looked_at": "gates, tracks"}
        assert markers.health()[1] == "active"

        # A layer that is switched off is emptied at once, the other stays.
        (result,) = markers.set_parameters([Parameter("layers", value=["gates"])])
        assert result.successful, result.reason
        assert nodes.spin_until(lambda: not shown.shown, TIMEOUT_S)
        assert screen.viewers["gates"].shown
        (result,) = markers.set_parameters([Parameter("gate_colour", value="pink")])
        assert not result.successful
        assert "allowed is '#rrggbb'" in result.reason

        # So is all when somebody asks for it.
        assert nodes.spin_until(screen.reset.service_is_ready, TIMEOUT_S)
        answer = screen.reset.call_async(Trigger.Request())
        assert nodes.spin_until(answer.done, TIMEOUT_S)
        assert answer.result().message == "emptied: gates"
        assert nodes.spin_until(lambda: not screen.viewers["gates"].shown, TIMEOUT_S)


def test_what_cannot_be_read_is_counted_and_what_is_recorded_is_whole(domain, tmp_path):
    bag = tmp_path / "bag"
    with Nodes(
        lambda **o: [
            MarkersNode({}, **o),
            RecorderNode({"bag": str(bag), "also": marker_topics()}, **o),
            Sender(**o),
        ],
        domain,
    ) as nodes:
        markers, recorder, screen = nodes.nodes
        wait = nodes.spin_until
        assert wait(lambda: screen.tracks.get_subscription_count() == 2, TIMEOUT_S)
        assert wait(lambda: screen.scans.get_subscription_count() == 2, TIMEOUT_S)
        assert wait(
            lambda: len(markers.figures()["looked_at"].split(", ")) == len(LAYERS), TIMEOUT_S
        )
        of_tracks = markers._publishers_of["tracks"]
        assert wait(lambda: of_tracks.get_subscription_count() == 2, TIMEOUT_S)
        good = message(7, 5_000_000_000, track_id=3)
        broken = message(7, 5_000_000_000, track_id=3)
        broken.tracks[0].state = [1.0]
        early = message(7, 5_000_000_000, track_id=3)
        early.tracks[0].first_detection.sec = -4
        nan = message(7, 6_000_000_000, track_id=4)
        nan.tracks[0].state[0] = float("nan")
        bad_scan = Scan()
        bad_scan.noise_covariance = [1.0, 2.0]
        for sent, counter in (
            (good, "published tracks"),
            (broken, "malformed_tracks"),
            (early, "malformed_tracks"),
            (nan, "not_drawn"),
            (message(6, 7_000_000_000, track_id=5), "older_epoch"),
        ):
            before = markers.counters[counter]
            screen.tracks.publish(sent)
            assert wait(lambda c=counter, n=before: markers.counters[c] > n, TIMEOUT_S), counter
        # Formations are those of the tracks' epoch; one has no place.
        found = FormationArray(header=good.header, key=good.key, system_uuid=good.system_uuid)
        one = Formation(formation_id=3, track_ids=[3], parent_track_ids=[-1])
        one.number_probabilities = [1.0]
        lost = Formation(formation_id=4, track_ids=[4], parent_track_ids=[-1])
        lost.number_probabilities = [1.0]
        lost.position = [float("nan"), 0.0]
        found.formations = [one, lost]
        before = markers.counters["not_drawn"]
        assert wait(lambda: screen.formations.get_subscription_count() == 2, TIMEOUT_S)
        screen.formations.publish(found)
        assert wait(lambda: markers.counters["published formations"] == 1, TIMEOUT_S)
        assert markers.counters["not_drawn"] == before + 1
        screen.scans.publish(bad_scan)
        assert wait(lambda: markers.counters["malformed_scans"] == 1, TIMEOUT_S)
        # The track of the first message has ended with the one that is not drawn.
        assert wait(lambda: screen.viewers["tracks"].messages == 2, TIMEOUT_S)
        assert not screen.viewers["tracks"].shown
        assert wait(lambda: recorder.counters["recorded /markers/tracks"] == 2, TIMEOUT_S)
        assert "topics_without_type" not in recorder.counters

        # An inactive node leaves nothing behind that it would no longer keep up to date.
        screen.tracks.publish(message(7, 8_000_000_000, track_id=6))
        assert wait(lambda: screen.viewers["tracks"].ids() == [6], TIMEOUT_S)
        markers.trigger_deactivate()
        assert wait(lambda: not screen.viewers["tracks"].shown, TIMEOUT_S)
        markers.trigger_cleanup()
        assert markers.figures() == {"looked_at": "none"}
        markers.trigger_configure()
        markers.trigger_activate()
        assert wait(lambda: screen.tracks.get_subscription_count() == 2, TIMEOUT_S)
        of_tracks = markers._publishers_of["tracks"]
        assert wait(lambda: of_tracks.get_subscription_count() == 2, TIMEOUT_S)
        screen.tracks.publish(message(7, 9_000_000_000, track_id=8))
        assert wait(lambda: screen.viewers["tracks"].ids() == [8], TIMEOUT_S)
    found = list(read_bag(bag, ["/markers/tracks"]))
    assert {r.type for r in found} == {MARKER_ARRAY}
    first = found[0].message().markers
    assert [(m.action, m.ns, m.id) for m in first] == [(3, "", 0), (0, "confirmed", 3)]


def message(epoch, stamp_ns, track_id):
    """One confirmed track."""
    from gda_tracker_msgs.msg import Track

    found = TrackArray()
    found.header.frame_id = "map"
    found.key.epoch, found.key.sensor_id, found.key.stamp_ns = epoch, "radar", stamp_ns
    track = Track(track_id=track_id, status=1, state=[1.0, 2.0, 3.0, 4.0])
    track.covariance = [float(i == j) for i in range(4) for j in range(4)]
    found.tracks.append(track)
    assert len(tracks_from_message(found)) == 1
    return found
