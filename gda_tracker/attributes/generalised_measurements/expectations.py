"""Numerical expectations of covering functions, over densities that broadcast against them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gda_tracker.attributes.generalised_measurements.quadrature import gaussian_expectation
from gda_tracker.vocabulary.arrays import FloatArray, IntArray


def numerical_expectation(
    grade: Callable[[FloatArray], FloatArray],
    count: int,
    mean: FloatArray,
    covariance: FloatArray,
    tolerance: float,
) -> FloatArray:
    """Integrals (..., M) of mu(z) N(z; mean, covariance) dz by checked quadrature.

    Parameters
    ----------
    grade
        mu (..., M) at points (..., M or 1, d).
    count
        M.
    mean, covariance
        (..., M or 1, d), (..., M or 1, d, d).
    tolerance
        Absolute accuracy.

    Raises
    ------
    QuadratureError
        If it is not reached.
    """
    d = mean.shape[-1]
    shape = np.broadcast_shapes(mean.shape[:-1], covariance.shape[:-2], (count,))
    flat_mean = np.broadcast_to(mean, (*shape, d)).reshape(-1, d)
    flat_covariance = np.broadcast_to(covariance, (*shape, d, d)).reshape(-1, d, d)
    column = np.broadcast_to(np.arange(count), shape).reshape(-1)

    def picked(points: FloatArray, which: IntArray) -> FloatArray:
        return own_grades(grade, points, column[which], count)

    return gaussian_expectation(picked, flat_mean, flat_covariance, tolerance).reshape(shape)


def own_grades(
    grade: Callable[[FloatArray], FloatArray], points: FloatArray, column: IntArray, count: int
) -> FloatArray:
    """Grades (B, q) of function ``column`` (B,) at points (B, q, d); all M are worked out."""
    values = np.empty(points.shape[:-1])
    for m in range(count):
        rows = column == m
        if rows.any():
            values[rows] = grade(points[rows][:, :, None, :])[..., m]
    return values
