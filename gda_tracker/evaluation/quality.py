"""Quality of tracking: all measures of one run against complete truth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gda_tracker.evaluation.consistency import (
    NormalisedErrors,
    gated_bounds,
    gated_moments,
    score_nees,
    score_nis,
)
from gda_tracker.evaluation.continuity import Continuity, score_continuity
from gda_tracker.evaluation.extent_errors import extent_error_m
from gda_tracker.evaluation.formation_scores import FormationScore
from gda_tracker.evaluation.matching import match_run
from gda_tracker.evaluation.set_distances import SetDistances, score_set_distances
from gda_tracker.kinematics.gating import MEASUREMENT_DIMENSION
from gda_tracker.kinematics.measurement_kinds import MEASUREMENT_MODELS
from gda_tracker.tracking.ring import RingResult
from gda_tracker.vocabulary.arrays import FloatArray, IntArray
from gda_tracker.vocabulary.scans import Scan, ScanTruth
from gda_tracker.vocabulary.tracks import Tracks


@dataclass(frozen=True)
class Quality:
    """All measures of one run.

    ``delayed_rmse_m`` and ``smoothed_rmse_m`` are the position errors of the tracks as they are
    told N scans later, NaN where they are not, and in the light of the whole run.
    ``extent_error_m`` is the mean Gaussian Wasserstein distance of matched tracks and extended
    targets, centre and ellipse in one; NaN without. ``formations`` are there if they were asked
    for.
    """

    continuity: Continuity
    distances: SetDistances
    nees: NormalisedErrors
    nis: NormalisedErrors
    delayed_rmse_m: float = math.nan
    smoothed_rmse_m: float = math.nan
    extent_error_m: float = math.nan
    formations: FormationScore | None = None


@dataclass(frozen=True)
class Consistency:
    """Normalised squared errors of all runs, with their 95 % bounds.

    ``mean`` is over everything, ``stderr`` from the scatter of the runs' means, ``expected`` what a
    consistent tracker has. Per scan (K,): ``per_scan`` the mean over runs and targets, ``samples``
    their number, ``lower`` and ``upper`` the bounds of a mean of so many independent values; NaN
    where there are none. ``typical_lower`` and ``typical_upper`` are the bounds for the median
    number of samples; ``inside`` is the share of scans within their own bounds, .95 if all is
    well.
    """

    mean: float
    stderr: float
    expected: float
    dimension: int
    per_scan: FloatArray
    samples: IntArray
    lower: FloatArray
    upper: FloatArray
    typical_lower: float
    typical_upper: float
    inside: float


def score_quality(
    results: Sequence[RingResult],
    truth: Sequence[ScanTruth],
    match_distance_m: float,
    delayed: Sequence[Tracks] = (),
    smoothed: Sequence[Tracks] = (),
) -> Quality:
    """Score one run.

    Parameters
    ----------
    results
        What each scan brought about; all were tracked.
    truth
        One entry per scan; it knows all targets.
    match_distance_m
        How far a track may be from its target, and the cut-off of GOSPA and OSPA.
    delayed, smoothed
        The tracks of each scan as they are told later, or nothing.

    Raises
    ------
    ValueError
        If a scan has no tracks, or the numbers of scans differ.
    """
    tracks, predictions, associations = [], [], []
    for result in results:
        if result.tracks is None or result.predictions is None or result.associations is None:
            raise ValueError(f"scan at {result.report.key.stamp_ns} ns: it was not tracked")
        tracks.append(result.tracks)
        predictions.append(result.predictions)
        associations.append(result.associations)
    matches = match_run(tracks, truth, match_distance_m)
    return Quality(
        score_continuity(tracks, truth, match_distance_m=match_distance_m),
        score_set_distances(tracks, truth, match_distance_m),
        score_nees(tracks, truth, matches),
        score_nis(
            tracks,
            predictions,
            associations,
            [result.assigned for result in results],
            [_measured_quantities(result.scan) for result in results],
        ),
        _position_error(delayed, truth, match_distance_m),
        _position_error(smoothed, truth, match_distance_m),
        extent_error_m(tracks, truth, matches),
    )


def _measured_quantities(scan: Scan | None) -> int:
    """How many quantities a scan's sensor gates with."""
    if scan is None or not scan.sensor_model:
        return MEASUREMENT_DIMENSION
    return len(MEASUREMENT_MODELS[scan.sensor_model])


def _position_error(
    tracks: Sequence[Tracks], truth: Sequence[ScanTruth], match_distance_m: float
) -> float:
    """Root of the mean squared distance [m] of matched tracks and targets; NaN without tracks."""
    if not tracks:
        return math.nan
    return score_continuity(tracks, truth, match_distance_m=match_distance_m).position_rmse_m


def combine_consistency(runs: Sequence[NormalisedErrors], n_scans: int) -> Consistency:
    """Combine the normalised squared errors of several runs of ``n_scans`` scans each.

    Errors of one run at different scans depend on each other, those of different runs do not:
    bounds hold scan by scan.

    Raises
    ------
    ValueError
        If the runs differ in dimension or gate.
    """
    kinds = {(run.dimension, run.threshold) for run in runs if len(run.squared)}
    if len(kinds) > 1:
        raise ValueError(f"dimension and threshold {sorted(kinds)}: allowed is one of each")
    dimension, threshold = kinds.pop() if kinds else (runs[0].dimension, runs[0].threshold)
    total, samples = np.zeros(n_scans), np.zeros(n_scans, dtype=np.int64)
    for run in runs:
        total += np.bincount(run.scan, run.squared, n_scans)
        samples += np.bincount(run.scan, minlength=n_scans)
    some = samples > 0
    lower, upper, per_scan = (np.full(n_scans, np.nan) for _ in range(3))
    per_scan[some] = total[some] / samples[some]
    lower[some], upper[some] = gated_bounds(dimension, samples[some], threshold)
    typical = (math.nan, math.nan)
    if some.any():
        median = int(np.median(samples[some]))
        low, high = gated_bounds(dimension, median, threshold)
        typical = (float(low), float(high))
    means = np.array([run.squared.mean() for run in runs if len(run.squared)])
    count = int(samples.sum())
    within = (per_scan >= lower) & (per_scan <= upper)
    return Consistency(
        mean=float(total.sum() / count) if count else math.nan,
        stderr=float(means.std(ddof=1) / math.sqrt(len(means))) if len(means) > 1 else math.nan,
        expected=gated_moments(dimension, threshold)[0],
        dimension=dimension,
        per_scan=per_scan,
        samples=samples,
        lower=lower,
        upper=upper,
        typical_lower=typical[0],
        typical_upper=typical[1],
        inside=float(within[some].mean()) if some.any() else math.nan,
    )
