"""Life of a track: M-of-N confirmation and deletion by misses, on arrays."""

from __future__ import annotations

import numpy as np

from gda_tracker.vocabulary.arrays import BoolArray, IntArray
from gda_tracker.vocabulary.tracks import CONFIRMED, TENTATIVE

LONGEST_WINDOW = 60
NEVER = np.iinfo(np.int64).max


def hits_in_window(history: IntArray, window: int) -> IntArray:
    """Hits among the last ``window`` scans; ``history`` (N,) has the newest scan in bit 0."""
    recent = history & np.int64((1 << window) - 1)
    return ((recent[:, None] >> np.arange(window, dtype=np.int64)) & 1).sum(axis=1)


def confirmed(
    status: IntArray,
    history: IntArray,
    confirmation_hits: int,
    confirmation_scans: int,
    hits: IntArray | None = None,
) -> IntArray:
    """Return the status (N,) after M-of-N confirmation: M hits within the last N scans.

    ``hits`` (N,) are those of the window, where they have been counted already.
    """
    if (status == CONFIRMED).all():
        return status
    hits = hits_in_window(history, confirmation_scans) if hits is None else hits
    enough = hits >= confirmation_hits
    return np.where((status == CONFIRMED) | enough, CONFIRMED, TENTATIVE).astype(np.int64)


def ended(
    status: IntArray,
    history: IntArray,
    age_scans: IntArray,
    coasted_scans: IntArray,
    *,
    confirmation_hits: int,
    confirmation_scans: int,
    deletion_misses: int,
    tentative_deletion_misses: int,
    hits: IntArray | None = None,
) -> BoolArray:
    """Which tracks (N,) end.

    A confirmed track ends after ``deletion_misses`` scans in a row without a detection (0: never).
    A tentative one ends after ``tentative_deletion_misses`` (0: never), or as soon as it can no
    longer reach M hits within the N scans after its start. ``hits`` as of :func:`confirmed`.
    """
    if (status == CONFIRMED).all():
        return coasted_scans >= (deletion_misses or NEVER)
    limit = np.where(
        status == CONFIRMED, deletion_misses or NEVER, tentative_deletion_misses or NEVER
    )
    remaining = np.maximum(confirmation_scans - age_scans, 0)
    hits = hits_in_window(history, confirmation_scans) if hits is None else hits
    hopeless = hits + remaining < confirmation_hits
    return (coasted_scans >= limit) | ((status == TENTATIVE) & hopeless)
