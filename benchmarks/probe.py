"""A node that sends scans one at a time and measures when what comes back was published."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from gda_tracker_msgs import msg
from rclpy.node import Node

from gda_tracker.io.messages import detections_to_message, scan_report_from_message
from gda_tracker.nodes.qualities import stream
from gda_tracker.vocabulary.scans import Detections, ScanReport

MESSAGES = {
    "detections": msg.DetectionArray,
    "scans": msg.Scan,
    "evidence": msg.Evidence,
    "attribute_scores": msg.AttributeScores,
    "associations": msg.Associations,
    "tracks": msg.TrackArray,
}


RESEND_PERIOD_S = 1.0


class Probe(Node):
    """``detections`` out, ``tracks`` and ``scan_reports`` in; one scan at a time.

    Subscriptions are matched in both directions one after the other, so a first scan or its answer
    may be lost: an unanswered scan is sent again, and the last one is then answered again.

    Parameters
    ----------
    observed
        Topics whose time of publication is wanted. They are received without being unpacked, but
        even so each costs the ring some time.
    """

    def __init__(self, observed: Sequence[str] = (), **options: Any) -> None:
        super().__init__("latency_probe", **options)
        self._sequence = 0
        self._observed = tuple(observed)
        self._sent_at = 0.0
        self.round_trip_s = 0.0
        self.report: ScanReport | None = None
        self.published_ns: dict[str, int] = {}
        self._got_tracks = False
        self._message: Any = None
        self.resent = 0
        self._detections = self.create_publisher(msg.DetectionArray, "detections", stream())
        self.create_subscription(msg.TrackArray, "tracks", self._on_tracks, stream())
        self.create_subscription(msg.ScanReport, "scan_reports", self._on_report, stream())
        for topic in self._observed:
            self.create_subscription(MESSAGES[topic], topic, self._stamp(topic), stream(), raw=True)

    def autostart(self) -> None:
        """Nothing to start: sending is the caller's."""

    def resend(self) -> None:
        """Send the scan again if it has been unanswered for long; to be called now and then."""
        waiting = time.perf_counter() - self._sent_at
        if waiting > RESEND_PERIOD_S * (1 + self.resent) and not self.complete():
            self.resent += 1
            self._detections.publish(self._message)

    def matched(self) -> bool:
        """Whether the track manager and what is observed have been found."""
        return self._detections.get_subscription_count() > ("detections" in self._observed) and all(
            self.count_publishers(t) for t in ("tracks", "scan_reports", *self._observed)
        )

    def send(self, detections: Detections) -> None:
        """Send a scan; :meth:`complete` says when it has been answered."""
        self._sequence += 1
        self.report, self._got_tracks, self.resent = None, False, 0
        self.published_ns.clear()
        self._message = detections_to_message(replace(detections, sequence=self._sequence))
        self._sent_at = time.perf_counter()
        self._detections.publish(self._message)

    def complete(self) -> bool:
        """Whether tracks, report and all observed messages of the scan have come."""
        answered = self.report is not None and self._got_tracks
        return answered and len(self.published_ns) == len(self._observed)

    def _on_tracks(self, _: Any) -> None:
        self.round_trip_s = time.perf_counter() - self._sent_at
        self._got_tracks = True

    def _on_report(self, message: Any) -> None:
        self.report = scan_report_from_message(message)

    def _stamp(self, topic: str) -> Callable[[Any, Any], None]:
        def on_message(_: Any, info: Any) -> None:
            self.published_ns.setdefault(topic, info["source_timestamp"])

        return on_message
