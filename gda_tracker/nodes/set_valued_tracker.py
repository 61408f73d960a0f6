"""Node ``set_valued_tracker``: ``detections`` in, ``track_sets`` and their ellipses out.

It needs none of the other nodes, and may run beside the ring on the same detections.
"""

from __future__ import annotations

import time
import uuid
from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from gda_tracker_msgs import msg
from rclpy.event_handler import SubscriptionEventCallbacks
from visualization_msgs.msg import MarkerArray

from gda_tracker.io.messages import (
    MessageError,
    detections_from_message,
    scan_report_to_message,
    stamp_from_time,
    track_sets_to_message,
)
from gda_tracker.io.track_set_markers import markers_of_track_sets
from gda_tracker.nodes.base import STAGE_ERRORS, RingNode, spin_node
from gda_tracker.nodes.qualities import sensor, stream
from gda_tracker.nodes.services import offer
from gda_tracker.tracking.set_valued.parameters import SetValuedParameters
from gda_tracker.tracking.set_valued.tracker import SetValuedTracker
from gda_tracker.vocabulary.scans import ScanKey, ScanReport

# Silence after which diagnostics say so.
STALE_AFTER_S = 10.0


class SetValuedTrackerNode(RingNode):
    """Tracks by sets: every association that cannot be rejected stays open.

    Nothing of its state outlives it: started again it has a new epoch and a new system identity,
    under which ids begin anew.
    """

    def __init__(self, parameters: Mapping[str, Any] | None = None, **options: Any) -> None:
        super().__init__("set_valued_tracker", SetValuedParameters, parameters, **options)
        self.tracker = SetValuedTracker(
            self.parameters, epoch=time.time_ns(), system_uuid=uuid.uuid4().bytes
        )
        self.counters = self.tracker.counters
        self._heard_at: float | None = None
        self._slowest_s = 0.0
        self._reports: Any = None
        offer(self, "reset", self._reset)

    def use_parameters(self, parameters: SetValuedParameters) -> None:
        """Take checked parameters; acts at the next scan."""
        super().use_parameters(parameters)
        self.tracker.set_parameters(parameters)

    def open_topics(self) -> None:
        """Open all topics."""
        p = self.parameters
        self._track_sets = self.advertise(msg.TrackSetArray, "track_sets", stream())
        self._markers = self.advertise(MarkerArray, "track_set_markers", stream(10))
        self._reports = None
        if p.scan_reports:
            self._reports = self.advertise(msg.ScanReport, "scan_reports", stream())
        self.subscribe(
            msg.DetectionArray,
            "detections",
            self._on_detections,
            sensor(p.detections_depth, p.detections_reliability),
            sent_again=p.scan_reports,
            event_callbacks=SubscriptionEventCallbacks(
                message_lost=self._on_lost, use_default_callbacks=False
            ),
        )

    def _on_lost(self, event: Any) -> None:
        self.counters["message_lost"] += int(event.total_count_change)

    def _on_detections(self, message: msg.DetectionArray) -> None:
        began = self._heard_at = self.seconds()
        try:
            detections = detections_from_message(message)
        except MessageError as error:
            self.drop("rejected_malformed", str(error))
            self._report(self._malformed(message), began)
            return
        try:
            sets, report = self.tracker.process(detections)
        except STAGE_ERRORS as error:
            # A number that the arithmetic cannot take: no set is worth more than the next scan.
            self.drop("failed", f"{type(error).__name__}: {error}")
            self.tracker.reset()
            key = ScanKey(self.tracker.epoch, detections.sensor_id, detections.stamp_ns)
            self._report(ScanReport(key, "rejected", "failed"), began)
            return
        if sets is None:
            self.get_logger().warning(
                f"scan of {report.key.sensor_id} rejected: {report.reason}",
                throttle_duration_sec=5.0,
            )
        else:
            self._track_sets.publish(track_sets_to_message(sets))
            if self._markers.get_subscription_count():
                self._markers.publish(markers_of_track_sets(sets, self.parameters.ellipse_scale))
        self._report(report, began)

    def _malformed(self, message: msg.DetectionArray) -> ScanReport:
        try:
            stamp_ns = stamp_from_time(message.header.stamp)
        except MessageError:
            stamp_ns = 0
        return ScanReport(
            ScanKey(self.tracker.epoch, message.sensor_id, stamp_ns),
            "rejected",
            reason="malformed",
            detections_received=len(message.range_m),
        )

    def _report(self, report: ScanReport, began: float) -> None:
        report.latency_s = self.seconds() - began
        self._slowest_s = max(self._slowest_s, report.latency_s)
        if self._reports is not None:
            self._reports.publish(scan_report_to_message(report))

    def _reset(self) -> str:
        ended = len(self.tracker.branches)
        self.tracker.reset()
        return f"{ended} sets ended"

    def health(self) -> tuple[int, str]:
        """Say whether detections come, and how many associations are open."""
        if not self.active:
            return super().health()
        if self._heard_at is None:
            return DiagnosticStatus.WARN, "no detections yet"
        age = self.seconds() - self._heard_at
        if age > STALE_AFTER_S:
            return DiagnosticStatus.WARN, f"stale: no detections for {age:.0f} s"
        return super().health()

    def figures(self) -> dict[str, Any]:
        """What lives, and what is open."""
        branches = self.tracker.branches
        confirmed = branches.select(branches.confirmed)
        return {
            "sets": len(branches),
            "sets_of_confirmed_tracks": len(confirmed),
            "confirmed_tracks": len(set(confirmed.track_id.tolist())),
            "ambiguous_sets": self.tracker.ambiguous_sets,
            "slowest_scan_ms": round(1e3 * self._slowest_s, 1),
        }


def main(arguments: list[str] | None = None) -> int:
    """Run the node."""
    return spin_node(SetValuedTrackerNode, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
