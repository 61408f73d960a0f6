"""Listens to ``/tf`` and ``/tf_static``; needs the package tf2_msgs, not tf2_ros."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from gda_tracker.io.bag_types import message_class
from gda_tracker.io.transform_messages import (
    TF_MESSAGE,
    TF_STATIC_TOPIC,
    TF_TOPIC,
    take_transforms,
)
from gda_tracker.kinematics.transform_buffer import TransformBuffer
from gda_tracker.nodes.qualities import latched, stream
from gda_tracker.parameters import ParameterError

DEPTH = 100


def transform_message() -> Any:
    """Return the class of the messages on ``/tf``.

    Raises
    ------
    ParameterError
        If its package is not installed here.
    """
    try:
        return message_class(TF_MESSAGE)
    except ImportError as error:
        raise ParameterError(
            "parameters pose_source and sensor_motion = 'tf' need the package tf2_msgs, which is "
            "not installed here (ROS installation: apt install ros-jazzy-tf2-msgs; else: make "
            "messages)"
        ) from error


class TransformListener:
    """Keeps a buffer up to date from a node's subscriptions.

    It listens also while the node is inactive: ``/tf_static`` is told only once.

    Parameters
    ----------
    node
        A :class:`~gda_tracker.nodes.base.RingNode`; its counters take what is special.
    on_change
        Called after each message.

    Raises
    ------
    ParameterError
        If the package tf2_msgs is not installed.
    """

    def __init__(self, node: Any, on_change: Callable[[], None]) -> None:
        message = transform_message()
        self.buffer = TransformBuffer()
        self._node, self._on_change = node, on_change
        self._subscriptions = [
            node.create_subscription(message, TF_TOPIC, self._on_moving, stream(DEPTH)),
            node.create_subscription(message, TF_STATIC_TOPIC, self._on_fixed, latched(DEPTH)),
        ]

    def _on_moving(self, message: Any) -> None:
        take_transforms(self.buffer, message, False, self._node.counters)
        self._on_change()

    def _on_fixed(self, message: Any) -> None:
        take_transforms(self.buffer, message, True, self._node.counters)
        self._on_change()

    def close(self) -> None:
        """Listen no longer."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
