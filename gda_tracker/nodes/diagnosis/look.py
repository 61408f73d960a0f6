"""Looking at a live system once: nodes, life cycles, parameters, endpoints, messages."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from gda_tracker_msgs import msg
from lifecycle_msgs.srv import GetState
from rcl_interfaces.srv import GetParameters
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

from gda_tracker.errors import UserError
from gda_tracker.io.parameter_files import known_tables
from gda_tracker.io.radar.parameter_groups.source import RADAR_TYPES
from gda_tracker.nodes.diagnosis.environment import busy_domains
from gda_tracker.nodes.diagnosis.observation import (
    NS_PER_S,
    Endpoint,
    Message,
    Observation,
    Report,
    Status,
)
from gda_tracker.nodes.inquirer import Inquirer, NodeName, Question
from gda_tracker.nodes.qualities import stream
from gda_tracker.nodes.runner import STAGES
from gda_tracker.nodes.topic_listener import radar_message_class
from gda_tracker.parameters import specifications

OURS = "gda_tracker"
ANSWER_TIMEOUT_S = 5.0
DETECTIONS_TYPE = "gda_tracker_msgs/msg/DetectionArray"
RING_TOPICS = ("scans", "predictions", "evidence", "attribute_scores", "associations")
OUTPUTS = ("tracks", "scan_reports")
RADAR_INPUT = "radar_input"


def observe(
    input_topic: str | None = None,
    domain: int | None = None,
    namespace: str | None = None,
    seconds: float = 5.0,
    wait_s: float = 5.0,
) -> Observation:
    """Look at what runs.

    Parameters
    ----------
    input_topic
        Topic of a radar's driver; by default the one that ``radar_input`` reads.
    domain
        ROS domain; ``None`` for that of the environment.
    namespace
        Of the tracker; by default the one in which the most of its nodes are.
    seconds
        How long to listen to topics.
    wait_s
        How long to look for the nodes.
    """
    busy = busy_domains()
    with Inquirer("gda_tracker_doctor", domain) as inquirer:
        seen = Observation(inquirer.domain, "/", seconds)
        seen.busy_domains = [d for d in busy if d != seen.domain]
        _find_nodes(inquirer, seen, namespace, wait_s)
        _ask(inquirer, seen)
        _name_inputs(seen, input_topic)
        _listen(inquirer, seen)
        seen.names = inquirer.names()
        _list_endpoints(inquirer, seen)
    return seen


def _find_nodes(
    inquirer: Inquirer, seen: Observation, namespace: str | None, wait_s: float
) -> None:
    def ring(names: Any) -> dict[str, set[str]]:
        spaces: dict[str, set[str]] = {}
        for node in names:
            if node.name in STAGES:
                spaces.setdefault(node.namespace, set()).add(node.name)
        return spaces

    wanted = None if namespace is None else "/" + namespace.strip("/")

    def complete(names: Any) -> bool:
        spaces = ring(names)
        return any(len(spaces[s]) == len(STAGES) for s in spaces if wanted in (None, s))

    inquirer.wait_for(complete, wait_s)
    seen.names = inquirer.names()
    spaces = ring(seen.names)
    seen.namespaces = sorted(spaces)
    seen.namespace = wanted or max(sorted(spaces), key=lambda s: len(spaces[s]), default="/")


def _ask(inquirer: Inquirer, seen: Observation) -> None:
    """Life cycles and parameters."""
    tables = known_tables()
    names = [name for name in tables if seen.copies(name)]
    states = [
        Question(GetState, f"{seen.node(name)}/get_state", GetState.Request()) for name in names
    ]
    wanted = {name: [*specifications(tables[name]), "use_sim_time"] for name in names}
    values = [
        Question(
            GetParameters,
            f"{seen.node(name)}/get_parameters",
            GetParameters.Request(names=wanted[name]),
        )
        for name in names
    ]
    answers = inquirer.ask([*states, *values], ANSWER_TIMEOUT_S)
    for name, state, answer in zip(
        names, answers[: len(names)], answers[len(names) :], strict=True
    ):
        seen.states[name] = None if state is None else state.current_state.label
        if answer is None or len(answer.values) != len(wanted[name]):
            continue
        found = {
            key: parameter_value_to_python(value)
            for key, value in zip(wanted[name], answer.values, strict=True)
        }
        seen.sim_time[name] = bool(found.pop("use_sim_time"))
        seen.parameters[name] = found


def _name_inputs(seen: Observation, input_topic: str | None) -> None:
    own = seen.parameters.get(RADAR_INPUT, {}).get("input_topic")
    topic = input_topic if input_topic is not None else own
    seen.inputs = [seen.topic(name) for name in (topic, "detections") if name]


def _list_endpoints(inquirer: Inquirer, seen: Observation) -> None:
    node = inquirer.node
    topics = {seen.topic(name) for name in (*RING_TOPICS, *OUTPUTS)}
    topics.update(seen.inputs)
    for name, kinds in node.get_topic_names_and_types():
        if {DETECTIONS_TYPE, *RADAR_TYPES} & set(kinds):
            topics.add(name)
    own = str(NodeName(node.get_namespace(), node.get_name()))
    for topic in sorted(topics):
        for publishes, infos in (
            (True, node.get_publishers_info_by_topic(topic)),
            (False, node.get_subscriptions_info_by_topic(topic)),
        ):
            for info in infos:
                name = str(NodeName(info.node_namespace, info.node_name))
                if name != own:
                    seen.endpoints.append(
                        Endpoint(
                            topic,
                            info.topic_type,
                            name,
                            publishes,
                            info.qos_profile,
                            str(info.topic_type_hash),
                        )
                    )


# --- messages -------------------------------------------------------------------------------------


def _listen(inquirer: Inquirer, seen: Observation) -> None:
    ear = _Ear(inquirer, seen)
    for topic in seen.inputs:
        ear.follow_input(topic)
    ear.follow(seen.topic("tracks"), msg.TrackArray, ReliabilityPolicy.RELIABLE)
    inquirer.node.create_subscription(
        msg.ScanReport, seen.topic("scan_reports"), ear.on_report, stream()
    )
    inquirer.node.create_subscription(DiagnosticArray, "/diagnostics", ear.on_diagnostics, stream())
    inquirer.node.create_subscription(
        Clock, "/clock", ear.on_clock, _quality(ReliabilityPolicy.BEST_EFFORT)
    )
    _follow_transforms(inquirer, seen)
    inquirer.spin_until(lambda: False, seen.seconds)


def _quality(reliability: Any, durability: Any = DurabilityPolicy.VOLATILE) -> QoSProfile:
    return QoSProfile(depth=200, reliability=reliability, durability=durability)


class _Ear:
    """Keeps the headers of what comes."""

    def __init__(self, inquirer: Inquirer, seen: Observation) -> None:
        self._inquirer, self._seen = inquirer, seen
        self._simulated_ns: int | None = None

    def follow_input(self, topic: str) -> None:
        """Listen to a topic of detections or of a radar, whatever it is, even best effort."""
        infos = self._inquirer.node.get_publishers_info_by_topic(topic)
        for kind in sorted({info.topic_type for info in infos}):
            if kind == DETECTIONS_TYPE:
                self.follow(topic, msg.DetectionArray, ReliabilityPolicy.BEST_EFFORT, True)
                return
            if kind in RADAR_TYPES:
                try:
                    message = radar_message_class(kind, topic)
                except UserError as error:
                    self._seen.unreadable[topic] = str(error)
                    continue
                self.follow(topic, message, ReliabilityPolicy.BEST_EFFORT)
                return

    def follow(self, topic: str, kind: Any, reliability: Any, of_sensor: bool = False) -> None:
        """Listen to a topic whose messages begin with a header."""
        heard = self._seen.heard.setdefault(topic, [])

        def take(raw: bytes) -> None:
            now = time.time_ns() if self._simulated_ns is None else self._simulated_ns
            stamp_ns, frame_id, sensor_id = header_of(raw, of_sensor)
            heard.append(Message(time.monotonic(), now, stamp_ns, frame_id, sensor_id))

        self._inquirer.node.create_subscription(kind, topic, take, _quality(reliability), raw=True)

    def on_report(self, message: Any) -> None:
        """Keep an answer."""
        self._seen.reports.append(
            Report(message.outcome, message.reason, message.latency_s, message.queue_length)
        )

    def on_clock(self, message: Any) -> None:
        """Take over the simulated time, if the tracker uses it."""
        self._seen.clocks += 1
        if any(self._seen.sim_time.values()):
            self._simulated_ns = message.clock.sec * NS_PER_S + message.clock.nanosec

    def on_diagnostics(self, message: Any) -> None:
        """Keep the first and the last status of each node of the tracker."""
        for status in message.status:
            if status.hardware_id != OURS:
                continue
            found = Status(
                status.level[0] if isinstance(status.level, bytes) else int(status.level),
                status.message,
                {item.key: item.value for item in status.values},
            )
            self._seen.first.setdefault(status.name, found)
            self._seen.last[status.name] = found


def header_of(raw: bytes, of_sensor: bool = False) -> tuple[int, str, str]:
    """Stamp [ns], frame and, if it follows, sensor of a serialised message that has a header.

    The message is not decoded: a scan of thousands of detections costs as much as an empty one.
    """
    order = "<" if raw[1] & 1 else ">"
    second, nanosecond, length = struct.unpack_from(f"{order}iII", raw, 4)
    frame = raw[16 : 16 + max(length - 1, 0)].decode("utf-8", "replace")
    sensor = ""
    if of_sensor:
        start = 4 + (12 + length + 3) // 4 * 4
        (size,) = struct.unpack_from(f"{order}I", raw, start)
        sensor = raw[start + 4 : start + 4 + max(size - 1, 0)].decode("utf-8", "replace")
    return second * NS_PER_S + nanosecond, frame, sensor


def _follow_transforms(inquirer: Inquirer, seen: Observation) -> None:
    """Listen to frames, where anybody publishes them and the package of their messages is here."""
    node = inquirer.node
    if not (node.count_publishers("/tf") or node.count_publishers("/tf_static")):
        return
    try:
        from tf2_msgs.msg import TFMessage
    except ImportError:
        return
    seen.transforms = []
    known = seen.transforms

    def take(message: Any) -> None:
        for item in message.transforms:
            pair = (item.header.frame_id.lstrip("/"), item.child_frame_id.lstrip("/"))
            if pair not in known:
                known.append(pair)

    durable = DurabilityPolicy.TRANSIENT_LOCAL
    listeners: list[tuple[str, Callable[[], QoSProfile]]] = [
        ("/tf", lambda: _quality(ReliabilityPolicy.BEST_EFFORT)),
        ("/tf_static", lambda: _quality(ReliabilityPolicy.RELIABLE, durable)),
    ]
    for topic, quality in listeners:
        node.create_subscription(TFMessage, topic, take, quality())
