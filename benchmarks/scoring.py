"""Scores of one run: the same for every tracker, from tracks and truth alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from gda_tracker.evaluation.continuity import score_continuity
from gda_tracker.vocabulary.scans import ScanTruth
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks


def ospa_m(tracks: Tracks, truth: ScanTruth, cutoff_m: float) -> float:
    """OSPA distance of order 1 between confirmed tracks and targets of one scan [m].

    Schuhmacher, Vo, Vo 2008, (3): the smallest sum of distances, cut off at ``cutoff_m``, plus the
    cutoff for each track or target too many, over the larger of both numbers.
    """
    live = tracks.mean[tracks.status == CONFIRMED][:, :2]
    targets = truth.target_state[:, :2]
    larger = max(len(live), len(targets))
    if not larger:
        return 0.0
    gap = targets[:, None, :] - live[None, :, :]
    distance = np.minimum(np.hypot(gap[..., 0], gap[..., 1]), cutoff_m)
    row, column = linear_sum_assignment(distance)
    unpaired = larger - min(len(live), len(targets))
    return float((distance[row, column].sum() + cutoff_m * unpaired) / larger)


def score_scene(
    tracks: Sequence[Tracks],
    truth: Sequence[ScanTruth],
    *,
    cutoff_m: float = 1000.0,
    skip_scans: int = 5,
) -> dict[str, Any]:
    """Score a run on a scene whose truth is complete.

    The first ``skip_scans`` scans, in which tracks are still being confirmed, do not count.
    """
    tracks, truth = tracks[skip_scans:], truth[skip_scans:]
    continuity = score_continuity(tracks, truth, match_distance_m=cutoff_m)
    live = sum(int(np.count_nonzero(t.status == CONFIRMED)) for t in tracks)
    matched = int(continuity.matched.sum())
    pairs = list(zip(tracks, truth, strict=True))
    return {
        "ospa_m": float(np.mean([ospa_m(*pair, cutoff_m) for pair in pairs])),
        "rmse_m": continuity.position_rmse_m,
        "missed_percent": 100.0 * (1.0 - continuity.completeness),
        "false_percent": 100.0 * (live - matched) / max(live, 1),
        "switches": continuity.identity_switches,
        "flips": continuity.identity_flips,
        "tracks": continuity.confirmed_tracks,
    }


def score_recording(
    tracks: Sequence[Tracks], truth: Sequence[ScanTruth], match_distance_m: float = 25.0
) -> dict[str, Any]:
    """Score a run on a recording whose truth knows only some of the objects."""
    continuity = score_continuity(
        tracks, truth, match_distance_m=match_distance_m, truth_is_partial=True
    )
    per_target = zip(continuity.target_id, continuity.completeness_per_target, strict=True)
    return {
        "completeness": {str(target): float(share) for target, share in per_target},
        "switches": continuity.identity_switches,
        "flips": continuity.identity_flips,
        "rmse_m": continuity.position_rmse_m,
        "tracks": continuity.confirmed_tracks,
    }
