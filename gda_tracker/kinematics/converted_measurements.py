"""Unbiased converted measurements: polar detections as Cartesian positions.

The plain conversion r (cos a, sin a) falls short of the target on average, by the factor
exp(-sigma_a^2 / 2): far away, with a coarse azimuth, this bias exceeds the range noise. Dividing by
that factor takes it away exactly (Mo, Song, Zhou, Sun and Bar-Shalom, "Unbiased converted
measurements for tracking", 1998); a Kalman filter then needs no derivative.
"""

from __future__ import annotations

import numpy as np

from gda_tracker.kinematics.polar_filters import PolarSensor, Updated, kalman_step
from gda_tracker.kinematics.sensor_models import SMALLEST_RANGE_M
from gda_tracker.vocabulary.arrays import FloatArray


def unbiased_positions(
    measurement: FloatArray, noise: FloatArray, at: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Unbiased positions in the sensor's axes, and the covariances of their errors.

    Parameters
    ----------
    measurement
        (N, 2) range [m] and azimuth [rad], or (N, 3) with elevation [rad].
    noise
        (N, d, d) covariance of these, diagonal.
    at
        (N, d) range and angles at which the covariance is worked out: the predicted ones, which do
        not depend on the measurement's own error. ``None``: the covariance is the expectation
        given the measurement.

    Returns
    -------
    position, covariance
        (N, d) [m], (N, d, d) [m2]. With ``at`` = the truth the covariance is exact.

    Raises
    ------
    ValueError
        If a noise covariance has correlations, for which there is no such closed form.

    Notes
    -----
    With lambda = exp(-sigma^2/2) for each angle, E[cos(a + w)] = lambda cos a and
    E[cos^2(a + w)] = (1 + lambda^4 cos 2a)/2, likewise for the sine.
    """
    dimension = measurement.shape[1]
    variance = np.diagonal(noise, axis1=1, axis2=2)
    off_diagonal = noise * (1.0 - np.eye(dimension))
    if off_diagonal.any():
        raise ValueError(
            "noise of converted measurements with correlations: allowed are diagonal covariances"
        )
    scale = _scale(variance)
    position = scale * _cartesian(measurement)
    if at is None:
        # Truth given the measurement: z - w.
        first, second = _moments(measurement, variance)
        outer = position[:, :, None] * first[:, None, :]
        covariance = (
            position[:, :, None] * position[:, None, :] - outer - outer.transpose(0, 2, 1) + second
        )
    else:
        # Measurement given the truth: unbiased, hence E[z z'] - x x'.
        _, second = _moments(at, variance)
        truth = _cartesian(at)
        covariance = (
            scale[:, :, None] * scale[:, None, :] * second - truth[:, :, None] * truth[:, None, :]
        )
    return position, covariance


def _scale(variance: FloatArray) -> FloatArray:
    """Factors (N, d) that make each coordinate unbiased."""
    rise = np.exp(0.5 * variance[:, 1:])
    if variance.shape[1] == 2:
        return np.repeat(rise, 2, axis=1)
    return rise[:, 1:] * np.stack([rise[:, 0], rise[:, 0], np.ones(len(rise))], axis=1)


def _cartesian(polar: FloatArray) -> FloatArray:
    """Positions (N, d) of range and angles (N, d)."""
    r, a = polar[:, 0], polar[:, 1]
    if polar.shape[1] == 2:
        return np.stack([r * np.cos(a), r * np.sin(a)], axis=1)
    ground = r * np.cos(polar[:, 2])
    return np.stack([ground * np.cos(a), ground * np.sin(a), r * np.sin(polar[:, 2])], axis=1)


def _moments(polar: FloatArray, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """E[p] (N, d) and E[p p'] (N, d, d) of positions whose polar values have Gaussian errors."""
    mean_square = polar[:, 0] ** 2 + variance[:, 0]
    azimuth, azimuth_square = _direction_moments(polar[:, 1], variance[:, 1])
    if polar.shape[1] == 2:
        return polar[:, :1] * azimuth, mean_square[:, None, None] * azimuth_square
    elevation, elevation_square = _direction_moments(polar[:, 2], variance[:, 2])
    first = np.concatenate([elevation[:, :1] * azimuth, elevation[:, 1:]], axis=1)
    second = np.empty((len(polar), 3, 3))
    second[:, :2, :2] = elevation_square[:, 0, 0, None, None] * azimuth_square
    second[:, :2, 2] = second[:, 2, :2] = elevation_square[:, 0, 1, None] * azimuth
    second[:, 2, 2] = elevation_square[:, 1, 1]
    return polar[:, :1] * first, mean_square[:, None, None] * second


def _direction_moments(angle: FloatArray, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """First (N, 2) and second (N, 2, 2) moments of (cos, sin) of angles with Gaussian errors."""
    first = np.exp(-0.5 * variance)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    fall = np.exp(-2.0 * variance)
    cosine, sine = fall * np.cos(2.0 * angle), fall * np.sin(2.0 * angle)
    second = np.empty((len(angle), 2, 2))
    second[:, 0, 0], second[:, 1, 1] = (1.0 + cosine) / 2.0, (1.0 - cosine) / 2.0
    second[:, 0, 1] = second[:, 1, 0] = sine / 2.0
    return first, second


def converted_update(
    mean: FloatArray,
    covariance: FloatArray,
    measurement: FloatArray,
    noise: FloatArray,
    sensor: PolarSensor,
) -> Updated:
    """Kalman update of N states with unbiased converted measurements.

    Arguments as in :func:`gda_tracker.kinematics.polar_filters.extended_update`. The covariance is
    worked out at the predicted position, where it does not depend on the measurement's own error.
    A range rate follows by an extended update, on the state that knows the position already.

    Raises
    ------
    ValueError
        If a noise covariance has correlations.
    """
    d = sensor.dimension
    if (noise * (1.0 - np.eye(sensor.measured))).any():
        raise ValueError(
            "noise of converted measurements with correlations: allowed are diagonal covariances"
        )
    predicted = sensor.measure(mean)[:, :d]
    local, spread = unbiased_positions(measurement[:, :d], noise[:, :d, :d], at=predicted)
    if sensor.rotation is not None:
        local, spread = local @ sensor.rotation.T, sensor.rotation @ spread @ sensor.rotation.T
    residual = local + sensor.position_m - mean[:, :d]
    updated = kalman_step(
        mean, covariance, residual, covariance[:, :, :d], covariance[:, :d, :d] + spread
    )
    # From a density over positions to one over range and angles, at the measurement.
    volume = measurement[:, 0] if d == 2 else measurement[:, 0] ** 2 * np.cos(measurement[:, 2])
    volume = volume * _scale(np.diagonal(noise, axis1=1, axis2=2)[:, :d]).prod(axis=1)
    log_likelihood = updated.log_likelihood + np.log(np.maximum(volume, SMALLEST_RANGE_M))
    if not sensor.range_rate:
        return Updated(updated.mean, updated.covariance, log_likelihood)
    h = sensor.jacobian(updated.mean)[:, -1:]
    crossed = updated.covariance @ h.transpose(0, 2, 1)
    rate = kalman_step(
        updated.mean,
        updated.covariance,
        measurement[:, -1:] - sensor.measure(updated.mean)[:, -1:],
        crossed,
        h @ crossed + noise[:, -1:, -1:],
    )
    return Updated(rate.mean, rate.covariance, log_likelihood + rate.log_likelihood)
