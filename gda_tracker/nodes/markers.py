"""Node ``markers``: what the tracker does as ``visualization_msgs/MarkerArray``, layer by layer.

It only listens. Messages are read and markers made for the layers that somebody looks at.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from gda_tracker_msgs import msg
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.serialization import deserialize_message
from visualization_msgs.msg import MarkerArray

from gda_tracker.formations.labels import is_finite
from gda_tracker.io.formation_messages import formations_from_message
from gda_tracker.io.markers.cdr import marker_array
from gda_tracker.io.markers.layers import (
    OF_DELAYED,
    OF_FORMATIONS,
    OF_PREDICTIONS,
    OF_SCANS,
    OF_TRACKS,
    Layers,
    Update,
)
from gda_tracker.io.markers.parameters import LAYERS, MarkerParameters, marker_topic
from gda_tracker.io.markers.shapes import drawable
from gda_tracker.io.messages import (
    MessageError,
    predictions_from_message,
    scan_from_message,
    tracks_from_message,
)
from gda_tracker.nodes.base import STAGE_ERRORS, RingNode, spin_node
from gda_tracker.nodes.qualities import latched, stream
from gda_tracker.nodes.services import offer

OUTPUT_DEPTH = 10
# The ring sends scans and predictions latched; one that is late shall still find its tracks.
INPUT_DEPTH = 10


class MarkersNode(RingNode):
    """Scans, predictions and tracks in; a marker array per layer out."""

    def __init__(self, parameters: Mapping[str, Any] | None = None, **options: Any) -> None:
        super().__init__("markers", MarkerParameters, parameters, **options)
        self._layers = Layers(self._wanted)
        self._publishers_of: dict[str, Any] = {}
        offer(self, "reset", self._reset)

    def open_topics(self) -> None:
        """Open a topic for each layer, and listen to the ring."""
        self._publishers_of = {
            name: self.advertise(MarkerArray, marker_topic(name), stream(OUTPUT_DEPTH))
            for name in LAYERS
        }
        for topic, kind, layers, read, take, quality in (
            (
                "scans",
                msg.Scan,
                OF_SCANS,
                scan_from_message,
                Layers.take_scan,
                latched(INPUT_DEPTH),
            ),
            (
                "predictions",
                msg.Predictions,
                OF_PREDICTIONS,
                predictions_from_message,
                Layers.take_predictions,
                latched(INPUT_DEPTH),
            ),
            (
                "tracks",
                msg.TrackArray,
                OF_TRACKS,
                tracks_from_message,
                Layers.take_tracks,
                stream(),
            ),
            (
                "tracks_delayed",
                msg.TrackArray,
                OF_DELAYED,
                tracks_from_message,
                Layers.take_delayed,
                stream(),
            ),
            (
                "track_formations",
                msg.FormationArray,
                OF_FORMATIONS,
                formations_from_message,
                Layers.take_formations,
                stream(),
            ),
        ):
            # As bytes: what nobody looks at is not even read.
            self.subscribe(
                kind, topic, self._taker(topic, kind, layers, read, take), quality, raw=True
            )

    def _taker(
        self,
        topic: str,
        kind: type,
        layers: tuple[str, ...],
        read: Callable[[Any], Any],
        take: Callable[[Layers, Any, MarkerParameters], list[Update]],
    ) -> Callable[[bytes], None]:
        def on_message(data: bytes) -> None:
            if not self._layers.wants(layers):
                return
            try:
                part = read(deserialize_message(data, kind))
            except MessageError as error:
                self.drop(f"malformed_{topic}", str(error))
                return
            if self._layers.is_old(part.key):
                self.drop("older_epoch")
                return
            if kind is msg.TrackArray and not drawable(part).all():
                self.drop("not_drawn", "tracks whose state or covariance is not finite")
            if kind is msg.FormationArray and not all(map(is_finite, part.formations)):
                self.drop("not_drawn", "formations whose place or extent is not finite")
            try:
                for update in take(self._layers, part, self.parameters):
                    self._publish(update)
            except STAGE_ERRORS as error:
                self.drop("failed", f"{type(error).__name__}: {error}")

        return on_message

    def _wanted(self, name: str) -> bool:
        if name not in self.parameters.layers or name not in self._publishers_of:
            return False
        return bool(self._publishers_of[name].get_subscription_count())

    def _publish(self, update: Update) -> None:
        self._publishers_of[update.layer].publish(marker_array(update, self.parameters))
        self.counters[f"published {update.layer}"] += 1

    def use_parameters(self, parameters: MarkerParameters) -> None:
        """Take checked parameters; layers that are switched off are emptied at once."""
        super().use_parameters(parameters)
        self._empty([name for name in self._layers.shown() if name not in parameters.layers])

    def _empty(self, names: list[str]) -> None:
        for name in names:
            empty = Update(name, 0, "", anew=True)
            self._publishers_of[name].publish(marker_array(empty, self.parameters))
        self._layers.forget(names)

    def on_deactivate(self, state: Any) -> TransitionCallbackReturn:
        """Stop; nothing stays that would no longer be kept up to date."""
        self._reset()
        return super().on_deactivate(state)

    def on_cleanup(self, state: Any) -> TransitionCallbackReturn:
        """Remove the topics."""
        self._publishers_of = {}
        return super().on_cleanup(state)

    def _reset(self) -> str:
        shown = self._layers.shown()
        self._empty(shown)
        self._layers.clear()
        return f"emptied: {', '.join(shown) or 'nothing was shown'}"

    def figures(self) -> dict[str, Any]:
        """Say which layers are looked at."""
        looked_at = [name for name in LAYERS if self._wanted(name)]
        return {"looked_at": ", ".join(looked_at) or "none"}


def main(arguments: list[str] | None = None) -> int:
    """Run the node."""
    return spin_node(MarkersNode, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
