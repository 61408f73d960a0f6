"""Distances of two sets of points: GOSPA with its three parts, and OSPA.

GOSPA: Rahmathullah, Garcia-Fernandez and Svensson 2017, "Generalized optimal sub-pattern assignment
metric", Definition 1 and Proposition 1 with alpha = 2, the only alpha for which the distance is a
sum over properly matched, missed and false points. OSPA: Schuhmacher, Vo and Vo 2008, "A consistent
metric for performance evaluation of multi-object filters", (3).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from gda_tracker.evaluation.matching import known_targets
from gda_tracker.vocabulary.arrays import FloatArray
from gda_tracker.vocabulary.scans import ScanTruth
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks

SQUARES = 2.0


@dataclass(frozen=True)
class SetDistance:
    """GOSPA and OSPA of one pair of sets.

    ``localisation``, ``missed`` and ``false`` [m^p] add up to ``gospa_m ** p``. Every missed and
    every false point costs c^p / 2.
    """

    gospa_m: float
    localisation: float
    missed: float
    false: float
    ospa_m: float


@dataclass(frozen=True)
class SetDistances:
    """GOSPA and OSPA of a run scan by scan; all arrays (K,), as in :class:`SetDistance`."""

    gospa_m: FloatArray
    localisation: FloatArray
    missed: FloatArray
    false: FloatArray
    ospa_m: FloatArray
    cutoff_m: float
    order: float


def set_distance(
    estimates_m: FloatArray, truth_m: FloatArray, cutoff_m: float, order: float = SQUARES
) -> SetDistance:
    """Compare a set of estimates with the set of true points.

    Parameters
    ----------
    estimates_m, truth_m
        (N, d) and (T, d) points [m], finite; N or T may be zero.
    cutoff_m
        c > 0 [m]: points farther apart do not belong together.
    order
        p >= 1.

    Raises
    ------
    ValueError
        If ``cutoff_m`` or ``order`` is not allowed, or a coordinate is not finite.

    Examples
    --------
    >>> set_distance(np.array([[1.0, 0.0]]), np.array([[0.0, 0.0], [10.0, 0.0]]), cutoff_m=10.0)
    ... # doctest: +ELLIPSIS
    SetDistance(gospa_m=7.14..., localisation=1.0, missed=50.0, false=0.0, ospa_m=7.10...)
    """
    _check(cutoff_m, order)
    estimates, truth = np.asarray(estimates_m, dtype=float), np.asarray(truth_m, dtype=float)
    if not (np.isfinite(estimates).all() and np.isfinite(truth).all()):
        raise ValueError("estimates_m and truth_m: allowed are finite coordinates")
    n, t = len(estimates), len(truth)
    most = max(n, t)
    if not min(n, t):
        # Without a pair every point is missed or false.
        missed, false = t * cutoff_m**order / 2.0, n * cutoff_m**order / 2.0
        distance = (missed + false) ** (1.0 / order)
        return SetDistance(distance, 0.0, missed, false, cutoff_m if most else 0.0)
    gap = np.linalg.norm(estimates[:, None, :] - truth[None, :, :], axis=2)
    cost = np.minimum(gap, cutoff_m) ** order
    row, column = linear_sum_assignment(cost)
    # A pair at the cut-off costs what one missed and one false point cost: it is no pair.
    near = gap[row, column] < cutoff_m
    localisation = float(cost[row, column][near].sum())
    pairs = int(near.sum())
    missed = (t - pairs) * cutoff_m**order / 2.0
    false = (n - pairs) * cutoff_m**order / 2.0
    gospa = (localisation + missed + false) ** (1.0 / order)
    ospa = ((localisation + (most - pairs) * cutoff_m**order) / most) ** (1.0 / order)
    return SetDistance(gospa, localisation, missed, false, ospa)


def score_set_distances(
    tracks: Sequence[Tracks],
    truth: Sequence[ScanTruth],
    cutoff_m: float,
    order: float = SQUARES,
) -> SetDistances:
    """Compare the positions of confirmed tracks with those of the known targets, scan by scan.

    Parameters
    ----------
    tracks, truth
        One entry per scan, in the same order. The truth must know all targets.
    cutoff_m, order
        As in :func:`set_distance`.

    Raises
    ------
    ValueError
        If the numbers of scans differ or an option is not allowed.
    """
    if len(tracks) != len(truth):
        raise ValueError(f"{len(tracks)} scans with tracks, {len(truth)} with truth: must be equal")
    _check(cutoff_m, order)
    found = np.zeros((len(tracks), 5))
    for scan, (live, known) in enumerate(zip(tracks, truth, strict=True)):
        d = set_distance(
            live.mean[live.status == CONFIRMED, :2],
            known.target_state[known_targets(known), :2],
            cutoff_m,
            order,
        )
        found[scan] = d.gospa_m, d.localisation, d.missed, d.false, d.ospa_m
    gospa, localisation, missed, false, ospa = found.T
    return SetDistances(gospa, localisation, missed, false, ospa, cutoff_m, order)


def _check(cutoff_m: float, order: float) -> None:
    if not 0.0 < cutoff_m < math.inf:
        raise ValueError(f"cutoff_m = {cutoff_m}: allowed is a number > 0 [m]")
    if not 1.0 <= order < math.inf:
        raise ValueError(f"order = {order}: allowed is a number >= 1")
