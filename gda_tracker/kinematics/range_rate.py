"""Range rate in the filters of the tracking plane: an update with range, azimuth and range rate.

Gating and association do not look at it: their likelihoods are per metre and radian. It makes the
velocity known at once, and with it the predictions that the next scan is compared with.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gda_tracker.kinematics.gaussian_filters import update
from gda_tracker.kinematics.polar_filters import Updated, kalman_step
from gda_tracker.kinematics.sensor_models import (
    SMALLEST_RANGE_M,
    Innovations,
    PolarMeasurements,
    innovations,
)
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array
from gda_tracker.vocabulary.scans import Scan

LOG_TWO_PI = math.log(2.0 * math.pi)
# How far the vertical speed of a target, which the plane does not know, may be from zero.
VERTICAL_SPEED_STD_MPS = 10.0


@dataclass(slots=True)
class RangeRates:
    """n range rates in the tracking plane, positive for targets that go away.

    ``value_mps`` (n,); ``covariance`` (n, 3): with range [m2/s], with azimuth [m rad/s], its own
    variance [m2/s2].
    """

    value_mps: FloatArray
    covariance: FloatArray


def range_rates(scan: Scan, measurements: PolarMeasurements) -> RangeRates | None:
    """Take the elevation out of the range rates of a scan; ``None`` if it has none.

    Seen under the elevation e from the plane the rate is cos(e) times that in the plane, plus
    sin(e) times the vertical speed, which is taken as zero with a standard deviation. Correlations
    with range and azimuth are kept where range and azimuth are those of the plane.

    ``measurements`` is :func:`~gda_tracker.kinematics.sensor_models.polar_measurements` of it.
    """
    if scan.range_rate_mps is None:
        return None
    noise = scan.noise_covariance
    covariance = np.zeros((len(scan), 3))
    covariance[:, 2] = noise[:, -1, -1]
    if measurements.range_m is scan.range_m:
        covariance[:, :2] = noise[:, :2, -1]
        return RangeRates(scan.range_rate_mps, covariance)
    # Nothing is left of a rate seen straight from below: its variance is beyond all others.
    cosine = np.clip(measurements.range_m / scan.range_m, 1e-6, 1.0)
    tangent_squared = 1.0 / cosine**2 - 1.0
    value = scan.range_rate_mps / cosine
    covariance[:, 2] = covariance[:, 2] / cosine**2 + tangent_squared * VERTICAL_SPEED_STD_MPS**2
    if scan.elevation_rad is not None:
        covariance[:, 2] += tangent_squared * value**2 * noise[:, 2, 2]
    return RangeRates(value, covariance)


def update_with_range_rate(
    mean: FloatArray,
    covariance: FloatArray,
    innovation: Innovations,
    measurements: PolarMeasurements,
    rates: RangeRates,
    detection: Int32Array,
) -> Updated:
    """Extended Kalman update of P states with range and azimuth, then with range rate.

    Parameters
    ----------
    mean, covariance
        (P, s), (P, s, s) predicted.
    innovation
        Of these states and rows ``detection`` (P,) of the scan, in range and azimuth.
    measurements, rates
        Of the scan.

    Returns
    -------
    Updated
        The states, and log N of all three quantities [log s/(m2 rad)].

    Notes
    -----
    The rate is the product of velocity and direction. It is linearised where the position is known
    already, and its second-order terms are allowed for: mean tr(A P)/2 and variance tr(A P A P)/2,
    A the second derivative. What it shares with the errors of range and azimuth is taken out
    before: with B = C R^-1, C their covariance with it, rate - B (range, azimuth) is independent of
    them.
    """
    squared, determinant = innovation.mahalanobis_squared()
    log_likelihood = -0.5 * (squared + np.log(determinant)) - LOG_TWO_PI
    mean, covariance = update(mean, covariance, innovation)

    size = mean.shape[1]
    v = slice(size // 2, size // 2 + 2)
    velocity, tau = mean[:, v], innovation.time_offset_s
    p = mean[:, :2] - measurements.sensor_xy_m
    if tau is not None:
        p = p + tau[:, None] * velocity
    distance = np.maximum(np.hypot(p[:, 0], p[:, 1]), SMALLEST_RANGE_M)
    u = p / distance[:, None]
    rate = np.sum(u * velocity, axis=1)
    by_position = (velocity - rate[:, None] * u) / distance[:, None]
    h = np.zeros((len(mean), 1, size))
    h[:, 0, :2], h[:, 0, v] = by_position, u
    if tau is not None:
        h[:, 0, v] += tau[:, None] * by_position
    shift, variance = second_order_terms(covariance, u, by_position, rate, distance, tau, v)
    residual = rates.value_mps[detection] - rate - shift

    shared = rates.covariance[detection]
    own = shared[:, 2]
    if shared[:, :2].any():
        again = innovations(measurements, mean, covariance, detection)
        share = np.linalg.solve(measurements.covariance[detection], shared[:, :2, None])[:, :, 0]
        residual = residual - np.sum(share * again.residual, axis=1)
        h = h - share[:, None] @ again.jacobian(size)
        own = own - np.sum(share * shared[:, :2], axis=1)
    crossed = covariance @ h.transpose(0, 2, 1)
    spread = h @ crossed + (own + variance)[:, None, None]
    updated = kalman_step(mean, covariance, residual[:, None], crossed, spread)
    updated.log_likelihood += log_likelihood
    return updated


def second_order_terms(
    covariance: FloatArray,
    u: FloatArray,
    by_position: FloatArray,
    rate: FloatArray,
    distance: FloatArray,
    tau: FloatArray | None,
    v: slice,
) -> tuple[FloatArray, FloatArray]:
    """Mean and variance (P,) of the second-order terms of the range rate."""
    r = distance[:, None, None]
    aside = (np.eye(2) - u[:, :, None] * u[:, None, :]) / r
    mixed = by_position[:, :, None] * u[:, None, :] / r
    second = np.zeros((len(u), 4, 4))
    second[:, :2, :2] = -(mixed + mixed.transpose(0, 2, 1)) - rate[:, None, None] * aside / r
    second[:, :2, 2:] = second[:, 2:, :2] = aside
    rows = np.r_[0:2, v]
    spread = covariance[:, rows[:, None], rows]
    if tau is not None:
        # The position at the time of the detection.
        move = np.tile(np.eye(4), (len(u), 1, 1))
        move[:, 0, 2] = move[:, 1, 3] = tau
        spread = move @ spread @ move.transpose(0, 2, 1)
    product = second @ spread
    shift = 0.5 * np.trace(product, axis1=1, axis2=2)
    return shift, 0.5 * np.sum(product * product.transpose(0, 2, 1), axis=(1, 2))
