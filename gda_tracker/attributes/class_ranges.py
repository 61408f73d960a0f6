"""What a measured number says of classes that are known by ranges: trapezoids a <= b <= c <= d.

Two readings of a range, for an estimate z with a standard deviation s:

``ranges``
    The range says what the class *can* do. The likelihood is generalised, the best that any value
    of the range makes of the estimate: sup_r g(r) exp(-(z - r)^2 / (2 s^2)), g the grade of
    membership. It is 1 for whatever lies within, and for an estimate that says nothing (s large);
    a class can be excluded, and none is preferred for being narrow.
``densities``
    The range says what the class *does*: its values are spread with the density g / area. The
    likelihood is the integral of N(z; r, s^2) g(r) / area over r, a density of z [1/unit].

>>> corners = np.array([[0.0, 0.0, 90.0, 100.0], [60.0, 80.0, 250.0, 300.0]])
>>> np.exp(log_possibility(np.array([70.0]), np.array([1.0]), corners)).round(3).tolist()
[[1.0, 0.505]]
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from gda_tracker.vocabulary.arrays import FloatArray

RANGES, DENSITIES = "ranges", "densities"
_ROOT_TWO_PI = np.sqrt(2.0 * np.pi)
_TINY = np.finfo(np.float64).tiny


def log_possibility(value: FloatArray, std: FloatArray, corners: FloatArray) -> FloatArray:
    """Log of sup_r g(r) exp(-(z - r)^2 / (2 s^2)).

    Parameters
    ----------
    value, std
        (n,) estimates and their standard deviations > 0.
    corners
        (K, 4) a <= b <= c <= d of each class.

    Returns
    -------
    array
        (n, K), at most 0. On a rise of width w from a the best value is u above a with u (u - e) =
        s^2, e = z - a, where that is on the rise, else its upper end.
    """
    a, b, c, d = corners.T
    z, s = value[:, None], std[:, None]
    rising = _log_side(z - a, b - a, s)
    falling = _log_side(d - z, d - c, s)
    return np.where(z < b, rising, np.where(z > c, falling, 0.0))


def _log_side(inside: FloatArray, width: FloatArray, std: FloatArray) -> FloatArray:
    """Log possibility before the upper end of a rise; ``inside`` is how far behind its foot."""
    root = np.sqrt(inside * inside + 4.0 * std * std)
    # Of the two forms of the root of the quadratic the one that does not cancel.
    best = np.where(
        inside >= 0.0,
        0.5 * (inside + root),
        2.0 * std * std / np.maximum(root - inside, _TINY),
    )
    best = np.minimum(best, width)
    grade = np.where(width > 0.0, best / np.where(width > 0.0, width, 1.0), 1.0)
    return np.asarray(
        np.log(np.maximum(grade, _TINY)) - 0.5 * ((inside - best) / std) ** 2, dtype=np.float64
    )


def mean_grade(value: FloatArray, std: FloatArray, corners: FloatArray) -> FloatArray:
    """Mean of the grade of membership over N(z, s^2), (n, K); arguments as above, a < d."""
    a, b, c, d = corners.T
    z, s = value[:, None], std[:, None]
    # Mirrored where the estimate lies in the upper half, so that the tails do not cancel.
    upper = z > 0.5 * (b + c)
    z = np.where(upper, -z, z)
    low, high = np.where(upper, -d, a), np.where(upper, -c, b)
    low_2, high_2 = np.where(upper, -b, c), np.where(upper, -a, d)
    return np.maximum(_mean_rise(z, s, low, high) - _mean_rise(z, s, low_2, high_2), 0.0)


def _mean_rise(z: FloatArray, s: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Mean over N(z, s^2) of what rises from 0 at ``low`` to 1 at ``high``."""
    width = high - low
    steep = width <= 0.0
    gained = _mean_excess(z - low, s) - _mean_excess(z - high, s)
    return np.where(steep, ndtr((z - low) / s), gained / np.where(steep, 1.0, width))


def _mean_excess(x: FloatArray, s: FloatArray) -> FloatArray:
    """Mean of the positive part of N(x, s^2)."""
    return np.asarray(x * ndtr(x / s) + s * np.exp(-0.5 * (x / s) ** 2) / _ROOT_TWO_PI)


def areas(corners: FloatArray) -> FloatArray:
    """Areas (K,) of trapezoids of height one."""
    a, b, c, d = corners.T
    return np.asarray(0.5 * (d - a + c - b))


def log_density(value: FloatArray, std: FloatArray, corners: FloatArray) -> FloatArray:
    """Log of the integral of N(z; r, s^2) g(r) / area over r, (n, K) [log 1/unit].

    Arguments as in :func:`log_possibility`, a < d. As a density of z it integrates to one.
    """
    density = mean_grade(value, std, corners) / areas(corners)
    return np.log(np.maximum(density, _TINY))
