"""Tracks, predictions and scans of formations, made by hand."""

from __future__ import annotations

import numpy as np
from event_examples import tracks

from gda_tracker.vocabulary.hypotheses import AssociationSettings, Predictions
from gda_tracker.vocabulary.scans import Scan

COVARIANCE = np.diag([400.0, 400.0, 4.0, 4.0])  # a memory of 10 s
STEP_S = 4.0
NORTH = (0.0, 150.0)
NOISE = np.diag([30.0**2, 0.002**2])
DENSITY = 1e-4


def states_of(positions, velocity=NORTH):
    """States (N, 4) of tracks at positions, all with one velocity or each with its own."""
    positions = np.asarray(positions, dtype=np.float64).reshape(-1, 2)
    return np.hstack([positions, np.broadcast_to(velocity, positions.shape)])


def live(time_s, ids, mean, *, detection=None, covariance=COVARIANCE, **options):
    """Tracks after a scan; ``detection`` names the detection of each."""
    found = tracks(time_s, ids, mean, covariance=covariance, **options)
    if detection is not None:
        found.detection_index = np.asarray(detection, dtype=np.int32)
    return found


def scan_of(time_s, positions, epoch=1):
    """A scan with detections at positions."""
    positions = np.asarray(positions, dtype=np.float64).reshape(-1, 2)
    n = len(positions)
    return Scan(
        live(time_s, [], np.zeros((0, 4)), epoch=epoch).key,
        "map",
        np.zeros(3),
        np.array([0.0, 0.0, 0.0, 1.0]),
        np.arange(n, dtype=np.int32),
        np.hypot(positions[:, 0], positions[:, 1]),
        np.arctan2(positions[:, 1], positions[:, 0]),
        np.tile(NOISE, (n, 1, 1)),
        np.zeros(n),
        np.zeros(n, dtype=bool),
    )


def predictions_of(time_s, ids, mean, *, p_d=0.9, density=DENSITY, epoch=1):
    """Predictions of one hypothesis a track."""
    mean = np.asarray(mean, dtype=np.float64).reshape(len(ids), 4)
    n = len(ids)
    numbers = np.array(ids, dtype=np.int64)
    return Predictions(
        live(time_s, [], np.zeros((0, 4)), epoch=epoch).key,
        AssociationSettings(clutter_density=density),
        numbers,
        np.full(n, -1),
        numbers,
        np.full(n, p_d),
        np.arange(n + 1, dtype=np.int32),
        np.ones(n),
        np.zeros(n, dtype=np.int32),
        mean,
        np.tile(COVARIANCE, (n, 1, 1)),
    )


def flight(tracker, places, scans, *, begin=0, detected=None, ids=None, p_d=0.9):
    """Fly objects north past the tracker, each with a track; return what it tells of each scan.

    ``places`` (K, 2) at scan 0, ``detected`` (scans, K) which of them the scans see (all), ``ids``
    the tracks of the first objects (all have one).
    """
    places = np.asarray(places, dtype=np.float64).reshape(-1, 2)
    ids = list(range(1, len(places) + 1)) if ids is None else ids
    found = []
    for k in range(scans):
        time_s = STEP_S * (begin + k)
        now = states_of(places + np.array(NORTH) * time_s)
        seen = np.ones(len(places), bool) if detected is None else np.asarray(detected[k], bool)
        index = np.where(seen, np.cumsum(seen) - 1, -1)[: len(ids)]
        found.append(
            tracker.take(
                live(time_s, ids, now[: len(ids)], detection=index),
                scan_of(time_s, now[seen, :2]),
                predictions_of(time_s, ids, now[: len(ids)], p_d=p_d),
            )
        )
    return found


def events_of(found):
    """(scan, kind, formation, others) of all events."""
    return [
        (k, e.kind, e.formation_id, e.other_formation_ids)
        for k, formations in enumerate(found)
        for e in formations.events
    ]
