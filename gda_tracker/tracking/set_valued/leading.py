"""Which set speaks for its track."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from gda_tracker.tracking.set_valued.branches import Branches

# Scores for what must not be: worse than anything, and worse than sharing a detection.
SHARED, IMPOSSIBLE = -1e6, -1e9


def led_by_own_score(branches: Branches) -> Branches:
    """Let the best-scored set of each track lead, whatever the other tracks do."""
    ordered = replace(branches, leads=np.zeros(len(branches), dtype=bool)).by_track()
    return replace(ordered, leads=ordered.rank() == 0)


def led_jointly(branches: Branches) -> Branches:
    """Let lead, one per track, the sets with the largest sum of scores that share no detection.

    An assignment problem of tracks and this scan's detections: of several sets of a track with the
    same detection only the best counts, sets without one may lead several tracks. A track that has
    nothing but sets of detections that are taken leads with its best-scored one.
    """
    if not len(branches):
        return branches
    ordered = led_by_own_score(branches)
    tracks, track = np.unique(ordered.track_id, return_inverse=True)
    track = track.ravel()
    detections, column = np.unique(ordered.detection, return_inverse=True)
    column = column.ravel()
    free = ordered.detection < 0
    # Columns: detections; for each track its best set without one; its best set, shared.
    width = len(detections)
    column = np.where(free, width + track, column)
    score = np.full((len(tracks), width + 2 * len(tracks)), IMPOSSIBLE)
    np.maximum.at(score, (track, column), ordered.score)
    own = np.arange(len(tracks))
    first = np.searchsorted(ordered.track_id, tracks)
    score[own, width + len(tracks) + own] = ordered.score[first] + SHARED
    _, chosen = linear_sum_assignment(score, maximize=True)
    shared = chosen >= width + len(tracks)
    leads = column == chosen[track]
    # The best of those with the chosen detection: rows are by score within their track.
    rows = np.flatnonzero(leads)
    _, begin = np.unique(track[rows], return_index=True)
    leads = np.zeros(len(ordered), dtype=bool)
    leads[rows[begin]] = True
    leads[first[shared]] = True
    return replace(ordered, leads=leads).by_track()
