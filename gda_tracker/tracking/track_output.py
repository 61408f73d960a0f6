"""From rows of the hypothesis table to tracks."""

from __future__ import annotations

import numpy as np

from gda_tracker.tracking.existence import existence_of_tracks
from gda_tracker.tracking.extended.output import extents_of_tracks
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.signal_strength import told_strengths
from gda_tracker.vocabulary.arrays import IntArray
from gda_tracker.vocabulary.scans import ScanKey
from gda_tracker.vocabulary.tracks import Tracks


def tracks_of(
    table: HypothesisTable,
    key: ScanKey,
    frame_id: str,
    system_uuid: bytes,
    deleted_track_id: IntArray,
    degraded: bool,
    signal_threshold: float,
) -> Tracks:
    """Return the tracks after a scan; ``table`` has one row for each.

    ``signal_threshold`` is that above which signals are detections.
    """
    strength, std_db, seen = told_strengths(table, signal_threshold)
    return Tracks(
        key=key,
        frame_id=frame_id,
        system_uuid=system_uuid,
        track_id=table.track_id,
        hypothesis_id=table.hypothesis_id,
        status=table.status,
        mean=table.mean,
        covariance=table.covariance,
        frame=table.frame,
        focal=table.focal,
        masses=table.masses,
        class_names=table.class_names,
        class_probability=table.class_probability,
        conflict=table.conflict,
        existence_probability=existence_of_tracks(table),
        signal_strength=strength,
        signal_strength_std_db=std_db,
        detection_probability=seen,
        hits=table.hits,
        misses=table.misses,
        coasted_scans=table.coasted_scans,
        first_detection_ns=table.first_detection_ns,
        last_detection_ns=table.last_detection_ns,
        detection_index=table.detection_index.astype(np.int32),
        deleted_track_id=deleted_track_id,
        degraded=degraded,
        **extents_of_tracks(table),
    )
