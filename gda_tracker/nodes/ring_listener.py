"""Listens to a ring during a replay for what a report tells of it beyond tracks and reports."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from gda_tracker_msgs import msg
from rclpy.node import Node

from gda_tracker.evaluation.innovations import GatedScan, gated_scan
from gda_tracker.evaluation.rounds import Heard, quantiles_ms
from gda_tracker.io.messages import (
    associations_from_message,
    predictions_from_message,
    scan_from_message,
)
from gda_tracker.nodes.qualities import stream
from gda_tracker.nodes.runner import STAGES
from gda_tracker.vocabulary.scans import ScanKey, ScanReport

# A replay without a limit of speed leaves no time to a reader of few.
DEPTH = 1000
# Scans of which not everything has come; a ring has one open, the next may be heard before its end.
MOST_OPEN = 20
TOPICS: dict[str, tuple[type, Any]] = {
    "scans": (msg.Scan, scan_from_message),
    "predictions": (msg.Predictions, predictions_from_message),
    "associations": (msg.Associations, associations_from_message),
}


class RingListenerNode(Node):
    """Keeps the gated pairs of every scan, and what the stages say of their latency."""

    def __init__(self, **options: Any) -> None:
        super().__init__("gda_tracker_ring_listener", **options)
        self._gated: dict[tuple[str, int], GatedScan] = {}
        self._latency_ms: dict[str, tuple[float, float]] = {}
        self._parts: dict[ScanKey, dict[str, Any]] = {}
        self._since: set[str] = set()
        self._inputs = [
            self.create_subscription(
                kind, topic, lambda m, t=topic, r=read: self._take(t, r(m)), stream(DEPTH)
            )
            for topic, (kind, read) in TOPICS.items()
        ]
        self._inputs.append(
            self.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 100)
        )

    def autostart(self) -> None:
        """Be ready at once: it has no life cycle."""

    def forget_diagnostics(self) -> None:
        """Wait from now on for diagnostics that are newer than this."""
        self._since.clear()

    def heard_diagnostics(self) -> bool:
        """Whether every stage has been heard since :meth:`forget_diagnostics`, or since the start.

        A node whose diagnostics arrive has found all readers of this one: they were made known to
        it in order, that of the diagnostics last.
        """
        return self._since >= set(STAGES)

    def heard(self, reports: Sequence[ScanReport]) -> Heard:
        """Return all of it; a scan of which a message was lost is missing.

        Parameters
        ----------
        reports
            The answers to all scans, which tell the time from admission to tracks.
        """
        whole = [report.latency_s for report in reports if report.latency_s > 0.0]
        latency_ms = {
            stage: self._latency_ms[stage] for stage in STAGES[1:] if stage in self._latency_ms
        }
        if whole:
            latency_ms["admission to tracks"] = quantiles_ms(whole)
        return Heard(
            self._gated,
            latency_ms,
            "Four processes over DDS. Admission to tracks: over all scans, with transport and "
            "whatever else this machine did. The stages: from the last input to the answer, of "
            "the last 100 scans, as they say on /diagnostics.",
        )

    def _take(self, topic: str, part: Any) -> None:
        place = (part.key.sensor_id, part.key.stamp_ns)
        if place in self._gated:
            return  # sent again
        parts = self._parts.setdefault(part.key, {})
        parts[topic] = part
        if len(parts) == len(TOPICS):
            self._gated[place] = gated_scan(
                parts["scans"], parts["predictions"], parts["associations"]
            )
            del self._parts[part.key]
        while len(self._parts) > MOST_OPEN:
            del self._parts[next(iter(self._parts))]

    def _on_diagnostics(self, message: Any) -> None:
        for status in message.status:
            stage = status.name.rpartition("/")[2]
            values = {item.key: item.value for item in status.values}
            if stage not in STAGES:
                continue
            self._since.add(stage)
            if "latency_ms_p50" in values:
                self._latency_ms[stage] = (
                    float(values["latency_ms_p50"]),
                    float(values["latency_ms_p95"]),
                )
