"""Simulated scans, the stages by hand, and exact comparison, for the tests of the track manager."""

from __future__ import annotations

import dataclasses

import numpy as np

from gda_tracker.kinematics.gating import gate
from gda_tracker.tracking.ring import Ring
from gda_tracker.vocabulary import CONFIRMED, Detections, ScanKey, Tracks

SECOND = 1_000_000_000
UUID = bytes(range(16))
SINGLE_SCAN = {"decision": "map", "filter": "cv"}
# One motion model and decisions for good, so that what a scan does can be told by hand.
QUIET = {**SINGLE_SCAN, "range_std_m": 10.0, "azimuth_std_rad": 0.001, "max_speed_mps": 50.0}


def ring_of(**track_manager) -> Ring:
    """A ring for targets of some 10 m/s with a scan each second."""
    return Ring({"track_manager": {**QUIET, **track_manager}})


def scan_at(stamp_s, positions, sensor_id="radar", rcs=2.0, **fields) -> Detections:
    """Exact detections of ``positions`` (n, 2) [m] by a sensor at the origin."""
    positions = np.asarray(positions, dtype=float).reshape(-1, 2)
    return Detections(
        sensor_id,
        round(stamp_s * SECOND),
        np.hypot(positions[:, 0], positions[:, 1]),
        np.arctan2(positions[:, 1], positions[:, 0]),
        rcs_m2=np.full(len(positions), float(rcs)),
        **fields,
    )


def moving(stamp_s, start=(3000.0, 1000.0), velocity=(10.0, -5.0)):
    """Position of a target at a time."""
    return np.array(start) + stamp_s * np.array(velocity)


def simulated(n_scans=30, n_targets=4, clutter=5, seed=1, period_s=1.0) -> list[Detections]:
    """Noisy scans of crossing targets with missed detections, clutter and unknown RCS."""
    rng = np.random.default_rng(seed)
    start = rng.uniform(1000.0, 2500.0, (n_targets, 2))
    velocity = rng.uniform(-25.0, 25.0, (n_targets, 2))
    scans = []
    for k in range(n_scans):
        seen = rng.random(n_targets) < 0.9
        position = start[seen] + k * period_s * velocity[seen]
        n = len(position) + rng.poisson(clutter)
        false = n - len(position)
        r = np.append(np.hypot(*position.T), rng.uniform(500.0, 4000.0, false))
        a = np.append(np.arctan2(position[:, 1], position[:, 0]), rng.uniform(0.0, 1.6, false))
        rcs = rng.gamma(2.0, 1.0, n)
        rcs[rng.random(n) < 0.1] = np.nan
        order = rng.permutation(n)
        scans.append(
            Detections(
                "radar",
                round((100.0 + k * period_s) * SECOND),
                (r + rng.normal(0.0, 10.0, n))[order],
                (a + rng.normal(0.0, 0.001, n))[order],
                rcs_m2=rcs[order],
            )
        )
    return scans


def initial_tracks(n=2, stamp_s=10.0, uuid=UUID, sensor_id="radar", **fields) -> Tracks:
    """Confirmed tracks with beliefs, as labelled initiation makes them."""
    ids = np.arange(1, n + 1)
    zeros = np.zeros(n, dtype=np.int64)
    start = np.array([moving(stamp_s, (3000.0 + 500.0 * i, 1000.0)) for i in range(n)])
    values = {
        "key": ScanKey(0, sensor_id, round(stamp_s * SECOND)),
        "system_uuid": uuid,
        "track_id": ids,
        "hypothesis_id": ids,
        "status": np.full(n, CONFIRMED),
        "mean": np.hstack([start.reshape(n, 2), np.tile([10.0, -5.0], (n, 1))]),
        "covariance": np.tile(np.diag([100.0, 100.0, 4.0, 4.0]), (n, 1, 1)),
        "frame": ("VS", "S", "B"),
        "focal": np.array([1, 2, 4], dtype=np.uint32),
        "masses": np.tile([0.2, 0.3, 0.5], (n, 1)),
        "class_names": ("false_alarm", "fighter", "cargo"),
        "class_probability": np.tile([0.2, 0.3, 0.5], (n, 1)),
        "conflict": np.full(n, 0.25),
        "hits": zeros + 2,
        "misses": zeros + 1,
        "coasted_scans": zeros,
        "first_detection_ns": zeros + 9 * SECOND,
        "last_detection_ns": zeros + 10 * SECOND,
        "detection_index": np.arange(n, dtype=np.int32),
    }
    return Tracks(**{**values, **fields})


def answers(ring: Ring):
    """Evidence, scores and associations for the scan that is open in the ring's manager."""
    opened = ring.manager.opened
    evidence = ring.fuzzifier(opened.scan)
    pairs = gate(opened.scan, opened.predictions)
    scores = ring.fusion(
        opened.predictions, evidence, pairs.hypothesis, pairs.detection, opened.scan.statements
    )
    return evidence, scores, ring.associate(opened.scan, opened.predictions, scores, pairs)


def assert_same(one, other, path="") -> None:
    """Compare two trees of dataclasses bit for bit, NaN equal to NaN."""
    assert type(one) is type(other), path
    if dataclasses.is_dataclass(one):
        # What does not count in a comparison, such as times, does not count here.
        for item in (item for item in dataclasses.fields(one) if item.compare):
            assert_same(getattr(one, item.name), getattr(other, item.name), f"{path}.{item.name}")
    elif isinstance(one, list | tuple):
        assert len(one) == len(other), path
        for place, pair in enumerate(zip(one, other, strict=True)):
            assert_same(*pair, f"{path}[{place}]")
    elif isinstance(one, np.ndarray):
        assert one.dtype == other.dtype, path
        assert one.shape == other.shape, path
        assert one.tobytes() == other.tobytes(), path
    else:
        assert one == other, path


def same_tracks(one: Tracks, other: Tracks) -> None:
    """Compare tracks bit for bit."""
    assert_same(one, other, "tracks")
