"""Listening to a radar's topic for a while, without a tracker."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.validate_topic_name import validate_topic_name

from gda_tracker.errors import UserError
from gda_tracker.io.bag_types import message_class
from gda_tracker.io.radar.frames import RadarFrame
from gda_tracker.io.radar.messages import RADAR_TYPES, frame_of_message
from gda_tracker.nodes.qualities import sensor
from gda_tracker.nodes.runner import Nodes, transport_environment, use_environment

DEPTH = 100
MOST_NAMED = 20  # topics in an error


def radar_message_class(kind: str, topic: str) -> Any:
    """Return the class of a radar's type.

    Raises
    ------
    UserError
        If it is none, or its package is not installed here.
    """
    if kind not in RADAR_TYPES:
        raise UserError(f"topic {topic}: {kind}: allowed is one of {', '.join(RADAR_TYPES)}")
    try:
        return message_class(kind)
    except ImportError as error:
        package = kind.split("/")[0]
        raise UserError(
            f"topic {topic}: {kind}: the package {package} is not installed here (on a ROS "
            f"installation: apt install ros-jazzy-{package.replace('_', '-')})"
        ) from error


def type_of_topic(node: Node, topic: str) -> str | None:
    """Return the type of a topic that somebody publishes now, ``None`` if nobody does."""
    name = node.resolve_topic_name(topic)
    kinds = {info.topic_type for info in node.get_publishers_info_by_topic(name)}
    known = [kind for kind in RADAR_TYPES if kind in kinds]
    return known[0] if known else next(iter(sorted(kinds)), None)


def listen(topic: str, wait_s: float, seconds: float) -> Iterator[RadarFrame]:
    """Return the frames that come on a topic within some seconds of the first one.

    Raises
    ------
    UserError
        If nothing comes within ``wait_s``, or the topic is not a radar's.
    """
    try:
        validate_topic_name(topic)
    except InvalidTopicNameException as error:
        raise UserError(f"{topic}: no such file, and no name that a topic can have") from error
    use_environment(transport_environment())
    received: list[Any] = []

    with Nodes(lambda **options: [_Listener("gda_tracker_inspect", **options)]) as nodes:
        node = nodes.nodes[0]
        begun = time.monotonic()
        if not nodes.spin_until(lambda: type_of_topic(node, topic) is not None, wait_s):
            raise UserError(_nothing_there(node, topic, wait_s))
        kind = type_of_topic(node, topic) or ""

        def take(message: Any) -> None:
            received.append(message)

        node.create_subscription(
            radar_message_class(kind, topic), topic, take, sensor(DEPTH, "best_effort")
        )
        left = max(wait_s - (time.monotonic() - begun), 1.0)
        if not nodes.spin_until(lambda: bool(received), left):
            raise UserError(f"topic {topic} ({kind}): no message within {wait_s:g} s")
        nodes.spin_until(lambda: False, seconds)
    return (frame_of_message(message, kind) for message in received)


class _Listener(Node):
    def autostart(self) -> None:
        """Nothing to start."""


def _nothing_there(node: Node, topic: str, wait_s: float) -> str:
    names = sorted(
        name for name, kinds in node.get_topic_names_and_types() if set(kinds) & set(RADAR_TYPES)
    )
    there = ", ".join(names[:MOST_NAMED]) or "none of a radar"
    return (
        f"no file and no topic {topic}: nobody publishes it in ROS domain "
        f"{node.context.get_domain_id()} within {wait_s:g} s; topics there: {there}"
    )
