"""Scores of what came out of the ring: several runs of one method, beside those of another.

Unlike :mod:`~gda_tracker.evaluation.monte_carlo`, which tracks by itself, this scores tracks that
exist already, from the nodes or from a bag.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gda_tracker.evaluation.continuity import score_continuity
from gda_tracker.evaluation.purity import confusion_counts, purity
from gda_tracker.evaluation.statistics import mean_and_stderr
from gda_tracker.vocabulary.arrays import FloatArray
from gda_tracker.vocabulary.scans import ScanTruth
from gda_tracker.vocabulary.tracks import Tracks


@dataclass(frozen=True)
class Run:
    """Tracks and truth of one run, one entry per scan each, in the same order."""

    tracks: list[Tracks]
    truth: list[ScanTruth]


@dataclass(frozen=True)
class Summary:
    """Scores of one method.

    ``purity`` (R,) is the mean over the tracks of each run, ``None`` where the truth does not name
    the sources of detections. ``switches`` and ``completeness`` are means over the runs,
    ``position_rmse_m`` is over all matched samples. ``latency_ms`` has one entry per scan.
    """

    method: str
    runs: int
    scans: int
    lost_scans: int
    purity: FloatArray | None
    completeness: float
    switches: float
    position_rmse_m: float
    match_distance_m: float
    latency_ms: FloatArray


def pair_with_truth(
    tracks: Mapping[tuple[str, int], Tracks], truth: Mapping[tuple[str, int], ScanTruth]
) -> list[Run]:
    """Sort scans that have both tracks and truth into runs, each in the order of time.

    Parameters
    ----------
    tracks, truth
        By sensor and stamp.
    """
    runs: dict[int, Run] = {}
    for key in sorted(tracks.keys() & truth.keys(), key=lambda key: key[1]):
        run = runs.setdefault(truth[key].run, Run([], []))
        run.tracks.append(tracks[key])
        run.truth.append(truth[key])
    return [runs[number] for number in sorted(runs)]


def run_purity(run: Run) -> float:
    """Purity of a run that was started from labels, mean over its tracks.

    The i-th track by rising id was started on the i-th target by rising id.
    """
    track_ids = np.sort(run.tracks[0].track_id)
    target_ids = np.sort(run.truth[0].target_id).astype(np.int64)
    return float(np.mean(purity(confusion_counts(run.tracks, run.truth, track_ids, target_ids))))


def summarise(
    method: str,
    runs: Sequence[Run],
    latency_ms: Sequence[float],
    lost_scans: int,
    *,
    labelled: bool,
    match_distance_m: float,
) -> Summary:
    """Score the runs of one method.

    Parameters
    ----------
    method
        Name of the method.
    runs
        What came out.
    latency_ms
        Latency of each scan.
    lost_scans
        Scans that went in and were not tracked.
    labelled
        Whether the tracks were started from labels, so that purity means something.
    match_distance_m
        How far a track may be from a target that it is said to follow.

    Raises
    ------
    ValueError
        If there are no runs.
    """
    if not runs:
        raise ValueError(f"{method}: no scan has both tracks and truth")
    found = [
        score_continuity(
            run.tracks, run.truth, match_distance_m=match_distance_m, truth_is_partial=True
        )
        for run in runs
    ]
    scans = sum(len(run.tracks) for run in runs)
    matched = np.array([score.matched.sum() for score in found], dtype=np.float64)
    squares = np.array([score.position_rmse_m for score in found]) ** 2
    known = matched > 0
    rmse = math.sqrt(np.average(squares[known], weights=matched[known])) if any(known) else math.nan
    return Summary(
        method=method,
        runs=len(runs),
        scans=scans,
        lost_scans=lost_scans,
        purity=np.array([run_purity(run) for run in runs]) if labelled else None,
        completeness=mean_and_stderr(np.array([score.completeness for score in found]))[0],
        switches=float(np.mean([score.identity_switches for score in found])),
        position_rmse_m=rmse,
        match_distance_m=match_distance_m,
        latency_ms=np.asarray(latency_ms, dtype=np.float64),
    )


def summary_table(columns: Mapping[str, Summary], baseline: str) -> list[list[str]]:
    """Rows of text, the first one the heading, of several summaries side by side.

    Parameters
    ----------
    columns
        Summaries by title. Purity of the others is compared with that of ``baseline``, run by run.
    baseline
        Title of the column to compare with.
    """
    first = columns[baseline].purity
    rows: list[list[str]] = [
        ["", *columns],
        ["method", *(c.method for c in columns.values())],
        ["runs", *(f"{c.runs}" for c in columns.values())],
        ["scans tracked", *(f"{c.scans}" for c in columns.values())],
        ["scans lost", *(f"{c.lost_scans}" for c in columns.values())],
        ["track purity [0..1]", *(_purity(c.purity) for c in columns.values())],
        [
            "purity, paired difference [0..1]",
            *(
                "-" if title == baseline else _difference(c.purity, first)
                for title, c in columns.items()
            ),
        ],
        ["identity switches [per run]", *(_number(c.switches, 2) for c in columns.values())],
        ["completeness [0..1]", *(_number(c.completeness, 3) for c in columns.values())],
        ["position error [m RMS]", *(_number(c.position_rmse_m, 1) for c in columns.values())],
        ["latency per scan, median [ms]", *(_latency(c, 50.0) for c in columns.values())],
        ["latency per scan, 99 % [ms]", *(_latency(c, 99.0) for c in columns.values())],
    ]
    return rows


def format_table(rows: Sequence[Sequence[str]]) -> str:
    """Plain text of a table with its heading underlined: first column left, the others right."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = []
    for row in rows:
        cells = [row[0].ljust(widths[0])]
        cells += [cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True)]
        lines.append("  ".join(cells).rstrip())
    rule = "-" * (sum(widths) + 2 * (len(widths) - 1))
    return "\n".join([lines[0], rule, *lines[1:], rule])


def paired_difference(values: FloatArray, reference: FloatArray) -> tuple[float, float]:
    """Mean of the differences run by run, and its standard error (NaN for a single run)."""
    return mean_and_stderr(values - reference)


def _purity(values: FloatArray | None) -> str:
    return "n/a" if values is None else _with_error(*mean_and_stderr(values), sign="")


def _difference(values: FloatArray | None, reference: FloatArray | None) -> str:
    if values is None or reference is None:
        return "n/a"
    return _with_error(*paired_difference(values, reference), sign="+")


def _with_error(mean: float, stderr: float, sign: str) -> str:
    text = f"{mean:{sign}.3f}"
    return f"{text} +- {stderr:.3f}" if math.isfinite(stderr) else text


def _latency(summary: Summary, percentage: float) -> str:
    if not len(summary.latency_ms):
        return "n/a"
    return _number(float(np.percentile(summary.latency_ms, percentage)), 1)


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "n/a"
