"""Mixtures of what is known of extents and rates, as one density with their moments.

Where a track takes several cells, each as far as it is probable, its extent is a mixture of inverse
Wishart densities, its rate one of Gamma densities. One of the same kind takes its place, with the
mixture's mean and its variance (of the extent: that of all elements together).
"""

from __future__ import annotations

import numpy as np

from gda_tracker.vocabulary.arrays import FloatArray, IntArray


def merge_extents(
    share: FloatArray, row: IntArray, extent: FloatArray, weight: FloatArray, count: int
) -> tuple[FloatArray, FloatArray]:
    """Merge P inverse Wishart densities into ``count``, by ``row`` (P,).

    Parameters
    ----------
    share
        (P,) probabilities, which sum to one for each row.
    extent, weight
        (P, d, d) means [m2] and (P,) weights a = nu - d - 1 > 2 of the densities.

    Returns
    -------
    extent, weight
        (count, d, d) and (count,).

    Notes
    -----
    Of one density with mean X the variances of all elements sum to
    v(a) = ((a + 2) |X|^2 + a tr(X)^2) / ((a + 1)(a - 2)), |X| the Frobenius norm.
    """
    mean = np.zeros((count, *extent.shape[1:]))
    np.add.at(mean, row, share[:, None, None] * extent)
    square, trace = _norms(extent)
    own = ((weight + 2.0) * square + weight * trace) / ((weight + 1.0) * (weight - 2.0))
    own += np.sum((extent - mean[row]) ** 2, axis=(1, 2))
    variance = np.bincount(row, share * own, minlength=count)
    square, trace = _norms(mean)
    # v(a) = variance, solved for a: a quadratic equation with one root above 2.
    half = 0.5 * (variance + square + trace)
    root = np.sqrt(half**2 + 2.0 * variance * (variance + square))
    return mean, (half + root) / variance


def _norms(extent: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Squared Frobenius norm (N,) and squared trace (N,)."""
    square: FloatArray = np.sum(extent**2, axis=(1, 2))
    return square, np.trace(extent, axis1=1, axis2=2) ** 2


def merge_rates(
    share: FloatArray, row: IntArray, shape: FloatArray, rate: FloatArray, count: int
) -> tuple[FloatArray, FloatArray]:
    """Merge P Gamma densities (``shape``, ``rate``) into ``count``, by mean and variance."""
    mean = np.bincount(row, share * shape / rate, minlength=count)
    each = shape / rate**2 + (shape / rate - mean[row]) ** 2
    variance = np.bincount(row, share * each, minlength=count)
    new_rate = mean / variance
    return mean * new_rate, new_rate
