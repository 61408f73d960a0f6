"""Filters for polar sensors in the plane and in space, with range rate where it is measured.

A sensor measures, in its own axes, range, azimuth, in space also elevation, and perhaps the range
rate: h(x) = [r, atan2(y, x)(, atan2(z, hypot(x, y)))(, (p . v)/r)] with p and v position and
velocity relative to the sensor (Koch 2014, (2.14)-(2.20); azimuth from the x axis,
counter-clockwise; the range rate is positive for a target that goes away). States (N, s) hold all
positions, then all velocities.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gda_tracker.kinematics.sensor_models import SMALLEST_RANGE_M, wrap_angle
from gda_tracker.vocabulary.arrays import FloatArray


@dataclass(frozen=True)
class PolarSensor:
    """Where a sensor stands and what it measures.

    ``position_m`` (d,) and ``velocity_mps`` (d,) in tracking axes, d = 2 or 3; ``rotation`` (d, d)
    from sensor to tracking axes; ``range_rate``: whether it is measured.
    """

    position_m: FloatArray
    rotation: FloatArray | None = None
    velocity_mps: FloatArray | None = None
    range_rate: bool = False
    dimension: int = field(init=False)

    def __post_init__(self) -> None:
        dimension = len(self.position_m)
        if dimension not in (2, 3):
            raise ValueError(
                f"position_m of {dimension} coordinates: allowed are 2 (plane) and 3 (space)"
            )
        object.__setattr__(self, "dimension", dimension)

    @property
    def measured(self) -> int:
        """Number of measured quantities: range and angles, and the range rate."""
        return self.dimension + self.range_rate

    def measure(self, state: FloatArray) -> FloatArray:
        """h(x) of states (..., s): (..., m) in m, rad(, rad)(, m/s)."""
        p, v = self._relative(state)
        horizontal = np.hypot(p[..., 0], p[..., 1])
        distance = np.maximum(np.sqrt(np.sum(p * p, axis=-1)), SMALLEST_RANGE_M)
        parts = [distance, np.arctan2(p[..., 1], p[..., 0])]
        if self.dimension == 3:
            parts.append(np.arctan2(p[..., 2], horizontal))
        if self.range_rate:
            parts.append(np.sum(p * v, axis=-1) / distance)
        return np.stack(parts, axis=-1)

    def jacobian(self, state: FloatArray) -> FloatArray:
        """Derivative of h by the state, (N, m, s) for states (N, s)."""
        d = self.dimension
        p, v = self._relative(state)
        distance = np.maximum(np.sqrt(np.sum(p * p, axis=-1)), SMALLEST_RANGE_M)
        ground = np.maximum(np.hypot(p[:, 0], p[:, 1]), SMALLEST_RANGE_M)
        local = np.zeros((len(state), self.measured, 2 * d))
        direction = p / distance[:, None]
        local[:, 0, :d] = direction
        local[:, 1, 0], local[:, 1, 1] = -p[:, 1] / ground**2, p[:, 0] / ground**2
        if d == 3:
            steep = -p[:, 2] / (distance**2 * ground)
            local[:, 2, 0], local[:, 2, 1] = p[:, 0] * steep, p[:, 1] * steep
            local[:, 2, 2] = ground / distance**2
        if self.range_rate:
            rate = np.sum(direction * v, axis=1)
            local[:, -1, :d] = (v - rate[:, None] * direction) / distance[:, None]
            local[:, -1, d:] = direction
        if self.rotation is not None:
            local[:, :, :d] = local[:, :, :d] @ self.rotation.T
            local[:, :, d:] = local[:, :, d:] @ self.rotation.T
        full = np.zeros((len(state), self.measured, state.shape[1]))
        full[:, :, : 2 * d] = local
        return full

    def residual(self, measurement: FloatArray, predicted: FloatArray) -> FloatArray:
        """Differences (..., m), the azimuth wrapped."""
        difference = measurement - predicted
        difference[..., 1] = wrap_angle(difference[..., 1])
        return difference

    def _relative(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Position and velocity (..., d) relative to the sensor, in its axes."""
        d = self.dimension
        p, v = state[..., :d] - self.position_m, state[..., d : 2 * d]
        if self.velocity_mps is not None:
            v = v - self.velocity_mps
        if self.rotation is None:
            return p, v
        return p @ self.rotation, v @ self.rotation


@dataclass(slots=True)
class Updated:
    """N updated states: ``mean`` (N, s), ``covariance`` (N, s, s), ``log_likelihood`` (N,)."""

    mean: FloatArray
    covariance: FloatArray
    log_likelihood: FloatArray


def extended_update(
    mean: FloatArray,
    covariance: FloatArray,
    measurement: FloatArray,
    noise: FloatArray,
    sensor: PolarSensor,
) -> Updated:
    """First-order extended Kalman update of N states with one measurement each.

    Parameters
    ----------
    mean, covariance
        (N, s), (N, s, s) predicted.
    measurement, noise
        (N, m) and (N, m, m) in the order range, azimuth(, elevation)(, range rate).
    sensor
        The sensor.

    Notes
    -----
    Koch 2014, (3.42)-(3.44); the likelihood is N(z; h(x), S).
    """
    h = sensor.jacobian(mean)
    crossed = h @ covariance
    spread = crossed @ h.transpose(0, 2, 1) + noise
    residual = sensor.residual(measurement, sensor.measure(mean))
    return kalman_step(mean, covariance, residual, crossed.transpose(0, 2, 1), spread)


def unscented_update(
    mean: FloatArray,
    covariance: FloatArray,
    measurement: FloatArray,
    noise: FloatArray,
    sensor: PolarSensor,
    kappa: float | None = None,
) -> Updated:
    """Unscented Kalman update: 2 s + 1 sigma points instead of a derivative.

    Arguments as in :func:`extended_update`. ``kappa`` > -s sets the weight of the central point,
    kappa / (s + kappa), against the others' 1 / (2 (s + kappa)). Without it 3 - s, which fits the
    fourth moments of a Gaussian (Julier and Uhlmann), but at least 0: a negative weight can make a
    covariance that is none. Angles are averaged as differences from the
    central point's, so that the cut at 180 degrees does no harm.

    Raises
    ------
    ValueError
        If ``kappa`` is out of range.
    """
    size = mean.shape[1]
    kappa = max(3.0 - size, 0.0) if kappa is None else kappa
    if not kappa > -size:
        raise ValueError(f"kappa = {kappa}: allowed is a number > {-size}")
    scale = size + kappa
    root = np.linalg.cholesky(covariance).transpose(0, 2, 1) * np.sqrt(scale)
    step = np.concatenate([np.zeros((len(mean), 1, size)), root, -root], axis=1)
    weight = np.full(2 * size + 1, 0.5 / scale)
    weight[0] = kappa / scale
    centre = sensor.measure(mean)
    moved = sensor.residual(sensor.measure(mean[:, None] + step), centre[:, None])
    shift = weight @ moved
    gap = moved - shift[:, None]
    weighted = weight[:, None] * gap
    spread = weighted.transpose(0, 2, 1) @ gap + noise
    crossed = step.transpose(0, 2, 1) @ weighted
    residual = sensor.residual(measurement, centre + shift)
    return kalman_step(mean, covariance, residual, crossed, spread)


def kalman_step(
    mean: FloatArray,
    covariance: FloatArray,
    residual: FloatArray,
    crossed: FloatArray,
    spread: FloatArray,
) -> Updated:
    """Kalman update from the residual v (N, m), the covariance P_xz (N, s, m) and S (N, m, m).

    W = P_xz S^-1, x + W v, P - W S W' (Koch 2014, (3.42)-(3.44)).
    """
    gain = np.linalg.solve(spread, crossed.transpose(0, 2, 1)).transpose(0, 2, 1)
    reduced = covariance - gain @ spread @ gain.transpose(0, 2, 1)
    squared = np.sum(residual * np.linalg.solve(spread, residual[:, :, None])[:, :, 0], axis=1)
    log_determinant = np.linalg.slogdet(spread)[1]
    return Updated(
        mean + (gain @ residual[:, :, None])[:, :, 0],
        0.5 * (reduced + reduced.transpose(0, 2, 1)),
        -0.5 * (squared + log_determinant + residual.shape[1] * np.log(2.0 * np.pi)),
    )
