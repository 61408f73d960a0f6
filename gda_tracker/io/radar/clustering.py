"""Clusters: several detections of one object made one, at their centroid.

Points closer than a distance and of about the same range rate are linked; linked points form a
cluster (single linkage, i.e. DBSCAN with one point as core), found by a k-d tree and a connected
components search of scipy.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from gda_tracker.vocabulary.arrays import FloatArray, IntArray
from gda_tracker.vocabulary.scans import Detections


def cluster(
    detections: Detections,
    distance_m: float,
    range_rate_mps: float,
    minimum_points: int,
    extent_m: float,
    range_rate_std_mps: float,
    counts: Counter[str],
) -> Detections:
    """Return one detection per cluster.

    The position is the centroid. Its covariance over range, azimuth[, elevation][, range rate] is
    the mean of the points' spread over their number, and ``extent_m`` squared across and along: the
    centroid moves about on the object; the range rate has ``range_rate_std_mps`` squared on top.
    The radar cross sections of the known points add up (their echoes come from one object), further
    attributes are averaged over the known ones. Clusters of fewer than ``minimum_points`` are
    counted as ``small_cluster`` and left out.
    """
    n = len(detections.range_m)
    if n == 0:
        return detections
    xyz = _cartesian(detections)
    label, number = _labels(xyz, detections.range_rate_mps, distance_m, range_rate_mps)
    size = np.bincount(label, minlength=number)
    keep = size >= minimum_points
    if not keep.all():
        counts["small_cluster"] += int(size[~keep].sum())
    number_kept = int(np.count_nonzero(keep))
    place = np.full(number, -1)
    place[keep] = np.arange(number_kept)
    inside = place[label] >= 0
    rows, group = np.flatnonzero(inside), place[label][inside]
    count = size[keep].astype(np.float64)

    def mean(values: FloatArray) -> FloatArray:
        return np.bincount(group, weights=values[rows], minlength=number_kept) / count

    centre = np.stack([mean(column) for column in xyz.T], axis=1)
    ground = np.hypot(centre[:, 0], centre[:, 1])
    range_m = np.sqrt(ground**2 + centre[:, 2] ** 2)
    azimuth = np.arctan2(centre[:, 1], centre[:, 0])
    elevation = None if detections.elevation_rad is None else np.arctan2(centre[:, 2], ground)
    rate = None if detections.range_rate_mps is None else mean(detections.range_rate_mps)
    offset = None if detections.time_offset_s is None else mean(detections.time_offset_s)
    across = extent_m / np.maximum(range_m, 1e-3)
    columns = [(detections.range_m, range_m, extent_m**2), (None, azimuth, across**2)]
    if elevation is not None:
        columns.append((detections.elevation_rad, elevation, across**2))
    if rate is not None:
        columns.append((detections.range_rate_mps, rate, range_rate_std_mps**2))
    variances = []
    for values, centroid, extent in columns:
        if values is None:  # the azimuth, which turns over at pi
            turn = detections.azimuth_rad[rows] - centroid[group]
            deviation = np.pi - (np.pi - turn) % (2.0 * np.pi)
        else:
            deviation = values[rows] - centroid[group]
        spread = np.bincount(group, weights=deviation**2, minlength=number_kept) / count
        variances.append(spread / count + extent)
    covariance = np.zeros((number_kept, len(variances), len(variances)))
    diagonal = np.arange(len(variances))
    covariance[:, diagonal, diagonal] = np.stack(variances, axis=1)
    rcs, rcs_valid = _summed_rcs(detections, rows, group, number_kept)
    values, valid = _mean_attributes(detections, rows, group, number_kept)
    return replace(
        detections,
        range_m=range_m,
        azimuth_rad=azimuth,
        elevation_rad=elevation,
        range_rate_mps=rate,
        rcs_m2=rcs,
        rcs_valid=rcs_valid,
        range_std_m=None,
        azimuth_std_rad=None,
        elevation_std_rad=None,
        range_rate_std_mps=None,
        covariance=covariance,
        time_offset_s=offset,
        attribute_values=values,
        attribute_valid=valid,
    )


def _cartesian(detections: Detections) -> FloatArray:
    elevation = detections.elevation_rad
    up = np.zeros(len(detections.range_m)) if elevation is None else elevation
    ground = detections.range_m * np.cos(up)
    return np.stack(
        [
            ground * np.cos(detections.azimuth_rad),
            ground * np.sin(detections.azimuth_rad),
            detections.range_m * np.sin(up),
        ],
        axis=1,
    )


def _labels(
    xyz: FloatArray, range_rate: FloatArray | None, distance_m: float, range_rate_mps: float
) -> tuple[IntArray, int]:
    """Cluster of each point (n,), counted by first appearance, and their number."""
    pairs = cKDTree(xyz).query_pairs(distance_m, output_type="ndarray")
    if range_rate is not None and len(pairs):
        close = np.abs(range_rate[pairs[:, 0]] - range_rate[pairs[:, 1]]) < range_rate_mps
        pairs = pairs[close]
    n = len(xyz)
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    number, label = connected_components(links, directed=False)
    _, first = np.unique(label, return_index=True)
    rank = np.empty(number, dtype=np.int64)
    rank[np.argsort(first, kind="stable")] = np.arange(number)
    return rank[label], int(number)


def _summed_rcs(
    detections: Detections, rows: IntArray, group: IntArray, number: int
) -> tuple[FloatArray | None, np.ndarray | None]:
    if detections.rcs_m2 is None:
        return None, None
    valid = detections.rcs_valid
    known = np.ones(len(detections.range_m), bool) if valid is None else valid.astype(bool)
    weight = np.where(known, detections.rcs_m2, 0.0)[rows]
    total = np.bincount(group, weights=weight, minlength=number)
    any_known = np.bincount(group, weights=known[rows].astype(float), minlength=number) > 0
    return total, any_known


def _mean_attributes(
    detections: Detections, rows: IntArray, group: IntArray, number: int
) -> tuple[FloatArray | None, np.ndarray | None]:
    if detections.attribute_values is None:
        return None, None
    given = detections.attribute_values[:, rows]
    known = np.isfinite(given)
    if detections.attribute_valid is not None:
        known &= detections.attribute_valid[:, rows].astype(bool)
    values = np.zeros((len(given), number))
    valid = np.zeros((len(given), number), dtype=bool)
    for index, (row, sure) in enumerate(zip(given, known, strict=True)):
        count = np.bincount(group[sure], minlength=number)
        total = np.bincount(group[sure], weights=row[sure], minlength=number)
        values[index] = total / np.maximum(count, 1)
        valid[index] = count > 0
    return values, valid
