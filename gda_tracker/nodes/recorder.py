"""Node ``recorder``: all topics of the suite into an MCAP bag, playable by ``ros2 bag play``."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from gda_tracker_msgs import msg
from rclpy.qos import DurabilityPolicy, QoSProfile
from visualization_msgs.msg import MarkerArray

from gda_tracker.io.bag_types import message_class
from gda_tracker.io.bags import BagTopic, BagWriter
from gda_tracker.nodes.base import RingNode, spin_node
from gda_tracker.nodes.qualities import latched, sensor, stream
from gda_tracker.parameters import ParameterError, parameter

FLUSH_PERIOD_S = 2.0

# Topic -> message and the quality it is subscribed with.
TOPICS: dict[str, tuple[type, QoSProfile]] = {
    "detections": (msg.DetectionArray, sensor(1000, "best_effort")),
    "statements": (msg.Statement, stream(1000)),
    "statement_reports": (msg.StatementReport, stream(1000)),
    "truth": (msg.ScanTruth, stream(1000)),
    "initial_tracks": (msg.TrackArray, latched(10)),
    "scans": (msg.Scan, latched(100)),
    "predictions": (msg.Predictions, latched(100)),
    "evidence": (msg.Evidence, latched(100)),
    "attribute_scores": (msg.AttributeScores, latched(100)),
    "associations": (msg.Associations, latched(100)),
    "tracks": (msg.TrackArray, stream(1000)),
    "tracks_delayed": (msg.TrackArray, stream(1000)),
    "scan_reports": (msg.ScanReport, stream(1000)),
    "/diagnostics": (DiagnosticArray, stream(100)),
}
# Topics of nodes that may run beside the ring.
TOPICS_BESIDE: dict[str, tuple[type, QoSProfile]] = {
    "track_sets": (msg.TrackSetArray, stream(1000)),
    "track_set_markers": (MarkerArray, stream(100)),
    "track_events": (msg.TrackEventArray, stream(1000)),
    "track_formations": (msg.FormationArray, stream(1000)),
}


@dataclass(frozen=True)
class RecorderParameters:
    """Where to record."""

    bag: str = parameter("gda_tracker_bag", "folder of the bag; must not exist", live=False)
    also: list[str] = parameter(
        [],
        "further topics as topic=type, e.g. tracked_objects="
        "autoware_perception_msgs/msg/TrackedObjects; their packages must be installed",
        live=False,
    )

    def __post_init__(self) -> None:
        """Refuse what is no topic and type."""
        for entry in self.also:
            topic, _, kind = entry.partition("=")
            if not topic or kind.count("/") != 2:
                raise ParameterError(
                    f"parameter also: {entry!r}, allowed are entries topic=package/msg/Name"
                )


class RecorderNode(RingNode):
    """Writes the bytes of every message as they came, with the time they came."""

    def __init__(self, parameters: Mapping[str, Any] | None = None, **options: Any) -> None:
        super().__init__("recorder", RecorderParameters, parameters, **options)
        self._writer: BagWriter | None = BagWriter(self.parameters.bag)
        self.create_timer(FLUSH_PERIOD_S, self._flush, clock=self._steady)

    def open_topics(self) -> None:
        """Subscribe to everything."""
        assert self._writer is not None
        for topic, (message, quality) in {**TOPICS, **TOPICS_BESIDE, **self._further()}.items():
            name = self.resolve_topic_name(topic)
            kept = quality.durability == DurabilityPolicy.TRANSIENT_LOCAL
            type_name = f"{message.__module__.split('.')[0]}/msg/{message.__name__}"
            self._writer.add_topic(
                BagTopic(name, type_name, depth=1 if kept else 100, transient_local=kept)
            )
            self.subscribe(
                message, topic, lambda data, name=name: self._record(name, data), quality, raw=True
            )

    def _further(self) -> dict[str, tuple[type, QoSProfile]]:
        """Topics of parameter ``also`` whose type is there; the others are said and left out."""
        found = {}
        for entry in self.parameters.also:
            topic, _, kind = entry.partition("=")
            try:
                found[topic] = (message_class(kind), stream(1000))
            except (ImportError, AttributeError):
                self.counters["topics_without_type"] += 1
                self.get_logger().error(f"{topic} is not recorded: {kind} is not installed here")
        return found

    def _record(self, topic: str, data: bytes) -> None:
        if self._writer is not None:
            self._writer.write(topic, data, time.time_ns())
            self.counters[f"recorded {topic}"] += 1

    def figures(self) -> dict[str, Any]:
        """Where it records."""
        return {"bag": self.parameters.bag}

    def _flush(self) -> None:
        if self._writer is not None:
            self._writer.flush()

    def close(self) -> None:
        """Finish the bag."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None


def main(arguments: list[str] | None = None) -> int:
    """Run the node."""
    return spin_node(RecorderNode, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
