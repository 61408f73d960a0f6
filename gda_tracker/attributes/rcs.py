"""Radar cross sections as random variables: the Swerling models (Tchamova et al. 2004, 14.3.1).

Swerling 1 and 2 are exponential, 3 and 4 are gamma distributed with shape 2; the pairs differ only
in how fast the target fluctuates, which plays no part from scan to scan. With shape k and mean a
the density is ``(k/a)^k s^(k-1) exp(-k s/a)``, for k = 1 and 2 the two densities of the chapter.

>>> round(float(cumulative_probability(4.0, 4.0, 3)), 4)    # 1 - 3 exp(-2)
0.594
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import gammainc, gammaincinv, xlogy

from gda_tracker.vocabulary.arrays import FloatArray


def gamma_shape(swerling: ArrayLike) -> FloatArray:
    """Shape of the gamma distribution of a Swerling model: 1 for models 1 and 2, 2 for 3 and 4.

    Raises
    ------
    ValueError
        For a number that is not a Swerling model.
    """
    model = np.asarray(swerling)
    if not ((model >= 1) & (model <= 4) & (model % 1 == 0)).all():
        raise ValueError(f"swerling = {np.array(swerling).tolist()}: allowed are 1, 2, 3, 4")
    return np.where(model >= 3, 2.0, 1.0)


def log_density(rcs_m2: ArrayLike, mean_rcs_m2: ArrayLike, swerling: ArrayLike) -> FloatArray:
    """Log of the density of the RCS, the arguments broadcast against each other.

    Parameters
    ----------
    rcs_m2
        Where to evaluate it [m2]; -inf below zero.
    mean_rcs_m2
        Mean RCS [m2], > 0.
    swerling
        Swerling model, 1 to 4.

    Returns
    -------
    array
        Log density [log 1/m2].
    """
    rcs_m2 = np.asarray(rcs_m2, dtype=np.float64)
    shape = gamma_shape(swerling)
    rate = shape / np.asarray(mean_rcs_m2, dtype=np.float64)
    value = log_gamma_density(np.maximum(rcs_m2, 0.0), shape, rate)
    return np.where(rcs_m2 < 0.0, -np.inf, value)


def log_gamma_density(rcs_m2: FloatArray, shape: FloatArray, rate: FloatArray) -> FloatArray:
    """Log density [log 1/m2] at ``rcs_m2`` >= 0 for shape 1 or 2 and rate = shape/mean [1/m2]."""
    # xlogy: at s = 0 the exponential density is 1/a, the density of shape 2 is 0.
    return np.asarray(shape * np.log(rate) + xlogy(shape - 1.0, rcs_m2) - rate * rcs_m2)


def density(rcs_m2: ArrayLike, mean_rcs_m2: ArrayLike, swerling: ArrayLike) -> FloatArray:
    """Density of the RCS [1/m2]; arguments as in :func:`log_density`."""
    return np.exp(log_density(rcs_m2, mean_rcs_m2, swerling))


def cumulative_probability(
    rcs_m2: ArrayLike, mean_rcs_m2: ArrayLike, swerling: ArrayLike
) -> FloatArray:
    """Probability that the RCS is at most ``rcs_m2``; arguments as in :func:`log_density`."""
    shape = gamma_shape(swerling)
    scaled = np.maximum(np.asarray(rcs_m2, dtype=np.float64), 0.0) * shape / np.asarray(mean_rcs_m2)
    return np.asarray(gammainc(shape, scaled), dtype=np.float64)


def inverse_cumulative_probability(
    probability: ArrayLike, mean_rcs_m2: ArrayLike, swerling: ArrayLike
) -> FloatArray:
    """RCS [m2] that is not exceeded with the given probability in [0, 1).

    This solves the chapter's equation for a sample: a uniform random number in, an RCS out.
    """
    shape = gamma_shape(swerling)
    scaled = gammaincinv(shape, np.asarray(probability, dtype=np.float64))
    return np.asarray(scaled * np.asarray(mean_rcs_m2) / shape, dtype=np.float64)


def sample(
    generator: np.random.Generator,
    mean_rcs_m2: ArrayLike,
    swerling: ArrayLike,
    size: int | tuple[int, ...] | None = None,
) -> FloatArray:
    """Draw radar cross sections [m2], one uniform random number each.

    ``size`` is the shape of the result; by default that of mean and model broadcast. One uniform
    per draw keeps random numbers in step between runs that differ in class or model alone.
    """
    if size is None:
        size = np.broadcast_shapes(np.shape(mean_rcs_m2), np.shape(swerling))
    return inverse_cumulative_probability(generator.random(size), mean_rcs_m2, swerling)
