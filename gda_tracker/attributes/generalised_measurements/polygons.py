"""Plane polygons: area, orientation, crossing edges, clipping by half planes."""

from __future__ import annotations

import numpy as np

from gda_tracker.vocabulary.arrays import BoolArray, FloatArray


def signed_area(vertices: FloatArray) -> FloatArray:
    """Areas (...) of polygons (..., V, 2), positive counter-clockwise."""
    from_first = vertices - vertices[..., :1, :]
    after = np.roll(from_first, -1, axis=-2)
    return 0.5 * cross(from_first, after).sum(axis=-1)


def cross(one: FloatArray, two: FloatArray) -> FloatArray:
    """Component along z of the cross product of plane vectors (..., 2)."""
    return np.asarray(one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0])


def self_crossing(vertices: FloatArray) -> BoolArray:
    """Whether two edges of a polygon (M, V, 2) cross, (M,); touching does not count."""
    start, end = vertices, np.roll(vertices, -1, axis=1)
    step = (end - start)[:, :, None]
    side_start = cross(step, start[:, None] - start[:, :, None])
    side_end = cross(step, end[:, None] - start[:, :, None])
    parted = side_start * side_end < 0.0
    return np.asarray((parted & parted.swapaxes(1, 2)).any(axis=(1, 2)))


def is_convex(vertices: FloatArray) -> bool:
    """Whether a counter-clockwise polygon (V, 2), free of crossings, never turns right."""
    step = np.roll(vertices, -1, axis=0) - vertices
    step = step[(step != 0.0).any(axis=1)]
    return bool((cross(step, np.roll(step, -1, axis=0)) >= 0.0).all())


def contains(vertices: FloatArray, points: FloatArray) -> BoolArray:
    """Whether polygons (..., V, 2) hold points (..., 2), their edges included."""
    start, end = vertices, np.roll(vertices, -1, axis=-2)
    step = end - start
    arm = points[..., None, :] - start
    side = cross(step, arm)
    along = (step * arm).sum(axis=-1)
    on_edge = (side == 0.0) & (along >= 0.0) & (along <= (step * step).sum(axis=-1))
    above_start = start[..., 1] > points[..., None, 1]
    above_end = end[..., 1] > points[..., None, 1]
    # A ray along +x meets an upward edge from its left, a downward one from its right.
    meets = (above_start != above_end) & np.where(above_end, side > 0.0, side < 0.0)
    return np.asarray(on_edge.any(axis=-1) | (meets.sum(axis=-1) % 2 == 1))


def clip(vertices: FloatArray, origins: FloatArray, directions: FloatArray) -> FloatArray:
    """Cut a polygon (V, 2) by half planes: what lies to the left of each line (K, 2), (K, 2).

    (Sutherland and Hodgman.) The parts of a polygon that falls apart stay joined by edges that run
    to and fro, which neither area nor probability notice.

    Returns
    -------
    array
        (V', 2), V' = 0 if nothing is left.
    """
    for origin, direction in zip(origins, directions, strict=True):
        if not len(vertices):
            break
        side = cross(np.broadcast_to(direction, vertices.shape), vertices - origin)
        after, side_after = np.roll(vertices, -1, axis=0), np.roll(side, -1)
        cuts = side * side_after < 0.0
        share = np.where(cuts, side / np.where(cuts, side - side_after, 1.0), 0.0)
        crossing = vertices + share[:, None] * (after - vertices)
        both = np.stack([vertices, crossing], axis=1).reshape(-1, 2)
        keep = np.stack([side >= 0.0, cuts], axis=1).reshape(-1)
        vertices = both[keep]
    return vertices
