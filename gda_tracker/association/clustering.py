"""Clusters: parts of the gate graph that share no hypothesis and no detection."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gda_tracker.vocabulary.arrays import FloatArray, Int32Array, IntArray

FEW_CLUSTERS = 8
"""Up to so many clusters, moderate ones are padded to one shape: calls cost more than zeros."""

MAX_PATTERN_PAIRS = 64
"""Clusters of so few gated pairs are kept for the next scan of the same pattern."""


@dataclass(frozen=True, slots=True)
class ClusterGroup:
    """B clusters padded to one shape, ``steps`` (larger side) by ``elements`` (smaller side).

    A node is a hypothesis h (number h), a detection j (number H + j) or padding (number H + n).
    Either side of a cluster may be its hypotheses; joint hypotheses are symmetric in the two
    sides.

    ``clusters`` (B,) are the indices of the clusters, ``sizes`` (B,) their true smaller sides.
    ``steps`` (B, S + 1) and ``elements`` (B, K) are nodes, ascending, then padding; the last step
    is always padding. ``pairs`` (p,) are their gated pairs, ``place`` the indices (slot, step,
    element) of each, (p,) each.
    """

    clusters: IntArray
    sizes: IntArray
    steps: IntArray
    elements: IntArray
    pairs: IntArray
    place: tuple[IntArray, IntArray, IntArray]

    @property
    def shape(self) -> tuple[int, int, int]:
        """(B, S, K)."""
        return len(self.clusters), self.steps.shape[1] - 1, self.elements.shape[1]

    def dense(self, values: FloatArray, fill: float) -> FloatArray:
        """Spread pair values (P,) to (B, S, K), ``fill`` outside the gate."""
        spread = np.empty(self.shape)
        spread.fill(fill)
        spread[self.place] = values[self.pairs]
        return spread

    def part(self, keep: IntArray) -> ClusterGroup:
        """Group of the clusters in the slots ``keep``, ascending."""
        slot, step, element = self.place
        moved = np.full(len(self.clusters), -1)
        moved[keep] = np.arange(len(keep))
        kept = (moved[slot] >= 0).nonzero()[0]
        return ClusterGroup(
            self.clusters[keep],
            self.sizes[keep],
            self.steps[keep],
            self.elements[keep],
            self.pairs[kept],
            (moved[slot[kept]], step[kept], element[kept]),
        )


@dataclass(frozen=True, slots=True)
class Clusters:
    """G clusters of P gated pairs, numbered by their first hypothesis, in groups of like size.

    ``pair_cluster`` (P,) is the cluster of each pair. Per cluster (G,): ``larger`` and ``smaller``
    side and the number of its pairs, ``pair_count``.
    """

    pair_cluster: Int32Array
    larger: IntArray
    smaller: IntArray
    pair_count: IntArray
    groups: tuple[ClusterGroup, ...]

    def __len__(self) -> int:
        return len(self.pair_count)


def gated_detections(detection: Int32Array, n_detections: int) -> tuple[IntArray, Int32Array]:
    """Detections inside any gate (D,), ascending, and the place of each pair's among them (P,)."""
    gated = np.zeros(n_detections, dtype=np.bool_)
    gated[detection] = True
    place = gated.cumsum(dtype=np.int32)
    place -= 1
    return gated.nonzero()[0], place[detection]


def find_clusters(
    hypothesis: Int32Array,
    detection: Int32Array,
    n_hypotheses: int,
    n_detections: int,
    padded_size: int = 4,
) -> Clusters:
    """Group gated pairs into clusters; the arrays of the result must not be changed.

    Small scans repeat a few patterns of gates, if only the gated detections are counted: their
    clusters are kept.

    Parameters
    ----------
    hypothesis, detection : (P,)
        Rows of each pair.
    n_hypotheses, n_detections : int
        Number of rows; those without a pair belong to no cluster.
    padded_size : int
        Clusters with a smaller side up to this may share a group. Larger ones share it only with
        those of the same smaller side.
    """
    rows: IntArray = hypothesis.astype(np.intp)
    columns: IntArray = detection.astype(np.intp)
    if len(rows) > MAX_PATTERN_PAIRS:
        return _find_clusters(rows, columns, n_hypotheses, n_detections, padded_size)
    return _known_clusters(
        rows.tobytes(), columns.tobytes(), n_hypotheses, n_detections, padded_size
    )


@lru_cache(maxsize=512)
def _known_clusters(
    rows: bytes, columns: bytes, n_hypotheses: int, n_detections: int, padded_size: int
) -> Clusters:
    clusters = _find_clusters(
        np.frombuffer(rows, dtype=np.intp),
        np.frombuffer(columns, dtype=np.intp),
        n_hypotheses,
        n_detections,
        padded_size,
    )
    arrays: list[NDArray[np.integer[Any]]] = [
        clusters.pair_cluster,
        clusters.larger,
        clusters.smaller,
        clusters.pair_count,
    ]
    for group in clusters.groups:
        arrays += [group.clusters, group.sizes, group.steps, group.elements, group.pairs]
        arrays += group.place
    for array in arrays:
        array.setflags(write=False)
    return clusters


def _find_clusters(
    rows: IntArray, columns: IntArray, n_hypotheses: int, n_detections: int, padded_size: int
) -> Clusters:
    if len(rows) == 0:
        none = np.zeros(0, dtype=np.int64)
        return Clusters(none.astype(np.int32), none, none, none, ())
    label = _component_labels(rows, columns, n_hypotheses, n_detections)[rows]
    used = np.zeros(n_hypotheses, dtype=np.intp)
    used[label] = 1
    number = used.cumsum() - 1
    count = int(number[-1]) + 1
    pair_cluster = number[label]

    # Sort the nodes by cluster, hypotheses before detections, nodes without a pair last.
    columns = columns + n_hypotheses
    part = np.full(n_hypotheses + n_detections, 2 * count)
    part[rows] = 2 * pair_cluster
    part[columns] = 2 * pair_cluster + 1
    order = part.argsort(kind="stable")
    size = np.bincount(part, minlength=2 * count + 1)
    first = size.cumsum() - size
    rank = np.empty_like(part)
    rank[order] = np.arange(len(part)) - first[part[order]]

    sizes = size[:-1].reshape(count, 2)
    swapped = (sizes[:, 1] > sizes[:, 0]).astype(np.intp)
    larger = np.maximum(sizes[:, 0], sizes[:, 1])
    smaller = np.minimum(sizes[:, 0], sizes[:, 1])
    turned = swapped[pair_cluster] == 1
    step = np.where(turned, rank[columns], rank[rows])
    element = np.where(turned, rank[rows], rank[columns])

    def nodes(clusters: IntArray, side: IntArray, length: IntArray, width: int) -> IntArray:
        """Nodes (B, width) of one side of each cluster, then padding."""
        offset = np.arange(width)
        found = order.take(first[2 * clusters + side, None] + offset, mode="clip")
        found[offset >= length[:, None]] = n_hypotheses + n_detections
        return found

    groups = []
    for clusters in _alike(smaller, padded_size if count <= FEW_CLUSTERS else min(2, padded_size)):
        if len(clusters) == count:
            pairs, slot = np.arange(len(rows)), pair_cluster
        else:
            slot_of = np.full(count, -1)
            slot_of[clusters] = np.arange(len(clusters))
            slot = slot_of[pair_cluster]
            pairs = (slot >= 0).nonzero()[0]
            slot = slot[pairs]
        long, short = larger[clusters], smaller[clusters]
        groups.append(
            ClusterGroup(
                clusters,
                short,
                nodes(clusters, swapped[clusters], long, max(long.tolist()) + 1),
                nodes(clusters, 1 - swapped[clusters], short, max(short.tolist())),
                pairs,
                (slot, step[pairs], element[pairs]),
            )
        )
    pair_count = np.bincount(pair_cluster, minlength=count)
    return Clusters(pair_cluster.astype(np.int32), larger, smaller, pair_count, tuple(groups))


def _alike(smaller: IntArray, padded_size: int) -> list[IntArray]:
    """Clusters by smaller side; those up to ``padded_size`` together."""
    kind = np.maximum(smaller, padded_size)
    if max(kind.tolist()) == padded_size:
        return [np.arange(len(kind))]
    present = np.bincount(kind).nonzero()[0]
    return [(kind == value).nonzero()[0] for value in present]


def _component_labels(
    rows: IntArray, columns: IntArray, n_hypotheses: int, n_detections: int
) -> IntArray:
    """Label (H,) of each hypothesis: the lowest hypothesis of its connected component.

    Labels fall along pairs, and to the label of the label, until no pair disagrees: the number of
    rounds grows like the logarithm of a component's diameter.
    """
    label = np.arange(n_hypotheses)
    while True:
        current = label[rows]
        lowest_at_column = np.empty(n_detections, dtype=np.intp)
        lowest_at_column[columns] = n_hypotheses
        np.minimum.at(lowest_at_column, columns, current)
        lowest = lowest_at_column[columns]
        if lowest.tobytes() == current.tobytes():
            return label
        np.minimum.at(label, rows, lowest)
        np.minimum.at(label, current, lowest)
        label = label[label]
