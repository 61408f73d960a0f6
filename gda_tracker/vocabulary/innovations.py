"""Which gated pairs are the detections that confirmed tracks took."""

from __future__ import annotations

import numpy as np

from gda_tracker.vocabulary.arrays import BoolArray, IntArray
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks


def taken_pairs(
    track_id: IntArray, leads: BoolArray, source_row: IntArray, tracks: Tracks
) -> BoolArray:
    """Mark the pairs (P,) of a confirmed track with the detection that it took.

    Parameters
    ----------
    track_id, leads, source_row
        (P,) the pair's track, whether its hypothesis spoke for the track before the scan, and the
        detection's row in the source's ``Detections``.
    tracks
        The tracks after the scan, by rising id.
    """
    if not len(tracks):
        return np.zeros(len(track_id), dtype=bool)
    row = np.minimum(np.searchsorted(tracks.track_id, track_id), len(tracks) - 1)
    return np.asarray(
        (tracks.track_id[row] == track_id)
        & leads
        & (tracks.status[row] == CONFIRMED)
        & (tracks.detection_index[row] == source_row),
        dtype=bool,
    )
