"""A node that says statements to a running ring and hears whether they are admitted."""

from __future__ import annotations

from typing import Any

from gda_tracker_msgs import msg
from rclpy.node import Node

from gda_tracker.io.messages import (
    scan_from_message,
    statement_report_from_message,
    statement_to_message,
)
from gda_tracker.nodes.qualities import latched, stream
from gda_tracker.vocabulary.scans import Scan
from gda_tracker.vocabulary.statements import Statement, StatementReport


class SpeakerNode(Node):
    """``statements`` out, ``statement_reports`` and ``scans`` in.

    Attributes
    ----------
    newest
        The newest scan of the ring, ``None`` until one has come.
    reports
        Answers, by source and sequence.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("speaker", **options)
        self.newest: Scan | None = None
        self.reports: dict[tuple[str, int], StatementReport] = {}
        self._statements = self.create_publisher(msg.Statement, "statements", stream())
        self.create_subscription(msg.Scan, "scans", self._on_scan, latched())
        self.create_subscription(
            msg.StatementReport, "statement_reports", self._on_report, stream()
        )

    def autostart(self) -> None:
        """Be ready at once: it has no life cycle."""

    @property
    def heard(self) -> bool:
        """Whether a track manager listens, and would be heard."""
        return (
            self._statements.get_subscription_count() > 0
            and self.count_publishers("statement_reports") > 0
        )

    def say(self, statement: Statement) -> None:
        """Publish a statement."""
        self._statements.publish(statement_to_message(statement))

    def _on_scan(self, message: Any) -> None:
        self.newest = scan_from_message(message)

    def _on_report(self, message: Any) -> None:
        report = statement_report_from_message(message)
        self.reports[(report.source, report.sequence)] = report
