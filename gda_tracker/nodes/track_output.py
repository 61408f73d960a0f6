"""Node ``track_output``: ``tracks`` in the formats of others, as far as their packages are there.

A format whose package is not installed is said in the log and in ``/diagnostics``; the others go
on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from gda_tracker_msgs import msg

from gda_tracker.io.bag_types import message_class
from gda_tracker.io.foreign_types import package_of
from gda_tracker.io.messages import MessageError, tracks_from_message
from gda_tracker.io.track_output_parameters import TrackOutputParameters
from gda_tracker.io.track_outputs import FORMATS
from gda_tracker.nodes.base import RingNode, spin_node
from gda_tracker.nodes.qualities import stream


class TrackOutputNode(RingNode):
    """``tracks`` in; ``RadarTracks``, ``Detection3DArray``, ``TrackedObjects`` out."""

    def __init__(self, parameters: Mapping[str, Any] | None = None, **options: Any) -> None:
        super().__init__("track_output", TrackOutputParameters, parameters, **options)
        self._formats: list[tuple[str, Any, Callable[..., Any]]] = []
        self._missing: list[str] = []

    def open_topics(self) -> None:
        """Open a topic for every format that is asked for and whose package is there."""
        self._formats, self._missing = [], []
        for name, (kind, convert) in FORMATS.items():
            topic = getattr(self.parameters, name)
            if not topic:
                continue
            try:
                message = message_class(kind)
            except ImportError:
                package = package_of(kind)
                self._missing.append(package)
                self.get_logger().error(
                    f"parameter {name} = {topic!r}: nothing is published, the package {package} "
                    f"is not installed here (ROS installation: apt install "
                    f"ros-jazzy-{package.replace('_', '-')}; else: make messages)"
                )
                continue
            self._formats.append((name, self.advertise(message, topic, stream()), convert))
        self.subscribe(msg.TrackArray, "tracks", self._on_tracks, stream())

    def _on_tracks(self, message: Any) -> None:
        try:
            tracks = tracks_from_message(message)
        except MessageError as error:
            self.drop("malformed_tracks", str(error))
            return
        for name, publisher, convert in self._formats:
            publisher.publish(convert(tracks, self.parameters))
            self.counters[f"published {name}"] += 1

    def health(self) -> tuple[int, str]:
        """Say what is not installed, or that no format was chosen."""
        if self._missing:
            return DiagnosticStatus.ERROR, f"not installed: {', '.join(self._missing)}"
        if self.active and not self._formats:
            return DiagnosticStatus.WARN, f"no format is chosen: {', '.join(FORMATS)}"
        return super().health()


def main(arguments: list[str] | None = None) -> int:
    """Run the node."""
    return spin_node(TrackOutputNode, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
