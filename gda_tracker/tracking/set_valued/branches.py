"""The table of living track sets."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from gda_tracker.kinematics.set_valued.filter import TrackSets
from gda_tracker.kinematics.set_valued.positions import STATE_SIZE
from gda_tracker.tracking.set_valued.parameters import MEMORY_SCANS
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray

# In the memory of a set: a scan without a detection, and one before the set began.
MISSED, NOT_BORN = -1, -2
NO_DETECTION = -1


@dataclass(slots=True)
class Branches:
    """N track sets, each a branch of its track; a row each.

    ``branch_id`` (N,) is 0 where none has been given yet; ``parent_id`` names the set before.
    ``leads`` (N,) names the one set that speaks for its track.
    ``memory`` (N, MEMORY_SCANS) holds the serial numbers of the detections of the last scans, the
    newest last. ``detection`` (N,) is the row in the scan, ``may_own`` (N, s) all rows that the
    predicted set may own. ``score`` (N,) is a log likelihood ratio, stamps are in ns.
    """

    sets: TrackSets
    track_id: IntArray
    branch_id: IntArray
    parent_id: IntArray
    confirmed: BoolArray
    leads: BoolArray
    score: FloatArray
    memory: IntArray
    detection: IntArray
    may_own: BoolArray
    hits: IntArray
    misses: IntArray
    coasted: IntArray
    first_ns: IntArray
    last_ns: IntArray

    def __len__(self) -> int:
        return len(self.track_id)

    def select(self, rows: IntArray | BoolArray) -> Branches:
        """Return the rows given."""
        columns = {f.name: getattr(self, f.name)[rows] for f in fields(self) if f.name != "sets"}
        return Branches(sets=self.sets.select(rows), **columns)

    def joined(self, other: Branches) -> Branches:
        """Return these rows and then those of ``other``, of the same scan."""
        columns = {
            f.name: np.concatenate([getattr(self, f.name), getattr(other, f.name)])
            for f in fields(self)
            if f.name != "sets"
        }
        return Branches(sets=self.sets.joined(other.sets), **columns)

    def by_track(self) -> Branches:
        """Return the rows by rising track id, what leads first, then the better score."""
        return self.select(np.lexsort((-self.score, ~self.leads, self.track_id)))

    def rank(self) -> IntArray:
        """Return the place (N,) of each row in its track, from 0; sorted by :meth:`by_track`."""
        new = np.ones(len(self), dtype=bool)
        new[1:] = self.track_id[1:] != self.track_id[:-1]
        row = np.arange(len(self))
        return row - np.maximum.accumulate(np.where(new, row, 0))


def no_branches(detections: int = 0) -> Branches:
    """An empty table for a scan of so many detections."""
    return new_branches(
        TrackSets(
            np.zeros((0, STATE_SIZE)),
            np.zeros((0, STATE_SIZE, STATE_SIZE)),
            np.zeros((0, STATE_SIZE, STATE_SIZE)),
        ),
        np.zeros(0, dtype=np.int64),
        np.zeros(0, dtype=np.int64),
        np.zeros(0, dtype=np.int64),
        detections,
        0,
    )


def new_branches(
    sets: TrackSets,
    track_id: IntArray,
    detection: IntArray,
    serial: IntArray,
    detections: int,
    stamp_ns: int,
) -> Branches:
    """Return sets that begin with the detections given, each a track of its own."""
    n = len(sets)
    memory = np.full((n, MEMORY_SCANS), NOT_BORN, dtype=np.int64)
    memory[:, -1] = serial
    may_own = np.zeros((n, detections), dtype=bool)
    may_own[np.arange(n), detection] = True
    stamps = np.full(n, stamp_ns, dtype=np.int64)
    none = np.zeros(n, dtype=np.int64)
    return Branches(
        sets=sets,
        track_id=track_id,
        branch_id=none.copy(),
        parent_id=none.copy(),
        confirmed=np.zeros(n, dtype=bool),
        leads=np.ones(n, dtype=bool),
        score=np.zeros(n),
        memory=memory,
        detection=detection.astype(np.int64),
        may_own=may_own,
        hits=np.ones(n, dtype=np.int64),
        misses=none.copy(),
        coasted=none.copy(),
        first_ns=stamps,
        last_ns=stamps.copy(),
    )


def remembering(memory: IntArray, newest: IntArray | int) -> IntArray:
    """Return the memory with one more scan."""
    memory = np.roll(memory, -1, axis=1)
    memory[:, -1] = newest
    return memory


def with_ids(branches: Branches, first_new_id: int) -> Branches:
    """Give ids: a set that is the only successor of the one before keeps its id.

    ``branch_id`` is that of the set before, or 0; new ones count from ``first_new_id``.
    """
    before = branches.branch_id
    _, inverse, count = np.unique(before, return_inverse=True, return_counts=True)
    keeps = (count[inverse.ravel()] == 1) & (before != 0)
    ids = before.copy()
    ids[~keeps] = first_new_id + np.arange(np.count_nonzero(~keeps))
    return replace(branches, branch_id=ids, parent_id=before)
