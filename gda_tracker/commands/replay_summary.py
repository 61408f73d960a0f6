"""What ``gda-tracker replay`` prints in the end: scans, tracks, and scores where there is truth."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from gda_tracker.evaluation.continuity import Continuity, score_continuity
from gda_tracker.simulation.playback import Playback
from gda_tracker.vocabulary.scans import ScanReport, ScanTruth
from gda_tracker.vocabulary.tracks import Tracks

REAL_MATCH_M = 25.0
SIMULATED_MATCH_M = 1000.0

Answers = list[tuple[ScanReport, Tracks | None]]


def print_summary(
    play: Playback,
    answers: Answers,
    revised: Mapping[str, Sequence[Tracks]],
    match_distance_m: float | None,
) -> None:
    """Print what came out.

    Parameters
    ----------
    play
        What was played, with the truth if it is known.
    answers
        Report and tracks of each scan.
    revised
        The tracks as they are told later, by the word for when; nothing where they are not.
    match_distance_m
        How far a track may be from its target; ``None``: what the recording says, or by
        where the truth comes from.
    """
    reports = [report for report, _ in answers]
    outcomes = count_outcomes(reports)
    print("scans: " + ", ".join(f"{count} {outcome}" for outcome, count in outcomes.items()))
    left_out = count_left_out(reports)
    if left_out:
        print("detections: " + ", ".join(f"{count} {reason}" for reason, count in left_out.items()))
    tracked = [(report, tracks) for report, tracks in answers if tracks is not None]
    ids = {int(i) for _, t in tracked for i in t.track_id[t.status == 1]}
    print(f"confirmed tracks: {len(ids)}")
    latency = [1e3 * report.latency_s for report, _ in tracked if report.latency_s > 0.0]
    if latency:
        print(
            f"latency per scan: median {np.median(latency):.1f} ms, "
            f"99 % {np.percentile(latency, 99):.1f} ms"
        )
    if play.truth is None:
        return
    pairs = with_truth(play.truth, [tracks for _, tracks in tracked])
    if not pairs:
        return
    match_distance_m, simulated = match_distance(play, [r for _, r in pairs], match_distance_m)
    _print_scores(pairs, simulated, match_distance_m)
    for when, tracks_by_scan in revised.items():
        later = with_truth(play.truth, tracks_by_scan)
        if later:
            error = _score(later, simulated, match_distance_m).position_rmse_m
            print(f"position error, {when}: {error:.1f} m (RMS)")


def count_outcomes(reports: Sequence[ScanReport]) -> Counter[str]:
    """What became of the scans, rejected ones by their reason."""
    return Counter(
        f"rejected: {report.reason}" if report.outcome == "rejected" else report.outcome
        for report in reports
    )


def count_left_out(reports: Sequence[ScanReport]) -> Counter[str]:
    """Detections left out of admitted scans, by the reason."""
    left_out: Counter[str] = Counter()
    for report in reports:
        left_out.update(report.rejected)
    return left_out


def match_distance(
    play: Playback, known: Sequence[ScanTruth], asked_m: float | None
) -> tuple[float, bool]:
    """How far [m] a track may be from its target, and whether the truth is complete."""
    # Where every detection's source is known the truth is a simulation's, and complete.
    simulated = all(truth.source_id is not None for truth in known)
    usual = SIMULATED_MATCH_M if simulated else REAL_MATCH_M
    return asked_m or play.match_distance_m or usual, simulated


Pairs = list[tuple[Tracks, ScanTruth]]


def with_truth(truth: Sequence[ScanTruth], tracks_by_scan: Sequence[Tracks]) -> Pairs:
    """Tracks and truth of the scans that have both."""
    known = {(t.sensor_id, t.stamp_ns): t for t in truth}
    return [
        (tracks, known[key])
        for tracks in tracks_by_scan
        if (key := (tracks.key.sensor_id, tracks.key.stamp_ns)) in known
    ]


def _score(pairs: Pairs, simulated: bool, match_distance_m: float) -> Continuity:
    return score_continuity(
        [tracks for tracks, _ in pairs],
        [truth for _, truth in pairs],
        match_distance_m=match_distance_m,
        truth_is_partial=not simulated,
    )


def _print_scores(pairs: Pairs, simulated: bool, match_distance_m: float) -> None:
    score = _score(pairs, simulated, match_distance_m)
    if simulated:
        print(
            f"targets: {len(score.target_id)}, completeness {score.completeness:.3f} (within "
            f"{score.match_distance_m:.0f} m), identity switches {score.identity_switches}, "
            f"false tracks {score.false_tracks}, position error {score.position_rmse_m:.1f} m (RMS)"
        )
        return
    for target, share, switches in zip(
        score.target_id, score.completeness_per_target, score.switches, strict=True
    ):
        print(
            f"target {target}: completeness {share:.3f} (within {score.match_distance_m:.0f} m), "
            f"identity switches {switches}"
        )
    print(f"position error: {score.position_rmse_m:.1f} m (RMS)")
