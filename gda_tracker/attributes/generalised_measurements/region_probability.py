"""Probability that a standard normal pair lies in a region with straight edges.

With polar coordinates around the mean, the probability is the boundary integral of
(1 - exp(-r^2/2)) dphi / (2 pi). Along a line it is closed, by Owen's T function. Outside a region
the integral of dphi is zero; far outside, where the closed form would lose its digits to
cancellation, the rest is integrated numerically with a common factor taken out.
"""

from __future__ import annotations

import numpy as np
from scipy.special import erfc, owens_t

from gda_tracker.vocabulary.arrays import BoolArray, FloatArray

FAR = 1.0
"""Standard deviations outside a region from which on the tail is integrated."""


SMALL = 2.0
"""Extent of a polygon, times 1 + its distance, up to which it is integrated by triangles."""

_TWO_PI = 2.0 * np.pi
_X, _W = np.polynomial.legendre.leggauss(14)
_X, _W = 0.5 * (1.0 + _X), 0.5 * _W
# Gaussian tails beyond 40 times their scale do not count.
_PANELS = np.array([0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 40.0])


def log_region_probability(
    offset: FloatArray, start: FloatArray, end: FloatArray, turn_at_infinity: FloatArray
) -> FloatArray:
    """Log probability of a region, relative accuracy about 1e-12 far outside, else absolute 1e-15.

    Parameters
    ----------
    offset
        (..., E) signed distance of the mean from the line of each edge, positive to its left; the
        region lies to the left of its edges.
    start, end
        (..., E) where the edge begins and ends on its line, from the foot of the perpendicular;
        infinite for rays.
    turn_at_infinity
        (...) angle of the region's part of the horizon, over 2 pi.
    """
    distance = np.abs(offset)
    left, right = np.minimum(start, end), np.maximum(start, end)
    nearest = np.clip(0.0, left, right)
    gap = np.hypot(distance, nearest).min(axis=-1)
    turn = np.sign(offset) * (np.arctan2(end, distance) - np.arctan2(start, distance))
    outside = np.rint(turn_at_infinity + turn.sum(axis=-1) / _TWO_PI) == 0.0
    far: BoolArray = outside & (gap > FAR)
    logs = np.full(far.shape, -np.inf)
    near = ~far
    if near.any():
        edges = _enclosed(offset[near], end[near]) - _enclosed(offset[near], start[near])
        probability = turn_at_infinity[near] + edges.sum(axis=-1)
        with np.errstate(divide="ignore"):
            logs[near] = np.log(np.clip(probability, 0.0, 1.0))
    if far.any():
        logs[far] = _log_tail(offset[far], start[far], end[far], gap[far])
    return logs


def _enclosed(offset: FloatArray, along: FloatArray) -> FloatArray:
    """Integral of (1 - exp(-r^2/2)) dphi / (2 pi) from the foot to ``along``, signed by offset."""
    distance = np.abs(offset)
    infinite = np.isinf(along)
    ratio = np.where(infinite, 0.0, along) / np.where(distance > 0.0, distance, 1.0)
    tail = np.where(
        infinite,
        np.sign(along) * 0.25 * erfc(distance / np.sqrt(2.0)),
        owens_t(distance, ratio),
    )
    value = np.arctan2(along, distance) / _TWO_PI - tail
    return np.where(distance > 0.0, np.sign(offset) * value, 0.0)


def _log_tail(
    offset: FloatArray, start: FloatArray, end: FloatArray, gap: FloatArray
) -> FloatArray:
    """Log of -1/(2 pi) times the integral of exp(-r^2/2) dphi over edges (Q, E), r >= gap (Q,)."""
    total = np.zeros(len(offset))
    for sign in (1.0, -1.0):
        # Outward from the nearest point of the edge, along it and against it.
        low, high = (start, end) if sign > 0.0 else (-end, -start)
        begin = np.clip(0.0, low, high)
        room = high - begin
        scale = 1.0 / np.maximum(begin, 1.0)
        for first, last in zip(_PANELS[:-1], _PANELS[1:], strict=True):
            a, b = np.minimum(first * scale, room), np.minimum(last * scale, room)
            step = a[..., None] + (b - a)[..., None] * _X
            along = begin[..., None] + step
            squared = offset[..., None] ** 2 + along**2
            with np.errstate(under="ignore"):
                kernel = np.exp(-0.5 * (squared - (gap**2)[:, None, None])) / squared
            total -= (offset * (b - a) * (kernel @ _W)).sum(axis=-1)
    with np.errstate(divide="ignore"):
        return np.log(np.maximum(total, 0.0) / _TWO_PI) - 0.5 * gap**2


def log_small_polygon_probability(corner: FloatArray, arms: FloatArray) -> FloatArray:
    """Log probability (Q,) of small polygons by Gauss-Legendre over a fan of triangles.

    Exact to rounding, where the boundary integral would lose the digits that a small area has not.

    Parameters
    ----------
    corner
        (Q, 2) first vertex.
    arms
        (Q, V, 2) from it to all vertices, counter-clockwise; the longest times 1 plus the length of
        ``corner`` is below ``SMALL``.
    """
    one, two = arms[:, 1:-1], arms[:, 2:]
    twice_area = one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0]
    total = np.zeros(len(arms))
    for s, weight_s in zip(_X, _W, strict=True):
        for t, weight_t in zip(_X, _W, strict=True):
            # The square maps to the triangle by s (one + t (two - one)), Jacobian s.
            step = s * (one + t * (two - one))
            # |corner + step|^2 - |corner|^2
            gain = (step * (step + 2.0 * corner[:, None])).sum(axis=-1)
            total += weight_s * weight_t * s * (twice_area * np.exp(-0.5 * gain)).sum(axis=-1)
    with np.errstate(divide="ignore"):
        return np.asarray(
            np.log(np.maximum(total, 0.0) / _TWO_PI) - 0.5 * (corner * corner).sum(axis=-1)
        )
