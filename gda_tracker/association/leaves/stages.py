"""Clusters laid out for dynamic programming: one track per step, detections as bits.

Steps run over all clusters of a batch at once. What a partial choice has to remember is which
*open* detections it has used: those that a later track of its cluster could still use.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import reverse_cuthill_mckee

from gda_tracker.association.leaves.problem import LeafProblem
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray

WordArray: TypeAlias = NDArray[np.uint64]

WORD = 64
"""Bits of a word."""

LARGE = 6
"""Clusters of more tracks than this are ordered by their neighbourhood."""

MAX_COMPARED = 2_000_000
"""Pairs of leaves of one track that the search for dominated leaves compares at most."""


@dataclass(frozen=True, slots=True)
class Stages:
    """O leaves of B clusters, ordered by step, cluster and falling score.

    ``clusters`` (B,); ``size`` (B,) tracks in each; ``tracks`` (B, K) the track of each step, -1
    beyond the size. ``leaf`` (O,) index of the leaf in the problem; ``log_score`` (O,);
    ``mask`` (W, O) its contested detections as bits; ``step`` and ``slot`` (O,). ``first`` and
    ``count`` (K, B) where the leaves of a step stand. ``open_after`` (W, K, B) the detections that
    later steps may use. ``bit`` (D,) is the bit of each contested detection, -1 in other clusters.
    """

    clusters: IntArray
    size: IntArray
    tracks: IntArray
    leaf: IntArray
    log_score: FloatArray
    mask: WordArray
    step: IntArray
    slot: IntArray
    first: IntArray
    count: IntArray
    open_after: WordArray
    bit: IntArray

    @property
    def n_steps(self) -> int:
        """K."""
        return len(self.first)

    def top(self) -> FloatArray:
        """Highest score of the leaves of each step and cluster (K, B), 0 where there is none."""
        highest = np.zeros(self.first.shape)
        some = self.count > 0
        highest[some] = self.log_score[self.first[some]]
        return highest

    def keep(self, kept: BoolArray) -> Stages:
        """Return the stages with some of the leaves (O,) only."""
        index = kept.nonzero()[0]
        step, slot = self.step[index], self.slot[index]
        mask = self.mask[:, index]
        first, count = _segments(step, slot, self.first.shape)
        return replace(
            self,
            leaf=self.leaf[index],
            log_score=self.log_score[index],
            mask=mask,
            step=step,
            slot=slot,
            first=first,
            count=count,
            open_after=_open_after(mask, step, slot, self.first.shape),
        )

    def part(self, slots: IntArray) -> tuple[Stages, IntArray]:
        """Return some of the clusters as a batch of their own, and which of the leaves it has."""
        steps = max(self.size[slots].tolist())
        moved = np.full(len(self.clusters), -1)
        moved[slots] = np.arange(len(slots))
        slot = moved[self.slot]
        own = slot >= 0
        fewer = replace(
            self,
            clusters=self.clusters[slots],
            size=self.size[slots],
            tracks=self.tracks[slots, :steps],
            first=self.first[:steps, slots],
            slot=slot,
        )
        return fewer.keep(own), own.nonzero()[0]


@dataclass(frozen=True, slots=True)
class Layout:
    """Places of tracks and contested detections within their clusters.

    ``rank`` (T,) is the step of each track; ``bit`` (D,) the number of each contested detection;
    ``n_bits`` (G,) how many each cluster has.
    """

    rank: IntArray
    bit: IntArray
    n_bits: IntArray


def make_layout(problem: LeafProblem) -> Layout:
    """Order the tracks of each cluster, neighbours together, so that few detections are open."""
    size = np.bincount(problem.cluster, minlength=problem.n_clusters)
    order = problem.cluster.argsort(kind="stable")
    large = size > LARGE
    if large.any():
        among = large[problem.cluster[problem.entry_track]]
        track, detection = problem.entry_track[among], problem.entry_detection[among]
        incidence = coo_matrix(
            (np.ones(len(track)), (track, detection)), (problem.n_tracks, problem.n_contested)
        ).tocsr()
        banded = reverse_cuthill_mckee((incidence @ incidence.T).tocsr(), symmetric_mode=True)
        order = banded[problem.cluster[banded].argsort(kind="stable")]
    rank = np.empty(problem.n_tracks, dtype=np.int64)
    rank[order] = np.arange(problem.n_tracks) - (size.cumsum() - size)[problem.cluster[order]]

    of_detection = np.empty(problem.n_contested, dtype=np.int64)
    of_detection[problem.entry_detection] = problem.cluster[problem.entry_track]
    n_bits = np.bincount(of_detection, minlength=problem.n_clusters)
    order = of_detection.argsort(kind="stable")
    bit = np.empty(problem.n_contested, dtype=np.int64)
    bit[order] = np.arange(problem.n_contested) - (n_bits.cumsum() - n_bits)[of_detection[order]]
    return Layout(rank, bit, n_bits)


def batches(layout: Layout, clusters: IntArray) -> list[IntArray]:
    """Clusters (C,) that are laid out together: all whose detections fit one word, others alone."""
    one_word = layout.n_bits[clusters] <= WORD
    together, alone = clusters[one_word], clusters[~one_word]
    return ([together] if len(together) else []) + list(alone[:, None])


def make_stages(problem: LeafProblem, clusters: IntArray, layout: Layout) -> Stages:
    """Lay out some clusters (B,), ascending."""
    rank, bit = layout.rank, layout.bit
    slot_of = np.full(problem.n_clusters, -1)
    slot_of[clusters] = np.arange(len(clusters))
    slot_of_track = slot_of[problem.cluster]
    among = (slot_of_track >= 0).nonzero()[0]
    size = np.bincount(slot_of_track[among], minlength=len(clusters))
    tracks = np.full((len(clusters), int(size.max(initial=0))), -1)
    tracks[slot_of_track[among], rank[among]] = among

    leaf = (slot_of_track[problem.owner] >= 0).nonzero()[0]
    step, slot = rank[problem.owner[leaf]], slot_of_track[problem.owner[leaf]]
    leaf = leaf[np.lexsort((-problem.log_score[leaf], slot, step))]
    step, slot = rank[problem.owner[leaf]], slot_of_track[problem.owner[leaf]]
    mask = _masks(problem.contested[leaf], bit, int(layout.n_bits[clusters].max()))
    shape = (tracks.shape[1], len(clusters))
    first, count = _segments(step, slot, shape)
    own = np.full(problem.n_contested, -1)
    used = problem.contested[leaf]
    used = used[used >= 0]
    own[used] = bit[used]
    return Stages(
        clusters,
        size,
        tracks,
        leaf,
        problem.log_score[leaf],
        mask,
        step,
        slot,
        first,
        count,
        _open_after(mask, step, slot, shape),
        own,
    )


def without_dominated(stages: Stages, k: int) -> Stages:
    """Leave out leaves that no one of the k best hypotheses needs.

    A leaf is dominated by another one of its track that uses no other contested detection than it
    does and scores no less. A hypothesis with a leaf that has k of those can be bettered k times.
    """
    count = stages.count[stages.step, stages.slot]
    first = stages.first[stages.step, stages.slot]
    place = np.arange(len(count)) - first
    # Leaves stand by falling score, so that only those before it can dominate one.
    compared = np.where(count * count <= MAX_COMPARED, place, 0)
    later = np.repeat(np.arange(len(count)), compared)
    earlier = first[later] + ragged_range(compared)
    inside = np.ones(len(later), dtype=np.bool_)
    for word in stages.mask:
        inside &= (word[earlier] & ~word[later]) == 0
    dominators = np.bincount(later[inside], minlength=len(count))
    return stages.keep(dominators < k)


def ragged_range(count: IntArray) -> IntArray:
    """0, 1, ... count[0] - 1, 0, 1, ... count[1] - 1, and so on."""
    end = count.cumsum()
    total = int(end[-1]) if len(end) else 0
    return np.arange(total) - np.repeat(end - count, count)


def _masks(contested: IntArray, bit: IntArray, n_bits: int) -> WordArray:
    """Contested detections (O, N) as words of bits (W, O)."""
    words = max(1, -(-n_bits // WORD))
    mask = np.zeros((words, len(contested)), dtype=np.uint64)
    place = np.append(bit, -1)[contested]  # -1 is the last one
    one = np.left_shift(np.uint64(1), (place % WORD).astype(np.uint64))
    for w in range(words):
        here = (place >= w * WORD) & (place < (w + 1) * WORD)
        np.bitwise_or.reduce(np.where(here, one, np.uint64(0)), axis=1, out=mask[w])
    return mask


def _segments(step: IntArray, slot: IntArray, shape: tuple[int, int]) -> tuple[IntArray, IntArray]:
    """Begin and number of the leaves of each step and cluster (K, B)."""
    count = np.bincount(step * shape[1] + slot, minlength=shape[0] * shape[1])
    first = count.cumsum() - count
    return first.reshape(shape), count.reshape(shape)


def _open_after(
    mask: WordArray, step: IntArray, slot: IntArray, shape: tuple[int, int]
) -> WordArray:
    """Detections (W, K, B) that later steps may use."""
    open_after = np.zeros((len(mask), *shape), dtype=np.uint64)
    if len(step) == 0:
        return open_after
    used = np.zeros((len(mask), shape[0] * shape[1]), dtype=np.uint64)
    place = step * shape[1] + slot
    begin = np.ones(len(place), dtype=np.bool_)
    begin[1:] = place[1:] != place[:-1]
    begins = begin.nonzero()[0]
    used[:, place[begins]] = np.bitwise_or.reduceat(mask, begins, axis=1)
    used = used.reshape(open_after.shape)
    later = np.bitwise_or.accumulate(used[:, ::-1], axis=1)[:, ::-1]
    open_after[:, :-1] = later[:, 1:]
    return open_after
