"""What track sets are worth: which targets they cover, and how undecided they are."""

from __future__ import annotations

import numpy as np
from scipy.special import chdtri

from gda_tracker.kinematics.set_valued.filter import squared_distances
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray
from gda_tracker.vocabulary.track_sets import TrackSetArray

COVERAGE_PROBABILITY = 0.99


def covering(
    sets: TrackSetArray, position_m: FloatArray, probability: float = COVERAGE_PROBABILITY
) -> BoolArray:
    """Which sets cover which targets.

    Parameters
    ----------
    sets
        N track sets.
    position_m
        (T, 2) true positions.
    probability
        A set covers a position if for one of its members the position lies in the ellipse about
        it that holds so much of the member's distribution.

    Returns
    -------
    (T, N)
    """
    targets, count = len(position_m), len(sets)
    if not count:
        return np.zeros((targets, 0), dtype=bool)
    gap = position_m[:, None] - sets.centroid[None, :, :2]
    repeated = np.tile(np.arange(count), targets)
    square = squared_distances(
        gap.reshape(-1, 2),
        sets.matrix[repeated, :2],
        sets.covariance[repeated, :2, :2],
    )
    found: BoolArray = square.reshape(targets, count) <= chdtri(2.0, 1.0 - probability)
    return found


def undecided(sets: TrackSetArray) -> BoolArray:
    """Which sets (N,) come of an association that is open.

    The set before may own several detections, or one that a set of another track may own too.
    """
    owners: dict[int, set[int]] = {}
    for row in range(len(sets)):
        for index in sets.may_own(row).tolist():
            owners.setdefault(index, set()).add(int(sets.track_id[row]))
    return np.array(
        [
            len(sets.may_own(row)) > 1
            or any(len(owners[index]) > 1 for index in sets.may_own(row).tolist())
            for row in range(len(sets))
        ],
        dtype=bool,
    )
