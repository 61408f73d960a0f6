"""What parameters reach on a case, kept scan by scan, and the measures of several cases together.

GOSPA with partial truth counts the tracks within the match distance of a known target only: what
is farther away may be real. A track split in two beside its target still counts as false.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gda_tracker.evaluation.continuity import score_continuity
from gda_tracker.evaluation.matching import known_targets, match_scan
from gda_tracker.evaluation.set_distances import set_distance
from gda_tracker.tracking.ring import Ring
from gda_tracker.tuning.cases import Case
from gda_tracker.tuning.search_space import Values
from gda_tracker.vocabulary.arrays import FloatArray
from gda_tracker.vocabulary.recordings import Recording
from gda_tracker.vocabulary.scans import ScanKey, ScanTruth
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks

# Per scan, in the columns of ``CaseScore.scans``.
COLUMNS = (
    "scored",  # 1 where a scan counts for GOSPA
    "gospa",  # its square and parts [m2]
    "localisation",
    "missed",
    "false",
    "every_track",  # square of GOSPA with all tracks, near or far
    "samples",  # known target positions
    "matched",  # of them under a confirmed track
    "square_error",  # of the matches [m2]
    "taken",  # detections that confirmed tracks took
    "own",  # of them from the target that the track took most from
)


@dataclass(frozen=True)
class CaseScore:
    """Scores of one case: ``scans`` (K, columns) and numbers of the whole run."""

    name: str
    scans: FloatArray
    switches: int
    false_tracks: int | None
    confirmed_tracks: int
    delay_s: float
    targets: int
    not_extracted: int
    names_sources: bool
    cpu_s: float

    def total(self, name: str) -> float:
        """Sum of a column."""
        return float(self.scans[:, COLUMNS.index(name)].sum())


def track_recording(recording: Recording, parameters: Values) -> tuple[list[Tracks], float]:
    """Tracks after each scan of a recording, and the processor time [s].

    A scan that the door rejects has no tracks: its targets count as missed.
    """
    start = time.process_time()
    ring = Ring(parameters)
    found: dict[tuple[str, int], Tracks] = {}
    said = 0
    for position, detections in enumerate(recording.detections):
        while said < len(recording.statements) and recording.statements[said][0] <= position:
            ring.say(recording.statements[said][1])
            said += 1
        results = ring.feed(detections)
        found.update(
            ((r.report.key.sensor_id, r.report.key.stamp_ns), r.tracks)
            for r in results
            if r.tracks is not None
        )
    for r in ring.finish():
        if r.tracks is not None:
            found[r.report.key.sensor_id, r.report.key.stamp_ns] = r.tracks
    cpu_s = time.process_time() - start
    tracks = []
    for detections in recording.detections:
        sensor, stamp = detections.sensor_id, detections.stamp_ns
        nothing = Tracks(key=ScanKey(0, sensor, stamp))
        tracks.append(found.get((sensor, stamp), nothing))
    return tracks, cpu_s


def score_case(case: Case, parameters: Values) -> CaseScore:
    """Track a case from its first scan and score the confirmed tracks.

    Raises
    ------
    ParameterError
        If the parameters are not allowed.
    """
    tracks, cpu_s = track_recording(case.recording, parameters)
    return score_tracks(case, tracks, cpu_s)


def score_tracks(case: Case, tracks: Sequence[Tracks], cpu_s: float = 0.0) -> CaseScore:
    """Score the tracks of a case, one entry per scan."""
    truth = case.recording.truth or []
    scans = np.zeros((len(truth), len(COLUMNS)))
    for row, (live, known) in enumerate(zip(tracks, truth, strict=True)):
        scans[row, :9] = _distances(case, live, known)
    if case.names_sources:
        scans[:, 9:] = _own_detections(tracks, truth)
    run = score_continuity(
        tracks,
        truth,
        match_distance_m=case.match_distance_m,
        truth_is_partial=case.partial,
    )
    delay = np.where(np.isnan(run.extraction_delay_s), run.duration_s, run.extraction_delay_s)
    return CaseScore(
        name=case.name,
        scans=scans,
        switches=run.identity_switches,
        false_tracks=run.false_tracks,
        confirmed_tracks=run.confirmed_tracks,
        delay_s=float(delay.sum()),
        targets=len(run.target_id),
        not_extracted=run.targets_not_extracted,
        names_sources=case.names_sources,
        cpu_s=cpu_s,
    )


def _distances(case: Case, live: Tracks, known: ScanTruth) -> tuple[float, ...]:
    """The first nine columns of one scan."""
    targets = known.target_state[known_targets(known), :2]
    estimates = live.mean[live.status == CONFIRMED, :2]
    every = set_distance(estimates, targets, case.match_distance_m)
    distance = every
    if case.partial:
        gap = np.linalg.norm(estimates[:, None] - targets[None], axis=2)
        near = gap.min(axis=1, initial=np.inf) < case.match_distance_m
        distance = set_distance(estimates[near], targets, case.match_distance_m)
    matched = match_scan(live, known, case.match_distance_m)[2]
    scored = len(targets) > 0 or not case.partial
    return (
        float(scored),
        distance.gospa_m**2,
        distance.localisation,
        distance.missed,
        distance.false,
        every.gospa_m**2 if scored else 0.0,
        float(len(targets)),
        float(len(matched)),
        float((matched**2).sum()),
    )


def _own_detections(tracks: Sequence[Tracks], truth: Sequence[ScanTruth]) -> FloatArray:
    """(K, 2): detections that confirmed tracks took, and those of each track's main target."""
    scan, track, source = [], [], []
    for row, (live, known) in enumerate(zip(tracks, truth, strict=True)):
        assert known.source_id is not None
        took = (live.status == CONFIRMED) & (live.detection_index >= 0)
        track.append(live.track_id[took])
        source.append(np.asarray(known.source_id)[live.detection_index[took]])
        scan.append(np.full(int(took.sum()), row))
    rows, ids, sources = (
        np.concatenate([*parts, np.zeros(0, dtype=np.int64)]).astype(np.int64)
        for parts in (scan, track, source)
    )
    # The target that a track took most from; of equals the smallest number. Clutter is nobody's.
    real = sources >= 0
    result = np.zeros((len(tracks), 2))
    result[:, 0] = np.bincount(rows, minlength=len(tracks))
    if not real.any():
        return result
    pairs, count = np.unique(np.stack([ids[real], sources[real]]), axis=1, return_counts=True)
    order = np.lexsort((pairs[1], -count, pairs[0]))
    track_ids, first = np.unique(pairs[0][order], return_index=True)
    main = pairs[1][order][first]
    place = np.searchsorted(track_ids, ids)
    place[place == len(track_ids)] = 0
    own = real & (track_ids[place] == ids) & (main[place] == sources)
    result[:, 1] = np.bincount(rows[own], minlength=len(tracks))
    return result


def measures(scores: Sequence[CaseScore]) -> dict[str, float | None]:
    """Measures of several cases together, ``None`` where the truth does not tell them.

    GOSPA is the root of the mean square over all scans, shares are over all target positions and
    detections, switches and false tracks are means per case, the delay a mean over all targets,
    where one never found counts with the duration of its case.
    """
    sums = dict(zip(COLUMNS, np.vstack([s.scans for s in scores]).sum(axis=0), strict=True))
    false = [score.false_tracks for score in scores if score.false_tracks is not None]
    complete = len(false) == len(scores)
    told = all(score.names_sources for score in scores)
    targets = sum(score.targets for score in scores)
    found: dict[str, Any] = {
        "gospa_m": _root(sums["gospa"], sums["scored"]),
        "localisation_m": _root(sums["localisation"], sums["scored"]),
        "missed_m": _root(sums["missed"], sums["scored"]),
        "false_m": _root(sums["false"], sums["scored"]),
        "gospa_every_track_m": _root(sums["every_track"], sums["scored"]),
        "completeness": _share(sums["matched"], sums["samples"]),
        "purity": _share(sums["own"], sums["taken"]) if told else None,
        "switches": float(np.mean([score.switches for score in scores])),
        "false_tracks": float(np.mean(false)) if complete else None,
        "confirmed_tracks": float(np.mean([score.confirmed_tracks for score in scores])),
        "delay_s": sum(s.delay_s for s in scores) / targets if targets else 0.0,
        "not_extracted": float(np.mean([score.not_extracted for score in scores])),
        "position_error_m": _root(sums["square_error"], sums["matched"]),
    }
    return {name: None if value is None else float(value) for name, value in found.items()}


def _root(total: float, count: float) -> float | None:
    return math.sqrt(total / count) if count else None


def _share(part: float, whole: float) -> float:
    """Share of a whole; nothing of nothing is 0: no track has earned anything."""
    return part / whole if whole else 0.0
