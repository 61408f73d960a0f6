"""Listens to a running ring for the page, and asks its nodes for their parameters.

It only listens, and with best effort: no node of the ring waits for it or sends anything twice. A
scan of which messages were lost is shown with what has come.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Any

from gda_tracker_msgs import msg
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python

from gda_tracker.formations.found import Formations
from gda_tracker.io.formation_messages import formations_from_message
from gda_tracker.io.messages import (
    MessageError,
    associations_from_message,
    attribute_scores_from_message,
    evidence_from_message,
    predictions_from_message,
    scan_from_message,
    scan_report_from_message,
    tracks_from_message,
)
from gda_tracker.nodes.qualities import sensor
from gda_tracker.nodes.runner import STAGES, Nodes, transport_environment, use_environment
from gda_tracker.parameters import specifications
from gda_tracker.tracking.ring import STAGE_TABLES, RingResult
from gda_tracker.view.desk import Answer, Parameters
from gda_tracker.view.history import History
from gda_tracker.view.picture import picture_of
from gda_tracker.vocabulary.scans import ScanKey, ScanReport
from gda_tracker.vocabulary.tracks import Tracks

DEPTH = 10
# Scans of which not everything has come; a ring has one open, several sources may share it.
MOST_OPEN = 20
FORMATIONS = "formations"
WAIT_FOR_REST_S = 0.25
ANSWER_TIMEOUT_S = 3.0
# Field of a ring's result, its topic, its message, and how that is read.
PARTS: tuple[tuple[str, str, type, Any], ...] = (
    ("scan", "scans", msg.Scan, scan_from_message),
    ("predictions", "predictions", msg.Predictions, predictions_from_message),
    ("evidence", "evidence", msg.Evidence, evidence_from_message),
    ("scores", "attribute_scores", msg.AttributeScores, attribute_scores_from_message),
    ("associations", "associations", msg.Associations, associations_from_message),
    ("tracks", "tracks", msg.TrackArray, tracks_from_message),
)


class Joiner:
    """Puts the messages of each scan together by their key, whatever the order they come in.

    A scan is complete when all parts and its report are there; or, with what is there, when
    ``wait_s`` have passed since its report, or when too many wait.
    """

    def __init__(self, wait_s: float = WAIT_FOR_REST_S) -> None:
        self._wait_s = wait_s
        # Whether a scan is complete with its formations alone.
        self.with_formations = False
        self._open: dict[ScanKey, tuple[dict[str, Any], float]] = {}
        self._given: dict[ScanKey, None] = {}

    def take(self, name: str, key: ScanKey, part: Any, now: float) -> list[RingResult]:
        """Take a part, or the report; return the scans that are complete now, in their order."""
        key = ScanKey(*key)
        if key in self._given:
            return []  # sent again
        parts, _ = self._open.setdefault(key, ({}, now))
        parts[name] = part
        if name == "report":
            self._open[key] = (parts, now)
        return self.due(now)

    def due(self, now: float) -> list[RingResult]:
        """Return the scans that wait no longer, in the order of their keys."""
        found = []
        for key in sorted(self._open):
            parts, since = self._open[key]
            followed = FORMATIONS in parts
            complete = len(parts) - followed == len(PARTS) + 1
            complete = complete and (followed or not self.with_formations)
            late = "report" in parts and now - since >= self._wait_s
            crowded = len(self._open) > MOST_OPEN
            if not (complete or late or crowded):
                continue
            del self._open[key]
            self._given[key] = None
            while len(self._given) > 5 * MOST_OPEN:
                del self._given[next(iter(self._given))]
            if "tracks" in parts:
                parts.setdefault("report", ScanReport(key, "tracked"))
                parts.pop(FORMATIONS, None)
                found.append(RingResult(**parts))
        return found


class ViewNode(Node):
    """Subscribes to what goes round the ring and keeps pictures of it in a history."""

    def __init__(self, history: History, **options: Any) -> None:
        super().__init__("view", **options)
        self.history = history
        self.heard = False
        self._joiner = Joiner()
        self._previous: Tracks | None = None
        for name, topic, message, read in PARTS:
            self.create_subscription(
                message,
                topic,
                lambda data, name=name, read=read: self._on_part(name, read, data),
                sensor(DEPTH, "best_effort"),
            )
        self.create_subscription(
            msg.ScanReport, "scan_reports", self._on_report, sensor(DEPTH, "best_effort")
        )
        self._formations: dict[ScanKey, Formations] = {}
        self.create_subscription(
            msg.FormationArray,
            "track_formations",
            self._on_formations,
            sensor(DEPTH, "best_effort"),
        )
        self.create_timer(WAIT_FOR_REST_S, self._look_after)
        self.clients_of: dict[str, tuple[Any, Any]] = {
            stage: (
                self.create_client(GetParameters, f"{stage}/get_parameters"),
                self.create_client(SetParametersAtomically, f"{stage}/set_parameters_atomically"),
            )
            for stage in STAGES
        }

    def autostart(self) -> None:
        """Be ready at once: it has no life cycle."""

    def _look_after(self) -> None:
        # Whoever follows formations may come and go.
        self._joiner.with_formations = self.count_publishers("track_formations") > 0
        self._show(self._joiner.due(self._now()))

    def _now(self) -> float:
        return self.get_clock().now().nanoseconds * 1e-9

    def _on_part(self, name: str, read: Any, message: Any) -> None:
        try:
            part = read(message)
        except MessageError as error:
            self.history.notice(f"a message of {name} cannot be read: {error}")
            return
        self._show(self._joiner.take(name, part.key, part, self._now()))

    def _on_formations(self, message: Any) -> None:
        try:
            found = formations_from_message(message)
        except MessageError as error:
            self.history.notice(f"a message of track_formations cannot be read: {error}")
            return
        self._formations[found.key] = found
        while len(self._formations) > MOST_OPEN:
            del self._formations[next(iter(self._formations))]
        self._show(self._joiner.take(FORMATIONS, found.key, found, self._now()))

    def _on_report(self, message: Any) -> None:
        report = scan_report_from_message(message)
        if report.outcome == "rejected":
            self.history.notice(
                f"scan of {report.key.sensor_id} at {report.key.stamp_ns} ns was rejected: "
                f"{report.reason}"
            )
        elif report.outcome != "initialised" and not report.repeated:
            self._show(self._joiner.take("report", report.key, report, self._now()))

    def _show(self, results: list[RingResult]) -> None:
        for result in results:
            picture = picture_of(result, self._previous)
            self._previous = result.tracks
            if picture is not None:
                self.heard = True
                picture.formations = self._formations.get(ScanKey(*picture.report.key))
                self.history.add(picture)


class ViewBridge:
    """A running ring as the page sees it: a source of pictures and a desk of parameters.

    Parameters
    ----------
    history
        Where the pictures go.
    namespace
        Namespace of the ring's nodes and topics.
    domain
        ROS domain, by default that of the environment.
    """

    def __init__(self, history: History, namespace: str = "", domain: int | None = None) -> None:
        use_environment(transport_environment())
        self._namespace = f"/{namespace.strip('/')}"
        remap = ["--ros-args", "-r", f"__ns:={self._namespace}"] if namespace else None
        self._nodes = Nodes(
            lambda **options: [ViewNode(history, **options)], domain, arguments=remap
        )
        self._node: ViewNode = self._nodes.nodes[0]
        self._closing = threading.Event()
        # One change at a time: a second one shall see what the first has brought about.
        self._changing = threading.Lock()
        self._thread = threading.Thread(target=self._run, name="view_bridge", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop listening."""
        self._closing.set()
        self._thread.join()

    def status(self) -> dict[str, Any]:
        """What the page shows of the source, as :meth:`Player.status`."""
        return {
            "mode": "live",
            "source": f"{self._namespace} in ROS domain {self._nodes.context.get_domain_id()}",
            "playing": True,
            "finished": False,
            "total": 0,
            "error": "" if self._node.heard else "waiting for tracks: is a ring running?",
        }

    def values(self) -> Parameters:
        """Values by node and name; a node that does not answer is missing."""
        with self._changing:
            pending = {}
            for stage, (client, _) in self._node.clients_of.items():
                if client.service_is_ready():
                    names = list(specifications(STAGE_TABLES[stage]))
                    request = GetParameters.Request(names=names)
                    pending[stage] = (names, self._ask(client, request))
            found: dict[str, Mapping[str, Any]] = {}
            for stage, (names, answer) in pending.items():
                response = answer()
                if response is not None:
                    found[stage] = dict(zip(names, _read(stage, response.values), strict=True))
            return found

    def change(self, node: str, values: Mapping[str, Any]) -> Answer:
        """Ask a node to change parameters, all or none."""
        with self._changing:
            client = self._node.clients_of[node][1]
            if not client.service_is_ready():
                return Answer(False, f"node {node} is not there")
            parameters: list[ParameterMessage] = [
                Parameter(name, value=value).to_parameter_msg() for name, value in values.items()
            ]
            response = self._ask(client, SetParametersAtomically.Request(parameters=parameters))()
            if response is None:
                return Answer(False, f"node {node} did not answer in {ANSWER_TIMEOUT_S:g} s")
            return Answer(bool(response.result.successful), str(response.result.reason))

    def _ask(self, client: Any, request: Any) -> Any:
        """Send a request; return what waits for the response, ``None`` when it is too late."""
        done = threading.Event()
        future = client.call_async(request)
        future.add_done_callback(lambda _: done.set())

        def answer() -> Any:
            if done.wait(ANSWER_TIMEOUT_S):
                return future.result()
            client.remove_pending_request(future)
            return None

        return answer

    def _run(self) -> None:
        with self._nodes:
            try:
                self._nodes.spin_until(self._closing.is_set)
            except ExternalShutdownException:
                return


def _read(stage: str, values: Any) -> list[Any]:
    """Values of parameters, an empty list where a list has come as nothing."""
    known = list(specifications(STAGE_TABLES[stage]).values())
    read = [parameter_value_to_python(value) for value in values]
    return [
        list(value or []) if item.is_list else value
        for item, value in zip(known, read, strict=True)
    ]
