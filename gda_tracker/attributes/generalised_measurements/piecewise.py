"""Integrals of piecewise linear functions against standard normal densities, tails included."""

from __future__ import annotations

import numpy as np
from scipy.special import erfcx

from gda_tracker.vocabulary.arrays import FloatArray

_SQRT_TWO = np.sqrt(2.0)
_PEAK = 1.0 / np.sqrt(2.0 * np.pi)
_X, _W = np.polynomial.legendre.leggauss(12)
_X, _W = 0.5 * (1.0 + _X), 0.5 * _W


def log_normal_integral(knots: FloatArray, grades: FloatArray) -> FloatArray:
    """Log of the integral of g(u) exp(-u^2/2) / sqrt(2 pi) du, g piecewise linear.

    The closed form by differences of the normal cumulative probability and of the density, scaled
    by the nearest point where g is positive, so that no tail underflows; pieces so short that the
    differences would cancel are integrated by Gauss-Legendre, exact to rounding there.

    Parameters
    ----------
    knots
        (..., K) nondecreasing; two equal ones make a jump.
    grades
        (..., K) values of g >= 0 at the knots; before the first and after the last g is constant.

    Returns
    -------
    array
        (...), -inf where g is zero.
    """
    shape = np.broadcast_shapes(knots.shape, grades.shape)
    border = (*shape[:-1], 1)
    u = np.concatenate(
        [np.full(border, -np.inf), np.broadcast_to(knots, shape), np.full(border, np.inf)], axis=-1
    )
    grades = np.broadcast_to(grades, shape)
    g = np.concatenate([grades[..., :1], grades, grades[..., -1:]], axis=-1)
    start, end, first, last = u[..., :-1], u[..., 1:], g[..., :-1], g[..., 1:]
    # The grade at the mean, for pieces that hold it, which are cut there.
    with np.errstate(invalid="ignore", divide="ignore"):
        middle = first + (last - first) * (-start / (end - start))
    middle = np.where((first == last) | ~((start < 0.0) & (end > 0.0)), first, middle)
    zero = np.zeros_like(start)
    right = (
        np.maximum(start, zero),
        np.maximum(end, zero),
        np.where(start < 0.0, middle, first),
        last,
    )
    left = (
        np.maximum(-end, zero),
        np.maximum(-start, zero),
        np.where(end > 0.0, middle, last),
        first,
    )
    near_to, far_to, near_grade, far_grade = (
        np.concatenate(pieces, axis=-1) for pieces in zip(right, left, strict=True)
    )
    return _outward_pieces(near_to, far_to, near_grade, far_grade)


def _outward_pieces(
    near: FloatArray, far: FloatArray, near_grade: FloatArray, far_grade: FloatArray
) -> FloatArray:
    """Log of the sum over pieces (..., N) from near >= 0 to far >= near, grades at both ends."""
    counts = (far > near) & ((near_grade > 0.0) | (far_grade > 0.0))
    nearest = np.where(counts, near, np.inf).min(axis=-1, keepdims=True)
    some = np.isfinite(nearest)
    nearest = np.where(some, nearest, 0.0)
    # What does not count must not overflow.
    near = np.where(counts, near, nearest)
    far = np.where(counts, far, nearest)
    with np.errstate(under="ignore"):
        at_near = np.exp(-0.5 * (near - nearest) * (near + nearest))
        at_far = np.exp(-0.5 * (far - nearest) * (far + nearest))
        zeroth = 0.5 * (at_near * erfcx(near / _SQRT_TWO) - at_far * erfcx(far / _SQRT_TWO))
        first = _PEAK * (at_near - at_far) - near * zeroth
        width = far - near
        short = width * np.maximum(near, 1.0) < 1.0
        if short.any():
            small, base = width[short], near[short]
            step = small[:, None] * _X
            density = _PEAK * at_near[short][:, None] * np.exp(-step * (base[:, None] + 0.5 * step))
            zeroth[short] = small * (density @ _W)
            first[short] = small * ((density * step) @ _W)
    # Ramps end at a finite place; constant pieces have no slope.
    slope = np.where(
        near_grade == far_grade, 0.0, (far_grade - near_grade) / np.where(width > 0.0, width, 1.0)
    )
    pieces = np.where(counts, near_grade * zeroth + slope * first, 0.0)
    total = np.maximum(pieces, 0.0).sum(axis=-1)
    with np.errstate(divide="ignore"):
        log_total = np.log(total) - 0.5 * nearest[..., 0] ** 2
    return np.where(some[..., 0], log_total, -np.inf)
