"""Tracks that may have shared detections: what their leaves say together.

In a tree a leaf excludes others by the detections it has used. Where two tracks may be one group
that is not enough: a leaf that shares a detection needs the other track's leaf that shares it too,
and every two leaves that do not share one count 1 - P_u. So there is a log factor f for each two
leaves of coupled tracks, -inf for those that cannot both be true. The log weight of a global
hypothesis is the sum of the log scores of its leaves and of the factors of every two of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.mht.generations import rows_of
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray, empty_floats

MOST_TOGETHER = 3
"""Tracks that may be coupled with each other, directly or through others."""
EVEN = 1e-3
"""Two tracks part when the factors of their leaves differ by less, in logarithms."""


@dataclass(frozen=True, slots=True)
class Couplings:
    """K finite factors: ``log_factor`` (K,) of the hypotheses ``first``, ``second`` (K,), by id.

    Two leaves of tracks that have any factor between them, without one of their own, cannot both
    be true.
    """

    first: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    second: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    log_factor: FloatArray = field(default_factory=empty_floats)

    def __len__(self) -> int:
        return len(self.first)

    def renamed(self, old: IntArray, new: IntArray) -> Couplings:
        """Factors of the hypotheses that are left, ``old`` ids (H,), rising, under new ones."""
        first, second = rows_of(old, self.first), rows_of(old, self.second)
        kept = np.flatnonzero((first >= 0) & (second >= 0))
        return Couplings(new[first[kept]], new[second[kept]], self.log_factor[kept])


@dataclass(frozen=True, slots=True)
class CoupledTracks:
    """Factors (a, b) of all leaves of two tracks, ``first`` < ``second`` by rank of the track."""

    first: int
    second: int
    log_factor: FloatArray


def coupled_tracks(
    couplings: Couplings, hypothesis_id: IntArray, track: IntArray
) -> list[CoupledTracks]:
    """Factors of the leaves (H,) of a table, whose tracks have the ranks ``track`` (H,)."""
    one, two = rows_of(hypothesis_id, couplings.first), rows_of(hypothesis_id, couplings.second)
    known = np.flatnonzero((one >= 0) & (two >= 0))
    if not len(known):
        return []
    one, two = one[known], two[known]
    found = []
    begin, count = np.searchsorted(track, np.arange(track[-1] + 1)), np.bincount(track)
    pair = track[one] * len(count) + track[two]
    for key in np.unique(pair).tolist():
        a, b = divmod(key, len(count))
        mine = pair == key
        factor = np.full((count[a], count[b]), -np.inf)
        factor[one[mine] - begin[a], two[mine] - begin[b]] = couplings.log_factor[known[mine]]
        found.append(CoupledTracks(a, b, factor))
    return found


def of_leaves(
    coupled: Sequence[CoupledTracks], track: IntArray, keep: BoolArray, numbers: IntArray
) -> Couplings:
    """Couplings of the leaves that are kept, by their place among them.

    Two tracks whose factors no longer differ are coupled no more.

    Parameters
    ----------
    coupled
        Factors of all leaves.
    track
        (L,) rank of each leaf's track.
    keep
        (L,) which leaves stay.
    numbers
        (L, W) the detections that they have used, as they will be remembered.
    """
    if not coupled:
        return Couplings()
    place = np.cumsum(keep) - 1
    parts = []
    for pair in coupled:
        rows, columns = np.flatnonzero(track == pair.first), np.flatnonzero(track == pair.second)
        stay, stay_too = keep[rows], keep[columns]
        factor = pair.log_factor[np.ix_(stay, stay_too)]
        rows, columns = rows[stay], columns[stay_too]
        finite = factor > -np.inf
        if np.array_equal(finite, ~in_conflict(numbers[rows], numbers[columns])) and (
            not finite.any() or np.ptp(factor[finite]) < EVEN
        ):
            continue
        a, b = np.nonzero(finite)
        parts.append((place[rows[a]], place[columns[b]], factor[a, b]))
    if not parts:
        return Couplings()
    first, second, log_factor = (np.concatenate(part) for part in zip(*parts, strict=True))
    return Couplings(first, second, log_factor)


def in_conflict(one: IntArray, two: IntArray) -> BoolArray:
    """Which leaves (A, W) and (B, W) have used the same detection: (A, B)."""
    same = (one[:, None, :] == two[None, :, :]) & (one[:, None, :] >= 0)
    return np.asarray(same.any(axis=2), dtype=np.bool_)


def together(pairs: Sequence[tuple[int, int]], most: int = MOST_TOGETHER) -> list[bool]:
    """Which pairs of tracks are coupled, taken in their order, ``most`` in one component."""
    component: dict[int, set[int]] = {}
    taken = []
    for a, b in pairs:
        union = component.get(a, {a}) | component.get(b, {b})
        taken.append(len(union) <= most)
        if taken[-1]:
            for member in union:
                component[member] = union
    return taken


def components(pairs: Sequence[tuple[int, int]]) -> list[tuple[int, ...]]:
    """Ranks of the tracks that hang together by pairs of them."""
    found: list[set[int]] = []
    for a, b in pairs:
        touched = [part for part in found if a in part or b in part]
        found = [part for part in found if part not in touched]
        found.append({a, b}.union(*touched))
    return [tuple(sorted(part)) for part in found]


def held_rows(couplings: Couplings, count: int) -> BoolArray:
    """Which of ``count`` leaves are coupled: they are not merged with others."""
    held = np.zeros(count, dtype=np.bool_)
    held[couplings.first] = held[couplings.second] = True
    return held


def settle_couplings(
    table: HypothesisTable, couplings: Couplings, gone: BoolArray, taken: BoolArray
) -> BoolArray:
    """Let tracks end, ``gone`` (H,), whose leaves are coupled with others'.

    A partner keeps the leaves that can be true beside the one that was chosen of the track that
    ends, whatever they share with it, and their scores take the factor over.

    Parameters
    ----------
    table
        The leaves, with their places in the couplings as ids; scores are replaced.
    couplings
        Of the leaves.
    gone
        (H,) leaves of tracks that end.
    taken
        (H,) leaves that use a detection of these tracks' chosen leaves.

    Returns
    -------
    (H,) array
        Leaves that cannot be true any more.
    """
    one = rows_of(table.hypothesis_id, couplings.first)
    two = rows_of(table.hypothesis_id, couplings.second)
    known = (one >= 0) & (two >= 0)
    factor = couplings.log_factor[known]
    one, two = np.concatenate([one[known], two[known]]), np.concatenate([two[known], one[known]])
    factor = np.tile(factor, 2)
    partners = np.isin(table.track_id, table.track_id[two[gone[one]]])
    beside = gone[one] & table.chosen[one]
    possible = np.zeros(len(table), dtype=np.bool_)
    possible[two[beside]] = True
    scores = table.log_score.copy()
    np.add.at(scores, two[beside], factor[beside])
    table.log_score = scores
    return np.where(partners, ~possible, taken)
