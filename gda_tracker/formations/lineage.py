"""Which formation is which from scan to scan: beginnings, splits, mergers, ends.

Of the parts of a formation the one with most of its tracks goes on under its number, and of the
formations that become one the one that brings most tracks; equal ones by the lowest track. The
others are new, or are no more, and both sides keep the number of the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gda_tracker.vocabulary.arrays import IntArray


@dataclass(frozen=True, slots=True)
class Regrouping:
    """How P formations became C groups of tracks.

    ``continues`` (C,) the row of the formation that goes on in the group, -1: a new one. ``parent``
    (C,) of a new one the formation that most of its tracks were in, -1: none. ``joins`` (P,) the
    group that a formation was taken into that does not go on, -1: it goes on, or has no track left;
    ``ended`` (P,) which have none.
    """

    continues: IntArray
    parent: IntArray
    joins: IntArray
    ended: IntArray


def regroup(before: list[IntArray], after: list[IntArray]) -> Regrouping:
    """Find who continues whom.

    Parameters
    ----------
    before, after
        Track ids of the formations, and of the groups that are there now; no track stands twice
        on one side.

    Examples
    --------
    Tracks 1 2 3 and 4: the first loses 3, which joins 4.

    >>> found = regroup([np.array([1, 2, 3]), np.array([4])], [np.array([1, 2]), np.array([3, 4])])
    >>> found.continues, found.joins
    (array([0, 1]), array([-1, -1]))
    """
    # By rising lowest track, so that the first of equal ones has it.
    order = np.argsort(np.array([ids.min() for ids in before], dtype=np.int64), kind="stable")
    turn = np.argsort(np.array([ids.min() for ids in after], dtype=np.int64), kind="stable")
    shared = _shared([before[row] for row in order], [after[row] for row in turn])
    continues = np.full(len(after), -1, dtype=np.int64)
    parent, heir = continues.copy(), np.full(len(before), -1, dtype=np.int64)
    if shared.size:
        best = np.argmax(shared, axis=1)
        alive = shared.max(axis=1) > 0
        heir[order[alive]] = turn[best[alive]]
        heirs = np.where(alive[:, None] & (best[:, None] == np.arange(len(after))), shared, 0)
        going = heirs.max(axis=0) > 0
        continues[turn[going]] = order[np.argmax(heirs, axis=0)[going]]
        new = ~going & (shared.max(axis=0) > 0)
        parent[turn[new]] = order[np.argmax(shared, axis=0)[new]]
    goes_on = np.isin(np.arange(len(before)), continues)
    return Regrouping(
        continues,
        parent,
        np.where(goes_on, -1, heir),
        np.flatnonzero(heir < 0).astype(np.int64),
    )


def _shared(before: list[IntArray], after: list[IntArray]) -> IntArray:
    """Numbers of common tracks (P, C)."""
    found = np.zeros((len(before), len(after)), dtype=np.int64)
    if found.size:
        old, new = np.concatenate(before), np.concatenate(after)
        old_row = np.repeat(np.arange(len(before)), [len(ids) for ids in before])
        new_row = np.repeat(np.arange(len(after)), [len(ids) for ids in after])
        _, i, j = np.intersect1d(old, new, assume_unique=True, return_indices=True)
        np.add.at(found, (old_row[i], new_row[j]), 1)
    return found
