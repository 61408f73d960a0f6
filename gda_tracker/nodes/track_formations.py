"""Node ``track_formations``: how many objects fly in each group of tracks, splits and mergers.

It listens to ``scans``, ``predictions`` and ``tracks``, and nothing in the ring waits for it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from gda_tracker_msgs import msg
from rclpy.lifecycle import TransitionCallbackReturn

from gda_tracker.events.detector import TracksRejected
from gda_tracker.formations.parameters import FormationParameters
from gda_tracker.formations.tracker import FormationTracker
from gda_tracker.io.formation_messages import formations_to_message
from gda_tracker.io.messages import (
    MessageError,
    predictions_from_message,
    scan_from_message,
    tracks_from_message,
)
from gda_tracker.nodes.base import STAGE_ERRORS, RingNode, spin_node
from gda_tracker.nodes.qualities import latched, stream
from gda_tracker.nodes.scan_table import Inputs, ScanTable
from gda_tracker.nodes.services import offer

# The ring sends scans and predictions latched; one that is late shall still find its tracks.
INPUT_DEPTH = 10
INPUTS = ("scans", "predictions", "tracks")


class TrackFormationsNode(RingNode):
    """``scans``, ``predictions`` and ``tracks`` in, ``track_formations`` out."""

    def __init__(self, parameters: Mapping[str, Any] | None = None, **options: Any) -> None:
        super().__init__("track_formations", FormationParameters, parameters, **options)
        self._waiting = ScanTable(INPUTS, self.counters, capacity=INPUT_DEPTH)
        self._tracker = self._new_tracker(self.parameters)
        self._formations: Any = None
        offer(self, "reset", self._reset)

    def _new_tracker(self, parameters: FormationParameters) -> FormationTracker:
        tracker = FormationTracker(parameters)
        tracker.counters = self.counters
        return tracker

    def open_topics(self) -> None:
        """Open ``track_formations``, and listen to the ring."""
        self._formations = self.advertise(msg.FormationArray, "track_formations", stream())
        for topic, kind, read, quality in (
            ("scans", msg.Scan, scan_from_message, latched(INPUT_DEPTH)),
            ("predictions", msg.Predictions, predictions_from_message, latched(INPUT_DEPTH)),
            ("tracks", msg.TrackArray, tracks_from_message, stream()),
        ):
            self.subscribe(kind, topic, self._taker(topic, read), quality)

    def _taker(self, topic: str, read: Callable[[Any], Any]) -> Callable[[Any], None]:
        def on_message(message: Any) -> None:
            try:
                part = read(message)
            except MessageError as error:
                self.drop(f"malformed_{topic}", str(error))
                return
            inputs = self._waiting.put(topic, part.key, part)
            if inputs is not None:
                self._take(inputs)

        return on_message

    def _take(self, inputs: Inputs) -> None:
        try:
            found = self._tracker.take(inputs["tracks"], inputs["scans"], inputs["predictions"])
        except TracksRejected as rejection:
            self.drop(str(rejection), rejection.detail)
            return
        except STAGE_ERRORS as error:
            # Half a step may have been taken.
            self._tracker.reset()
            self.drop("failed", f"{type(error).__name__}: {error}")
            return
        self._formations.publish(formations_to_message(found))

    def use_parameters(self, parameters: FormationParameters) -> None:
        """Take checked parameters; all formations begin anew."""
        super().use_parameters(parameters)
        self._tracker = self._new_tracker(parameters)

    def on_deactivate(self, state: Any) -> TransitionCallbackReturn:
        """Stop; what is missed meanwhile must not look like a step of the tracks."""
        self._reset()
        return super().on_deactivate(state)

    def _reset(self) -> str:
        self._tracker.reset()
        self._waiting.clear()
        return "all formations begin anew"

    def figures(self) -> dict[str, Any]:
        """Say how many formations there are."""
        return {"formations": len(self._tracker)}


def main(arguments: list[str] | None = None) -> int:
    """Run the node."""
    return spin_node(TrackFormationsNode, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
