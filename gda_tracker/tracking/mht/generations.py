"""Generations: the hypothesis trees of the last scans, from which the past is told anew.

The trees are kept as one table per scan. A row is a node; its ``parent_id`` is the
``hypothesis_id`` of a row of the table before. So a past state is stored once, however many leaves
descend from it, and the revised past of a track is a walk from its chosen leaf.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.vocabulary.arrays import BoolArray, IntArray
from gda_tracker.vocabulary.scans import ScanKey


@dataclass(slots=True)
class Generation:
    """The nodes of one closed scan.

    ``settled`` (H,) marks the path of tracks that have ended since: nothing revises it any more.
    ``deleted_track_id`` and ``degraded`` are those of the scan.
    """

    key: ScanKey
    table: HypothesisTable
    settled: BoolArray
    deleted_track_id: IntArray
    degraded: bool


def ancestors(parent_id: IntArray, generations: Sequence[Generation]) -> list[IntArray]:
    """Walk back from nodes with the parents ``parent_id`` (L,).

    Returns
    -------
    list of (L,) arrays
        Row of the ancestor in each of the generations, in their order (oldest first), -1 before
        the track's start.
    """
    found: list[IntArray] = []
    for generation in reversed(generations):
        rows = rows_of(generation.table.hypothesis_id, parent_id)
        found.append(rows)
        if len(generation.table):
            parent_id = np.where(rows >= 0, generation.table.parent_id[rows], 0)
        else:
            parent_id = np.zeros(len(rows), dtype=np.int64)
    return found[::-1]


def settle(generations: Sequence[Generation], parent_id: IntArray) -> None:
    """Mark the paths that lead to nodes with these parents as settled."""
    for generation, rows in zip(generations, ancestors(parent_id, generations), strict=True):
        marked = generation.settled.copy()
        marked[rows[rows >= 0]] = True
        generation.settled = marked


def path(generations: Sequence[Generation], parent_id: IntArray) -> list[IntArray]:
    """Rows that tell the past, per generation.

    They are the ancestors of nodes with the parents ``parent_id`` (the chosen leaves) and what is
    settled: at most one row per track, by rising track id.
    """
    told = []
    for generation, rows in zip(generations, ancestors(parent_id, generations), strict=True):
        mask = generation.settled.copy()
        mask[rows[rows >= 0]] = True
        told.append(np.flatnonzero(mask))
    return told


def rows_of(identifiers: IntArray, wanted: IntArray) -> IntArray:
    """Rows of ``wanted`` (L,) in the rising ``identifiers`` (H,), -1 where absent."""
    if not len(identifiers):
        return np.full(len(wanted), -1, dtype=np.int64)
    place = np.minimum(np.searchsorted(identifiers, wanted), len(identifiers) - 1)
    return np.where(identifiers[place] == wanted, place, -1)
