"""Which of the sets stay: merge, tell duplicates, cap, confirm, end.

Without it three targets have more than a hundred sets after twenty scans.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

from gda_tracker.tracking.set_valued.branches import NOT_BORN, Branches
from gda_tracker.tracking.set_valued.leading import led_by_own_score, led_jointly
from gda_tracker.tracking.set_valued.parameters import EACH, JOINT, SetValuedParameters
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray

LEADING = {JOINT: led_jointly, EACH: led_by_own_score}


def thin(branches: Branches, parameters: SetValuedParameters, counters: Counter[str]) -> Branches:
    """Return the sets that stay, by track, the one that leads first; count why others went."""
    p = parameters
    keep = branches.coasted <= _longest_coast(branches, p)
    counters["sets_coasted_out"] += _gone(keep)
    branches = LEADING[p.leading_sets](branches.select(keep))
    keep = branches.score >= _best_score(branches) - p.score_margin
    counters["sets_far_below_best"] += _gone(keep)
    branches = branches.select(keep)
    before = len(branches)
    branches = merge(branches, p.merge_distance, p.merge_scans)
    counters["sets_merged"] += before - len(branches)
    branches = confirm(branches, p.confirmation_hits, p.confirmation_scans)
    keep = ~duplicates(branches, p.duplicate_scans)
    counters["sets_duplicate"] += _gone(keep)
    return cap(branches.select(keep), p, counters)


def cap(branches: Branches, parameters: SetValuedParameters, counters: Counter[str]) -> Branches:
    """Keep the first sets of each track, and so many in all."""
    keep = branches.rank() < parameters.max_sets_per_track
    counters["sets_over_track_limit"] += _gone(keep)
    branches = branches.select(keep)
    order = np.lexsort((-branches.score, branches.rank(), ~branches.confirmed))
    keep = np.zeros(len(branches), dtype=bool)
    keep[order[: parameters.max_sets]] = True
    counters["sets_over_limit"] += _gone(keep)
    return branches.select(keep)


def _gone(keep: BoolArray) -> int:
    return int(np.count_nonzero(~keep))


def _longest_coast(branches: Branches, parameters: SetValuedParameters) -> IntArray:
    return np.where(
        branches.confirmed, parameters.max_coasted_scans, parameters.tentative_max_coasted_scans
    )


def _best_score(branches: Branches) -> FloatArray:
    """Score of the set that leads each row's track; sorted by track."""
    return branches.score[np.searchsorted(branches.track_id, branches.track_id)]


def merge(branches: Branches, distance: float, scans: int) -> Branches:
    """Join sets of one track whose centroids are close or whose last detections are the same.

    Parameters
    ----------
    branches
        Sorted by track, the one that leads first, then the better score.
    distance
        Largest distance of two centroids under P + K K' of the one that comes first.
    scans
        Last scans of which the detections are compared.

    Returns
    -------
    Branches
        What comes first stays as it is, and may own what any of those joined might.
    """
    first, second = _pairs_of_tracks(branches.track_id)
    if not len(first):
        return branches
    gap = branches.sets.centroid[second] - branches.sets.centroid[first]
    own = branches.sets.matrix
    root = np.linalg.cholesky(branches.sets.covariance + own @ own.transpose(0, 2, 1))
    square = np.sum((np.linalg.inv(root)[first] @ gap[:, :, None]) ** 2, axis=(1, 2))
    last = branches.memory[:, -scans:]
    same = (last[first] == last[second]).all(axis=1)
    joins = (square < distance**2) | same
    first, second = first[joins], second[joins]
    keep = np.ones(len(branches), dtype=bool)
    may_own = branches.may_own.copy()
    # Greedy, from the first down: what has been joined joins nothing itself.
    begin = np.searchsorted(first, np.arange(len(branches) + 1))
    for row in np.unique(first):
        if keep[row]:
            taken = second[begin[row] : begin[row + 1]]
            taken = taken[keep[taken]]
            keep[taken] = False
            may_own[row] |= may_own[taken].any(axis=0)
    return replace(branches, may_own=may_own).select(keep)


def _pairs_of_tracks(track_id: IntArray) -> tuple[IntArray, IntArray]:
    """All pairs of rows i < j of one track, by rising i; sorted by track."""
    end = np.searchsorted(track_id, track_id, side="right")
    row = np.arange(len(track_id))
    count = end - row - 1
    first = np.repeat(row, count)
    return first, first + 1 + np.arange(len(first)) - np.repeat(np.cumsum(count) - count, count)


def confirm(branches: Branches, hits: int, scans: int) -> Branches:
    """Confirm the tracks of which the leading set has so many detections in the last scans."""
    seen = np.count_nonzero(branches.memory[:, -scans:] >= 0, axis=1) >= hits
    tracks = branches.track_id[(branches.rank() == 0) & seen]
    return replace(branches, confirmed=branches.confirmed | np.isin(branches.track_id, tracks))


def duplicates(branches: Branches, scans: int) -> BoolArray:
    """Which sets have had, for so many scans, the detections of a set of another track.

    One of each group is none: one that leads its track before others, then one of a confirmed
    track, then the better score. Sorted by track.
    """
    found = np.zeros(len(branches), dtype=bool)
    if not scans or len(branches) < 2:
        return found
    last = branches.memory[:, -scans:]
    rows = np.flatnonzero((last[:, -1] >= 0) & (last[:, 0] != NOT_BORN))
    if not len(rows):
        return found
    _, group = np.unique(last[rows], axis=0, return_inverse=True)
    group = group.ravel()
    rank = branches.rank()[rows]
    order = np.lexsort((-branches.score[rows], ~branches.confirmed[rows], rank > 0, group))
    ordered = group[order]
    leader = order[np.searchsorted(ordered, np.arange(group.max() + 1))]
    found[rows] = branches.track_id[rows] != branches.track_id[rows[leader[group]]]
    return found
