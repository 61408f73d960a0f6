"""What is wrong with nodes, topics, types and qualities of service."""

from __future__ import annotations

from collections.abc import Iterator

from rclpy.qos import QoSCompatibility, qos_check_compatible

from gda_tracker.io.radar.parameter_groups.source import RADAR_TYPES
from gda_tracker.nodes.diagnosis.findings import ERROR, NOTE, WARNING, Finding
from gda_tracker.nodes.diagnosis.look import DETECTIONS_TYPE, RADAR_INPUT
from gda_tracker.nodes.diagnosis.observation import Observation
from gda_tracker.nodes.runner import STAGES

# Topics of the ring: who publishes and who reads them.
WIRING: dict[str, tuple[str, tuple[str, ...]]] = {
    "scans": ("track_manager", ("rcs_fuzzifier", "attribute_fusion", "association")),
    "predictions": ("track_manager", ("attribute_fusion", "association")),
    "evidence": ("rcs_fuzzifier", ("attribute_fusion", "track_manager")),
    "attribute_scores": ("attribute_fusion", ("association", "track_manager")),
    "associations": ("association", ("track_manager",)),
}
ACTIVE = "active"
MOST_NAMED = 8


def graph_findings(seen: Observation) -> list[Finding]:
    """Judge the graph."""
    if not any(seen.copies(name) for name in (*STAGES, RADAR_INPUT)):
        return [_no_ring(seen), *_topics_of_others(seen), *_input_types(seen)]
    return [
        *_nodes(seen),
        *_wiring(seen),
        *_inputs(seen),
        *_input_types(seen),
        *_qualities(seen),
    ]


def _listed(names: list[str]) -> str:
    more = len(names) - MOST_NAMED
    return ", ".join(names[:MOST_NAMED]) + (f" and {more} more" if more > 0 else "")


def _no_ring(seen: Observation) -> Finding:
    others = [str(name) for name in seen.names]
    if others:
        return Finding(
            ERROR,
            "ring_missing",
            f"domain {seen.domain}",
            f"no node of the tracker in {seen.namespace}; other nodes: {_listed(others)}",
            "nobody tracks",
            "gda-tracker run --input TOPIC (or --namespace NS here, if it runs in another one)",
        )
    why = "nothing runs in this domain, or discovery does not get through"
    fix = "gda-tracker run, with the same ROS_DOMAIN_ID in every terminal"
    if seen.busy_domains:
        busy = ", ".join(map(str, seen.busy_domains[:MOST_NAMED]))
        why += f"; other processes of this host use domain {busy}, by their ports"
        fix = f"export ROS_DOMAIN_ID={seen.busy_domains[0]} (then gda-tracker doctor again)"
    return Finding(
        ERROR,
        "nothing_discovered",
        f"domain {seen.domain}",
        "no other node found",
        why,
        fix + "; over a network: ros2 multicast receive and ros2 multicast send, and "
        "ROS_STATIC_PEERS=HOST where multicast is blocked",
    )


def _topics_of_others(seen: Observation) -> Iterator[Finding]:
    for topic, kinds in _radar_topics(seen).items():
        yield Finding(
            NOTE,
            "radar_found",
            topic,
            f"carries {', '.join(kinds)}",
            "a radar's driver is there, and nobody tracks what it sees",
            f"gda-tracker run --input {topic}",
        )


def _radar_topics(seen: Observation) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for endpoint in seen.endpoints:
        if endpoint.publishes and endpoint.kind in RADAR_TYPES:
            kinds = found.setdefault(endpoint.topic, [])
            if endpoint.kind not in kinds:
                kinds.append(endpoint.kind)
    return found


# --- nodes ----------------------------------------------------------------------------------------


def _nodes(seen: Observation) -> Iterator[Finding]:
    for other in seen.namespaces:
        if other != seen.namespace:
            yield Finding(
                NOTE,
                "another_namespace",
                other,
                "has nodes of the tracker too",
                f"this report is about {seen.namespace}",
                f"gda-tracker doctor --namespace {other}",
            )
    for name in STAGES:
        if not seen.copies(name):
            yield Finding(
                ERROR,
                "node_missing",
                seen.node(name),
                "is not running",
                "the ring stands still: each scan waits for the answers of all four nodes",
                f"ros2 run gda_tracker {name} --ros-args -r __ns:={seen.namespace}, or "
                "gda-tracker run --processes, which restarts nodes that end",
            )
    for name in (*STAGES, RADAR_INPUT):
        copies, node = seen.copies(name), seen.node(name)
        if copies > 1:
            yield Finding(
                ERROR,
                "node_duplicate",
                node,
                f"is there {copies} times",
                "two nodes answer the same scans, and services and parameters reach either",
                f"ps -ef | grep -e 'gda-tracker run' -e nodes.{name}; stop one of them",
            )
            continue
        if not copies:
            continue
        state = seen.states.get(name)
        if state is None:
            yield Finding(
                ERROR,
                "node_silent",
                node,
                "does not answer its services",
                "it hangs, or its messages do not get here (transport, shared memory, firewall)",
                f"ros2 lifecycle get {node}; restart it; or all nodes with "
                "FASTDDS_DEFAULT_PROFILES_FILE=params/fastdds_udp.xml",
            )
        elif state != ACTIVE:
            steps = (
                "activate"
                if state == "inactive"
                else "configure && ros2 lifecycle set " + (f"{node} activate")
            )
            yield Finding(
                ERROR,
                "node_inactive",
                node,
                f"is {state}",
                "it ignores its inputs",
                f"ros2 lifecycle set {node} {steps}",
            )


def _running(seen: Observation, name: str) -> bool:
    """Whether a node should have its topics open."""
    return seen.copies(name) == 1 and seen.states.get(name) in (ACTIVE, "inactive")


def _wiring(seen: Observation) -> Iterator[Finding]:
    for name, (source, readers) in WIRING.items():
        topic = seen.topic(name)
        sources = [endpoint.node for endpoint in seen.publishers(topic)]
        strangers = sorted({node for node in sources if node != seen.node(source)})
        if strangers:
            yield Finding(
                ERROR,
                "foreign_publisher",
                topic,
                f"is published by {', '.join(strangers)} too",
                "what a bag of the ring or another ring publishes there spoils the open scan",
                "ros2 bag play BAG --topics /detections, or gda-tracker replay BAG",
            )
        if _running(seen, source) and seen.node(source) not in sources:
            yield _unwired(topic, seen.node(source), "publish")
        heard_by = {endpoint.node for endpoint in seen.subscriptions(topic)}
        for reader in readers:
            if _running(seen, reader) and seen.node(reader) not in heard_by:
                yield _unwired(topic, seen.node(reader), "read")


def _unwired(topic: str, node: str, verb: str) -> Finding:
    return Finding(
        ERROR,
        "topic_missing",
        topic,
        f"{node} does not {verb} it",
        "the ring is open there: the topic was renamed for this node, or discovery is incomplete",
        f"ros2 node info {node}; start it without a remapping of {topic.rsplit('/', 1)[-1]}",
    )


# --- inputs ---------------------------------------------------------------------------------------


def _inputs(seen: Observation) -> Iterator[Finding]:
    """Whether anybody publishes what is read, and anybody reads what is published."""
    detections = seen.topic("detections")
    for topic in seen.inputs:
        if seen.publishers(topic):
            continue
        if topic == detections and len(seen.inputs) > 1 and not seen.publishers(seen.inputs[0]):
            continue  # nothing goes in, so nothing can come out
        yield Finding(
            ERROR,
            "input_missing",
            topic,
            "nobody publishes it",
            "no scan comes, so there are no tracks",
            _where_else(seen, topic),
        )
    if not seen.copies("track_manager"):
        return
    readers = {endpoint.node for endpoint in seen.subscriptions(detections)}
    if _running(seen, "track_manager") and seen.node("track_manager") not in readers:
        yield _unwired(detections, seen.node("track_manager"), "read")
    for topic in seen.inputs:
        if topic != detections and seen.publishers(topic) and not seen.copies(RADAR_INPUT):
            yield Finding(
                ERROR,
                "radar_input_missing",
                topic,
                "nobody makes detections of it",
                "the track_manager reads DetectionArray alone; radar_input makes them",
                f"gda-tracker run --input {topic}",
            )


def _where_else(seen: Observation, topic: str) -> str:
    """A command, with what is published elsewhere and would fit."""
    kinds = (DETECTIONS_TYPE,) if topic == seen.topic("detections") else RADAR_TYPES
    others = sorted({e.topic for e in seen.endpoints if e.publishes and e.kind in kinds} - {topic})
    if others and topic == seen.topic("detections"):
        space = others[0].rsplit("/", 1)[0] or "/"
        return (
            f"ros2 run ... --ros-args -r {others[0]}:={topic} for the node that publishes "
            f"{_listed(others)}, or gda-tracker run --namespace {space}"
        )
    radar = sorted(_radar_topics(seen))
    if others or radar:
        return (
            f"gda-tracker run --input {(others or radar)[0]} (there are {_listed(others or radar)})"
        )
    return (
        "start the driver: nobody publishes a radar's type in this domain (with a ROS installation "
        f"ros2 topic list -t shows all topics, ros2 topic info -v {topic} this one)"
    )


def _input_types(seen: Observation) -> Iterator[Finding]:
    for topic in sorted({endpoint.topic for endpoint in seen.endpoints}):
        ends = [endpoint for endpoint in seen.endpoints if endpoint.topic == topic]
        kinds = sorted({endpoint.kind for endpoint in ends})
        if len(kinds) > 1:
            told = "; ".join(
                f"{e.node} {'publishes' if e.publishes else 'reads'} {e.kind}" for e in ends
            )
            radar = any(kind in RADAR_TYPES for kind in kinds)
            yield Finding(
                ERROR,
                "type_mismatch",
                topic,
                f"has two types: {told}",
                "publishers and subscriptions of different types never meet",
                f"rename one of the topics, and gda-tracker run --input {topic}_raw"
                if radar
                else f"ros2 topic info -v {topic}; rename one of the topics",
            )
            continue
        hashes = {endpoint.type_hash for endpoint in ends if endpoint.type_hash}
        if len(hashes) > 1:
            yield Finding(
                ERROR,
                "type_versions",
                topic,
                f"is {kinds[0]} of {len(hashes)} versions ({', '.join(e.node for e in ends)})",
                "the fields differ between the installations of the nodes",
                "build and source the same workspace for all nodes, restart them",
            )
    for topic, reason in seen.unreadable.items():
        yield Finding(
            WARNING,
            "type_unknown",
            topic,
            f"cannot be read here: {reason}",
            "radar_input needs the package too",
            reason.partition("(on a ROS installation: ")[2].rstrip(")") or "install the package",
        )


# --- quality of service ---------------------------------------------------------------------------


def _qualities(seen: Observation) -> Iterator[Finding]:
    for topic in sorted({endpoint.topic for endpoint in seen.endpoints}):
        for publisher in seen.publishers(topic):
            for reader in seen.subscriptions(topic):
                if publisher.kind != reader.kind:
                    continue
                verdict, reason = qos_check_compatible(publisher.quality, reader.quality)
                if verdict != QoSCompatibility.ERROR:
                    continue
                ours = reader.node == seen.node("track_manager")
                yield Finding(
                    ERROR,
                    "qos_mismatch",
                    topic,
                    f"{publisher.node} offers {_quality(publisher.quality)}, {reader.node} asks "
                    f"for {_quality(reader.quality)}: {_reason(reason)}",
                    "they never connect, and no message gets through",
                    _quality_fix(topic, publisher.node, reader.node, ours),
                )


def _quality(quality: object) -> str:
    words = (getattr(quality, "reliability", None), getattr(quality, "durability", None))
    return ", ".join(str(getattr(w, "name", w)).lower().replace("_", " ") for w in words)


def _reason(text: str) -> str:
    return " ".join(text.replace("ERROR:", "").split()).rstrip(";") or "incompatible"


def _quality_fix(topic: str, publisher: str, reader: str, ours: bool) -> str:
    if ours and topic.endswith("/detections"):
        return (
            "start the tracker with detections_reliability: best_effort in its parameter file, "
            f"or let {publisher} publish reliably"
        )
    override = f"qos_overrides.{topic}"
    return (
        f"ros2 run ... --ros-args -p {override}.subscription.reliability:=best_effort for "
        f"{reader}, or .publisher.reliability:=reliable for {publisher} (durability likewise)"
    )
