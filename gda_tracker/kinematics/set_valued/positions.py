"""Detections of a radar as observations of the set-valued filter.

The seriously possible region (Stirling & Thompson 1991, equation 9) is a box along the axes of an
observation whose errors are uncorrelated. Range and azimuth are neither linear in the state nor, as
x and y, uncorrelated. So each detection is converted into an unbiased position and that is written
in axes of its own: along the line of sight and across it, where range and azimuth errors are
uncorrelated. Detections with correlated errors (a tilted radar, a covariance of the source) take
the principal axes of their position error. The state stays in the tracking plane; every detection
has its own H, a rotation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gda_tracker.kinematics.sensor_models import (
    SMALLEST_RANGE_M,
    PolarMeasurements,
    polar_measurements,
)
from gda_tracker.vocabulary.arrays import FloatArray, IntArray
from gda_tracker.vocabulary.scans import Scan

STATE_SIZE = 4  # x, y, vx, vy
# Beyond, a detection is rather a circle than a position.
COARSEST_AZIMUTH_STD_RAD = 0.5


@dataclass(slots=True)
class Positions:
    """s detections as observations z = H x + w of states [x, y, vx, vy].

    ``observation`` z (s, 2) [m] in axes of the detection's own, ``observing`` H (s, 2, 4), ``std``
    (s, 2) [m] of the two errors, which are uncorrelated, ``position_m`` (s, 2) in the tracking
    plane, ``range_m`` (s,) from the sensor in that plane, >= a nanometre. ``source_index`` (s,) is
    the row in the source's ``Detections``. ``left_out`` detections of the scan were none.
    """

    observation: FloatArray
    observing: FloatArray
    std: FloatArray
    position_m: FloatArray
    range_m: FloatArray
    source_index: IntArray
    left_out: int = 0

    def __len__(self) -> int:
        return len(self.observation)

    def noise(self) -> FloatArray:
        """R (s, 2, 2) [m2], diagonal."""
        return self.std[:, :, None] ** 2 * np.eye(2)


def positions_of_scan(scan: Scan) -> Positions:
    """Convert the detections of an admitted scan; range rates are not used.

    A detection with a time offset observes the position at its own time, x + dt vx. One with an
    azimuth error above :data:`COARSEST_AZIMUTH_STD_RAD` tells no position and is left out.
    """
    measurements = polar_measurements(scan)
    noise = measurements.covariance
    fine = noise[:, 1, 1] <= COARSEST_AZIMUTH_STD_RAD**2
    rows = np.flatnonzero(fine & (np.linalg.det(noise) > 0.0))
    measurements = measurements.select(rows)
    factor, covariance = _along_and_across(measurements)
    axes = _own_axes(measurements.azimuth_rad, covariance)
    sight = _rotation(measurements.azimuth_rad)
    position = measurements.sensor_xy_m + (factor * measurements.range_m)[:, None] * sight[:, 0]
    turn = axes @ sight.transpose(0, 2, 1)
    local = turn @ covariance @ turn.transpose(0, 2, 1)
    observing = np.zeros((len(rows), 2, STATE_SIZE))
    observing[:, :, :2] = axes
    if measurements.time_offset_s is not None:
        observing[:, :, 2:] = measurements.time_offset_s[:, None, None] * axes
    return Positions(
        observation=(axes @ position[:, :, None])[:, :, 0],
        observing=observing,
        std=np.sqrt(np.diagonal(local, axis1=1, axis2=2)),
        position_m=position,
        range_m=np.maximum(measurements.range_m, SMALLEST_RANGE_M),
        source_index=scan.source_index[rows].astype(np.int64),
        left_out=len(scan) - len(rows),
    )


def _along_and_across(measurements: PolarMeasurements) -> tuple[FloatArray, FloatArray]:
    """Factor (s,) that makes the positions unbiased, and covariances along and across the sight.

    For uncorrelated errors as :func:`gda_tracker.kinematics.converted_measurements.
    unbiased_positions` gives them, the moments of the truth given the measurement, but written
    along the line of sight, where they are diagonal and no digits are lost far away. Otherwise to
    first order.
    """
    r, noise = measurements.range_m, measurements.covariance
    range_variance, variance = noise[:, 0, 0], noise[:, 1, 1]
    covariance = np.empty((len(r), 2, 2))
    free = noise[:, 0, 1] == 0.0
    fall = np.exp(-2.0 * variance)
    square = r * r
    covariance[:, 0, 0] = np.where(
        free,
        square * (np.expm1(variance) + 0.5 * np.expm1(-2.0 * variance))
        + range_variance * (1.0 + fall) / 2.0,
        range_variance,
    )
    covariance[:, 1, 1] = np.where(
        free, -0.5 * (square + range_variance) * np.expm1(-2.0 * variance), square * variance
    )
    covariance[:, 0, 1] = covariance[:, 1, 0] = r * noise[:, 0, 1]
    return np.where(free, np.exp(0.5 * variance), 1.0), covariance


def _own_axes(azimuth: FloatArray, covariance: FloatArray) -> FloatArray:
    """Rotations (s, 2, 2) into axes in which these covariances are diagonal."""
    along, across, mixed = covariance[:, 0, 0], covariance[:, 1, 1], covariance[:, 0, 1]
    turn = 0.5 * np.arctan2(2.0 * mixed, along - across)
    # By less than 45 degrees: the axes stay those of the line of sight as far as they can.
    turn = turn - np.pi / 2.0 * np.round(turn / (np.pi / 2.0))
    return _rotation(azimuth + turn)


def _rotation(angle: FloatArray) -> FloatArray:
    """Matrices (s, 2, 2) that write a vector in axes turned by an angle [rad]."""
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.stack([np.stack([cosine, sine], axis=1), np.stack([-sine, cosine], axis=1)], axis=1)
