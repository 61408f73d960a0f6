"""Initiation: two-point differencing of detections that belong to no track, and of labelled ones.

Tchamova et al. 2004, section 14.2.2.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import linear_sum_assignment

from gda_tracker.kinematics.sensor_models import PolarMeasurements, cartesian_positions
from gda_tracker.vocabulary.arrays import FloatArray, IntArray, empty_floats


def two_point_states(
    first_position: FloatArray,
    first_covariance: FloatArray,
    second_position: FloatArray,
    second_covariance: FloatArray,
    dt_s: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """States from pairs of positions: the second position, and their difference over the time.

    Parameters
    ----------
    first_position, second_position
        (N, 2) [m].
    first_covariance, second_covariance
        (N, 2, 2) [m2].
    dt_s
        (N,) time between them [s], > 0.

    Returns
    -------
    mean, covariance
        (N, 4) [x, y, vx, vy] and (N, 4, 4) at the time of the second position.
    """
    step = dt_s[:, None]
    mean = np.concatenate([second_position, (second_position - first_position) / step], axis=1)
    covariance = np.empty((len(mean), 4, 4))
    covariance[:, :2, :2] = second_covariance
    covariance[:, :2, 2:] = covariance[:, 2:, :2] = second_covariance / step[:, :, None]
    covariance[:, 2:, 2:] = (first_covariance + second_covariance) / step[:, :, None] ** 2
    return mean, covariance


@dataclass(slots=True)
class StartPoints:
    """Detections of the last scans that belong to no track yet.

    ``position`` (S, 2) [m], ``covariance`` (S, 2, 2) [m2], ``stamp_ns`` (S,), ``age_scans`` (S,)
    scans since the detection.
    """

    position: FloatArray = field(default_factory=lambda: empty_floats(0, 2))
    covariance: FloatArray = field(default_factory=lambda: empty_floats(0, 2, 2))
    stamp_ns: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    age_scans: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def __len__(self) -> int:
        return len(self.position)

    def select(self, rows: np.ndarray) -> StartPoints:
        """Return the start points of the given rows or mask."""
        return StartPoints(
            self.position[rows], self.covariance[rows], self.stamp_ns[rows], self.age_scans[rows]
        )


@dataclass(slots=True)
class NewTracks:
    """Tracks that start on a scan: N states and where they come from.

    ``detection`` (N,) is the row in the scan, ``first_stamp_ns`` (N,) the time of the earlier
    detection, ``gap_scans`` (N,) the scans between the two detections plus one.
    """

    mean: FloatArray
    covariance: FloatArray
    detection: IntArray
    first_stamp_ns: IntArray
    gap_scans: IntArray


def start_tracks(
    points: StartPoints,
    measurements: PolarMeasurements,
    unassigned: IntArray,
    stamp_ns: int,
    *,
    max_speed_mps: float,
    memory_scans: int,
) -> tuple[NewTracks, StartPoints]:
    """Pair unassigned detections with earlier start points.

    A pair is allowed if the speed that it implies, less three standard deviations of the position
    difference, is at most ``max_speed_mps``. Among the allowed pairs the assignment with the most
    pairs and, among those, the smallest sum of normalised distances is taken.

    Parameters
    ----------
    points
        Start points of earlier scans.
    measurements
        The scan's measurements; ``unassigned`` (U,) are the rows that belong to no track.
    stamp_ns
        Time of the scan.
    max_speed_mps
        Largest speed of a target [m/s].
    memory_scans
        Scans for which a start point waits for its second detection.

    Returns
    -------
    new, points
        The new tracks, and the start points that wait for the next scan.
    """
    positions, covariances = cartesian_positions(measurements)
    position, covariance = positions[unassigned], covariances[unassigned]
    offsets = measurements.time_offset_s
    stamps = np.full(len(unassigned), stamp_ns, dtype=np.int64)
    if offsets is not None:
        stamps += np.round(offsets[unassigned] * 1e9).astype(np.int64)
    # (S, U) pairs of start point and detection
    dt = (stamps[None, :] - points.stamp_ns[:, None]) / 1e9
    gap = position[None, :, :] - points.position[:, None, :]
    variance = np.trace(points.covariance, axis1=1, axis2=2)[:, None] + np.trace(
        covariance, axis1=1, axis2=2
    )
    distance = np.sqrt((gap * gap).sum(axis=2))
    allowed = (dt > 0.0) & (distance - 3.0 * np.sqrt(variance) <= max_speed_mps * dt)
    reach = max_speed_mps * dt + 3.0 * np.sqrt(variance)
    cost = np.where(allowed, distance / np.where(allowed, reach, 1.0), 1e6)
    older, newer = linear_sum_assignment(cost)
    good = allowed[older, newer]
    older, newer = older[good], newer[good]

    mean, start_covariance = two_point_states(
        points.position[older],
        points.covariance[older],
        position[newer],
        covariance[newer],
        dt[older, newer],
    )
    new = NewTracks(
        mean,
        start_covariance,
        unassigned[newer],
        points.stamp_ns[older],
        points.age_scans[older] + 1,
    )
    waiting = np.ones(len(points), dtype=bool)
    waiting[older] = False
    kept = points.select(waiting & (points.age_scans + 1 < memory_scans + 1))
    fresh = np.ones(len(unassigned), dtype=bool)
    fresh[newer] = False
    return new, StartPoints(
        np.concatenate([kept.position, position[fresh]]),
        np.concatenate([kept.covariance, covariance[fresh]]),
        np.concatenate([kept.stamp_ns, stamps[fresh]]),
        np.concatenate([kept.age_scans + 1, np.zeros(int(fresh.sum()), dtype=np.int64)]),
    )
