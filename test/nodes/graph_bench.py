"""A ring under test, and a client that publishes what a test wants."""

from __future__ import annotations

import os
from dataclasses import replace

from diagnostic_msgs.msg import DiagnosticArray
from gda_tracker_msgs import msg
from graph_helpers import (
    TIMEOUT_S,
)
from rclpy.node import Node

from gda_tracker.io.messages import (
    detections_to_message,
    scan_report_from_message,
    statement_report_from_message,
    statement_to_message,
    tracks_from_message,
    tracks_to_message,
)
from gda_tracker.nodes.qualities import latched, stream
from gda_tracker.nodes.runner import Nodes, stage_nodes

METHOD = "gda/dsm_classic/cv"


class Client(Node):
    """Publishes what a test wants and keeps what comes back."""

    def __init__(self, **options):
        super().__init__("client", **options)
        self.detections = self.create_publisher(msg.DetectionArray, "detections", stream())
        self.initial = self.create_publisher(msg.TrackArray, "initial_tracks", latched())
        self.statements = self.create_publisher(msg.Statement, "statements", stream())
        self.reports, self.tracks, self.diagnostics = [], {}, {}
        self.heard = []
        self.create_subscription(
            msg.StatementReport, "statement_reports", self._statement_report, stream()
        )
        self.create_subscription(msg.ScanReport, "scan_reports", self._report, stream())
        self.create_subscription(msg.TrackArray, "tracks", self._tracks, stream())
        self.create_subscription(DiagnosticArray, "/diagnostics", self._diagnose, stream())

    def autostart(self):
        """Nothing to start."""

    def _report(self, message):
        self.reports.append(scan_report_from_message(message))

    def _statement_report(self, message):
        self.heard.append(statement_report_from_message(message))

    def _tracks(self, message):
        tracks = tracks_from_message(message)
        self.tracks[(tracks.key.sensor_id, tracks.key.stamp_ns)] = tracks

    def _diagnose(self, message):
        for status in message.status:
            self.diagnostics[status.name] = status

    def value(self, node, name):
        """A value of a node's diagnostics, as text."""
        status = self.diagnostics.get(f"/{node}")
        values = {} if status is None else {v.key: v.value for v in status.values}
        return values.get(name)


class Bench:
    """A ring in one process and a client."""

    def __init__(self, domain, parameters):
        self.nodes = Nodes(
            lambda **o: [Client(**o), *stage_nodes(parameters, **o)],
            domain,
        )
        self.client = self.nodes.nodes[0]
        self.manager = self.nodes.nodes[1]

    def __enter__(self):
        self.nodes.__enter__()
        self.until(
            lambda: (
                self.client.detections.get_subscription_count() > 0
                and self.client.count_publishers("scan_reports") > 0
                and self.client.count_publishers("tracks") > 0
                and self.client.statements.get_subscription_count() > 0
                and self.client.count_publishers("statement_reports") > 0
            )
        )
        return self

    def __exit__(self, *unused):
        self.nodes.__exit__(*unused)

    def until(self, done):
        assert self.nodes.spin_until(done, TIMEOUT_S), (self.client.reports, self.manager.counters)

    def send(self, message):
        """Publish, wait for the answer, return it."""
        count = len(self.client.reports)
        if not isinstance(message, msg.DetectionArray):
            message = detections_to_message(message)
        self.client.detections.publish(message)
        self.until(lambda: len(self.client.reports) > count)
        return self.client.reports[-1]

    def say(self, message):
        """Publish a statement, wait for the answer, return it."""
        count = len(self.client.heard)
        if not isinstance(message, msg.Statement):
            message = statement_to_message(message)
        self.client.statements.publish(message)
        self.until(lambda: len(self.client.heard) > count)
        return self.client.heard[-1]

    def initialise(self, tracks):
        """Send labelled tracks and wait until they are taken."""
        tracks = replace(tracks, system_uuid=os.urandom(16))
        self.client.initial.publish(tracks_to_message(tracks))
        self.until(lambda: any(r.outcome == "initialised" for r in self.client.reports))


def spoil(detections, **changes):
    """A copy with other arrays, and a stamp half a second later so that it is a scan of its own."""
    return replace(detections, stamp_ns=detections.stamp_ns + 500_000_000, **changes)
