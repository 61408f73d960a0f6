"""Methods on recordings whose truth is complete: trajectories seen by a simulated radar."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from gda_tracker.errors import UserError
from gda_tracker.evaluation.quality import score_quality
from gda_tracker.simulation.playback import with_method
from gda_tracker.tracking.ring import Ring, RingResult
from gda_tracker.vocabulary.recordings import Recording

DEFAULT_METHODS = ("default", "map/none/cv", "mht/none/imm")
HEAD = (
    "method",
    "completeness",
    "switches",
    "flips",
    "false tracks",
    "per hour",
    "not found",
    "GOSPA [m]",
    "localisation",
    "missed",
    "false",
    "error [m]",
    "CPU [ms]",
)


@dataclass(frozen=True, slots=True)
class RecordingScore:
    """One method, mean over runs.

    ``completeness`` is the share of the targets' scans under a confirmed track; ``switches`` and
    ``flips`` are lasting and all changes of that track, ``false_tracks`` confirmed ones that never
    were at a target, ``not_found`` targets that never had one: all per run. ``gospa_m`` is the mean
    over scans; ``localisation``, ``missed`` and ``false`` [m2] are the means of its parts.
    ``position_rmse_m`` is the error of matched tracks, ``cpu_ms`` the processor time a scan.
    """

    method: str
    runs: int
    targets: float
    match_distance_m: float
    completeness: float
    switches: float
    flips: float
    false_tracks: float
    false_tracks_per_hour: float
    not_found: float
    gospa_m: float
    localisation: float
    missed: float
    false: float
    position_rmse_m: float
    cpu_ms: float

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers by name."""
        return asdict(self)


def track_recording(recording: Recording, method: str) -> tuple[list[RingResult], float]:
    """Take the scans round the ring; return what came of each, and the processor time [s].

    Raises
    ------
    UserError
        If a scan was not tracked.
    """
    ring = Ring(with_method(recording.preset, method))
    results = []
    start = time.process_time()
    for detections in recording.detections:
        result = ring.process(detections)
        if result.tracks is None:
            report = result.report
            raise UserError(
                f"{recording.name}: scan at {detections.stamp_ns} ns: {report.outcome} "
                f"({report.reason}), and a scan without tracks cannot be scored"
            )
        results.append(result)
    return results, time.process_time() - start


def score_method(
    recordings: Sequence[Recording], method: str, match_distance_m: float | None = None
) -> RecordingScore:
    """Track the runs of one recording with a method.

    Parameters
    ----------
    recordings
        Runs, each with truth that knows the source of every detection.
    method
        ``decision/attribute_term/filter`` or ``default``.
    match_distance_m
        How far a track may be from its target, and the cut-off of GOSPA; by default the
        recording's own.

    Raises
    ------
    UserError
        If a recording has no such truth or no match distance.
    """
    rows = []
    for recording in recordings:
        distance = match_distance_m or recording.match_distance_m
        truth = recording.truth
        if not truth or any(one.source_id is None for one in truth) or distance is None:
            raise UserError(
                f"{recording.name}: the truth is not complete; allowed are recordings of a "
                "simulated radar"
            )
        results, cpu_s = track_recording(recording, method)
        quality = score_quality(results, truth, distance)
        one, sets = quality.continuity, quality.distances
        rows.append(
            (
                len(one.target_id),
                distance,
                one.completeness,
                one.identity_switches,
                one.identity_flips,
                one.false_tracks or 0,
                one.false_tracks_per_hour,
                one.targets_not_extracted,
                sets.gospa_m.mean(),
                sets.localisation.mean(),
                sets.missed.mean(),
                sets.false.mean(),
                one.position_rmse_m,
                1e3 * cpu_s / len(results),
            )
        )
    return RecordingScore(method, len(rows), *np.mean(rows, axis=0).tolist())


def format_scores(name: str, scores: Sequence[RecordingScore]) -> str:
    """Return a table, one line a method."""
    first = scores[0]
    lines = [
        f"{name}: {first.targets:g} targets, {first.runs} run{'s' if first.runs > 1 else ''}, "
        f"match distance {first.match_distance_m:.0f} m"
    ]
    rows = [HEAD, *(cells(score) for score in scores)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(HEAD))]
    for row in rows:
        padded = [cell.rjust(width) for cell, width in zip(row, widths, strict=True)]
        padded[0] = row[0].ljust(widths[0])
        lines.append("  " + "  ".join(padded))
    return "\n".join(lines)


def cells(score: RecordingScore) -> tuple[str, ...]:
    """Return the numbers of a method as text, in the order of ``HEAD``."""
    return (
        score.method,
        f"{score.completeness:.3f}",
        f"{score.switches:.1f}",
        f"{score.flips:.1f}",
        f"{score.false_tracks:.1f}",
        f"{score.false_tracks_per_hour:.1f}",
        f"{score.not_found:.1f}",
        f"{score.gospa_m:.1f}",
        f"{score.localisation:.0f}",
        f"{score.missed:.0f}",
        f"{score.false:.0f}",
        f"{score.position_rmse_m:.2f}",
        f"{score.cpu_ms:.1f}",
    )
