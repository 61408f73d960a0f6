"""Continuity of tracks: every target under a confirmed track, and always under the same one.

Scan by scan, confirmed tracks and known target positions are matched one to one within
``match_distance_m``. Two close targets may be matched crosswise for a scan without any track having
changed its target: every change of the matched track is a *flip*, only a change that lasts is a
*switch*.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from gda_tracker.vocabulary.arrays import FloatArray, IntArray
from gda_tracker.vocabulary.scans import ScanTruth
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks

# Matched scans in a row under another track, from which on a flip counts as a switch.
SETTLE_SCANS = 3


@dataclass(frozen=True)
class Continuity:
    """Scores of one run.

    ``target_id`` (T,) lists the targets; ``samples``, ``matched``, ``flips`` and ``switches`` (T,)
    count the scans at which a target's position is known, those of them under a confirmed track,
    the changes of that track, and the changes that last. ``false_tracks`` is ``None`` where the
    truth is partial: a track without a known target may then follow something real.
    """

    target_id: IntArray
    samples: IntArray
    matched: IntArray
    flips: IntArray
    switches: IntArray
    confirmed_tracks: int
    false_tracks: int | None
    position_rmse_m: float
    match_distance_m: float
    mean_latency_s: float = math.nan

    @property
    def completeness_per_target(self) -> FloatArray:
        """(T,) share of the known samples under a confirmed track, NaN without samples."""
        return _ratio(self.matched, self.samples)

    @property
    def completeness(self) -> float:
        """Share of all known samples under a confirmed track, NaN without samples."""
        return float(_ratio(self.matched.sum(), self.samples.sum()))

    @property
    def identity_flips(self) -> int:
        """Changes of the matched track, over all targets."""
        return int(self.flips.sum())

    @property
    def identity_switches(self) -> int:
        """Lasting changes of the matched track, over all targets."""
        return int(self.switches.sum())


def score_continuity(
    tracks: Sequence[Tracks],
    truth: Sequence[ScanTruth],
    *,
    match_distance_m: float = 25.0,
    settle_scans: int = SETTLE_SCANS,
    truth_is_partial: bool = False,
    latency_s: Sequence[float] = (),
) -> Continuity:
    """Score the tracks of one run against the truth.

    Parameters
    ----------
    tracks, truth
        One entry per scan, in the same order. Target states that are not finite are unknown and do
        not count.
    match_distance_m
        Largest horizontal distance of a track and its target, > 0.
    settle_scans
        Matched scans in a row under another track, from which on a flip counts as a switch.
    truth_is_partial
        Whether there may be targets that the truth does not know.
    latency_s
        What the scan reports say of the time from detections to tracks; only averaged here.

    Raises
    ------
    ValueError
        If the numbers of scans differ, or ``match_distance_m`` or ``settle_scans`` is not positive.
    """
    if len(tracks) != len(truth):
        raise ValueError(f"{len(tracks)} scans with tracks, {len(truth)} with truth: must be equal")
    if not match_distance_m > 0.0:
        raise ValueError(f"match_distance_m = {match_distance_m}: allowed is > 0")
    if settle_scans < 1:
        raise ValueError(f"settle_scans = {settle_scans}: allowed is >= 1")
    samples, matched_target, matched_track, distance = _match_all(tracks, truth, match_distance_m)
    target_id = np.unique(samples)
    flips = np.zeros(len(target_id), dtype=np.int64)
    switches = np.zeros(len(target_id), dtype=np.int64)
    for row, target in enumerate(target_id):
        flips[row], switches[row] = _changes(matched_track[matched_target == target], settle_scans)
    confirmed = np.unique(_join([t.track_id[t.status == CONFIRMED] for t in tracks]))
    never_matched = int((~np.isin(confirmed, matched_track)).sum())
    return Continuity(
        target_id=target_id,
        samples=_count(samples, target_id),
        matched=_count(matched_target, target_id),
        flips=flips,
        switches=switches,
        confirmed_tracks=len(confirmed),
        false_tracks=None if truth_is_partial else never_matched,
        position_rmse_m=math.sqrt(np.mean(distance**2)) if len(distance) else math.nan,
        match_distance_m=match_distance_m,
        mean_latency_s=float(np.mean(latency_s)) if len(latency_s) else math.nan,
    )


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
    targets = np.flatnonzero(np.isfinite(truth.target_state[:, :2]).all(axis=1))
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


def _match_all(
    tracks: Sequence[Tracks], truth: Sequence[ScanTruth], match_distance_m: float
) -> tuple[IntArray, IntArray, IntArray, FloatArray]:
    """Target ids of all known samples; target id, track id and distance of all matches."""
    samples, targets, ids, distances = [], [], [], []
    for live, known in zip(tracks, truth, strict=True):
        row, column, distance = match_scan(live, known, match_distance_m)
        samples.append(known.target_id[np.isfinite(known.target_state[:, :2]).all(axis=1)])
        targets.append(known.target_id[row])
        ids.append(live.track_id[column])
        distances.append(distance)
    all_distances = np.concatenate([*distances, np.zeros(0)])
    return _join(samples), _join(targets), _join(ids), all_distances


def _changes(track_ids: IntArray, settle_scans: int) -> tuple[int, int]:
    """Flips and lasting switches in one target's sequence of matched tracks."""
    if not len(track_ids):
        return 0, 0
    breaks = np.flatnonzero(np.diff(track_ids) != 0) + 1
    begin = np.concatenate([[0], breaks])
    lengths = np.diff(np.concatenate([begin, [len(track_ids)]]))
    switches = 0
    owner = track_ids[0]
    for start, length in zip(begin, lengths, strict=True):
        if track_ids[start] != owner and length >= settle_scans:
            switches += 1
            owner = track_ids[start]
    return len(breaks), switches


def _join(parts: list[np.ndarray]) -> IntArray:
    return np.concatenate([*parts, np.zeros(0, dtype=np.int64)]).astype(np.int64)


def _count(values: IntArray, ids: IntArray) -> IntArray:
    return (values[None, :] == ids[:, None]).sum(axis=1)


def _ratio(part: np.ndarray | np.integer, whole: np.ndarray | np.integer) -> FloatArray:
    part, whole = np.asarray(part, dtype=np.float64), np.asarray(whole, dtype=np.float64)
    return np.divide(part, whole, out=np.full(part.shape, np.nan), where=whole > 0)
