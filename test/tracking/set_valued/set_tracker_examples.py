"""Scans of the three crossing tracks, and trackers that suit them."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from gda_tracker.parameters import from_mapping
from gda_tracker.simulation.crossing_tracks import (
    CrossingTracks,
    set_valued_preset,
    simulate_crossing_tracks,
)
from gda_tracker.tracking.set_valued.parameters import SetValuedParameters
from gda_tracker.tracking.set_valued.tracker import SetValuedTracker
from gda_tracker.vocabulary.scans import Detections

CLEAR = CrossingTracks()
CLUTTERED = CrossingTracks(detection_probability=0.9, clutter=6.0)
# Nothing is merged, thrown out or capped.
UNTHINNED = {
    "merge_distance": 0.0,
    "merge_scans": 16,
    "duplicate_scans": 0,
    "score_margin": 1e9,
    "max_sets_per_track": 100,
    "max_sets": 10_000,
}


@lru_cache
def scans(model=CLEAR, seed=1):
    return simulate_crossing_tracks(model, seed)


def parameters(model=CLEAR, **changes):
    return from_mapping(SetValuedParameters, {**set_valued_preset(model), **changes})


def tracker_of(model=CLEAR, **changes):
    return SetValuedTracker(parameters(model, **changes), epoch=7, system_uuid=bytes(range(16)))


def outputs_of(model=CLEAR, seed=1, samples=None, **changes):
    tracker = tracker_of(model, **changes)
    found = [tracker.process(scan) for scan in scans(model, seed)[0][:samples]]
    assert all(report.outcome == "tracked" for _, report in found)
    return [sets for sets, _ in found], tracker


def scan_at(seconds, positions, sensor="radar", **further):
    x, y = np.asarray(positions, dtype=float).reshape(-1, 2).T
    return Detections(sensor, round(seconds * 1e9), np.hypot(x, y), np.arctan2(y, x), **further)
