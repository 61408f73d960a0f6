"""What sensors measure that is not range and azimuth: h(x), its derivatives, its likelihood.

A sensor stands, or its platform moves, at p_1 with velocity q_1; a bistatic radar has a transmitter
and a TDoA or FDoA pair a second receiver, the *reference*, at p_2 with q_2. With
r_i = |p - p_i|, u_i = (p - p_i)/r_i and the rates r_i' = u_i . (v - q_i) of a target at p with
velocity v (Koch 2014, (2.20)), the quantities are

==================  ======================================  =========================
model               measures                                measurement space
==================  ======================================  =========================
bearing             azimuth of p - p_1                      rad
range               r_1                                     m
range_doppler       r_1, r_1'                               m, m/s
doppler             r_1, azimuth, r_1'                      m, rad, m/s
doppler_rotated     the same, in the rotated frame          m, rad, m/s
bistatic            r_1 + r_2                               m
bistatic_doppler    r_1 + r_2, r_1' + r_2'                  m, m/s
tdoa                r_1 - r_2, c times the time difference  m
fdoa                r_1' - r_2'                             m/s
tdoa_fdoa           both                                    m, m/s
==================  ======================================  =========================

(Koch 2014, (2.21)-(2.23), in metres and metres per second: the time difference times the speed of
light, the frequency difference times -wavelength, since a target that goes away lowers the
frequency.) They are expanded to second order: a component of a Gaussian sum that starts a track is
as long as the curve that a measurement leaves is bent, and there a first-order likelihood is wrong.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gda_tracker.kinematics.measurement_kinds import (
    AZIMUTH,
    MEASUREMENT_MODELS,
    RANGE,
    RANGE_RATE,
    MeasurementModel,
)
from gda_tracker.kinematics.sensor_models import SMALLEST_RANGE_M, wrap_angle
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array, IntArray
from gda_tracker.vocabulary.scans import Scan

LOG_TWO_PI = math.log(2.0 * math.pi)
# Position and velocity in the plane: what is measured depends on nothing else.
STATE = 4


@dataclass(frozen=True, slots=True)
class Sites:
    """Where a sensor and its reference are: ``position_m``, ``velocity_mps`` (S, 2), S = 1 or 2."""

    position_m: FloatArray
    velocity_mps: FloatArray


@dataclass(slots=True)
class Observed:
    """The n measurements of a scan: ``value`` (n, m) and ``noise`` (n, m, m) of a model's m."""

    model: MeasurementModel
    sites: Sites
    value: FloatArray
    noise: FloatArray

    def __len__(self) -> int:
        return len(self.value)

    def select(self, rows: IntArray) -> Observed:
        """The measurements of the given rows."""
        return Observed(self.model, self.sites, self.value[rows], self.noise[rows])


def locates(scan: Scan) -> bool:
    """Whether the detections of a scan are places in the plane: of range and azimuth."""
    return not scan.sensor_model or MEASUREMENT_MODELS[scan.sensor_model].locates


def observed(scan: Scan) -> Observed:
    """What a scan with a sensor model measures, in tracking axes."""
    model = MEASUREMENT_MODELS[scan.sensor_model]
    _, _, z, w = (float(part) for part in scan.sensor_orientation_xyzw)
    columns = {RANGE: scan.range_m, RANGE_RATE: scan.range_rate_mps}
    columns[AZIMUTH] = wrap_angle(scan.azimuth_rad + 2.0 * math.atan2(z, w))
    place = {RANGE: 0, AZIMUTH: 1, RANGE_RATE: -1}
    rows = [place[quantity] for quantity in model.quantities]
    value = [column for q in model.quantities if (column := columns[q]) is not None]
    positions: list[FloatArray | None] = [scan.sensor_position_m]
    velocities = [scan.sensor_velocity_mps]
    if model.has_reference:
        positions.append(scan.reference_position_m)
        velocities.append(scan.reference_velocity_mps)
    still = np.zeros(3)
    return Observed(
        model,
        Sites(
            np.array([still if p is None else p for p in positions])[:, :2],
            np.array([still if v is None else v for v in velocities])[:, :2],
        ),
        # An empty scan may come without the range rates that it does not have.
        np.stack(value, axis=1) if len(scan) else np.zeros((0, len(model))),
        scan.noise_covariance[:, np.array(rows)[:, None], rows],
    )


def measure(model: MeasurementModel, sites: Sites, mean: FloatArray) -> FloatArray:
    """h(x) (..., m) of states (..., s >= 4) [x, y, vx, vy, ...]."""
    parts = []
    ranges, rates = _ranges(sites, mean)
    signs = _signs(model)
    for quantity in model.quantities:
        if quantity == AZIMUTH:
            offset = mean[..., :2] - sites.position_m[0]
            parts.append(np.arctan2(offset[..., 1], offset[..., 0]))
        else:
            parts.append((ranges if quantity == RANGE else rates) @ signs)
    return np.stack(parts, axis=-1)


def _signs(model: MeasurementModel) -> FloatArray:
    return np.array([1.0, model.reference_sign] if model.has_reference else [1.0])


def _ranges(sites: Sites, mean: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distances and range rates (..., S) of states from the sites."""
    offset = mean[..., None, :2] - sites.position_m
    distance = np.maximum(np.hypot(offset[..., 0], offset[..., 1]), SMALLEST_RANGE_M)
    rate = np.sum(offset * (mean[..., None, 2:4] - sites.velocity_mps), axis=-1) / distance
    return distance, rate


def derivatives(
    model: MeasurementModel, sites: Sites, mean: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """First (N, m, 4) and second (N, m, 4, 4) derivatives of h at states (N, s >= 4)."""
    n = len(mean)
    first, second = np.zeros((n, len(model), STATE)), np.zeros((n, len(model), STATE, STATE))
    for sign, position, velocity in zip(
        _signs(model), sites.position_m, sites.velocity_mps, strict=True
    ):
        offset, relative = mean[:, :2] - position, mean[:, 2:4] - velocity
        r = np.maximum(np.hypot(offset[:, 0], offset[:, 1]), SMALLEST_RANGE_M)
        u = offset / r[:, None]
        aside = (np.eye(2) - u[:, :, None] * u[:, None, :]) / r[:, None, None]
        if RANGE in model.quantities:
            place = model.quantities.index(RANGE)
            first[:, place, :2] += sign * u
            second[:, place, :2, :2] += sign * aside
        if RANGE_RATE in model.quantities:
            place = model.quantities.index(RANGE_RATE)
            rate = np.sum(u * relative, axis=1)
            by_position = (relative - rate[:, None] * u) / r[:, None]
            mixed = by_position[:, :, None] * u[:, None, :] / r[:, None, None]
            bent = mixed + mixed.transpose(0, 2, 1) + (rate / r)[:, None, None] * aside
            first[:, place, :2] += sign * by_position
            first[:, place, 2:] += sign * u
            second[:, place, :2, :2] -= sign * bent
            second[:, place, :2, 2:] += sign * aside
            second[:, place, 2:, :2] += sign * aside
    if AZIMUTH in model.quantities:
        place = model.quantities.index(AZIMUTH)
        offset = mean[:, :2] - sites.position_m[0]
        r = np.maximum(np.hypot(offset[:, 0], offset[:, 1]), SMALLEST_RANGE_M)
        c, s = offset[:, 0] / r, offset[:, 1] / r
        first[:, place, 0], first[:, place, 1] = -s / r, c / r
        second[:, place, 0, 0], second[:, place, 1, 1] = 2 * c * s / r**2, -2 * c * s / r**2
        second[:, place, 0, 1] = second[:, place, 1, 0] = (s * s - c * c) / r**2
    return first, second


@dataclass(slots=True)
class Expected:
    """What N states look like to a sensor, before its noise.

    ``value`` (N, m) the expected measurement, ``jacobian`` H (N, m, 4), ``covariance`` (N, m, m) of
    h(x) to second order, ``velocity`` (N, 2) relative to the sensor, ``state`` (N, 4, 4) the
    covariance of position and velocity.
    """

    model: MeasurementModel
    value: FloatArray
    jacobian: FloatArray
    covariance: FloatArray
    velocity: FloatArray
    state: FloatArray

    def select(self, rows: IntArray | Int32Array) -> Expected:
        """The rows given."""
        return Expected(
            self.model,
            self.value[rows],
            self.jacobian[rows],
            self.covariance[rows],
            self.velocity[rows],
            self.state[rows],
        )


def expected(
    model: MeasurementModel, sites: Sites, mean: FloatArray, covariance: FloatArray
) -> Expected:
    """Moments of h(x) for states ``mean`` (N, s), ``covariance`` (N, s, s), to second order.

    With A_i the second derivative of the quantity i the mean is h_i + tr(A_i P)/2 and the
    covariance H P H' + tr(A_i P A_j P)/2, exact for a quadratic h.
    """
    head = covariance[:, :STATE, :STATE]
    jacobian, second = derivatives(model, sites, mean)
    bent = second @ head[:, None]
    shift = 0.5 * np.trace(bent, axis1=-2, axis2=-1)
    spread = 0.5 * np.einsum("niab,njba->nij", bent, bent)
    return Expected(
        model,
        measure(model, sites, mean) + shift,
        jacobian,
        jacobian @ head @ jacobian.transpose(0, 2, 1) + spread,
        mean[:, 2:4] - sites.velocity_mps[0],
        head,
    )


@dataclass(slots=True)
class Compared:
    """P pairs of state and measurement.

    ``residual`` v (P, m), ``covariance`` S (P, m, m), ``crossed`` (P, 4, m) of state and
    measurement.
    """

    model: MeasurementModel
    residual: FloatArray
    covariance: FloatArray
    crossed: FloatArray

    def squared(self) -> FloatArray:
        """Squared Mahalanobis distance (P,) v' S^-1 v."""
        solved = np.linalg.solve(self.covariance, self.residual[:, :, None])[:, :, 0]
        found: FloatArray = np.sum(self.residual * solved, axis=1)
        return found

    def log_likelihood(self) -> FloatArray:
        """Log N(z; h(x), S) (P,), in log of one over the unit of the measurement space.

        That of a bearing alone is wrapped round the circle, and integrates to one over a turn
        however wide it is.
        """
        constant = np.linalg.slogdet(self.covariance)[1] + len(self.model) * LOG_TWO_PI
        if self.model.quantities != (AZIMUTH,):
            return -0.5 * (self.squared() + constant)
        turns = self.residual + 2.0 * math.pi * np.arange(-3, 4)
        exponent = -0.5 * turns**2 / self.covariance[:, :, 0]
        peak = exponent.max(axis=1)
        found: FloatArray = peak + np.log(np.exp(exponent - peak[:, None]).sum(axis=1))
        return found - 0.5 * constant


def compare(of: Expected, value: FloatArray, noise: FloatArray) -> Compared:
    """Compare P expected measurements with as many measured ones (P, m), noise (P, m, m)."""
    model = of.model
    if model.rotated:
        return _compare_rotated(of, value, noise)
    residual = value - of.value
    if AZIMUTH in model.quantities:
        place = model.quantities.index(AZIMUTH)
        residual[:, place] = wrap_angle(residual[:, place])
    return Compared(
        model, residual, of.covariance + noise, of.state @ of.jacobian.transpose(0, 2, 1)
    )


def _compare_rotated(of: Expected, value: FloatArray, noise: FloatArray) -> Compared:
    """Compare range, azimuth and range rate, the rate in axes turned to the measured azimuth.

    There the range rate is one component of the relative velocity, u(a) . v with a the measured
    azimuth, and linear in the state (Koch 2014, after (2.20)). The error w of the azimuth leaves
    -w t(a) . v of it, t across u; it goes to the noise, with what it shares with the azimuth.
    """
    u = np.stack([np.cos(value[:, 1]), np.sin(value[:, 1])], axis=1)
    t = np.stack([-u[:, 1], u[:, 0]], axis=1)
    across = np.sum(t * of.velocity, axis=1)
    across_variance = np.einsum("na,nab,nb->n", t, of.state[:, 2:, 2:], t)
    residual = value - of.value
    residual[:, 1] = wrap_angle(residual[:, 1])
    residual[:, 2] = value[:, 2] - np.sum(u * of.velocity, axis=1)
    jacobian = of.jacobian.copy()
    jacobian[:, 2, :2], jacobian[:, 2, 2:] = 0.0, u
    crossed = of.state @ jacobian.transpose(0, 2, 1)
    covariance = jacobian @ crossed + noise
    covariance[:, :2, :2] = of.covariance[:, :2, :2] + noise[:, :2, :2]
    covariance[:, 2, :2] -= across[:, None] * noise[:, 1, :2]
    covariance[:, :2, 2] = covariance[:, 2, :2]
    covariance[:, 2, 2] += noise[:, 1, 1] * (across**2 + across_variance)
    covariance[:, 2, 2] -= 2.0 * across * noise[:, 1, 2]
    return Compared(of.model, residual, covariance, crossed)


def update(
    mean: FloatArray, covariance: FloatArray, pair: Compared
) -> tuple[FloatArray, FloatArray]:
    """Kalman update of P states (P, s), (P, s, s) by the pairs, one each.

    W = P_xz S^-1, x + W v, P - W S W' (Koch 2014, (3.42)-(3.44)). What of the state is beyond
    position and velocity is left to the caller (:func:`.model_sets.follow_head`).

    Raises
    ------
    ValueError
        If the state is not position and velocity.
    """
    if mean.shape[1] != STATE:
        raise ValueError(f"states of {mean.shape[1]} components: allowed are {STATE}")
    gain = np.linalg.solve(pair.covariance, pair.crossed.transpose(0, 2, 1)).transpose(0, 2, 1)
    reduced = covariance - gain @ pair.covariance @ gain.transpose(0, 2, 1)
    moved = mean + (gain @ pair.residual[:, :, None])[:, :, 0]
    return moved, 0.5 * (reduced + reduced.transpose(0, 2, 1))
