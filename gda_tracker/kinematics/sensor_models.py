"""Sensor models: from a scan to measurements in the tracking plane, and from states to innovations.

A polar measurement is z = [horizontal range, azimuth in tracking axes]; elevation, yaw, tilt and
height of the sensor are taken out once per scan, so that the filters see one simple model:
h(x) = [|p - s|, atan2(p_y - s_y, p_x - s_x)], p the target's position, s the sensor's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gda_tracker.vocabulary.arrays import FloatArray, Int32Array, IntArray
from gda_tracker.vocabulary.scans import Scan

TWO_PI = 2.0 * math.pi
# Below this horizontal range the azimuth has no meaning.
SMALLEST_RANGE_M = 1e-9


def wrap_angle(angle: FloatArray) -> FloatArray:
    """Wrap angles [rad] into [-pi, pi]; an odd multiple of pi becomes -pi but for rounding."""
    return (angle + math.pi) % TWO_PI - math.pi


@dataclass(slots=True)
class PolarMeasurements:
    """n measurements in the tracking plane.

    ``range_m``, ``azimuth_rad`` (n,), ``covariance`` (n, 2, 2) in the order range, azimuth
    [m2, m rad, rad2], ``sensor_xy_m`` (2,), ``time_offset_s`` (n,) or ``None``.
    """

    range_m: FloatArray
    azimuth_rad: FloatArray
    covariance: FloatArray
    sensor_xy_m: FloatArray
    time_offset_s: FloatArray | None

    def __len__(self) -> int:
        return len(self.range_m)

    def select(self, rows: IntArray) -> PolarMeasurements:
        """Return the measurements of the given rows."""
        return PolarMeasurements(
            self.range_m[rows],
            self.azimuth_rad[rows],
            self.covariance[rows],
            self.sensor_xy_m,
            None if self.time_offset_s is None else self.time_offset_s[rows],
        )


def polar_measurements(scan: Scan) -> PolarMeasurements:
    """Take sensor yaw, tilt and elevation out of a scan.

    A level sensor without elevation keeps range and noise as they are and only turns the azimuth.
    Else range r, azimuth a, elevation e become the horizontal range and azimuth of the rotated
    direction, with the noise carried along by the Jacobian.
    """
    x, y, z, w = (float(value) for value in scan.sensor_orientation_xyzw)
    noise = scan.noise_covariance[:, :2, :2]
    tilted = abs(x) > 1e-12 or abs(y) > 1e-12
    if scan.elevation_rad is None and not tilted:
        yaw = 2.0 * math.atan2(z, w)
        azimuth = scan.azimuth_rad if yaw == 0.0 else wrap_angle(scan.azimuth_rad + yaw)
        return PolarMeasurements(
            scan.range_m, azimuth, noise, scan.sensor_position_m[:2], scan.time_offset_s
        )
    n = len(scan)
    rotation = _rotation_matrix(x, y, z, w)
    r, a = scan.range_m, scan.azimuth_rad
    e = np.zeros(n) if scan.elevation_rad is None else scan.elevation_rad
    ca, sa, ce, se = np.cos(a), np.sin(a), np.cos(e), np.sin(e)
    # Columns: derivative of the Cartesian vector by range, azimuth, elevation.
    local = np.stack(
        [
            np.stack([ca * ce, -r * sa * ce, -r * ca * se], axis=1),
            np.stack([sa * ce, r * ca * ce, -r * sa * se], axis=1),
            np.stack([se, np.zeros(n), r * ce], axis=1),
        ],
        axis=1,
    )
    turned = rotation @ local
    vector = turned[:, :, 0] * r[:, None]
    horizontal = np.hypot(vector[:, 0], vector[:, 1])
    above = horizontal < SMALLEST_RANGE_M
    horizontal = np.maximum(horizontal, SMALLEST_RANGE_M)
    azimuth = np.arctan2(vector[:, 1], vector[:, 0])
    # By the angle, not by vector / horizontal, which straight above the sensor is no direction.
    to_polar = np.zeros((n, 2, 3))
    to_polar[:, 0, 0], to_polar[:, 0, 1] = np.cos(azimuth), np.sin(azimuth)
    to_polar[:, 1, 0] = -to_polar[:, 0, 1] / horizontal
    to_polar[:, 1, 1] = to_polar[:, 0, 0] / horizontal
    measured = 2 if scan.elevation_rad is None else 3
    jacobian = (to_polar @ turned)[:, :, :measured]
    covariance = (
        jacobian @ scan.noise_covariance[:, :measured, :measured] @ jacobian.transpose(0, 2, 1)
    )
    if above.any():
        covariance[above, 0, 1] = covariance[above, 1, 0] = 0.0
        covariance[above, 1, 1] = math.pi**2
    return PolarMeasurements(
        horizontal, azimuth, covariance, scan.sensor_position_m[:2], scan.time_offset_s
    )


def _rotation_matrix(x: float, y: float, z: float, w: float) -> FloatArray:
    """Rotation matrix (3, 3) of a unit quaternion."""
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def cartesian_positions(measurements: PolarMeasurements) -> tuple[FloatArray, FloatArray]:
    """Positions (n, 2) [m] and their covariances (n, 2, 2) [m2] by first-order conversion.

    Tchamova et al. 2004, section 14.2.2, with the xy term that the chapter drops.
    """
    cosine, sine = np.cos(measurements.azimuth_rad), np.sin(measurements.azimuth_rad)
    r = measurements.range_m
    position = measurements.sensor_xy_m + np.stack([r * cosine, r * sine], axis=1)
    jacobian = np.empty((len(r), 2, 2))
    jacobian[:, 0, 0], jacobian[:, 0, 1] = cosine, -r * sine
    jacobian[:, 1, 0], jacobian[:, 1, 1] = sine, r * cosine
    return position, jacobian @ measurements.covariance @ jacobian.transpose(0, 2, 1)


@dataclass(slots=True)
class Innovations:
    """Innovations of P pairs (state, measurement).

    ``residual`` (P, 2) [m, rad] with the azimuth wrapped, ``position_jacobian`` (P, 2, 2) the
    derivative of h by the position [1, rad/m], ``time_offset_s`` (P,) or ``None``, ``covariance``
    (P, 2, 2) S = H P H' + R.
    """

    residual: FloatArray
    position_jacobian: FloatArray
    time_offset_s: FloatArray | None
    covariance: FloatArray

    def jacobian(self, size: int) -> FloatArray:
        """Return H (P, 2, ``size``), the derivative of h by a state of ``size`` components."""
        full = np.zeros((len(self.residual), 2, size))
        full[:, :, :2] = self.position_jacobian
        if self.time_offset_s is not None:
            velocity = slice(size // 2, size // 2 + 2)
            full[:, :, velocity] = self.time_offset_s[:, None, None] * self.position_jacobian
        return full

    def mahalanobis_squared(self) -> tuple[FloatArray, FloatArray]:
        """Return d2 (P,) = v' S^-1 v and det S (P,)."""
        s_rr, s_ra = self.covariance[:, 0, 0], self.covariance[:, 0, 1]
        s_aa = self.covariance[:, 1, 1]
        determinant = s_rr * s_aa - s_ra * s_ra
        v_r, v_a = self.residual[:, 0], self.residual[:, 1]
        squared = (s_aa * v_r * v_r - 2.0 * s_ra * v_r * v_a + s_rr * v_a * v_a) / determinant
        return squared, determinant


@dataclass(slots=True)
class PredictedMeasurements:
    """What N states look like to the sensor.

    ``range_m``, ``azimuth_rad`` (N,), ``position_jacobian`` H (N, 2, 2) by the position [1, rad/m],
    ``covariance`` (N, 2, 2) H P H' [m2, m rad, rad2].
    """

    range_m: FloatArray
    azimuth_rad: FloatArray
    position_jacobian: FloatArray
    covariance: FloatArray

    def innovations(
        self,
        measurements: PolarMeasurements,
        state: Int32Array | slice,
        detection: Int32Array,
        offset: FloatArray | None = None,
    ) -> Innovations:
        """Innovations of pairs: rows ``state`` (P,) of these, rows ``detection`` (P,) of a scan."""
        residual = np.empty((len(detection), 2))
        residual[:, 0] = measurements.range_m[detection] - self.range_m[state]
        residual[:, 1] = wrap_angle(measurements.azimuth_rad[detection] - self.azimuth_rad[state])
        return Innovations(
            residual,
            self.position_jacobian[state],
            offset,
            self.covariance[state] + measurements.covariance[detection],
        )


def predicted_measurements(
    position: FloatArray, spread: FloatArray, sensor_xy_m: FloatArray
) -> PredictedMeasurements:
    """h, H and H P H' of positions (N, 2) [m] with covariances (N, 2, 2) [m2].

    Tchamova et al. 2004, section 14.2.1.1, in range, azimuth order, azimuth from the x axis.
    """
    dx = position[:, 0] - sensor_xy_m[0]
    dy = position[:, 1] - sensor_xy_m[1]
    distance = np.maximum(np.hypot(dx, dy), SMALLEST_RANGE_M)
    jacobian = np.empty((len(position), 2, 2))
    jacobian[:, 0, 0] = dx / distance
    jacobian[:, 0, 1] = dy / distance
    jacobian[:, 1, 0] = -jacobian[:, 0, 1] / distance
    jacobian[:, 1, 1] = jacobian[:, 0, 0] / distance
    return PredictedMeasurements(
        distance, np.arctan2(dy, dx), jacobian, jacobian @ spread @ jacobian.transpose(0, 2, 1)
    )


def innovations(
    measurements: PolarMeasurements,
    mean: FloatArray,
    covariance: FloatArray,
    detection: Int32Array,
) -> Innovations:
    """Innovations of P states, ``mean`` (P, s), against rows ``detection`` (P,) of a scan.

    A detection with a time offset tau is compared with the position moved on by tau times the
    velocity.
    """
    position, spread = mean[:, :2], covariance[:, :2, :2]
    offset = None
    if measurements.time_offset_s is not None:
        offset = measurements.time_offset_s[detection]
        velocity = slice(mean.shape[1] // 2, mean.shape[1] // 2 + 2)
        cross = covariance[:, :2, velocity]
        tau = offset[:, None, None]
        position = position + offset[:, None] * mean[:, velocity]
        spread = spread + tau * (
            cross + cross.transpose(0, 2, 1) + tau * covariance[:, velocity, velocity]
        )
    predicted = predicted_measurements(position, spread, measurements.sensor_xy_m)
    return predicted.innovations(measurements, slice(None), detection, offset)
