"""The door: validates, orders and de-duplicates what sensors send.

Nothing that is refused here changes anything but a counter. A fault of the whole scan rejects the
scan; a fault of one detection leaves that detection out; a fault of an attribute makes it unknown.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from gda_tracker.vocabulary.arrays import BoolArray, FloatArray
from gda_tracker.vocabulary.scans import IDENTITY_QUATERNION, Detections, Scan, ScanKey

LARGEST_STAMP_NS = 2**63 - 1


class Rejected(ValueError):
    """A scan is refused as a whole; the message is the reason's name."""


@dataclass(frozen=True)
class DefaultNoise:
    """Standard deviations for detections that bring none of their own [m, rad, rad, m/s]."""

    range_std_m: float
    azimuth_std_rad: float
    elevation_std_rad: float
    range_rate_std_mps: float


def validate(
    detections: Detections, noise: DefaultNoise, tracking_frame: str, limit: int, epoch: int = 0
) -> tuple[Scan, Counter[str]]:
    """Turn ``detections`` into an admitted scan.

    Returns
    -------
    scan, counts
        The scan with the valid detections in the source's order, and how many detections were left
        out or mended, by reason: ``not_finite``, ``negative_range``, ``zero_range``, ``bad_noise``
        (left out), ``azimuth_wrapped``, ``rcs_not_finite``, ``rcs_negative`` (mended).

    Raises
    ------
    Rejected
        ``missing_sensor_id``, ``stamp_out_of_range``, ``too_many_detections``,
        ``array_length_mismatch`` or ``bad_sensor_pose``.
    """
    n = len(detections.range_m)
    if not detections.sensor_id:
        raise Rejected("missing_sensor_id")
    if not 0 <= detections.stamp_ns <= LARGEST_STAMP_NS:
        raise Rejected("stamp_out_of_range")
    if n > limit:
        raise Rejected("too_many_detections")
    for name in (
        "azimuth_rad",
        "elevation_rad",
        "range_rate_mps",
        "rcs_m2",
        "rcs_valid",
        "time_offset_s",
    ):
        values = getattr(detections, name)
        if values is not None and np.shape(values) != (n,):
            raise Rejected("array_length_mismatch")
    position, orientation = _pose(detections)
    counts: Counter[str] = Counter()

    quantities = [detections.range_m, detections.azimuth_rad]
    quantities += [
        q for q in (detections.elevation_rad, detections.range_rate_mps) if q is not None
    ]
    offsets = detections.time_offset_s
    keep = np.ones(n, dtype=bool)
    finite = np.logical_and.reduce([np.isfinite(q) for q in quantities])
    if offsets is not None:
        finite &= np.isfinite(offsets)
    _leave_out(keep, ~finite, "not_finite", counts)
    _leave_out(keep, detections.range_m < 0.0, "negative_range", counts)
    _leave_out(keep, detections.range_m == 0.0, "zero_range", counts)
    covariance = _noise_covariance(detections, noise, n)
    _leave_out(keep, ~_positive_definite(covariance), "bad_noise", counts)

    rows = np.flatnonzero(keep)
    azimuth = detections.azimuth_rad[rows]
    beyond = np.abs(azimuth) > math.pi
    if beyond.any():
        counts["azimuth_wrapped"] += int(np.count_nonzero(beyond))
        azimuth = np.where(beyond, -((-azimuth + math.pi) % (2.0 * math.pi) - math.pi), azimuth)
    rcs, known = _radar_cross_section(detections, rows, counts)

    def chosen(values: FloatArray | None) -> FloatArray | None:
        return None if values is None else np.asarray(values, dtype=np.float64)[rows]

    scan = Scan(
        key=ScanKey(epoch, detections.sensor_id, detections.stamp_ns),
        frame_id=tracking_frame,
        sensor_position_m=position,
        sensor_orientation_xyzw=orientation,
        source_index=rows.astype(np.int32),
        range_m=np.asarray(detections.range_m, dtype=np.float64)[rows],
        azimuth_rad=azimuth,
        noise_covariance=covariance[rows],
        rcs_m2=rcs,
        rcs_valid=known,
        elevation_rad=chosen(detections.elevation_rad),
        range_rate_mps=chosen(detections.range_rate_mps),
        time_offset_s=chosen(offsets),
    )
    return scan, counts


def _leave_out(keep: BoolArray, bad: BoolArray, reason: str, counts: Counter[str]) -> None:
    bad = bad & keep
    if bad.any():
        counts[reason] += int(np.count_nonzero(bad))
        keep[bad] = False


def _pose(detections: Detections) -> tuple[FloatArray, FloatArray]:
    position = np.array(detections.sensor_position_m, dtype=np.float64)
    orientation = np.array(detections.sensor_orientation_xyzw, dtype=np.float64)
    if position.shape != (3,) or orientation.shape != (4,):
        raise Rejected("bad_sensor_pose")
    if not orientation.any():
        orientation = np.array(IDENTITY_QUATERNION)
    length = math.sqrt(float(orientation @ orientation))
    if not np.isfinite(position).all() or not abs(length - 1.0) < 1e-3:
        raise Rejected("bad_sensor_pose")
    return position, orientation


def _noise_covariance(detections: Detections, noise: DefaultNoise, n: int) -> FloatArray:
    """Noise covariance (n, d, d) from what the scan brings, else from the parameters."""
    sources = [
        (detections.range_m, detections.range_std_m, noise.range_std_m),
        (detections.azimuth_rad, detections.azimuth_std_rad, noise.azimuth_std_rad),
        (detections.elevation_rad, detections.elevation_std_rad, noise.elevation_std_rad),
        (detections.range_rate_mps, detections.range_rate_std_mps, noise.range_rate_std_mps),
    ]
    deviations = []
    for measured, own, default in sources:
        if own is not None and np.shape(own) not in ((n,), (1,)):
            raise Rejected("array_length_mismatch")
        if measured is not None:
            deviations.append(default if own is None else np.asarray(own, dtype=np.float64))
    d = len(deviations)
    if detections.covariance is not None:
        if np.shape(detections.covariance) != (n, d, d):
            raise Rejected("array_length_mismatch")
        return np.asarray(detections.covariance, dtype=np.float64)
    covariance = np.zeros((n, d, d))
    for i, deviation in enumerate(deviations):
        # A negative deviation stays visible as a negative variance, which the next check refuses.
        covariance[:, i, i] = deviation * np.abs(deviation)
    return covariance


def _positive_definite(covariance: FloatArray) -> BoolArray:
    """Whether each (d, d) block is finite, symmetric and positive definite, by leading minors."""
    n, d, _ = covariance.shape
    good = np.isfinite(covariance).all(axis=(1, 2))
    safe = np.where(good[:, None, None], covariance, np.eye(d))
    good &= np.isclose(safe, safe.transpose(0, 2, 1), rtol=1e-6, atol=0.0).all(axis=(1, 2))
    if d == 2:
        determinant = safe[:, 0, 0] * safe[:, 1, 1] - safe[:, 0, 1] * safe[:, 1, 0]
        return good & (safe[:, 0, 0] > 0.0) & (determinant > 0.0)
    for size in range(1, d + 1):
        good &= np.linalg.det(safe[:, :size, :size]) > 0.0
    return good


def _radar_cross_section(
    detections: Detections, rows: np.ndarray, counts: Counter[str]
) -> tuple[FloatArray, BoolArray]:
    """RCS [m2] with zeros where unknown, and whether it is known."""
    if detections.rcs_m2 is None:
        return np.zeros(len(rows)), np.zeros(len(rows), dtype=bool)
    rcs = np.array(detections.rcs_m2, dtype=np.float64)[rows]
    if detections.rcs_valid is None:
        known = np.ones(len(rows), dtype=bool)
    else:
        known = np.asarray(detections.rcs_valid, dtype=bool)[rows]
    _leave_out(known, ~np.isfinite(rcs), "rcs_not_finite", counts)
    _leave_out(known, rcs < 0.0, "rcs_negative", counts)
    rcs[~known] = 0.0
    return rcs, known


@dataclass(slots=True, order=True)
class _Waiting:
    generation: int
    stamp_ns: int
    arrival: int
    scan: Scan = field(compare=False)
    admitted_at: float = field(compare=False)
    received: int = field(compare=False)
    counts: Counter[str] = field(compare=False)


class WaitingRoom:
    """A bounded queue of admitted scans in time order.

    A stamp that lies ``time_jump_s`` or more before the newest admitted one starts a new
    generation: the time axis was reset (a bag loops), and so will be the tracks. Less than that is
    ``late``.
    """

    def __init__(self) -> None:
        self._queue: list[_Waiting] = []
        self._arrivals = itertools.count()
        self.generation = 0
        self.newest_ns: int | None = None
        self.opened: tuple[int, str] | None = None

    def __len__(self) -> int:
        return len(self._queue)

    def holds(self, sensor_id: str, stamp_ns: int) -> bool:
        """Whether a scan of this sensor and stamp waits already."""
        return any(
            w.stamp_ns == stamp_ns and w.scan.key.sensor_id == sensor_id for w in self._queue
        )

    def check_time(self, sensor_id: str, stamp_ns: int, time_jump_s: float) -> int:
        """Return the generation that the scan belongs to; raise ``Rejected('late')``."""
        newest = self.newest_ns
        if newest is not None and stamp_ns < newest - round(time_jump_s * 1e9):
            return self.generation + 1
        if self.opened is not None:
            last_ns, last_sensor = self.opened
            if stamp_ns < last_ns or (stamp_ns == last_ns and sensor_id == last_sensor):
                raise Rejected("late")
        return self.generation

    def put(
        self, scan: Scan, generation: int, admitted_at: float, received: int, counts: Counter[str]
    ) -> None:
        """Add a scan; its generation comes from :meth:`check_time`."""
        if generation != self.generation:
            self.generation, self.newest_ns, self.opened = generation, None, None
        stamp_ns = scan.key.stamp_ns
        self.newest_ns = stamp_ns if self.newest_ns is None else max(self.newest_ns, stamp_ns)
        heapq.heappush(
            self._queue,
            _Waiting(
                generation, stamp_ns, next(self._arrivals), scan, admitted_at, received, counts
            ),
        )

    def take(self) -> _Waiting:
        """Take the earliest scan out."""
        waiting = heapq.heappop(self._queue)
        if waiting.generation == self.generation:
            self.opened = (waiting.stamp_ns, waiting.scan.key.sensor_id)
        return waiting
