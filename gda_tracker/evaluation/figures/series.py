"""Rows for pictures: where detections lie, and what each track did over the scans."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from gda_tracker.vocabulary.arrays import FloatArray, IntArray
from gda_tracker.vocabulary.scans import Detections, ScanTruth
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks

NOTHING = -2
CLUTTER = -1


def detection_positions(detections: Detections) -> FloatArray:
    """Positions (n, 2) [m] of a scan's detections in the tracking frame."""
    elevation = detections.elevation_rad
    flat = np.zeros(len(detections.range_m)) if elevation is None else elevation
    ground = detections.range_m * np.cos(flat)
    local = np.stack(
        [
            ground * np.cos(detections.azimuth_rad),
            ground * np.sin(detections.azimuth_rad),
            detections.range_m * np.sin(flat),
        ],
        axis=1,
    )
    turned = Rotation.from_quat(detections.sensor_orientation_xyzw).apply(local.reshape(-1, 3))
    return np.asarray(turned[:, :2] + detections.sensor_position_m[:2], dtype=np.float64)


@dataclass(frozen=True)
class TrackHistory:
    """One track over the scans on which it lived.

    ``scan`` (L,) counts from 0 in the sequence that was asked for; ``position_m`` (L, 2);
    ``confirmed`` (L,); ``detection`` (L,) is its row in the scan's detections, -1 for none.
    """

    track_id: int
    scan: IntArray
    position_m: FloatArray
    confirmed: np.ndarray
    detection: IntArray


def track_histories(tracks: Sequence[Tracks]) -> list[TrackHistory]:
    """Histories of all tracks, by rising id."""
    if not tracks:
        return []
    scan = np.repeat(np.arange(len(tracks)), [len(t) for t in tracks])
    ids = np.concatenate([t.track_id for t in tracks])
    position = np.concatenate([t.mean[:, :2] for t in tracks])
    confirmed = np.concatenate([t.status for t in tracks]) == CONFIRMED
    detection = np.concatenate([t.detection_index for t in tracks]).astype(np.int64)
    found = []
    for track_id in np.unique(ids):
        own = ids == track_id
        found.append(
            TrackHistory(int(track_id), scan[own], position[own], confirmed[own], detection[own])
        )
    return found


def detection_sources(history: TrackHistory, truth: Sequence[ScanTruth]) -> IntArray:
    """Whose detection (L,) a track took on each scan: a target's id, CLUTTER, or NOTHING.

    Raises
    ------
    ValueError
        If the truth of one of the scans does not name the sources of its detections.
    """
    found = np.full(len(history.scan), NOTHING, dtype=np.int64)
    for index, (scan, detection) in enumerate(zip(history.scan, history.detection, strict=True)):
        sources = truth[scan].source_id
        if sources is None:
            raise ValueError(f"the truth of scan {scan} does not name the sources of detections")
        if detection >= 0:
            found[index] = sources[detection]
    return found


def target_paths(truth: Sequence[ScanTruth]) -> dict[int, FloatArray]:
    """True positions (scans, 2) [m] of each target by rising id, NaN where unknown."""
    ids = sorted({int(i) for known in truth for i in known.target_id})
    paths = {i: np.full((len(truth), 2), np.nan) for i in ids}
    for scan, known in enumerate(truth):
        for target, state in zip(known.target_id, known.target_state, strict=True):
            paths[int(target)][scan] = state[:2]
    return paths


def target_names(truth: Sequence[ScanTruth]) -> dict[int, str]:
    """Class of each target, or "target 3" where the truth names no class, by id."""
    names: dict[int, str] = {}
    for known in truth:
        for index, target in enumerate(known.target_id.tolist()):
            label = known.target_class[index] if index < len(known.target_class) else ""
            names.setdefault(target, label or f"target {target}")
    return dict(sorted(names.items()))
