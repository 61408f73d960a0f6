"""The leaves of hypothesis trees as a problem of choice: tracks, contested detections, clusters."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from gda_tracker.association.errors import AssociationInputError, NoFeasibleHypothesis
from gda_tracker.vocabulary.arrays import FloatArray, IntArray

DROPPED = -1
"""Row of the leaf that stands for a dropped track."""

MAX_TABLE = 1 << 24
"""Largest table of flags that takes the place of sorting."""

MAX_LOG_SCORE = 1e9
"""Largest finite log score, by magnitude."""


@dataclass(frozen=True, slots=True)
class LeafProblem:
    """M leaves of T tracks in G clusters, ordered by track.

    ``row`` (M,) is the caller's row of each leaf, ``DROPPED`` where the leaf stands for dropping
    its track; ``log_score`` (M,); ``owner`` (M,) is the leaf's track, 0 to T - 1, ascending;
    ``start`` (T + 1,) where the leaves of each track begin. ``contested`` (M, N) has the
    detections that leaves of another track use as well, numbered from 0 to ``n_contested`` - 1,
    and -1 elsewhere; ``entry_track`` and ``entry_detection`` (E,) are the pairs of a track and a
    contested detection of its leaves, by track. ``cluster`` (T,) numbers the connected components
    by their first track.
    """

    row: IntArray
    log_score: FloatArray
    owner: IntArray
    start: IntArray
    contested: IntArray
    n_contested: int
    entry_track: IntArray
    entry_detection: IntArray
    cluster: IntArray
    n_clusters: int

    @property
    def n_tracks(self) -> int:
        """T."""
        return len(self.cluster)

    def best_leaf(self) -> IntArray:
        """First leaf of the highest score of each track (T,)."""
        top = np.maximum.reduceat(self.log_score, self.start[:-1])
        at_top = (self.log_score == top[self.owner]).nonzero()[0]
        owner = self.owner[at_top]
        first = np.ones(len(at_top), dtype=np.bool_)
        first[1:] = owner[1:] != owner[:-1]
        found: IntArray = at_top[first]
        return found

    def with_drops(self, tracks: IntArray, log_dropped: FloatArray) -> LeafProblem:
        """Return the problem with a leaf for dropping each of some tracks (C,).

        ``log_dropped`` (T,) is the log weight of dropping a track; those of -inf get no leaf.
        """
        tracks = tracks[log_dropped[tracks] > -np.inf]
        owner = np.concatenate([self.owner, tracks])
        order = owner.argsort(kind="stable")
        nothing = np.full((len(tracks), self.contested.shape[1]), -1)
        owner = owner[order]
        return replace(
            self,
            row=np.concatenate([self.row, np.full(len(tracks), DROPPED)])[order],
            log_score=np.concatenate([self.log_score, log_dropped[tracks]])[order],
            owner=owner,
            start=owner.searchsorted(np.arange(self.n_tracks + 1)),
            contested=np.concatenate([self.contested, nothing])[order],
        )


@dataclass(frozen=True, slots=True)
class CheckedLeaves:
    """The caller's arrays, checked: ``log_score`` (L,), ``track`` (L,), ``used`` (L, N).

    ``track_ids`` (T,) are the tracks, ascending, ``owner`` (L,) the index of each leaf's track
    among them, ``log_dropped`` (T,) the log weight of dropping each.
    """

    log_score: FloatArray
    owner: IntArray
    used: IntArray
    track_ids: IntArray
    log_dropped: FloatArray


def check_leaves(
    log_score: ArrayLike, track: ArrayLike, used: ArrayLike, log_dropped: ArrayLike
) -> CheckedLeaves:
    """Check the arguments of the public functions.

    Raises
    ------
    AssociationInputError
        For shapes that do not fit, scores or weights that are NaN, +inf or beyond
        ``MAX_LOG_SCORE``, and detections below -1.
    """
    score = np.asarray(log_score, dtype=np.float64)
    ids = np.asarray(track)
    detections = np.asarray(used)
    if score.ndim != 1:
        raise AssociationInputError(f"log_score has shape {score.shape}: allowed is (L,)")
    if ids.shape != score.shape:
        raise AssociationInputError(f"track has shape {ids.shape}: allowed is {score.shape}")
    if detections.ndim != 2 or len(detections) != len(score):
        raise AssociationInputError(
            f"used has shape {detections.shape}: allowed is ({len(score)}, N)"
        )
    for name, values in (("track", ids), ("used", detections)):
        if values.size and values.dtype.kind not in "iu":
            raise AssociationInputError(f"{name} has type {values.dtype}: allowed are integers")
    if detections.size and detections.min() < -1:
        raise AssociationInputError(
            f"used holds {detections.min()}: allowed are detection numbers >= 0, and -1 for none"
        )
    _check_weights("log_score", score)
    track_ids, owner = np.unique(ids.astype(np.int64), return_inverse=True)
    weight = np.asarray(log_dropped, dtype=np.float64)
    if weight.shape not in ((), track_ids.shape):
        raise AssociationInputError(
            f"log_dropped has shape {weight.shape}: allowed is one number, or one for each of the "
            f"{len(track_ids)} tracks"
        )
    _check_weights("log_dropped", weight)
    return CheckedLeaves(
        score,
        owner.astype(np.int64),
        detections.astype(np.int64),
        track_ids,
        np.broadcast_to(weight, track_ids.shape),
    )


def usable_problem(leaves: CheckedLeaves) -> LeafProblem:
    """Order the leaves by track and find contested detections and clusters.

    Leaves of log score -inf are left out. A track without any other can only be dropped.

    Raises
    ------
    NoFeasibleHypothesis
        If such a track's ``log_dropped`` is -inf.
    """
    problem = _problem(leaves)
    without = (np.diff(problem.start) == 0).nonzero()[0]
    if len(without) == 0:
        return problem
    if np.isneginf(leaves.log_dropped[without]).any():
        raise NoFeasibleHypothesis(
            f"track {leaves.track_ids[without[0]]} has only leaves of log score -inf, and "
            "log_dropped allows no dropping"
        )
    return problem.with_drops(without, leaves.log_dropped)


def _problem(leaves: CheckedLeaves) -> LeafProblem:
    allowed = (leaves.log_score > -np.inf).nonzero()[0]
    order = allowed[leaves.owner[allowed].argsort(kind="stable")]
    owner = leaves.owner[order]
    n_tracks = len(leaves.track_ids)
    contested, n_contested = _contested(owner, leaves.used[order], n_tracks)
    entry_track, entry_detection = _entries(owner, contested, n_tracks, n_contested)
    cluster, n_clusters = _components(entry_track, entry_detection, n_tracks, n_contested)
    return LeafProblem(
        order,
        leaves.log_score[order],
        owner,
        owner.searchsorted(np.arange(n_tracks + 1)),
        contested,
        n_contested,
        entry_track,
        entry_detection,
        cluster,
        n_clusters,
    )


def _contested(owner: IntArray, used: IntArray, n_tracks: int) -> tuple[IntArray, int]:
    """Contested detections per leaf (M, N), and their number; ``owner`` ascends."""
    flat = used.ravel()
    place = (flat >= 0).nonzero()[0]
    detection = flat[place]
    contested = np.full(used.shape, -1)
    if len(detection) == 0:
        return contested, 0
    lowest = int(detection.min())
    span = int(detection.max()) - lowest + 1
    if span <= 8 * len(detection) + 1024:  # numbers are dense enough for a table
        detection = detection - lowest
    else:
        values, detection = np.unique(detection, return_inverse=True)
        span = len(values)
    track = owner[place // used.shape[1]]
    # Of repeated indices the last one is assigned. Unused numbers stay unshared.
    first_track, last_track = np.full(span, n_tracks), np.full(span, -1)
    first_track[detection[::-1]] = track[::-1]
    last_track[detection] = track
    shared = first_track < last_track
    number = np.where(shared, shared.cumsum() - 1, -1)
    contested.ravel()[place] = number[detection]
    return contested, int(np.count_nonzero(shared))


def _entries(
    owner: IntArray, contested: IntArray, n_tracks: int, n_contested: int
) -> tuple[IntArray, IntArray]:
    """Pairs of a track and a contested detection of its leaves, each once, by track."""
    flat = contested.ravel()
    place = (flat >= 0).nonzero()[0]
    key = owner[place // max(contested.shape[1], 1)] * n_contested + flat[place]
    if n_tracks * n_contested <= MAX_TABLE:
        seen = np.zeros(n_tracks * n_contested, dtype=np.bool_)
        seen[key] = True
        key = seen.nonzero()[0]
    else:
        key = np.unique(key)
    track, detection = np.divmod(key, max(n_contested, 1))
    return track, detection


def _components(
    track: IntArray, detection: IntArray, n_tracks: int, n_detections: int
) -> tuple[IntArray, int]:
    """Connected component of each track (T,), numbered by first track, and their number.

    Labels fall to the lowest of any neighbour, and to the label of the label, until all agree.
    """
    label = np.arange(n_tracks)
    while True:
        current = label[track]
        lowest_at = np.full(n_detections, n_tracks)
        np.minimum.at(lowest_at, detection, current)
        lowest = lowest_at[detection]
        if (lowest == current).all():
            break
        np.minimum.at(label, track, lowest)
        np.minimum.at(label, current, lowest)
        label = label[label]
    first = label == np.arange(n_tracks)
    number = first.cumsum() - 1
    return number[label], int(np.count_nonzero(first))


def _check_weights(name: str, values: FloatArray) -> None:
    wrong = ~(np.abs(values) <= MAX_LOG_SCORE) & (values != -np.inf)  # True for NaN
    if wrong.any():
        raise AssociationInputError(
            f"{name} holds {values[wrong].flat[0]}: allowed are -inf and finite values of "
            f"magnitude up to {MAX_LOG_SCORE:g}"
        )
