"""Node ``track_manager``: the one door and the only state of the ring."""

from __future__ import annotations

import time
import uuid
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from gda_tracker_msgs import msg
from rclpy.event_handler import SubscriptionEventCallbacks

from gda_tracker.io.messages import (
    MessageError,
    associations_from_message,
    attribute_scores_from_message,
    detections_from_message,
    evidence_from_message,
    predictions_to_message,
    scan_report_to_message,
    scan_to_message,
    stamp_from_time,
    statement_from_message,
    statement_report_to_message,
    tracks_from_message,
)
from gda_tracker.io.track_cdr import tracks_to_cdr
from gda_tracker.nodes.base import STAGE_ERRORS, RingNode, spin_node
from gda_tracker.nodes.figures import Recent, TrackingFigures
from gda_tracker.nodes.qualities import latched, sensor, stream
from gda_tracker.nodes.state_services import offer_state_services
from gda_tracker.parameters import ParameterError
from gda_tracker.tracking import checkpoint
from gda_tracker.tracking.manager import TrackManager
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.vocabulary.scans import ScanKey, ScanReport
from gda_tracker.vocabulary.statements import StatementReport
from gda_tracker.vocabulary.tracks import Tracks

LONGEST_RETRY_S = 30.0
WATCHDOG_PERIOD_S = 0.25


class TrackManagerNode(RingNode):
    """``detections``, ``statements`` and answers in, ``scans``, ``predictions``, ``tracks`` out.

    Under ``mht`` also ``tracks_delayed``: the tracks of N scans ago with their revised past.
    """

    def __init__(self, parameters: Mapping[str, Any] | None = None, **options: Any) -> None:
        super().__init__("track_manager", TrackManagerParameters, parameters, **options)
        path = self.parameters.checkpoint_path
        self._checkpoint = Path(path).expanduser() if path else None
        self.manager = TrackManager(
            self.parameters, epoch=time.time_ns(), system_uuid=uuid.uuid4().bytes
        )
        if self._checkpoint is not None:
            try:
                found = checkpoint.load(self.manager, self._checkpoint)
            except checkpoint.CheckpointError as error:
                raise ParameterError(f"parameter checkpoint_path: {error}") from error
            if found:
                self.get_logger().info(
                    f"restored {self.manager.state.table.chosen.sum()} tracks from "
                    f"{self._checkpoint}"
                )
        self.counters = self.manager.counters
        self._answers: dict[str, Any] = {}
        self._open_messages: tuple[Any, Any] | None = None
        self._opened_at = self._retry_at = 0.0
        self._retry_period = self.parameters.retry_period_s
        self._retries = 0
        self._last_input: float | None = None
        self._sequences: dict[str, int] = {}
        self._latency = Recent()
        self._arrivals = Recent()
        self._figures = TrackingFigures()
        offer_state_services(self)

    def use_parameters(self, parameters: TrackManagerParameters) -> None:
        """Hand over new parameters; they act when the next scan opens."""
        super().use_parameters(parameters)
        self.manager.set_parameters(parameters)

    def open_topics(self) -> None:
        """Open all topics."""
        p = self.parameters
        self._scans = self.advertise(msg.Scan, "scans", latched())
        self._predictions = self.advertise(msg.Predictions, "predictions", latched())
        self._tracks = self.advertise(msg.TrackArray, "tracks", stream())
        self._delayed = self.advertise(msg.TrackArray, "tracks_delayed", stream())
        self._reports = self.advertise(msg.ScanReport, "scan_reports", stream())
        self._statement_reports = self.advertise(msg.StatementReport, "statement_reports", stream())
        for topic, message, read in (
            ("evidence", msg.Evidence, evidence_from_message),
            ("attribute_scores", msg.AttributeScores, attribute_scores_from_message),
            ("associations", msg.Associations, associations_from_message),
        ):
            self.subscribe(
                message,
                topic,
                lambda m, topic=topic, read=read: self._on_answer(topic, read, m),
                latched(),
            )
        self.subscribe(msg.TrackArray, "initial_tracks", self._on_initial_tracks, latched())
        self.subscribe(msg.Statement, "statements", self._on_statement, stream(p.statements_depth))
        self.subscribe(
            msg.DetectionArray,
            "detections",
            self._on_detections,
            sensor(p.detections_depth, p.detections_reliability),
            sent_again=True,
            event_callbacks=SubscriptionEventCallbacks(
                message_lost=self._on_lost, use_default_callbacks=False
            ),
        )
        self.create_timer(WATCHDOG_PERIOD_S, self._watch, clock=self._steady)

    # --- the door ---------------------------------------------------------------------------------

    def _on_lost(self, event: Any) -> None:
        self.counters["message_lost"] += int(event.total_count_change)

    def _on_detections(self, message: msg.DetectionArray) -> None:
        self._last_input = self.seconds()
        self._arrivals.note(self._last_input)
        try:
            detections = detections_from_message(message)
        except MessageError as error:
            self.drop("rejected_malformed", str(error))
            try:
                stamp_ns = stamp_from_time(message.header.stamp)
            except MessageError:
                stamp_ns = 0
            self._report(
                ScanReport(
                    ScanKey(self.manager.epoch, message.sensor_id, stamp_ns),
                    "rejected",
                    reason="malformed",
                    detections_received=len(message.range_m),
                )
            )
            return
        self._count_gap(detections.sensor_id, detections.sequence)
        report = self.manager.admit(detections, now=self.seconds())
        if report is None:
            self._advance()
            return
        if report.repeated:
            self._tracks.publish(tracks_to_cdr(self.manager.tracks()))
        else:
            self.get_logger().warning(
                f"scan of {report.key.sensor_id} rejected: {report.reason}",
                throttle_duration_sec=5.0,
            )
        self._report(report)

    def _on_statement(self, message: msg.Statement) -> None:
        try:
            report = self.manager.tell(statement_from_message(message))
        except MessageError as error:
            self.drop("statement_rejected_malformed", str(error))
            report = StatementReport(
                message.source, message.sequence, 0, "rejected", reason="malformed"
            )
        if report.outcome == "admitted":
            # Before the answer: what was admitted outlives the node.
            self._save()
        else:
            self.get_logger().warning(
                f"statement {report.sequence} of {report.source} rejected: {report.reason}",
                throttle_duration_sec=5.0,
            )
        self._statement_reports.publish(statement_report_to_message(report))

    def _count_gap(self, sensor_id: str, sequence: int) -> None:
        """Count scans that the source numbered and that never came."""
        last = self._sequences.get(sensor_id, 0)
        if sequence and last and sequence > last + 1:
            self.counters["sequence_gap"] += sequence - last - 1
        if sequence:
            self._sequences[sensor_id] = sequence

    def _on_initial_tracks(self, message: msg.TrackArray) -> None:
        try:
            initial = tracks_from_message(message)
        except MessageError as error:
            self.drop("malformed_initial_tracks", str(error))
            return
        report = self.manager.initialise(initial)
        if report.outcome == "initialised" and not report.repeated:
            self._forget_open()
            self._publish_delayed()
            self._save()
        self._report(report)
        self._advance()

    # --- one scan ---------------------------------------------------------------------------------

    def _advance(self) -> None:
        """Open the next scan if none is open."""
        if not self.manager.ready:
            return
        opened = self.manager.open()
        self._answers.clear()
        scan = scan_to_message(opened.scan)
        self._scans.publish(scan)  # at once: the fuzzifier needs no more
        predictions = predictions_to_message(opened.predictions)
        self._predictions.publish(predictions)
        self._open_messages = (scan, predictions)
        self._opened_at = self.seconds()
        self._retry_period = self.parameters.retry_period_s
        self._retry_at = self._opened_at + self._retry_period
        self._retries = 0

    def _send_again(self) -> None:
        assert self._open_messages is not None
        scan, predictions = self._open_messages
        self._scans.publish(scan)
        self._predictions.publish(predictions)

    def _on_answer(self, topic: str, read: Any, message: Any) -> None:
        opened = self.manager.opened
        if opened is None:
            self.counters["not_open"] += 1
            return
        try:
            answer = read(message)
        except MessageError as error:
            self.drop(f"malformed_{topic}", str(error))
            return
        if answer.key != opened.scan.key:
            self.counters["not_open"] += 1
            return
        self._answers.setdefault(topic, answer)
        associations = self._answers.get("associations")
        if associations is None:
            return
        complete = "evidence" in self._answers and "attribute_scores" in self._answers
        if not complete and not associations.degraded:
            return
        try:
            tracks, report = self.manager.close(
                self._answers.get("evidence"), self._answers.get("attribute_scores"), associations
            )
        except STAGE_ERRORS as error:
            # Inconsistent, or worse. Nothing has changed; the watchdog asks the stages again.
            self._answers.clear()
            self.drop("inconsistent_answer", f"{type(error).__name__}: {error}")
            return
        self._closed(tracks, report, opened.admitted_at)
        self._figures.note(
            opened.scan, opened.predictions, opened.table.chosen, associations, tracks
        )

    def _closed(self, tracks: Tracks, report: ScanReport, admitted_at: float) -> None:
        message = tracks_to_cdr(tracks)
        retries = self._retries
        self._forget_open()
        self._publish_delayed()
        self._save()
        self._tracks.publish(message)
        latency_s = self.seconds() - admitted_at
        self._latency.note(latency_s)
        self._report(replace(report, latency_s=latency_s, retries=retries))
        self._advance()

    def _publish_delayed(self) -> None:
        """Publish what the scan has made final; before the checkpoint, since it is told once."""
        for tracks in self.manager.delayed:
            self._delayed.publish(tracks_to_cdr(tracks))

    def start_afresh(self, dropped: list[ScanReport]) -> None:
        """Go on after the state was replaced; ``dropped`` answers the scans under way."""
        self._forget_open()
        self._sequences.clear()
        self._publish_delayed()
        self._save()
        for report in dropped:
            self._report(report)

    def _forget_open(self) -> None:
        self._open_messages = None
        self._answers.clear()

    def _save(self) -> None:
        if self._checkpoint is None:
            return
        try:
            checkpoint.save(self.manager, self._checkpoint)
        except checkpoint.CheckpointError as error:
            # A full disk must not stop the tracking; a restart then has an older state.
            self.drop("checkpoint_failed", str(error))

    def _report(self, report: ScanReport) -> None:
        self._reports.publish(scan_report_to_message(report))

    # --- the watchdog -----------------------------------------------------------------------------

    def _watch(self) -> None:
        """Send an open scan again, degrade it, or give it up, as the parameters say."""
        now, p = self.seconds(), self.parameters
        if not self.active:
            return
        if p.reorder_timeout_s:
            self.manager.release(now - p.reorder_timeout_s)
        self._advance()  # what a timeout or a parameter has released
        opened = self.manager.opened
        if opened is None or self._open_messages is None:
            return
        age = now - self._opened_at
        if p.scan_timeout_s and age >= p.scan_timeout_s:
            self.get_logger().warning("scan given up: no answer from the stages")
            self._closed(*self.manager.give_up(), opened.admitted_at)
            return
        if p.attribute_timeout_s and age >= p.attribute_timeout_s:
            settings = opened.predictions.settings
            if not settings.degraded and "attribute_scores" not in self._answers:
                opened.predictions.settings = replace(settings, degraded=True)
                self._open_messages = (
                    self._open_messages[0],
                    predictions_to_message(opened.predictions),
                )
                self._send_again()
        if now >= self._retry_at:
            self._retries += 1
            self.counters["retry"] += 1
            self._retry_period = min(2.0 * self._retry_period, LONGEST_RETRY_S)
            self._retry_at = now + self._retry_period
            missing = {"evidence", "attribute_scores", "associations"} - set(self._answers)
            self.get_logger().warning(
                f"open scan is {age:.1f} s old, no {', '.join(sorted(missing))}; sent again",
                throttle_duration_sec=5.0,
            )
            self._send_again()

    # --- diagnostics ------------------------------------------------------------------------------

    def health(self) -> tuple[int, str]:
        """Say what is wrong with the input or the ring."""
        if not self.active:
            return super().health()
        p = self.parameters
        if self.manager.opened is not None and self._retries:
            age = self.seconds() - self._opened_at
            return DiagnosticStatus.ERROR, f"a stage does not answer: open scan is {age:.0f} s old"
        if p.initiation == "labelled" and self.manager.state.initialised_from is None:
            return DiagnosticStatus.WARN, "waiting for initial_tracks"
        if self._last_input is None:
            return DiagnosticStatus.WARN, "no detections yet"
        age = self.seconds() - self._last_input
        if age > p.stale_after_s:
            return DiagnosticStatus.WARN, f"stale: last detections {age:.0f} s ago"
        if self.manager.waiting > p.queue_depth // 2:
            return (
                DiagnosticStatus.WARN,
                f"{self.manager.waiting} scans wait: they come faster than they are worked off",
            )
        problem = self._figures.problem()
        return (DiagnosticStatus.WARN, problem) if problem else (DiagnosticStatus.OK, "tracking")

    def figures(self) -> dict[str, Any]:
        """Key figures of the tracker."""
        state = self.manager.state
        rate_hz = self._arrivals.rate_hz(self.seconds())
        return {
            "tracks": int(state.table.chosen.sum()),
            "hypotheses": len(state.table),
            "scans_closed": state.scans_closed,
            "queue_length": self.manager.waiting,
            "statements_waiting": len(state.desk.waiting),
            "rate_hz": "unknown" if rate_hz is None else round(rate_hz, 2),
            **self._latency.milliseconds("latency"),
            **self._figures.values(),
            "decision": self.manager.parameters.decision,
            "attribute_term": self.manager.parameters.attribute_term,
            "input_age_s": (
                "none" if self._last_input is None else round(self.seconds() - self._last_input, 1)
            ),
        }


def main(arguments: list[str] | None = None) -> int:
    """Run the node."""
    return spin_node(TrackManagerNode, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
