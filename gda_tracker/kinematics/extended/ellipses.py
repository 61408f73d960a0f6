"""Ellipses as symmetric positive definite matrices: roots, axes, outlines, distances."""

from __future__ import annotations

import numpy as np

from gda_tracker.vocabulary.arrays import FloatArray


def symmetric_power(matrix: FloatArray, exponent: float) -> FloatArray:
    """Power (..., d, d) of symmetric positive definite matrices, symmetric itself.

    Raises
    ------
    ValueError
        If a matrix is not positive definite (for exponents >= 0: not positive semidefinite, up to
        rounding).
    """
    value, vector = np.linalg.eigh(matrix)
    slack = -1e-12 * np.abs(value[..., -1:]) if exponent >= 0.0 else 0.0
    bad = ~(value >= slack) if exponent >= 0.0 else ~(value > 0.0)
    if bad.any():
        raise ValueError(f"eigenvalue {value[bad].min()}: allowed are positive definite matrices")
    power = np.maximum(value, 0.0) ** exponent
    return (vector * power[..., None, :]) @ np.swapaxes(vector, -1, -2)


def semi_axes(extent: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Semi-axes and orientation of the ellipses y' X^-1 y = 1 in the plane.

    Parameters
    ----------
    extent
        (..., 2, 2) X [m2].

    Returns
    -------
    length, orientation
        (..., 2) semi-axes [m], the longer first, and (...) direction of the longer one [rad],
        counter-clockwise from x, in (-pi/2, pi/2]; 0 for a circle.
    """
    xx, xy, yy = extent[..., 0, 0], extent[..., 0, 1], extent[..., 1, 1]
    middle, half = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    length = np.sqrt(np.stack([middle + half, np.maximum(middle - half, 0.0)], axis=-1))
    return length, 0.5 * np.arctan2(2.0 * xy, xx - yy)


def extent_of(length: FloatArray, orientation: FloatArray) -> FloatArray:
    """Matrix (..., 2, 2) of ellipses with semi-axes (..., 2) and orientation (...) [rad]."""
    axis = rotation(orientation)
    squares = np.asarray(length, dtype=np.float64) ** 2
    return (axis * squares[..., None, :]) @ np.swapaxes(axis, -1, -2)


def rotation(angle: FloatArray | float) -> FloatArray:
    """Rotation matrices (..., 2, 2), counter-clockwise [rad]."""
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.stack([np.stack([cosine, -sine], axis=-1), np.stack([sine, cosine], axis=-1)], -2)


def outline(centre: FloatArray, extent: FloatArray, points: int = 64) -> FloatArray:
    """Closed polygon (points + 1, 2) of the ellipse about ``centre`` (2,)."""
    turn = np.linspace(0.0, 2.0 * np.pi, points + 1)
    return centre + np.stack([np.cos(turn), np.sin(turn)], axis=1) @ symmetric_power(extent, 0.5)


def gaussian_wasserstein(
    centre: FloatArray, extent: FloatArray, other_centre: FloatArray, other_extent: FloatArray
) -> FloatArray:
    """Gaussian Wasserstein distance (...) [m] of ellipses.

    Parameters
    ----------
    centre, other_centre
        (..., d) [m].
    extent, other_extent
        (..., d, d) [m2], squares of semi-axes along their axes.

    Notes
    -----
    d^2 = |m1 - m2|^2 + tr(X1 + X2 - 2 (X1^1/2 X2 X1^1/2)^1/2): the distance of Givens and Shortt,
    for ellipses recommended by Yang, Baum and Granstroem, "Metrics for performance evaluation of
    elliptic extended object tracking methods", 2016. Two circles about one centre have
    the distance sqrt(d) times the difference of their radii.
    """
    root = symmetric_power(extent, 0.5)
    cross = symmetric_power(root @ other_extent @ root, 0.5)
    trace = np.trace(extent + other_extent - 2.0 * cross, axis1=-2, axis2=-1)
    gap: FloatArray = np.sum((centre - other_centre) ** 2, axis=-1)
    return np.sqrt(gap + np.maximum(trace, 0.0))
