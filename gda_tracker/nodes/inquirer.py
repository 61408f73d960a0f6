"""Asking the nodes of a running graph: who is there, and what their services answer."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from rclpy.node import Node

from gda_tracker.nodes.runner import Nodes, transport_environment, use_environment

# Nodes that are known are found within this; others may need a little longer.
SETTLE_S = 0.5


@dataclass(frozen=True, order=True)
class NodeName:
    """Name of a node in the graph."""

    namespace: str
    name: str

    def __str__(self) -> str:
        return f"{self.namespace.rstrip('/')}/{self.name}"


@dataclass(frozen=True)
class Question:
    """A request to a service, by its kind and full name."""

    kind: Any
    service: str
    request: Any


class _Asking(Node):
    def autostart(self) -> None:
        """Be ready at once: it has no life cycle."""


class Inquirer:
    """A node that asks; to be used in a ``with`` statement.

    Parameters
    ----------
    name
        Name of the node that asks.
    domain
        ROS domain; ``None`` for that of the environment.
    """

    def __init__(self, name: str, domain: int | None = None) -> None:
        use_environment(transport_environment())
        options = {"start_parameter_services": False, "enable_rosout": False}
        self._nodes = Nodes(lambda **o: [_Asking(name, **options, **o)], domain)
        self.node: Node = self._nodes.nodes[0]

    def __enter__(self) -> Inquirer:
        self._nodes.__enter__()
        return self

    def __exit__(self, *arguments: object) -> None:
        self._nodes.__exit__(*arguments)

    @property
    def domain(self) -> int:
        """ROS domain that is asked."""
        return int(self.node.context.get_domain_id())

    def spin_until(self, done: Callable[[], bool], timeout_s: float) -> bool:
        """Spin until ``done``; return whether it came before the time-out."""
        return bool(self._nodes.spin_until(done, timeout_s))

    def names(self) -> list[NodeName]:
        """Names of all other nodes, one entry per node: a name that is there twice stands twice."""
        found = [
            NodeName(namespace, name)
            for name, namespace in self.node.get_node_names_and_namespaces()
        ]
        own = NodeName(self.node.get_namespace(), self.node.get_name())
        if own in found:
            found.remove(own)
        return sorted(found)

    def wait_for(self, enough: Callable[[Sequence[NodeName]], bool], wait_s: float) -> bool:
        """Wait until the nodes that are found are enough, and a moment for further ones."""
        found = self.spin_until(lambda: enough(self.names()), wait_s)
        if found:
            self.spin_until(lambda: False, SETTLE_S)
        return found

    def ask(self, questions: Sequence[Question], timeout_s: float) -> list[Any]:
        """Ask all at once; return the answers in this order, ``None`` where none came in time."""
        clients = [self.node.create_client(q.kind, q.service) for q in questions]
        futures: list[Any] = [None] * len(questions)
        deadline = time.monotonic() + timeout_s

        def done() -> bool:
            for place, (question, client) in enumerate(zip(questions, clients, strict=True)):
                if futures[place] is None and client.service_is_ready():
                    futures[place] = client.call_async(question.request)
            return all(future is not None and future.done() for future in futures)

        self.spin_until(done, max(deadline - time.monotonic(), 0.0))
        answers = [
            future.result() if future is not None and future.done() else None for future in futures
        ]
        for client in clients:
            self.node.destroy_client(client)
        return answers
