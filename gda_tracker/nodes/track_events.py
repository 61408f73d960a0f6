"""Node ``track_events``: what tracks do, e.g. leave their lane, decided by sequential tests.

It listens to ``tracks`` alone, and nothing in the ring waits for it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gda_tracker_msgs import msg
from rclpy.lifecycle import TransitionCallbackReturn

from gda_tracker.events.detector import TrackEventDetector, TracksRejected
from gda_tracker.events.parameters import EventParameters
from gda_tracker.io.context_files import read_context_file
from gda_tracker.io.event_messages import events_to_message
from gda_tracker.io.messages import MessageError, tracks_from_message
from gda_tracker.kinematics.context import Context
from gda_tracker.nodes.base import STAGE_ERRORS, RingNode, spin_node
from gda_tracker.nodes.qualities import stream
from gda_tracker.nodes.services import offer


def context_of(parameters: EventParameters) -> Context:
    """Return the lanes and plans that the parameters name.

    Raises
    ------
    ContextFileError
        If there is a file and it cannot be used.
    """
    path = parameters.context_file
    return read_context_file(path) if path else Context()


class TrackEventsNode(RingNode):
    """``tracks`` in, ``track_events`` out."""

    def __init__(self, parameters: Mapping[str, Any] | None = None, **options: Any) -> None:
        super().__init__("track_events", EventParameters, parameters, **options)
        # Of the last parameters that were checked: what is used is what was found good.
        self._context = context_of(self.parameters)
        self._detector = TrackEventDetector(self.parameters, self._context)
        self._detector.counters = self.counters
        self._events: Any = None
        offer(self, "reset", self._reset)

    def open_topics(self) -> None:
        """Open ``track_events``, and listen to ``tracks``."""
        self._events = self.advertise(msg.TrackEventArray, "track_events", stream())
        self.subscribe(msg.TrackArray, "tracks", self._on_tracks, stream())

    def _on_tracks(self, message: Any) -> None:
        try:
            tracks = tracks_from_message(message)
        except MessageError as error:
            self.drop("malformed_tracks", str(error))
            return
        try:
            events = self._detector.take(tracks)
        except TracksRejected as rejection:
            self.drop(str(rejection), rejection.detail)
            return
        except STAGE_ERRORS as error:
            # Half a step may have been taken.
            self._detector.reset()
            self.drop("failed", f"{type(error).__name__}: {error}")
            return
        if len(events):
            self._events.publish(events_to_message(events))

    def check_parameters(self, parameters: EventParameters) -> None:
        """Refuse a file of lanes and plans that cannot be used."""
        self._context = context_of(parameters)

    def use_parameters(self, parameters: EventParameters) -> None:
        """Take checked parameters, with the file as it was then; all tests begin anew."""
        super().use_parameters(parameters)
        self._detector = TrackEventDetector(parameters, self._context)
        self._detector.counters = self.counters

    def on_deactivate(self, state: Any) -> TransitionCallbackReturn:
        """Stop; what is missed meanwhile must not look like a step of the tracks."""
        self._detector.reset()
        return super().on_deactivate(state)

    def _reset(self) -> str:
        self._detector.reset()
        return "all tests begin anew"

    def figures(self) -> dict[str, Any]:
        """Say what the tracks are held against."""
        context = self._detector.context
        return {"lanes": len(context.lanes), "plans": len(context.plans)}


def main(arguments: list[str] | None = None) -> int:
    """Run the node."""
    return spin_node(TrackEventsNode, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
