"""Which detections belong together: partitions by distance, a bounded number of them.

Detections closer than a threshold are joined, and so on along chains (single linkage). Each
threshold makes one partition; a few thresholds make the few worth looking at, from many small cells
to few large ones (Granstroem, Lundquist and Orguner, "Extended target tracking using a Gaussian
mixture PHD filter", 2012, distance partitioning).
"""

from __future__ import annotations

import numpy as np

from gda_tracker.vocabulary.arrays import FloatArray, IntArray

MAX_DETECTIONS = 5000
"""The distances of all pairs are held at once: 100 MB."""


def distance_partitions(
    positions: FloatArray, least_m: float, largest_m: float, most: int = 8
) -> IntArray:
    """Partitions of n detections at thresholds from ``least_m`` to ``largest_m``.

    Parameters
    ----------
    positions
        (n, d) [m], whatever the distance is to be taken in.
    least_m, largest_m
        Below the first, detections are always joined; beyond the second never [m].
    most
        Partitions returned at most, >= 1: where the thresholds make more, those that last over the
        largest ranges of thresholds.

    Returns
    -------
    (K, n) cell of each detection, numbered from 0 by first appearance; the finest partition first.
    No two are alike; of no detections there is one partition.

    Raises
    ------
    ValueError
        If a position is not finite, there are too many detections, or an argument is not allowed.
    """
    if not 0.0 < least_m <= largest_m < np.inf:
        raise ValueError(
            f"least_m = {least_m}, largest_m = {largest_m}: allowed is 0 < least_m <= largest_m"
        )
    if most < 1:
        raise ValueError(f"most = {most}: allowed is an integer >= 1")
    if not np.isfinite(positions).all():
        raise ValueError("positions: allowed are finite numbers")
    n = len(positions)
    if n > MAX_DETECTIONS:
        raise ValueError(f"{n} detections: allowed are {MAX_DETECTIONS} at most")
    if n < 2:
        return np.zeros((1, n), dtype=np.int64)
    # Slow to import, and needed for extended objects alone.
    from scipy.cluster.hierarchy import fcluster, linkage

    tree = linkage(positions, method="single")
    inner = tree[(tree[:, 2] > least_m) & (tree[:, 2] <= largest_m), 2]
    # From each edge on, its own joins are made; the partition lasts until the next edge.
    edges = np.unique(np.append(inner, least_m))
    lasts = np.diff(np.append(edges, largest_m))
    chosen = np.sort(np.argsort(-lasts, kind="stable")[:most])
    return np.array([by_appearance(fcluster(tree, edge, "distance")) for edge in edges[chosen]])


def by_appearance(label: IntArray) -> IntArray:
    """The same cells, numbered in the order in which they appear."""
    _, first, inverse = np.unique(label, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[inverse.reshape(-1)]
