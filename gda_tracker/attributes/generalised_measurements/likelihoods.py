"""Generalised likelihoods and association likelihoods (Mahler 2011, sections 4 to 6).

Every closed form of the source is one expectation of the covering function under a Gaussian density
of the measurement space: (36), (41) under N(eta(x), R); (46), (60), (62), (78), (81) under
N(H x_i, H P_i H'); (70), (73) under N(H x_i, H P_i H' + R).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from gda_tracker.attributes.generalised_measurements.covering import (
    CoveringFunction,
    frozen_finite,
)
from gda_tracker.attributes.generalised_measurements.expectations import numerical_expectation
from gda_tracker.attributes.generalised_measurements.quadrature import ABSOLUTE_TOLERANCE
from gda_tracker.vocabulary.arrays import FloatArray


def log_generalised_likelihood(
    statements: CoveringFunction, points: ArrayLike, noise_covariance: ArrayLike | None = None
) -> FloatArray:
    """Log f(Theta | x) of M statements, given eta(x).

    Parameters
    ----------
    statements
        M generalised measurements of dimension d.
    points
        (..., d) predicted measurements eta(x).
    noise_covariance
        (d, d) R of additive Gaussian noise, or ``None`` for deterministic statements.

    Returns
    -------
    array
        (..., M) log mu(eta(x)) (29), (31) to (33), or with noise log of the integral of
        mu(z) N(z; eta(x), R) dz (36), (38), (41).

    Examples
    --------
    A region [0, inf) seen with noise, from its edge:

    >>> from gda_tracker.attributes.generalised_measurements.scalars import interval
    >>> region = interval([0.0], [np.inf])
    >>> np.exp(log_generalised_likelihood(region, [[0.0]], [[4.0]])).tolist()
    [[0.5]]
    """
    d = statements.dimension
    array = np.asarray(points, dtype=np.float64)
    if noise_covariance is None:
        with np.errstate(divide="ignore"):
            return np.log(statements(array))
    if array.ndim == 0 or array.shape[-1] != d:
        raise ValueError(f"points have the shape {array.shape}: allowed is (..., {d})")
    noise = frozen_finite("noise_covariance", noise_covariance, d, d)
    return statements.log_expectation(array[..., None, :], noise[None])


def log_association_likelihood(
    statements: CoveringFunction,
    mean: ArrayLike,
    covariance: ArrayLike,
    measurement_matrix: ArrayLike | None = None,
    noise_covariance: ArrayLike | None = None,
) -> FloatArray:
    """Log l(Theta | i) of M statements and T Gaussian tracks, by a linear measurement (46).

    Parameters
    ----------
    statements
        M generalised measurements of dimension d.
    mean, covariance
        (T, s), (T, s, s) x_i and P_i.
    measurement_matrix
        (d, s) H of rank d; ``None``: the measurement space is that of the states.
    noise_covariance
        (d, d) R of additive Gaussian noise, or ``None`` for deterministic statements.

    Returns
    -------
    array
        (T, M), without unit, at most 0; -inf where a statement is impossible.

    Examples
    --------
    "It is beyond x = 0", heard of two tracks with standard deviations of 1:

    >>> from gda_tracker.attributes.generalised_measurements.scalars import interval
    >>> region = interval([0.0], [np.inf])
    >>> tracks = [[0.0, 5.0], [1.0, -5.0]], [np.eye(2), np.eye(2)]
    >>> log_likelihood = log_association_likelihood(region, *tracks, [[1.0, 0.0]])
    >>> np.exp(log_likelihood).round(4).tolist()
    [[0.5], [0.8413]]
    """
    x, p = _tracks(mean, covariance)
    d, s = statements.dimension, x.shape[1]
    h = np.eye(s) if measurement_matrix is None else np.asarray(measurement_matrix, np.float64)
    if h.shape != (d, s):
        raise ValueError(f"measurement_matrix has the shape {h.shape}: allowed is ({d}, {s})")
    spread = h @ p @ h.T
    if noise_covariance is not None:
        spread = spread + frozen_finite("noise_covariance", noise_covariance, d, d)
    return statements.log_expectation((x @ h.T)[:, None], spread[:, None])


def log_association_likelihood_by_quadrature(
    statements: CoveringFunction,
    mean: ArrayLike,
    covariance: ArrayLike,
    measure: Callable[[FloatArray], FloatArray],
    state_matrix: ArrayLike | None = None,
    noise_covariance: ArrayLike | None = None,
    tolerance: float = ABSOLUTE_TOLERANCE,
) -> FloatArray:
    """Log l(Theta | i) of M statements and T Gaussian tracks, by any measurement eta (46).

    Parameters
    ----------
    statements
        M generalised measurements of dimension d.
    mean, covariance
        (T, s), (T, s, s) x_i and P_i.
    measure
        eta: maps y (..., k) to measurements (..., d), such as a place to its bearing.
    state_matrix
        (k, s) y = G x is the part of the state that eta depends on, k at most 2; ``None``: all.
    noise_covariance
        (d, d) R of additive Gaussian noise, or ``None`` for deterministic statements.
    tolerance
        Absolute accuracy of the likelihood. Where the likelihood of a statement changes within much
        less than the uncertainty of a track it may not be kept.

    Returns
    -------
    array
        (T, M).

    Raises
    ------
    QuadratureError
        If the accuracy is not reached, as by a jump along a curve in two dimensions.
    """
    x, p = _tracks(mean, covariance)
    s = x.shape[1]
    g = np.eye(s) if state_matrix is None else np.asarray(state_matrix, dtype=np.float64)
    if g.ndim != 2 or g.shape[1] != s:
        raise ValueError(f"state_matrix has the shape {g.shape}: allowed is (k, {s})")

    def likelihood(y: FloatArray) -> FloatArray:
        points = measure(y[..., 0, :])
        return np.exp(log_generalised_likelihood(statements, points, noise_covariance))

    value = numerical_expectation(
        likelihood, len(statements), (x @ g.T)[:, None], (g @ p @ g.T)[:, None], tolerance
    )
    with np.errstate(divide="ignore"):
        return np.log(value)


def log_clutter_likelihood(
    statements: CoveringFunction, low: ArrayLike, high: ArrayLike
) -> FloatArray:
    """Log c(Theta_j) (M,) of false alarms spread evenly over a box (47), without unit.

    Parameters
    ----------
    statements
        M generalised measurements of dimension d.
    low, high
        (d,) corners of the box of the measurement space, finite.
    """
    d = statements.dimension
    start, end = frozen_finite("low", low, d), frozen_finite("high", high, d)
    if not (start < end).all():
        raise ValueError(f"low = {start.tolist()}, high = {end.tolist()}: allowed is low < high")
    with np.errstate(divide="ignore"):
        return np.log(statements.average(start, end))


def _tracks(mean: ArrayLike, covariance: ArrayLike) -> tuple[FloatArray, FloatArray]:
    x = frozen_finite("mean", mean, None, None)
    return x, frozen_finite("covariance", covariance, len(x), x.shape[1], x.shape[1])
