"""Track purity: whose detection did each track take? Tchamova et al. 2004, tables 14.4 to 14.9.

The chapter calls purity "the number of correct observation-target associations (in case of detected
target) over the total number of available observations during tracking scenario". Its rows add up
to one with ``missed`` and ``FA``, and every entry is k/1150 or k/1900: 50 runs times the 23 or 38
scans after the two of the initiation. So each of these scans counts once per track, whether the
target was detected or not, as one of: own detection, another target's, a false alarm, none
(missed). Scored is the association made on the scan itself, without hindsight.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gda_tracker.vocabulary.arrays import FloatArray, IntArray
from gda_tracker.vocabulary.scans import ScanTruth
from gda_tracker.vocabulary.tracks import Tracks


def confusion_counts(
    tracks: Sequence[Tracks],
    truth: Sequence[ScanTruth],
    track_ids: IntArray,
    target_ids: IntArray,
) -> IntArray:
    """Count what each track was given over the scored scans.

    Parameters
    ----------
    tracks, truth
        One entry per scored scan, in the same order; the truth names the source of each detection.
    track_ids
        (N,) the tracks to score. One that does not live on a scan missed it.
    target_ids
        (T,) the targets, in the order of the columns.

    Returns
    -------
    (N, T + 2) array
        Scans per track with a detection of each target, with none (missed), with a false alarm.

    Raises
    ------
    ValueError
        If the numbers of scans differ, a scan's truth does not name its sources or does not fit its
        tracks, or a detection comes from a target that is not in ``target_ids``.
    """
    if len(tracks) != len(truth):
        raise ValueError(f"{len(tracks)} scans with tracks, {len(truth)} with truth: must be equal")
    track_ids = np.asarray(track_ids, dtype=np.int64)
    target_ids = np.asarray(target_ids, dtype=np.int64)
    n_scans, n_tracks, n_targets = len(tracks), len(track_ids), len(target_ids)
    counts = np.zeros((n_tracks, n_targets + 2), dtype=np.int64)
    if not n_scans or not n_tracks:
        return counts

    sources, first_source = _all_sources(truth)
    lives = np.array([len(t) for t in tracks])
    scan = np.repeat(np.arange(n_scans), lives)
    live_id = np.concatenate([t.track_id for t in tracks])
    detection = np.concatenate([t.detection_index for t in tracks]).astype(np.int64)
    if np.any(detection >= np.diff(first_source)[scan]):
        raise ValueError("a track has a detection_index beyond the detections of its scan's truth")

    row, scored = _rank(live_id, track_ids)
    given = scored & (detection >= 0)
    source = sources[(first_source[scan] + detection)[given]]
    column, known = _rank(source, target_ids)
    if not np.all(known | (source < 0)):
        raise ValueError(
            f"source_id {source[~known & (source >= 0)][0]} in the truth: allowed are "
            f"{target_ids.tolist()} and -1"
        )
    column[source < 0] = n_targets + 1
    np.add.at(counts, (row[given], column), 1)
    counts[:, n_targets] = n_scans - counts.sum(axis=1)
    return counts


def confusion(counts: IntArray) -> FloatArray:
    """Shares of :func:`confusion_counts`: every row adds up to one (or is zero without scans)."""
    total = counts.sum(axis=-1, keepdims=True)
    return np.divide(counts, total, out=np.zeros(counts.shape), where=total > 0)


def purity(counts: IntArray) -> FloatArray:
    """Purity per track: the share of scans with the own detection.

    Parameters
    ----------
    counts
        (..., T, T + 2) with row i and column i for the same target.

    Returns
    -------
    (..., T) array
    """
    return np.diagonal(confusion(counts), axis1=-2, axis2=-1).copy()


def _all_sources(truth: Sequence[ScanTruth]) -> tuple[IntArray, IntArray]:
    """Sources of all scans in one array, and where each scan begins in it."""
    parts = []
    for entry in truth:
        if entry.source_id is None:
            raise ValueError(
                f"truth at stamp {entry.stamp_ns} ns: source_id of its detections is missing"
            )
        parts.append(np.asarray(entry.source_id, dtype=np.int64))
    begin = np.concatenate([[0], np.cumsum([len(part) for part in parts])]).astype(np.int64)
    return np.concatenate(parts), begin


def _rank(values: IntArray, allowed: IntArray) -> tuple[IntArray, np.ndarray]:
    """Position of each value in ``allowed``, and whether it is there."""
    if not len(allowed):
        return np.zeros(len(values), dtype=np.int64), np.zeros(len(values), dtype=bool)
    order = np.argsort(allowed, kind="stable")
    place = np.minimum(np.searchsorted(allowed, values, sorter=order), len(allowed) - 1)
    position = order[place]
    return position, allowed[position] == values
