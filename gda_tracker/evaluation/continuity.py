"""Continuity of tracks: every target under a confirmed track, soon and always under the same one.

Scan by scan, confirmed tracks and known target positions are matched one to one within
``match_distance_m``. Two close targets may be matched crosswise for a scan without any track having
changed its target: every change of the matched track is a *flip*, only a change that lasts is a
*switch*. A *false track* is one that was confirmed and never matched. The *extraction delay* runs
from the first detection of a target to a confirmed track (performance measures of Koch 2014,
section 1.3.3).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gda_tracker.evaluation.matching import Matches, match_run
from gda_tracker.vocabulary.arrays import FloatArray, IntArray, empty_floats
from gda_tracker.vocabulary.scans import ScanTruth
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks

# Matched scans in a row under another track, from which on a flip counts as a switch.
SETTLE_SCANS = 3


@dataclass(frozen=True)
class Continuity:
    """Scores of one run.

    ``target_id`` (T,) lists the targets; ``samples``, ``matched``, ``flips`` and ``switches`` (T,)
    count the scans at which a target's position is known, those of them under a confirmed track,
    the changes of that track, and the changes that last. ``extraction_delay_s`` and
    ``extraction_delay_scans`` (T,) run from the first detection of the target, or from its first
    known position where the truth does not name the sources of detections, to the first scan from
    then on under a confirmed track, NaN if there is none.

    ``false_tracks`` is ``None`` where the truth is partial: a track without a known target may then
    follow something real. ``false_track_life_s`` (F,) is, for each of them, the time from its first
    scan as a confirmed track to the first one without it, or to the last scan of all: a track that
    still lives then has lived at least so long. ``duration_s`` is the time from the first scan to
    the last.
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
    extraction_delay_s: FloatArray = field(default_factory=empty_floats)
    extraction_delay_scans: FloatArray = field(default_factory=empty_floats)
    false_track_life_s: FloatArray = field(default_factory=empty_floats)
    duration_s: float = 0.0

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

    @property
    def targets_not_extracted(self) -> int:
        """Targets that were not under a confirmed track from their first detection on."""
        return int(np.isnan(self.extraction_delay_s).sum())

    @property
    def false_tracks_per_hour(self) -> float:
        """False tracks over the duration, NaN where they are not known or the duration is zero."""
        if self.false_tracks is None or self.duration_s <= 0.0:
            return math.nan
        return 3600.0 * self.false_tracks / self.duration_s


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
    if settle_scans < 1:
        raise ValueError(f"settle_scans = {settle_scans}: allowed is >= 1")
    found = match_run(tracks, truth, match_distance_m)
    target_id = np.unique(found.sample_target)
    flips = np.zeros(len(target_id), dtype=np.int64)
    switches = np.zeros(len(target_id), dtype=np.int64)
    for row, target in enumerate(target_id):
        followed = found.track_id[found.target_id == target]
        flips[row], switches[row] = _changes(followed, settle_scans)
    delay_scans, delay_s = _extraction_delay(found, truth, target_id)
    confirmed_id, life_s = _confirmed_life(tracks, found.stamp_ns)
    never_matched = ~np.isin(confirmed_id, found.track_id)
    distance, stamps = found.distance_m, found.stamp_ns
    return Continuity(
        target_id=target_id,
        samples=_count(found.sample_target, target_id),
        matched=_count(found.target_id, target_id),
        flips=flips,
        switches=switches,
        confirmed_tracks=len(confirmed_id),
        false_tracks=None if truth_is_partial else int(never_matched.sum()),
        position_rmse_m=math.sqrt(np.mean(distance**2)) if len(distance) else math.nan,
        match_distance_m=match_distance_m,
        mean_latency_s=float(np.mean(latency_s)) if len(latency_s) else math.nan,
        extraction_delay_s=delay_s,
        extraction_delay_scans=delay_scans,
        false_track_life_s=np.zeros(0) if truth_is_partial else life_s[never_matched],
        duration_s=float(stamps[-1] - stamps[0]) / 1e9 if len(stamps) else 0.0,
    )


def _extraction_delay(
    found: Matches, truth: Sequence[ScanTruth], target_id: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Scans and seconds (T,) from each target's first detection to its first match."""
    scan, target = found.sample_scan, found.sample_target
    sources = [r.source_id for r in truth if r.source_id is not None]
    if len(sources) == len(truth) and sources:
        scan = np.repeat(np.arange(len(truth)), np.array([len(s) for s in sources]))
        target = np.concatenate(sources).astype(np.int64)
    delay_scans = np.full(len(target_id), np.nan)
    delay_s = delay_scans.copy()
    for row, wanted in enumerate(target_id):
        seen = scan[target == wanted]
        matched = found.scan[found.target_id == wanted]
        if len(seen):
            matched = matched[matched >= seen[0]]
        if len(seen) and len(matched):
            delay_scans[row] = matched[0] - seen[0]
            delay_s[row] = (found.stamp_ns[matched[0]] - found.stamp_ns[seen[0]]) / 1e9
    return delay_scans, delay_s


def _confirmed_life(tracks: Sequence[Tracks], stamp_ns: IntArray) -> tuple[IntArray, FloatArray]:
    """Ids of all tracks that were ever confirmed, rising, and how long [s] they then lived."""
    live = [t.track_id[t.status == CONFIRMED] for t in tracks]
    count = np.array([len(ids) for ids in live], dtype=np.int64)
    all_ids = np.concatenate([*live, np.zeros(0, dtype=np.int64)]).astype(np.int64)
    scan = np.repeat(np.arange(len(tracks)), count)
    ids, first, row = np.unique(all_ids, return_index=True, return_inverse=True)
    last = np.zeros(len(ids), dtype=np.int64)
    np.maximum.at(last, row, scan)
    # The first scan without the track, as far as there is one.
    end = np.minimum(last + 1, max(len(tracks) - 1, 0))
    if not len(ids):
        return ids, np.zeros(0)
    return ids, (stamp_ns[end] - stamp_ns[scan[first]]) / 1e9


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


def _count(values: IntArray, ids: IntArray) -> IntArray:
    return (values[None, :] == ids[:, None]).sum(axis=1)


def _ratio(part: np.ndarray | np.integer, whole: np.ndarray | np.integer) -> FloatArray:
    part, whole = np.asarray(part, dtype=np.float64), np.asarray(whole, dtype=np.float64)
    return np.divide(part, whole, out=np.full(part.shape, np.nan), where=whole > 0)
