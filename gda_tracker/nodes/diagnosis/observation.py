"""What was seen of a live system: plain data, so that the judging needs no graph."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gda_tracker.nodes.inquirer import NodeName

NS_PER_S = 1_000_000_000


@dataclass(frozen=True)
class Endpoint:
    """A publisher or a subscription: topic, type, node and quality of service."""

    topic: str
    kind: str
    node: str
    publishes: bool
    quality: Any
    type_hash: str = ""


@dataclass(slots=True)
class Message:
    """When a message came [s, steady], what the clock said [ns], and its header."""

    arrived_s: float
    clock_ns: int
    stamp_ns: int
    frame_id: str
    sensor_id: str = ""


@dataclass(slots=True)
class Status:
    """One status of ``/diagnostics``."""

    level: int
    text: str
    values: dict[str, str]

    def count(self, name: str) -> int:
        """Return a counter, 0 where there is none."""
        text = self.values.get(name, "0")
        return int(text) if text.isdigit() else 0


@dataclass(slots=True)
class Report:
    """The answer to a scan."""

    outcome: str
    reason: str
    latency_s: float
    queue_length: int


@dataclass(slots=True)
class Observation:
    """A live system, looked at for ``seconds``.

    Attributes
    ----------
    namespace
        Of the ring that was looked at.
    namespaces
        All in which there are nodes of the tracker.
    names
        All nodes of the graph, a name as often as there are nodes of it.
    states
        Life cycle of the tracker's nodes, ``None`` where a node did not answer.
    sim_time
        Parameter ``use_sim_time`` of those that answered.
    parameters
        Parameters of the nodes that answered, ``{node: {name: value}}``.
    inputs
        Topics that the tracker reads from outside, full names.
    endpoints
        Of the topics that matter, and of all that carry a radar's type.
    heard
        Messages by topic.
    first, last
        The first and the last status of each node of the tracker.
    transforms
        Pairs of parent and child frame; ``None`` if they could not be heard.
    """

    domain: int
    namespace: str
    seconds: float
    namespaces: list[str] = field(default_factory=list)
    names: list[NodeName] = field(default_factory=list)
    states: dict[str, str | None] = field(default_factory=dict)
    sim_time: dict[str, bool] = field(default_factory=dict)
    parameters: dict[str, dict[str, Any]] = field(default_factory=dict)
    inputs: list[str] = field(default_factory=list)
    unreadable: dict[str, str] = field(default_factory=dict)
    endpoints: list[Endpoint] = field(default_factory=list)
    heard: dict[str, list[Message]] = field(default_factory=dict)
    reports: list[Report] = field(default_factory=list)
    first: dict[str, Status] = field(default_factory=dict)
    last: dict[str, Status] = field(default_factory=dict)
    clocks: int = 0
    transforms: list[tuple[str, str]] | None = None
    busy_domains: list[int] = field(default_factory=list)

    def topic(self, name: str) -> str:
        """Full name of a topic of the ring."""
        return name if name.startswith("/") else f"{self.namespace.rstrip('/')}/{name}"

    def node(self, name: str) -> str:
        """Full name of a node of the ring."""
        return f"{self.namespace.rstrip('/')}/{name}"

    def copies(self, name: str) -> int:
        """How many nodes of a name are in the ring's namespace."""
        return self.names.count(NodeName(self.namespace, name))

    def publishers(self, topic: str) -> list[Endpoint]:
        """Publishers of a topic."""
        return [e for e in self.endpoints if e.topic == topic and e.publishes]

    def subscriptions(self, topic: str) -> list[Endpoint]:
        """Subscriptions of a topic."""
        return [e for e in self.endpoints if e.topic == topic and not e.publishes]

    def rate_hz(self, topic: str) -> float | None:
        """Messages per second, ``None`` for fewer than two."""
        arrived = [message.arrived_s for message in self.heard.get(topic, [])]
        if len(arrived) < 2 or arrived[-1] <= arrived[0]:
            return None
        return (len(arrived) - 1) / (arrived[-1] - arrived[0])


def by_sensor(messages: Iterable[Message]) -> dict[str, list[Message]]:
    """Messages by sensor, in the order in which they came."""
    found: dict[str, list[Message]] = {}
    for message in messages:
        found.setdefault(message.sensor_id, []).append(message)
    return found


def offset_s(messages: list[Message]) -> float:
    """How far the clock is ahead of the stamps [s], the median."""
    return float(np.median([m.clock_ns - m.stamp_ns for m in messages]) / NS_PER_S)
