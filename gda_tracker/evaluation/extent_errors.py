"""How well the ellipses of extended objects fit: the Gaussian Wasserstein distance."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from gda_tracker.evaluation.matching import Matches
from gda_tracker.kinematics.extended.ellipses import gaussian_wasserstein
from gda_tracker.vocabulary.arrays import FloatArray
from gda_tracker.vocabulary.scans import ScanTruth
from gda_tracker.vocabulary.tracks import Tracks


def extent_errors_m(
    tracks: Sequence[Tracks], truth: Sequence[ScanTruth], found: Matches
) -> FloatArray:
    """Distances [m] of matched tracks to the true ellipses, centre, size and direction in one.

    Of those targets that are extended and those tracks that know an extent.

    Parameters
    ----------
    tracks, truth
        One entry per scan.
    found
        From :func:`~gda_tracker.evaluation.matching.match_run` with the same tracks and truth.
    """
    rows = []
    for scan, track, target in zip(found.scan, found.track_row, found.target_row, strict=True):
        own, true = tracks[scan], truth[scan]
        if true.target_extent is None or not len(own.extent_weight):
            continue
        if np.linalg.det(true.target_extent[target]) > 0.0:
            rows.append(
                (
                    own.mean[track, :2],
                    own.extent[track],
                    true.target_state[target, :2],
                    true.target_extent[target],
                )
            )
    if not rows:
        return np.zeros(0)
    return gaussian_wasserstein(*(np.stack(part) for part in zip(*rows, strict=True)))


def extent_error_m(tracks: Sequence[Tracks], truth: Sequence[ScanTruth], found: Matches) -> float:
    """Mean of :func:`extent_errors_m`; NaN without any."""
    errors = extent_errors_m(tracks, truth, found)
    return float(errors.mean()) if len(errors) else math.nan
