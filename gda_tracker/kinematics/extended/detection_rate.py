"""How many detections an extended object gives: a Poisson rate with a Gamma density.

The number n of detections of one scan is Poisson with the rate gamma; what is known of gamma is a
Gamma density with ``shape`` a and ``rate`` b, conjugate to it (Granstroem and Orguner, "Estimation
and maintenance of measurement rates for multiple extended target tracking", 2012).
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import gammaln

from gda_tracker.vocabulary.arrays import FloatArray, IntArray

LEAST_SHAPE = 1.0


def predict_rate(
    shape: FloatArray, rate: FloatArray, dt_s: float, memory_s: float
) -> tuple[FloatArray, FloatArray]:
    """Forget: the expected rate a/b stays, its variance grows by exp(dt / memory).

    The shape does not fall below 1, the exponential density: after a long time any rate may be, but
    the mean is not lost.
    """
    kept = np.maximum(math.exp(-dt_s / memory_s), np.minimum(1.0, LEAST_SHAPE / shape))
    return shape * kept, rate * kept


def update_rate(
    shape: FloatArray, rate: FloatArray, count: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Posterior after ``count`` (N,) detections in one scan."""
    return shape + count, rate + 1.0


def update_rate_unseen(
    shape: FloatArray, rate: FloatArray, detection_probability: float
) -> tuple[FloatArray, FloatArray]:
    """Posterior after a scan without detections, which may have overlooked the object as a whole.

    The mixture of the density as it was, with weight 1 - P_D, and that after a count of 0, by its
    mean and variance.
    """
    none = np.exp(shape * (np.log(rate) - np.log1p(rate)))
    seen = detection_probability * none
    weight = seen / (1.0 - detection_probability + seen)
    mean = shape * ((1.0 - weight) / rate + weight / (rate + 1.0))
    square = shape * (shape + 1.0) * ((1.0 - weight) / rate**2 + weight / (rate + 1.0) ** 2)
    new_rate = mean / (square - mean**2)
    return mean * new_rate, new_rate


def log_count_probability(shape: FloatArray, rate: FloatArray, count: IntArray) -> FloatArray:
    """Log probability (N,) of ``count`` detections: negative binomial, sums to one over counts."""
    found: FloatArray = (
        gammaln(shape + count)
        - gammaln(shape)
        - gammaln(np.asarray(count) + 1.0)
        + shape * (np.log(rate) - np.log1p(rate))
        - count * np.log1p(rate)
    )
    return found


def log_unseen_probability(
    shape: FloatArray, rate: FloatArray, detection_probability: float
) -> FloatArray:
    """Log probability (N,) of no detection at all: 1 - P_D + P_D (b / (b + 1))^a.

    ``detection_probability`` is the chance that the object is in view; it may then still give no
    detection, by its rate.
    """
    none = np.exp(shape * (np.log(rate) - np.log1p(rate)))
    return np.log(1.0 - detection_probability + detection_probability * none)
