"""What the layers show from scan to scan: trails, what is to be deleted, what begins anew.

Scans, predictions and tracks come in any order; what needs two of them waits for the other. Nothing
is made for a layer that nobody wants.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from gda_tracker.formations.found import Formations
from gda_tracker.io.markers import shapes
from gda_tracker.io.markers.formation_shapes import formation_shapes
from gda_tracker.io.markers.parameters import LAYERS, MarkerParameters
from gda_tracker.io.markers.shapes import LINE_STRIP, Shape
from gda_tracker.tracking.gates import gates_of
from gda_tracker.vocabulary.hypotheses import Predictions
from gda_tracker.vocabulary.scans import Scan, ScanKey
from gda_tracker.vocabulary.tracks import Tracks

NANOSECONDS = 1_000_000_000
# Scans whose detections stay, however long they may.
MOST_SCANS = 500
# Layers by what they are made of.
OF_SCANS = ("detections", "associations", "gates", "sensors")
OF_PREDICTIONS = ("gates",)
OF_DELAYED = ("tracks_delayed",)
OF_FORMATIONS = ("formations",)
OF_TRACKS = tuple(
    name for name in LAYERS if name not in (*OF_DELAYED, *OF_FORMATIONS, "detections", "sensors")
)

Name = tuple[str, int]


@dataclass(slots=True)
class Update:
    """What is published at once on the topic of a layer.

    ``anew``: all that was shown is deleted first; ``gone`` are the namespaces and numbers of the
    shapes to be deleted.
    """

    layer: str
    stamp_ns: int
    frame_id: str
    shapes: list[Shape] = field(default_factory=list)
    gone: list[Name] = field(default_factory=list)
    anew: bool = False


class Trails:
    """Where tracks have been, by their number, as long as they are there."""

    def __init__(self) -> None:
        self._points: dict[int, deque[tuple[float, float]]] = {}

    def clear(self) -> None:
        """Forget all."""
        self._points.clear()

    def extend(self, tracks: Tracks, p: MarkerParameters, scans: int) -> None:
        """Take the tracks after one more scan in; those that are not among them have ended."""
        kept: dict[int, deque[tuple[float, float]]] = {}
        for row in shapes.shown_rows(tracks, p).tolist():
            track_id = int(tracks.track_id[row])
            points = self._points.get(track_id, deque())
            if points.maxlen != scans:
                points = deque(points, maxlen=scans)
            x, y = tracks.mean[row, :2].tolist()
            points.append((x, y))
            kept[track_id] = points
        self._points = kept

    def lines(self, namespace: str, width: float, colour: dict[int, shapes.Colour]) -> list[Shape]:
        """Return a line for each track that has been in two places."""
        return [
            Shape(
                namespace,
                shapes.number_of(track_id),
                LINE_STRIP,
                colour[track_id],
                (width, 0.0, 0.0),
                points=np.array(points),
            )
            for track_id, points in self._points.items()
            if len(points) > 1
        ]


class Layers:
    """All layers of one tracker.

    Parameters
    ----------
    wanted
        Says of a layer, by name, whether anybody looks at it now.
    """

    def __init__(self, wanted: Callable[[str], bool]) -> None:
        self._wanted = wanted
        self._epoch = 0
        self._newest: dict[str, int] = {}
        self._scan: Scan | None = None
        self._predictions: Predictions | None = None
        self._tracks: Tracks | None = None
        self._previous: Tracks | None = None
        self._trails, self._delayed = Trails(), Trails()
        # Shown now, by layer; a layer that is missing has been shown to nobody.
        self._shown: dict[str, set[Name]] = {}
        # Detections that stay: sensor, number, stamp.
        self._kept: deque[tuple[str, int, int]] = deque()
        self._number = 0

    def wants(self, names: Iterable[str]) -> bool:
        """Whether anybody looks at one of the layers; what is not looked at is forgotten."""
        return bool([name for name in names if self._wants(name)])

    def _wants(self, name: str) -> bool:
        if self._wanted(name):
            return True
        self._shown.pop(name, None)
        if name == "trails":
            self._trails.clear()
        elif name in OF_DELAYED:
            self._delayed.clear()
        elif name == "detections":
            self._kept.clear()
        return False

    def clear(self) -> None:
        """Begin anew: whatever is published next deletes what was shown before."""
        self._newest.clear()
        self._scan = self._predictions = self._tracks = self._previous = None
        self._trails.clear()
        self._delayed.clear()
        self._kept.clear()
        self._shown.clear()

    def forget(self, names: Iterable[str]) -> None:
        """Take note that some layers were emptied."""
        for name in names:
            self._shown.pop(name, None)

    def shown(self) -> list[str]:
        """Return the layers that show something."""
        return [name for name in LAYERS if self._shown.get(name)]

    def is_old(self, key: ScanKey) -> bool:
        """Whether a message is of a track manager that was restarted since."""
        return key.epoch < self._epoch

    def _notice(self, what: str, key: ScanKey) -> None:
        """Begin anew with a new epoch, and when the time was set back."""
        if key.epoch > self._epoch or key.stamp_ns < self._newest.get(what, key.stamp_ns):
            self.clear()
            self._epoch = key.epoch
        self._newest[what] = key.stamp_ns

    def take_scan(self, scan: Scan, p: MarkerParameters) -> list[Update]:
        """Take a scan; return what is to be published."""
        self._notice("scan", scan.key)
        again = self._scan is not None and self._scan.key == scan.key
        self._scan = scan
        found = [] if again else self._of_scan(scan, p)
        return found + self._gates(p) + self._associations(p)

    def _of_scan(self, scan: Scan, p: MarkerParameters) -> list[Update]:
        found = []
        if self._wants("detections"):
            found.append(self._detections(scan, p))
        if self._wants("sensors"):
            shown = self._shown.get("sensors", set())
            others = {name for name in shown if name[0] != scan.key.sensor_id}
            found.append(self._update("sensors", scan, shapes.sensor(scan, p), others))
        return found

    def _detections(self, scan: Scan, p: MarkerParameters) -> Update:
        made = shapes.detections(scan, self._number, p)
        self._number = (self._number + 1) % shapes.LARGEST_NUMBER
        limit = scan.key.stamp_ns - round(p.detection_persistence_s * NANOSECONDS)
        own = scan.key.sensor_id

        def stays(sensor: str, stamp_ns: int) -> bool:
            if not p.detection_persistence_s:
                return sensor != own
            return stamp_ns >= limit

        self._kept = deque((k for k in self._kept if stays(k[0], k[2])), maxlen=MOST_SCANS - 1)
        others = {(sensor, number) for sensor, number, _ in self._kept}
        self._kept.extend((s.namespace, s.number, scan.key.stamp_ns) for s in made)
        return self._update("detections", scan, made, others)

    def take_predictions(self, predictions: Predictions, p: MarkerParameters) -> list[Update]:
        """Take the predictions of a scan; return what is to be published."""
        self._notice("predictions", predictions.key)
        self._predictions = predictions
        return self._gates(p)

    def _gates(self, p: MarkerParameters) -> list[Update]:
        scan, predictions = self._scan, self._predictions
        if scan is None or predictions is None or scan.key != predictions.key:
            return []
        if not self._wants("gates"):
            return []
        # The tracks of this very scan may have come before.
        before = self._tracks
        if before is not None and before.key == scan.key:
            before = self._previous
        gates = gates_of(scan, predictions, before)
        lines = [] if gates is None else shapes.gate_lines(gates, scan.sensor_position_m[:2], p)
        return [self._update("gates", scan, lines)]

    def take_tracks(self, tracks: Tracks, p: MarkerParameters) -> list[Update]:
        """Take the tracks after a scan; return what is to be published."""
        self._notice("tracks", tracks.key)
        again = self._tracks is not None and self._tracks.key == tracks.key
        if not again:
            self._previous = self._tracks
        self._tracks = tracks
        found = [
            self._update(name, tracks, make(tracks, p))
            for name, make in (
                ("tracks", shapes.track_spheres),
                ("velocities", shapes.velocity_arrows),
                ("covariances", shapes.covariance_ellipses),
                ("labels", shapes.labels),
            )
            if self._wants(name)
        ]
        if self._wants("trails") and not again:
            self._trails.extend(tracks, p, p.trail_scans)
            colour = dict(zip(tracks.track_id.tolist(), shapes.colours(tracks, p), strict=True))
            lines = self._trails.lines("trails", p.scale * p.line_width_m, colour)
            found.append(self._update("trails", tracks, lines))
        return found + self._associations(p)

    def _associations(self, p: MarkerParameters) -> list[Update]:
        scan, tracks = self._scan, self._tracks
        if scan is None or tracks is None or scan.key != tracks.key:
            return []
        if not self._wants("associations"):
            return []
        return [self._update("associations", scan, shapes.associations(scan, tracks, p))]

    def take_delayed(self, tracks: Tracks, p: MarkerParameters) -> list[Update]:
        """Take tracks as they are seen later; return what is to be published."""
        self._notice("delayed", tracks.key)
        if not self._wants("tracks_delayed"):
            return []
        self._delayed.extend(tracks, p, p.delayed_scans)
        colour = dict.fromkeys(tracks.track_id.tolist(), p.colour("delayed_colour"))
        lines = self._delayed.lines("tracks_delayed", p.scale * p.line_width_m, colour)
        return [self._update("tracks_delayed", tracks, lines)]

    def take_formations(self, found: Formations, p: MarkerParameters) -> list[Update]:
        """Take the formations after a scan; return what is to be published."""
        self._notice("formations", found.key)
        if not self._wants("formations"):
            return []
        return [self._update("formations", found, formation_shapes(found, p))]

    def _update(
        self,
        name: str,
        of: Scan | Tracks | Formations,
        made: list[Shape],
        others: Iterable[Name] = (),
    ) -> Update:
        """Return an update that shows ``made``, keeps ``others`` and deletes the rest."""
        now = {(shape.namespace, shape.number) for shape in made}
        before = self._shown.get(name)
        stay = set(others) & (before or set())
        self._shown[name] = now | stay
        return Update(
            name,
            of.key.stamp_ns,
            of.frame_id,
            made,
            sorted((before or set()) - now - stay),
            anew=before is None,
        )
