"""Tracks for the tests of events: made by hand, or with the errors of Kalman filters."""

from __future__ import annotations

import numpy as np

from gda_tracker.kinematics.context import FORWARD, Context, Lane, Plan
from gda_tracker.vocabulary.scans import ScanKey
from gda_tracker.vocabulary.tracks import Tracks

COVARIANCE = np.diag([4.0, 4.0, 0.25, 0.25])  # a memory of 4 s
# Samples are 12 s apart; a scan each 13 s gives one with each.
STEP_S = 13.0

LANE = Lane("fairway", np.array([[0.0, 0.0], [3000.0, 0.0]]), 40.0, 20.0, FORWARD)


def plan(track_id=1, speed=10.0):
    points = np.array([[0.0, 0.0], [2600.0 * speed / 10.0, 0.0]])
    return Plan("route", track_id, np.array([0, 260 * 10**9]), points, np.full(2, 20.0), 20.0)


CONTEXT = Context("map", (LANE,), ())


def tracks(time_s, ids, mean, *, covariance=COVARIANCE, detected=True, status=1, epoch=1):
    """Tracks of a scan; ``mean`` (N, 4)."""
    mean = np.asarray(mean, dtype=np.float64)
    mean = mean.reshape(len(ids), mean.shape[-1])
    n = len(ids)
    covariance = np.asarray(covariance, dtype=np.float64)
    if covariance.ndim == 2:
        covariance = np.tile(covariance, (n, 1, 1))
    index = np.where(np.broadcast_to(detected, (n,)), np.arange(n), -1).astype(np.int32)
    zeros = np.zeros(n, dtype=np.int64)
    return Tracks(
        key=ScanKey(epoch, "radar", round(time_s * 1e9)),
        frame_id="map",
        track_id=np.array(ids, dtype=np.int64),
        hypothesis_id=np.array(ids, dtype=np.int64),
        status=np.broadcast_to(np.asarray(status, dtype=np.int64), (n,)).copy(),
        mean=mean,
        covariance=covariance,
        masses=np.zeros((n, 0)),
        class_probability=np.zeros((n, 0)),
        conflict=np.zeros(n),
        hits=zeros + 3,
        misses=zeros,
        coasted_scans=zeros,
        first_detection_ns=zeros,
        last_detection_ns=zeros,
        detection_index=index,
    )


def walk(states, ids=(1,), **options):
    """Tracks of one target a row: ``states`` (K, 4), a scan each 13 s."""
    return [
        tracks(STEP_S * k, list(ids), np.tile(state, (len(ids), 1)), **options)
        for k, state in enumerate(np.asarray(states, dtype=np.float64))
    ]


def on_lane_then_off(kept=6, off=6, speed=10.0):
    """States of a target in the middle of the lane that then runs parallel to it outside."""
    times = STEP_S * np.arange(kept + off)
    y = np.where(np.arange(kept + off) < kept, 0.0, 60.0)
    return np.column_stack([speed * times + 100.0, y, np.full_like(y, speed), np.zeros_like(y)])


def happenings(detector, scans):
    """(kind, track, scan) of all events."""
    found = []
    for number, scan in enumerate(scans):
        found += [(e.kind, e.track_id, number) for e in detector.take(scan).events]
    return found
