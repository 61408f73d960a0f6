"""Whose track is it? Confirmed tracks and known targets of each scan, matched one to one.

Every measure that needs to know which target a track follows takes it from here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from gda_tracker.vocabulary.arrays import FloatArray, IntArray
from gda_tracker.vocabulary.scans import ScanTruth
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks


@dataclass(frozen=True)
class Matches:
    """Matches of a run of K scans.

    ``stamp_ns`` (K,) are the times of the scans. Known target positions (S,): ``sample_scan`` and
    ``sample_target``, the target's id. Matched ones (M,), in the order of the scans: ``scan``,
    ``target_id``, ``track_id``, ``target_row`` and ``track_row`` in that scan's truth and tracks,
    ``distance_m``.
    """

    stamp_ns: IntArray
    sample_scan: IntArray
    sample_target: IntArray
    scan: IntArray
    target_id: IntArray
    track_id: IntArray
    target_row: IntArray
    track_row: IntArray
    distance_m: FloatArray


def known_targets(truth: ScanTruth) -> IntArray:
    """Rows of the targets whose position is known."""
    return np.flatnonzero(np.isfinite(truth.target_state[:, :2]).all(axis=1))


def match_scan(
    tracks: Tracks, truth: ScanTruth, match_distance_m: float
) -> tuple[IntArray, IntArray, FloatArray]:
    """Match confirmed tracks and known targets of one scan one to one.

    Of all matchings without a pair beyond ``match_distance_m``, those with the most pairs are
    looked at, and among these the one with the smallest sum of distances is taken.

    Returns
    -------
    target_row, track_row, distance_m
        (M,) each: rows of the truth and of the tracks, and how far they are apart.
    """
    targets = known_targets(truth)
    live = np.flatnonzero(tracks.status == CONFIRMED)
    if not len(targets) or not len(live):
        none = np.zeros(0, dtype=np.int64)
        return none, none, np.zeros(0)
    gap = truth.target_state[targets, None, :2] - tracks.mean[None, live, :2]
    distance = np.hypot(gap[..., 0], gap[..., 1])
    allowed = distance <= match_distance_m
    # A forbidden pair costs more than all allowed ones together, so that one more pair always pays.
    forbidden = match_distance_m * (min(distance.shape) + 1)
    row, column = linear_sum_assignment(np.where(allowed, distance, forbidden))
    near = allowed[row, column]
    row, column = row[near], column[near]
    return targets[row], live[column], distance[row, column]


def match_run(
    tracks: Sequence[Tracks], truth: Sequence[ScanTruth], match_distance_m: float
) -> Matches:
    """Match every scan of a run by :func:`match_scan`.

    Parameters
    ----------
    tracks, truth
        One entry per scan, in the same order. Target states that are not finite are unknown.
    match_distance_m
        Largest horizontal distance of a track and its target, > 0.

    Raises
    ------
    ValueError
        If the numbers of scans differ or ``match_distance_m`` is not positive.
    """
    if len(tracks) != len(truth):
        raise ValueError(f"{len(tracks)} scans with tracks, {len(truth)} with truth: must be equal")
    if not match_distance_m > 0.0:
        raise ValueError(f"match_distance_m = {match_distance_m}: allowed is > 0")
    found = [match_scan(t, r, match_distance_m) for t, r in zip(tracks, truth, strict=True)]
    known = [known_targets(r) for r in truth]
    return Matches(
        stamp_ns=np.array([r.stamp_ns for r in truth], dtype=np.int64),
        sample_scan=_scan_of_each(known),
        sample_target=_join([r.target_id[rows] for r, rows in zip(truth, known, strict=True)]),
        scan=_scan_of_each([rows for rows, _, _ in found]),
        target_id=_join([r.target_id[m[0]] for r, m in zip(truth, found, strict=True)]),
        track_id=_join([t.track_id[m[1]] for t, m in zip(tracks, found, strict=True)]),
        target_row=_join([m[0] for m in found]),
        track_row=_join([m[1] for m in found]),
        distance_m=np.concatenate([*(m[2] for m in found), np.zeros(0)]),
    )


def _scan_of_each(parts: Sequence[np.ndarray]) -> IntArray:
    """Number of the scan for each entry of the concatenated parts."""
    return np.repeat(np.arange(len(parts)), np.array([len(p) for p in parts], dtype=np.int64))


def _join(parts: Sequence[np.ndarray]) -> IntArray:
    return np.concatenate([*parts, np.zeros(0, dtype=np.int64)]).astype(np.int64)
