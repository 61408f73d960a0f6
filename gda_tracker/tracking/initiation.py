"""Initiation: two-point differencing of detections that belong to no track, and of labelled ones.

Tchamova et al. 2004, section 14.2.2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.sparse import csr_array
from scipy.sparse.csgraph import min_weight_full_bipartite_matching

from gda_tracker.kinematics.sensor_models import PolarMeasurements, cartesian_positions
from gda_tracker.vocabulary.arrays import FloatArray, IntArray, empty_floats

# Up to so many cells the assignment is solved as a full matrix, which is faster then.
DENSE_CELLS = 4096
LOG_TWO_PI = math.log(2.0 * math.pi)


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


def bounded_speed(
    mean: FloatArray, covariance: FloatArray, max_speed_mps: float
) -> tuple[FloatArray, FloatArray]:
    """States (N, 4) updated by what is known about speeds: none exceeds ``max_speed_mps``.

    The uniform distribution of the velocity over the disc of this radius has mean zero and
    covariance max_speed^2 / 4 per coordinate; it enters as a measurement of the velocity. Without
    it two inexact positions in quick succession start tracks at speeds that no target has.
    (Compare the initial covariance diag[R, v_max^2 I] of Koch 2014, (3.8).)
    """
    prior = (max_speed_mps / 2.0) ** 2 * np.eye(2)
    spread = covariance[:, 2:, 2:] + prior
    gain = covariance[:, :, 2:] @ np.linalg.inv(spread)
    bounded = mean - (gain @ mean[:, 2:, None])[:, :, 0]
    reduced = covariance - gain @ spread @ gain.transpose(0, 2, 1)
    return bounded, 0.5 * (reduced + reduced.transpose(0, 2, 1))


@dataclass(slots=True)
class StartPoints:
    """Detections of the last scans that belong to no track yet.

    ``position`` (S, 2) [m], ``covariance`` (S, 2, 2) [m2], ``stamp_ns`` (S,), ``age_scans`` (S,)
    scans since the detection, ``number`` (S,) running number of the detection,
    ``signal`` (S,) its strength, NaN where unknown.
    """

    position: FloatArray = field(default_factory=lambda: empty_floats(0, 2))
    covariance: FloatArray = field(default_factory=lambda: empty_floats(0, 2, 2))
    stamp_ns: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    age_scans: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    number: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    signal: FloatArray = field(default_factory=empty_floats)

    def __post_init__(self) -> None:
        """Say of points that were made without strengths that none is known."""
        if len(self.signal) != len(self.position):
            self.signal = np.full(len(self.position), np.nan)

    def __len__(self) -> int:
        return len(self.position)

    def select(self, rows: np.ndarray) -> StartPoints:
        """Return the start points of the given rows or mask."""
        return StartPoints(
            self.position[rows],
            self.covariance[rows],
            self.stamp_ns[rows],
            self.age_scans[rows],
            self.number[rows],
            self.signal[rows],
        )


@dataclass(slots=True)
class NewTracks:
    """Tracks that start on a scan: N states at its time and where they come from.

    ``detection`` (N,) is the row in the scan, ``first_stamp_ns`` (N,) the time of the earlier
    detection and ``first_number`` (N,) its running number, ``gap_scans`` (N,) the scans between the
    two detections plus one. ``log_density`` (N,) [log 1/m2] is that of the second one's position
    given the first, were both a target's. ``first_signal`` (N,) is the strength of the earlier
    detection, NaN where unknown.
    """

    mean: FloatArray = field(default_factory=lambda: empty_floats(0, 4))
    covariance: FloatArray = field(default_factory=lambda: empty_floats(0, 4, 4))
    detection: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    first_stamp_ns: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    gap_scans: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    first_number: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    log_density: FloatArray = field(default_factory=empty_floats)
    first_signal: FloatArray = field(default_factory=empty_floats)

    def __post_init__(self) -> None:
        """Say of tracks that were made without strengths that none is known."""
        if len(self.first_signal) != len(self.detection):
            self.first_signal = np.full(len(self.detection), np.nan)

    def select(self, rows: np.ndarray | slice) -> NewTracks:
        """Return the new tracks of the given rows."""
        return NewTracks(
            self.mean[rows],
            self.covariance[rows],
            self.detection[rows],
            self.first_stamp_ns[rows],
            self.gap_scans[rows],
            self.first_number[rows],
            self.log_density[rows],
            self.first_signal[rows],
        )


def start_tracks(
    points: StartPoints,
    measurements: PolarMeasurements,
    unassigned: IntArray,
    stamp_ns: int,
    *,
    max_speed_mps: float,
    memory_scans: int,
    first_number: int = 0,
    signal: FloatArray | None = None,
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
        Scans for which a start point waits for its second detection, counted from the next one.
    first_number
        Running number of the scan's first detection.
    signal
        (n,) strengths of the measurements, where they count.

    Returns
    -------
    new, points
        The new tracks, and the start points that wait for the next scan.
    """
    free = measurements.select(unassigned)
    position, covariance = cartesian_positions(free)
    offset = free.time_offset_s
    stamps = np.full(len(free), stamp_ns, dtype=np.int64)
    if offset is not None:
        stamps += np.round(offset * 1e9).astype(np.int64)
    age = np.zeros(len(free), dtype=np.int64)
    fresh = StartPoints(position, covariance, stamps, age, first_number + unassigned)
    if signal is not None:
        fresh.signal = signal[unassigned]
    older, newer, cost = _allowed_pairs(points, fresh, max_speed_mps)
    older, newer = _match(older, newer, cost)

    new = NewTracks()
    if len(newer):
        new = _tracks_of_pairs(points, fresh, older, newer, max_speed_mps)
        new.detection = unassigned[newer]
        if offset is not None:
            new.mean, new.covariance = _move_back(new.mean, new.covariance, offset[newer])
    waiting = points.age_scans + 1 < memory_scans
    waiting[older] = False
    kept = points.select(waiting)
    if len(newer):
        alone = np.ones(len(fresh), dtype=bool)
        alone[newer] = False
        fresh = fresh.select(alone)
    return new, StartPoints(
        np.concatenate([kept.position, fresh.position]),
        np.concatenate([kept.covariance, fresh.covariance]),
        np.concatenate([kept.stamp_ns, fresh.stamp_ns]),
        np.concatenate([kept.age_scans + 1, fresh.age_scans]),
        np.concatenate([kept.number, fresh.number]),
        np.concatenate([kept.signal, fresh.signal]),
    )


def _tracks_of_pairs(
    points: StartPoints, fresh: StartPoints, older: IntArray, newer: IntArray, max_speed_mps: float
) -> NewTracks:
    """Tracks at the times of their second detections; ``detection`` are rows of ``fresh``."""
    dt_s = (fresh.stamp_ns[newer] - points.stamp_ns[older]) / 1e9
    first, first_covariance = points.position[older], points.covariance[older]
    second, second_covariance = fresh.position[newer], fresh.covariance[newer]
    mean, covariance = two_point_states(first, first_covariance, second, second_covariance, dt_s)
    return NewTracks(
        mean,
        covariance,
        newer,
        points.stamp_ns[older],
        points.age_scans[older] + 1,
        points.number[older],
        _log_density(second - first, first_covariance + second_covariance, dt_s, max_speed_mps),
        points.signal[older],
    )


def _log_density(
    gap: FloatArray, covariance: FloatArray, dt_s: FloatArray, max_speed_mps: float
) -> FloatArray:
    """Log density (N,) of position differences (N, 2) of a target's detections ``dt_s`` (N,) apart.

    Normal, with the errors' covariance (N, 2, 2) and that of speeds below ``max_speed_mps``, as in
    :func:`bounded_speed`.
    """
    travel = np.square(max_speed_mps * dt_s / 2.0)
    spread = covariance + travel[:, None, None] * np.eye(2)
    squared = (gap * np.linalg.solve(spread, gap[:, :, None])[:, :, 0]).sum(axis=1)
    log_density: FloatArray = -0.5 * (squared + np.log(np.linalg.det(spread))) - LOG_TWO_PI
    return log_density


def _allowed_pairs(
    points: StartPoints, fresh: StartPoints, max_speed_mps: float
) -> tuple[IntArray, IntArray, FloatArray]:
    """Rows of the allowed pairs in ``points`` and ``fresh``, with distance over reach in [0, 1].

    Only detections within a strip of x around a start point are compared with it: no matrix of all
    pairs in a scan full of clutter.
    """
    variance = points.covariance[:, 0, 0] + points.covariance[:, 1, 1]
    fresh_variance = fresh.covariance[:, 0, 0] + fresh.covariance[:, 1, 1]
    if not len(points) or not len(fresh):
        none = np.zeros(0, dtype=np.int64)
        return none, none, np.zeros(0)
    longest = (fresh.stamp_ns.max() - points.stamp_ns) / 1e9
    strip = max_speed_mps * longest + 3.0 * np.sqrt(variance + fresh_variance.max())
    order = np.argsort(fresh.position[:, 0], kind="stable")
    x, sorted_x = points.position[:, 0], fresh.position[order, 0]
    first = np.searchsorted(sorted_x, x - strip, side="left")
    count = np.maximum(np.searchsorted(sorted_x, x + strip, side="right") - first, 0)
    older = np.repeat(np.arange(len(points)), count)
    newer = order[np.arange(len(older)) + np.repeat(first - (np.cumsum(count) - count), count)]

    gap = fresh.position[newer] - points.position[older]
    distance = np.hypot(gap[:, 0], gap[:, 1])
    travel = max_speed_mps * ((fresh.stamp_ns[newer] - points.stamp_ns[older]) / 1e9)
    reach = travel + 3.0 * np.sqrt(variance[older] + fresh_variance[newer])
    allowed = (travel > 0.0) & (distance <= reach)
    return older[allowed], newer[allowed], distance[allowed] / reach[allowed]


def _numbered(values: IntArray) -> tuple[IntArray, IntArray]:
    """Return the distinct values, rising, and the place of each of them (P,) among these.

    As ``np.unique`` does, which sorts; these are rows of arrays that are about as long as they are.
    """
    there = np.zeros(int(values.max()) + 1, dtype=np.bool_)
    there[values] = True
    return np.flatnonzero(there), (np.cumsum(there) - 1)[values]


def _match(older: IntArray, newer: IntArray, cost: FloatArray) -> tuple[IntArray, IntArray]:
    """Choose from the allowed pairs the most, with the least cost; sorted by the older row."""
    if not len(cost):
        return older, newer
    (rows, row), (columns, column) = _numbered(older), _numbered(newer)
    # Leaving a row alone costs more than any other choice of all the rows.
    alone = 2.0 * (len(rows) + 1)
    if len(rows) * len(columns) <= DENSE_CELLS:
        dense = np.full((len(rows), len(columns)), alone)
        dense[row, column] = cost
        i, j = linear_sum_assignment(dense)
        good = dense[i, j] < alone
    else:
        # The solver of older scipy takes 32-bit indices alone.
        own = np.arange(len(rows), dtype=np.int32)
        row, column = row.astype(np.int32), column.astype(np.int32)
        sparse = csr_array(
            (
                # The solver takes a zero for no edge; one more for each row changes no choice.
                np.concatenate([1.0 + cost, np.full(len(rows), 1.0 + alone)]),
                (np.concatenate([row, own]), np.concatenate([column, len(columns) + own])),
            ),
            shape=(len(rows), len(columns) + len(rows)),
        )
        i, j = min_weight_full_bipartite_matching(sparse)
        good = j < len(columns)
    return rows[i[good]], columns[j[good]]


def _move_back(
    mean: FloatArray, covariance: FloatArray, offset_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Move states (N, 4) from their detections' time, ``offset_s`` (N,), to that of the scan."""
    transition = np.tile(np.eye(4), (len(mean), 1, 1))
    transition[:, 0, 2] = transition[:, 1, 3] = -offset_s
    moved = (transition @ mean[:, :, None])[:, :, 0]
    return moved, transition @ covariance @ transition.transpose(0, 2, 1)
