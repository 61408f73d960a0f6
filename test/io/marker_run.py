"""A run of the ring with start, life and end of tracks, and layers with a viewer each."""

import dataclasses
from functools import lru_cache

import numpy as np
from marker_viewer import Viewer
from rclpy.serialization import deserialize_message
from visualization_msgs.msg import MarkerArray

from gda_tracker.formations.parameters import FormationParameters
from gda_tracker.formations.tracker import FormationTracker
from gda_tracker.io.markers import cdr
from gda_tracker.io.markers.layers import Layers
from gda_tracker.io.markers.parameters import (
    LAYERS,
    MarkerParameters,
)
from gda_tracker.parameters import from_mapping
from gda_tracker.simulation.playback import of_scenario, with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.tracking.ring import Ring


def marker_array(update, parameters):
    """What a subscriber gets of an update."""
    return deserialize_message(cdr.marker_array(update, parameters), MarkerArray)


METHOD = "mht/bayes/imm"
PER_TRACK = ("tracks", "covariances", "labels")
ALL_LIVE = set(LAYERS) - {"tracks_delayed"}


@lru_cache(maxsize=1)
def marker_results():
    """Results of the ring on the crossing targets: start, life and end of tracks."""
    scenario = load_scenario("crossing_targets")
    (play,) = of_scenario(scenario, 1, 3, METHOD)
    parameters = with_method(tracker_preset(scenario), METHOD)
    manager = {**parameters["track_manager"], "initiation": "automatic", "deletion_misses": 2}
    manager["mht_scans"] = 2
    ring = Ring({**parameters, "track_manager": manager})
    found = [ring.process(detections) for detections in play.detections]
    # Silence at the end: tracks coast and end.
    last = play.detections[-1]
    step = last.stamp_ns - play.detections[-2].stamp_ns
    none = np.zeros(0)
    for k in range(1, 4):
        empty = dataclasses.replace(
            last, stamp_ns=last.stamp_ns + k * step, range_m=none, azimuth_rad=none, rcs_m2=None,
            rcs_valid=None, sequence=last.sequence + k,
        )  # fmt: skip
        found.append(ring.process(empty))
    assert all(result.tracks is not None for result in found)
    assert len(found[-1].tracks) == 0
    return found


def table(**values):
    return from_mapping(MarkerParameters, values)


class Watched:
    """Layers with a viewer each."""

    def __init__(self, looked_at=LAYERS, **values):
        self.p, self.looked_at = table(**values), set(looked_at)
        self.layers = Layers(lambda name: name in self.looked_at and name in self.p.layers)
        self.viewers = {name: Viewer() for name in LAYERS}
        self.updates = []
        self.last = None
        self.formations = FormationTracker(
            FormationParameters(together_distance_m=5000.0, apart_distance_m=8000.0)
        )

    def _show(self, updates):
        self.updates += updates
        for update in updates:
            self.viewers[update.layer].take(marker_array(update, self.p))

    def scan(self, result):
        """Take a result in the order in which the ring publishes."""
        self._show(self.layers.take_scan(result.scan, self.p))
        self._show(self.layers.take_predictions(result.predictions, self.p))
        self._show(self.layers.take_tracks(result.tracks, self.p))
        for tracks in result.delayed:
            self._show(self.layers.take_delayed(tracks, self.p))
        self._show(self.layers.take_formations(self._found(result), self.p))

    def _found(self, result):
        """Formations after a scan; a run that begins again begins them anew."""
        key = result.tracks.key
        if self.last is not None and key.stamp_ns <= self.last.stamp_ns:
            self.formations.reset()
        if key != self.last:
            args = (result.tracks, result.scan, result.predictions)
            self.found = self.formations.take(*args)
        self.last = key
        return self.found

    def content(self):
        """All that is shown, to compare."""
        return {name: dict(viewer.shown) for name, viewer in self.viewers.items()}
