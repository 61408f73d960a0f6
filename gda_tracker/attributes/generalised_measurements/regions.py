"""Imprecise statements on a place: polygons, boxes, bearing sectors (Mahler 2011, (29))."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gda_tracker.attributes.generalised_measurements.covering import (
    CoveringFunction,
    frozen,
    frozen_finite,
)
from gda_tracker.attributes.generalised_measurements.gaussians import whiten
from gda_tracker.attributes.generalised_measurements.polygons import (
    clip,
    contains,
    cross,
    self_crossing,
    signed_area,
)
from gda_tracker.attributes.generalised_measurements.region_probability import (
    SMALL,
    log_region_probability,
    log_small_polygon_probability,
)
from gda_tracker.vocabulary.arrays import FloatArray

_TWO_PI = 2.0 * np.pi
# Standard deviations to which an infinite side is cut: beyond lies less than any double.
_INFINITE = 45.0


@dataclass(frozen=True, eq=False)
class Polygon(CoveringFunction):
    """M polygons in a plane (d = 2), edges included; they need not be convex.

    Parameters
    ----------
    vertices
        (M, V, 2) in either order; polygons of fewer vertices repeat one. They are kept in
        counter-clockwise order.

    Examples
    --------
    >>> harbour = Polygon([[[0.0, 0.0], [2000.0, 0.0], [2000.0, 1000.0], [0.0, 1000.0]]])
    >>> harbour([[500.0, 500.0], [500.0, 1500.0]]).tolist()
    [[1.0], [0.0]]
    """

    vertices: FloatArray

    def __post_init__(self) -> None:
        vertices = frozen_finite("vertices", self.vertices, None, None, 2)
        area = signed_area(vertices) if vertices.shape[1] else np.zeros(len(vertices))
        if (area == 0.0).any():
            raise ValueError("vertices: allowed are polygons of an area > 0")
        if self_crossing(vertices).any():
            raise ValueError("vertices: allowed are polygons whose edges do not cross")
        turned = np.where(area[:, None, None] > 0.0, vertices, vertices[:, ::-1])
        turned.flags.writeable = False
        object.__setattr__(self, "vertices", turned)

    @property
    def dimension(self) -> int:  # noqa: D102
        return 2

    def __len__(self) -> int:
        return len(self.vertices)

    def grade(self, points: FloatArray) -> FloatArray:  # noqa: D102
        return contains(self.vertices, points).astype(np.float64)

    def log_expectation(self, mean: FloatArray, covariance: FloatArray) -> FloatArray:  # noqa: D102
        return log_polygon_probability(self.vertices, mean, covariance)

    def average(self, low: FloatArray, high: FloatArray) -> FloatArray:  # noqa: D102
        lines = box_lines(low, high)
        parts = [clip(polygon, *lines) for polygon in self.vertices]
        area = np.array([float(signed_area(part)) if len(part) else 0.0 for part in parts])
        return np.asarray(area / float(np.prod(np.asarray(high) - np.asarray(low))))


@dataclass(frozen=True, eq=False)
class Box(CoveringFunction):
    """M boxes in a plane (d = 2), edges included, with sides along the axes.

    Parameters
    ----------
    low, high
        (M, 2) corners, which may be infinite: a strip, a half plane, a quadrant.
    """

    low: FloatArray
    high: FloatArray

    def __post_init__(self) -> None:
        low = frozen("low", self.low, None, 2)
        high = frozen("high", self.high, *low.shape)
        if (low > high).any() or np.isposinf(low).any() or np.isneginf(high).any():
            raise ValueError("low, high: allowed is low <= high, low not +inf, high not -inf")
        object.__setattr__(self, "low", low)
        object.__setattr__(self, "high", high)

    @property
    def dimension(self) -> int:  # noqa: D102
        return 2

    def __len__(self) -> int:
        return len(self.low)

    def grade(self, points: FloatArray) -> FloatArray:  # noqa: D102
        inside = (points >= self.low) & (points <= self.high)
        return np.asarray(inside.all(axis=-1).astype(np.float64))

    def log_expectation(self, mean: FloatArray, covariance: FloatArray) -> FloatArray:  # noqa: D102
        reach = _INFINITE * np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
        low = np.where(np.isneginf(self.low), np.minimum(mean, self.high) - reach, self.low)
        high = np.where(np.isposinf(self.high), np.maximum(mean, self.low) + reach, self.high)
        return log_polygon_probability(box_vertices(low, high), mean, covariance)

    def average(self, low: FloatArray, high: FloatArray) -> FloatArray:  # noqa: D102
        overlap = np.minimum(self.high, high) - np.maximum(self.low, low)
        return np.asarray(np.prod(np.maximum(overlap, 0.0) / (np.asarray(high) - low), axis=-1))


@dataclass(frozen=True, eq=False)
class Sector(CoveringFunction):
    """M bearing sectors in a plane (d = 2), edges included: all that is seen in an angle.

    Parameters
    ----------
    apex
        (M, 2) place of the sensor or observer.
    first_bearing_rad
        (M,) bearing of the right edge, counter-clockwise from the x axis.
    opening_rad
        (M,) angle of the sector, counter-clockwise from it, above 0 and up to 2 pi.
    """

    apex: FloatArray
    first_bearing_rad: FloatArray
    opening_rad: FloatArray

    def __post_init__(self) -> None:
        apex = frozen_finite("apex", self.apex, None, 2)
        first = frozen_finite("first_bearing_rad", self.first_bearing_rad, len(apex))
        opening = frozen_finite("opening_rad", self.opening_rad, len(apex))
        if not ((opening > 0.0) & (opening <= _TWO_PI)).all():
            raise ValueError("opening_rad: allowed are numbers > 0 and <= 2 pi")
        object.__setattr__(self, "apex", apex)
        object.__setattr__(self, "first_bearing_rad", first)
        object.__setattr__(self, "opening_rad", opening)

    @property
    def dimension(self) -> int:  # noqa: D102
        return 2

    def __len__(self) -> int:
        return len(self.apex)

    @property
    def directions(self) -> tuple[FloatArray, FloatArray]:
        """Unit vectors (M, 2) along the right and the left edge."""
        bearings = self.first_bearing_rad, self.first_bearing_rad + self.opening_rad
        right, left = (np.stack([np.cos(b), np.sin(b)], axis=-1) for b in bearings)
        return right, left

    def grade(self, points: FloatArray) -> FloatArray:  # noqa: D102
        arm = points - self.apex
        right, left = self.directions
        past_right, before_left = cross(right, arm) >= 0.0, cross(arm, left) >= 0.0
        inside = np.where(
            self.opening_rad <= np.pi, past_right & before_left, past_right | before_left
        )
        # At an opening of pi, or 2 pi, the two edges are one line.
        inside |= (self.opening_rad == _TWO_PI) | (arm == 0.0).all(axis=-1)
        return inside.astype(np.float64)

    def log_expectation(self, mean: FloatArray, covariance: FloatArray) -> FloatArray:  # noqa: D102
        right, left = self.directions
        (apex, right, left), _ = whiten(covariance, self.apex - mean, right, left)
        right = right / np.linalg.norm(right, axis=-1, keepdims=True)
        left = left / np.linalg.norm(left, axis=-1, keepdims=True)
        turn = np.arctan2(cross(right, left), (right * left).sum(axis=-1))
        # Whitening keeps the side of pi an opening is on; rounding may not.
        wide = self.opening_rad > np.pi
        turn = np.where(wide & (turn < 0.5 * np.pi), turn + _TWO_PI, turn)
        turn = np.where(~wide & (turn < -0.5 * np.pi), turn + _TWO_PI, turn)
        apex, right, left = np.broadcast_arrays(apex, right, left)
        along = [(apex * right).sum(axis=-1), -(apex * left).sum(axis=-1)]
        offset = [-cross(right, apex), cross(left, apex)]
        infinite = np.full(along[0].shape, np.inf)
        logs = log_region_probability(
            np.stack(offset, axis=-1),
            np.stack([along[0], -infinite], axis=-1),
            np.stack([infinite, along[1]], axis=-1),
            np.broadcast_to(turn, along[0].shape) / _TWO_PI,
        )
        return np.where(self.opening_rad == _TWO_PI, 0.0, logs)

    def average(self, low: FloatArray, high: FloatArray) -> FloatArray:  # noqa: D102
        box = box_vertices(np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64))
        area = np.empty(len(self))
        for row, (origins, directions) in enumerate(zip(*self.narrow_lines(), strict=True)):
            part = clip(box, origins, directions)
            area[row] = float(signed_area(part)) if len(part) else 0.0
        share = area / float(signed_area(box))
        return np.where(self.opening_rad > np.pi, 1.0 - share, share)

    def narrow_lines(self) -> tuple[FloatArray, FloatArray]:
        """Lines with the sector to their left, or what it leaves out if it is wider than pi.

        Returns origins and directions (M, 2, 2).
        """
        right, left = self.directions
        sign = np.where(self.opening_rad > np.pi, -1.0, 1.0)[:, None]
        return (
            np.stack([self.apex, self.apex], axis=1),
            np.stack([sign * right, -sign * left], axis=1),
        )


def annular_sector(
    apex: ArrayLike,
    first_bearing_rad: float,
    opening_rad: float,
    nearest_m: float,
    farthest_m: float,
    tolerance_m: float = 1.0,
) -> Polygon:
    """Bearing sector with limits in range, as one polygon.

    Its arcs are chords that are nowhere farther than ``tolerance_m`` from the circle.

    Parameters
    ----------
    apex
        (2,) place of the sensor or observer.
    first_bearing_rad, opening_rad
        Bearing of the right edge, counter-clockwise from the x axis, and opening, below 2 pi.
    nearest_m, farthest_m
        Limits in range, 0 <= nearest < farthest.
    tolerance_m
        Largest distance between chord and arc.
    """
    if not 0.0 < opening_rad < _TWO_PI:
        raise ValueError(f"opening_rad = {opening_rad}: allowed is a number > 0 and < 2 pi")
    if not 0.0 <= nearest_m < farthest_m < np.inf:
        raise ValueError(
            f"nearest_m = {nearest_m}, farthest_m = {farthest_m}: allowed is "
            "0 <= nearest_m < farthest_m"
        )
    if not tolerance_m > 0.0:
        raise ValueError(f"tolerance_m = {tolerance_m}: allowed is a number > 0")
    chord_rad = 2.0 * np.arccos(max(1.0 - tolerance_m / farthest_m, 0.0))
    chords = max(1, int(np.ceil(opening_rad / chord_rad)))
    bearing = first_bearing_rad + opening_rad * np.linspace(0.0, 1.0, chords + 1)
    arc = np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)
    inner = nearest_m * arc[::-1] if nearest_m > 0.0 else np.zeros((1, 2))
    return Polygon((np.asarray(apex) + np.concatenate([farthest_m * arc, inner]))[None])


def box_vertices(low: FloatArray, high: FloatArray) -> FloatArray:
    """Corners (..., 4, 2) of boxes, counter-clockwise."""
    low, high = np.broadcast_arrays(low, high)
    x, y = (low[..., 0], high[..., 0]), (low[..., 1], high[..., 1])
    corners = [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])]
    return np.stack([np.stack(corner, axis=-1) for corner in corners], axis=-2)


def box_lines(low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Origins and directions (4, 2) of lines with the finite box to their left."""
    vertices = box_vertices(np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64))
    return vertices, np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])


def log_polygon_probability(
    vertices: FloatArray, mean: FloatArray, covariance: FloatArray
) -> FloatArray:
    """Log probability (..., M) of counter-clockwise polygons (..., M, V, 2) under Gaussians."""
    first = vertices[..., :1, :]
    # Differences are taken before whitening: a small polygon may be far from the mean.
    (corner, arms, step), _ = whiten(
        covariance[..., None, :, :],
        first - mean[..., None, :],
        vertices - first,
        np.roll(vertices, -1, axis=-2) - vertices,
    )
    corner, arms, step = np.broadcast_arrays(corner, arms, step)
    whitened = corner + arms
    length = np.linalg.norm(step, axis=-1)
    direction = step / np.where(length > 0.0, length, 1.0)[..., None]
    start = (direction * whitened).sum(axis=-1)
    logs = log_region_probability(
        -cross(direction, whitened), start, start + length, np.zeros(whitened.shape[:-2])
    )
    extent = np.linalg.norm(arms, axis=-1).max(axis=-1)
    small = extent * (1.0 + np.linalg.norm(corner[..., 0, :], axis=-1)) < SMALL
    if small.any():
        logs[small] = log_small_polygon_probability(corner[small, 0], arms[small])
    return logs
