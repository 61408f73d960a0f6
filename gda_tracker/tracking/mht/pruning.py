"""Pruning: the trees stay small, whatever comes.

Of the branches of a scan those stay that the N-scan decision leaves and that are probable enough,
a limited number per track and in all (:mod:`gda_tracker.association.leaf_pruning`); then leaves
that have become nearly the same are merged. The leaf of the best global hypothesis of every track
always stays, so that the next scan has a global hypothesis too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray


@dataclass(frozen=True, slots=True)
class Nearness:
    """When two leaves of a track are nearly the same.

    They have used the same detections on the last ``scans`` scans, the squared Mahalanobis distance
    of their states, by the covariance of the better one, is at most ``distance_squared``, and no
    class probability or mass differs by more than ``belief``.
    """

    scans: int
    distance_squared: float
    belief: float


def leaves_in_all(per_track: int, most: int, n_tracks: int) -> int:
    """Leaves per track so that ``n_tracks`` have ``most`` in all, one at least."""
    return max(1, min(per_track, most // max(n_tracks, 1)))


def merge(
    table: HypothesisTable, nearness: Nearness, held: BoolArray | None = None
) -> HypothesisTable:
    """Merge leaves that are nearly the same: the best one stays, with the sum of their weights.

    A leaf is compared with the best of those of its track that have used the same recent
    detections: the chosen one, else that of the highest score, else the first. Leaves that are
    ``held`` (H,) are left alone.
    """
    count = len(table)
    if count < 2:
        return table
    recent = table.detection_numbers[:, : nearness.scans]
    rank = np.where(table.chosen, np.inf, table.log_score)
    order = np.lexsort((-rank, *recent.T[::-1], table.track_id))
    keys = np.concatenate([table.track_id[:, None], recent], axis=1)[order]
    new = np.ones(count, dtype=np.bool_)
    new[1:] = (keys[1:] != keys[:-1]).any(axis=1)
    first = np.flatnonzero(new)
    if len(first) == count:
        return table
    best = np.empty(count, dtype=np.int64)
    best[order] = order[first][np.cumsum(new) - 1]
    rows = np.flatnonzero(best != np.arange(count))
    if held is not None:
        rows = rows[~(held[rows] | held[best[rows]])]
    rows = rows[_near(table, rows, best[rows], nearness)]
    if not len(rows):
        return table
    merged = table.copy()
    merged.log_score = table.log_score.copy()
    # Of several near one leaf the order of rows is the order of the sums.
    np.logaddexp.at(merged.log_score, best[rows], table.log_score[rows])
    kept = np.ones(count, dtype=np.bool_)
    kept[rows] = False
    return merged.select(kept)


def _near(
    table: HypothesisTable, rows: np.ndarray, best: np.ndarray, nearness: Nearness
) -> BoolArray:
    """Which of the leaves ``rows`` are near those in ``best``, in state and belief."""
    gap = table.mean[rows] - table.mean[best]
    solved = np.linalg.solve(table.covariance[best], gap[:, :, None])[:, :, 0]
    near: BoolArray = (gap * solved).sum(axis=1) <= nearness.distance_squared
    beliefs: tuple[FloatArray, ...] = (table.class_probability, table.masses)
    for values in beliefs:
        near &= (np.abs(values[rows] - values[best]) <= nearness.belief).all(axis=1)
    return near
