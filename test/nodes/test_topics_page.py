"""docs/topics.md against the running nodes, and the driver of docs/radar-csv.md in the ring."""

from __future__ import annotations

import re
from pathlib import Path

from gda_tracker_msgs import msg
from graph_helpers import TIMEOUT_S
from rclpy.node import Node

from gda_tracker.io.messages import tracks_from_message
from gda_tracker.nodes.evaluator import EvaluatorNode
from gda_tracker.nodes.qualities import stream
from gda_tracker.nodes.radar_input import RadarInputNode
from gda_tracker.nodes.recorder import RecorderNode
from gda_tracker.nodes.runner import Nodes, stage_nodes
from gda_tracker.nodes.scan_source import ScanSourceNode
from gda_tracker.nodes.set_valued_tracker import SetValuedTrackerNode
from gda_tracker.nodes.track_events import TrackEventsNode
from gda_tracker.nodes.track_formations import TrackFormationsNode
from gda_tracker.nodes.track_output import TrackOutputNode
from gda_tracker.vocabulary.tracks import CONFIRMED

DOCS = Path(__file__).resolve().parents[2] / "docs"
# What ROS itself opens for every node.
OWN = {"/rosout", "/parameter_events", "/clock"}


class Listener(Node):
    """Keeps the newest tracks; ``listener`` and ``my_driver`` are no nodes of the suite."""

    def __init__(self, **options):
        super().__init__("listener", **options)
        self.tracks = None
        self.create_subscription(msg.TrackArray, "tracks", self._take, stream())

    def autostart(self):
        pass

    def _take(self, message):
        self.tracks = tracks_from_message(message)


def table():
    """Rows of the page: topic -> (type, publishers, subscribers)."""
    rows = {}
    text = (DOCS / "topics.md").read_text(encoding="utf-8").split("## Services")[0]
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 5 and cells[0].startswith("`"):
            names = [frozenset(re.findall(r"`([^`]+)`", cell)) for cell in cells[2:4]]
            rows[cells[0].strip("`")] = (cells[1].strip("`"), *names, cells[2])
    return rows


def driver():
    """The driver of the page, as a node that starts like the others."""
    page = (DOCS / "radar-csv.md").read_text(encoding="utf-8")
    code = re.search(r"^```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)[1]
    space = {"__name__": "my_driver"}
    exec(compile(code, "radar-csv.md", "exec"), space)
    return type("MyDriver", (space["MyDriver"],), {"autostart": lambda self: None})


def test_topics_of_the_page_and_a_driver_of_ones_own(environment, domain, tmp_path):
    def make(**options):
        return [
            Listener(**options),
            *stage_nodes({}, **options),
            RadarInputNode({"input_topic": "/nobody"}, **options),
            TrackOutputNode({}, **options),
            TrackEventsNode({}, **options),
            TrackFormationsNode({}, **options),
            EvaluatorNode({}, **options),
            SetValuedTrackerNode({}, **options),
            RecorderNode({"bag": str(tmp_path / "bag")}, **options),
            # It stands still for want of credit: the driver is the source here.
            ScanSourceNode({}, plays=[], **options),
            driver()(**options),
        ]

    with Nodes(make, domain) as nodes:
        listener = nodes.nodes[0]
        suite = {node.get_name() for node in nodes.nodes} - {"listener", "my_driver"}
        found: dict[str, list] = {}
        for place, method in enumerate(
            (
                listener.get_publisher_names_and_types_by_node,
                listener.get_subscriber_names_and_types_by_node,
            )
        ):
            for name in suite:
                for topic, types in method(name, "/"):
                    if topic in OWN or topic.startswith(f"/{name}/") or topic == "/nobody":
                        continue
                    entry = found.setdefault(topic, [set(types), set(), set()])
                    entry[1 + place].add(name)
        page = table()
        assert {topic.strip("/") for topic in page} == {topic.strip("/") for topic in found}
        for topic, (kind, publishers, subscribers, told) in page.items():
            types, publishing, subscribing = found["/" + topic.strip("/")]
            full = kind.replace("/", "/msg/") if "/" in kind else f"gda_tracker_msgs/msg/{kind}"
            assert types == {full}, topic
            assert subscribing == subscribers, topic
            assert publishing == (suite if told == "every node" else publishers), topic

        # Sources stop with an empty list of plays; the driver's scans are tracked.
        def tracked():
            live = listener.tracks
            return live is not None and (live.status == CONFIRMED).any()

        assert nodes.spin_until(tracked, TIMEOUT_S)
        row = int((listener.tracks.status == CONFIRMED).argmax())
        assert abs(listener.tracks.mean[row, 1] - 40.0) < 5.0
