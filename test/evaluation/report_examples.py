"""Two targets and two tracks, small enough to work out by hand."""

from __future__ import annotations

import numpy as np

from gda_tracker.evidence.frames import parse_element
from gda_tracker.vocabulary.scans import Detections, ScanKey, ScanTruth
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks

FRAME = ("VS", "S", "B")
CLASSES = ("false_alarm", "fighter", "cargo")
FOCAL = np.array([parse_element(FRAME, name) for name in ("S", "B", "S&B")], dtype=np.uint32)


def scan_stamp(scan: int, run: int = 0) -> int:
    return (1000 * run + scan) * 1_000_000_000


def make_detections(scan: int, positions, run: int = 0) -> Detections:
    xy = np.asarray(positions, dtype=float).reshape(-1, 2)
    return Detections(
        "radar", scan_stamp(scan, run), np.hypot(*xy.T), np.arctan2(xy[:, 1], xy[:, 0])
    )


def make_truth(scan: int, states, sources, run: int = 0, ids=(1, 2)) -> ScanTruth:
    return ScanTruth(
        "radar",
        scan_stamp(scan, run),
        np.array(ids, dtype=np.int32),
        np.hstack([np.asarray(states, dtype=float), np.zeros((len(ids), 2))]),
        None if sources is None else np.array(sources, dtype=np.int32),
        ("fighter", "cargo"),
        run,
    )


def make_tracks(
    scan: int, positions, detection, run: int = 0, ids=(1, 2), masses=None, classes=None
) -> Tracks:
    n = len(ids)
    ids = np.array(ids, dtype=np.int64)
    mean = np.hstack([np.asarray(positions, dtype=float).reshape(n, 2), np.zeros((n, 2))])
    return Tracks(
        key=ScanKey(0, "radar", scan_stamp(scan, run)),
        track_id=ids,
        hypothesis_id=ids,
        status=np.full(n, CONFIRMED),
        mean=mean,
        covariance=np.tile(np.eye(4), (n, 1, 1)),
        frame=FRAME,
        focal=FOCAL,
        masses=np.tile([0.5, 0.5, 0.0], (n, 1)) if masses is None else np.asarray(masses),
        class_names=CLASSES,
        class_probability=(
            np.tile([0.0, 0.5, 0.5], (n, 1)) if classes is None else np.asarray(classes)
        ),
        detection_index=np.array(detection, dtype=np.int32),
    )


def swapping_run(run: int = 0, ids=(1, 2)):
    """Four scans: targets at y = 0 and y = 100 m; the tracks swap after the second scan.

    Scan 2 (from 0) has one false alarm, taken by track 2 instead of the detection of target 1.
    """
    detections, truth, tracks = [], [], []
    for scan in range(4):
        x = 1000.0 + 100.0 * scan
        places = [[x, 0.0], [x, 100.0]]
        swapped = scan >= 2
        extra = [[x, 50.0]] if scan == 2 else []
        detections.append(make_detections(scan, places + extra, run))
        truth.append(make_truth(scan, places, [1, 2, -1][: 2 + len(extra)], run))
        taken = [1, 2 if scan == 2 else 0] if swapped else [0, 1]
        tracks.append(make_tracks(scan, places[::-1] if swapped else places, taken, run, ids))
    return detections, truth, tracks
