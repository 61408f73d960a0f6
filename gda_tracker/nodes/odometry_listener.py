"""Listens to the odometry of the vehicle that a radar is on."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from gda_tracker.io.bag_types import message_class
from gda_tracker.io.foreign_types import package_of
from gda_tracker.io.radar.odometry_messages import take_odometry
from gda_tracker.io.radar.parameter_groups.motion import ODOMETRY_TYPES
from gda_tracker.kinematics.odometry_buffer import OdometryBuffer
from gda_tracker.nodes.qualities import sensor

DEPTH = 100
LOOK_PERIOD_S = 0.2


class OdometryListener:
    """Keeps a buffer up to date from a node's subscription.

    It listens also while the node is inactive, and subscribes once the type of the topic is known.

    Parameters
    ----------
    node
        A node ``radar_input``; its counters take what is special, its parameters say what is meant.
    on_change
        Called after each message.
    """

    def __init__(self, node: Any, on_change: Callable[[], None]) -> None:
        self.buffer = OdometryBuffer()
        # Why nothing is listened to, or why the last message was not taken.
        self.problem = ""
        self._node, self._on_change = node, on_change
        self._subscription: Any = None
        self._timer = node.create_timer(LOOK_PERIOD_S, self._look, clock=node._steady)
        self._look()

    def _look(self) -> None:
        p = self._node.parameters
        kind = p.odometry_type or self._type_on(p.odometry_topic)
        if kind is None:
            return
        self._timer.cancel()
        try:
            message = message_class(kind)
        except ImportError:
            package = package_of(kind).replace("_", "-")
            self.problem = (
                f"odometry {p.odometry_topic} ({kind}): its package is not installed here (ROS "
                f"installation: apt install ros-jazzy-{package})"
            )
            self._node.get_logger().error(self.problem)
            return
        self.problem = f"no message on the odometry {p.odometry_topic}"
        # Best effort hears both kinds of publishers.
        self._subscription = self._node.create_subscription(
            message,
            p.odometry_topic,
            lambda m: self._take(m, kind),
            sensor(DEPTH, "best_effort"),
        )
        self._node.get_logger().info(f"reads the odometry {p.odometry_topic} ({kind})")

    def _type_on(self, topic: str) -> str | None:
        """Return the first of the types that are read and are published on a topic now.

        Without one, ``problem`` says what is there instead.
        """
        name = self._node.resolve_topic_name(topic)
        kinds = {info.topic_type for info in self._node.get_publishers_info_by_topic(name)}
        found = [kind for kind in ODOMETRY_TYPES if kind in kinds]
        if found:
            return found[0]
        self.problem = f"nobody publishes the odometry {topic}"
        if kinds:
            self.problem = (
                f"odometry {topic} is of type {', '.join(sorted(kinds))}: allowed is one of "
                f"{', '.join(ODOMETRY_TYPES)}"
            )
        return None

    def _take(self, message: Any, kind: str) -> None:
        node = self._node
        self.problem = take_odometry(self.buffer, message, kind, node.parameters, node.counters)
        if self.problem:
            node.get_logger().warning(
                f"odometry is not taken: {self.problem}", throttle_duration_sec=5.0
            )
        self._on_change()

    def close(self) -> None:
        """Listen no longer."""
        self._node.destroy_timer(self._timer)
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
