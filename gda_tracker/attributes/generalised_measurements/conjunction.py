"""Pointwise minimum of covering functions, where it has a closed form."""

from __future__ import annotations

import numpy as np

from gda_tracker.attributes.generalised_measurements.covering import (
    CoveringFunction,
    frozen,
)
from gda_tracker.attributes.generalised_measurements.fuzzy import Everything
from gda_tracker.attributes.generalised_measurements.polygons import clip, is_convex
from gda_tracker.attributes.generalised_measurements.regions import (
    Box,
    Polygon,
    Sector,
    box_vertices,
)
from gda_tracker.attributes.generalised_measurements.scalars import PiecewiseLinear
from gda_tracker.vocabulary.arrays import FloatArray


def minimum(one: CoveringFunction, two: CoveringFunction) -> CoveringFunction | None:
    """Minimum of M functions with M others, ``None`` where no closed form is known.

    Known are piecewise linear functions of a scalar, two boxes, a polygon with a finite box, with a
    convex polygon or with a sector no wider than pi, and anything with everything.
    """
    if isinstance(one, Everything):
        return two
    if isinstance(two, Everything):
        return one
    if isinstance(one, PiecewiseLinear) and isinstance(two, PiecewiseLinear):
        return one.minimum(two)
    if isinstance(one, Box) and isinstance(two, Box):
        return _boxes(one, two)
    for subject, other in ((one, two), (two, one)):
        lines = _lines(other)
        if isinstance(subject, Polygon) and lines is not None:
            return _clipped(subject, *lines)
    return None


class _Clipped(Polygon):
    """What clipping left of M polygons: of area zero where nothing is left.

    Edges may run to and fro, so that the checks of the base class do not hold.
    """

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices", frozen("vertices", self.vertices, None, None, 2))


def _lines(region: CoveringFunction) -> tuple[FloatArray, FloatArray] | None:
    """Origins and directions (M, K, 2) of lines with a convex region to their left, if it has."""
    if isinstance(region, Box) and np.isfinite(region.low).all() and np.isfinite(region.high).all():
        origins = box_vertices(region.low, region.high)
        directions = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
        return origins, np.broadcast_to(directions, origins.shape)
    if isinstance(region, Sector) and (region.opening_rad <= np.pi).all():
        return region.narrow_lines()
    if isinstance(region, Polygon) and all(is_convex(polygon) for polygon in region.vertices):
        return region.vertices, np.roll(region.vertices, -1, axis=1) - region.vertices
    return None


def _clipped(subject: Polygon, origins: FloatArray, directions: FloatArray) -> Polygon:
    pieces = [
        clip(polygon, *lines)
        for polygon, *lines in zip(subject.vertices, origins, directions, strict=True)
    ]
    longest = max([3, *(len(piece) for piece in pieces)])
    vertices = np.zeros((len(pieces), longest, 2))
    for row, piece in enumerate(pieces):
        if len(piece):
            # A polygon of fewer vertices repeats its last one.
            vertices[row] = piece[np.minimum(np.arange(longest), len(piece) - 1)]
    return _Clipped(vertices)


def _boxes(one: Box, two: Box) -> Box:
    low, high = np.maximum(one.low, two.low), np.minimum(one.high, two.high)
    apart = (low > high).any(axis=-1, keepdims=True)
    # Boxes without a common point: a box of area zero.
    return Box(np.where(apart, 0.0, low), np.where(apart, 0.0, high))
