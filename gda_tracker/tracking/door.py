"""The door: validates what sensors send.

Nothing that is refused here changes anything but a counter. A fault of the whole scan rejects the
scan; a fault of one detection leaves that detection out; a fault of an attribute makes it unknown.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from gda_tracker.tracking.columns import Rejected as Rejected
from gda_tracker.tracking.columns import column, leave_out, numbers, optional
from gda_tracker.tracking.door_attributes import further_attributes, radar_cross_section
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray
from gda_tracker.vocabulary.scans import IDENTITY_QUATERNION, Detections, Scan, ScanKey

LARGEST_STAMP_NS = 2**63 - 1
# What lies beyond is no measurement, and its squares would spoil the arithmetic.
LARGEST_RANGE_M = 1e9
LARGEST_TIME_OFFSET_S = 60.0
SMALLEST_VARIANCE, LARGEST_VARIANCE = 1e-18, 1e18
# Least determinant of a correlation matrix that counts as positive definite.
SMALLEST_MINOR = 1e-12

DEVIATIONS = ("range_std_m", "azimuth_std_rad", "elevation_std_rad", "range_rate_std_mps")
OPTIONAL_QUANTITIES = ("elevation_rad", "range_rate_mps", "rcs_m2", "time_offset_s")


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
        out or mended, by reason: ``not_finite``, ``negative_range``, ``zero_range``,
        ``range_too_large``, ``time_offset_too_large``, ``bad_noise`` (left out),
        ``azimuth_wrapped``, ``rcs_not_finite``, ``rcs_negative`` (mended), ``attribute_not_finite``
        (values that became unknown).

    Raises
    ------
    Rejected
        ``missing_sensor_id``, ``stamp_out_of_range``, ``too_many_detections``,
        ``malformed_array``, ``array_length_mismatch``, ``bad_attribute_names`` or
        ``bad_sensor_pose``.
    """
    if not isinstance(detections.sensor_id, str) or not detections.sensor_id:
        raise Rejected("missing_sensor_id")
    stamp_ns = detections.stamp_ns
    if not isinstance(stamp_ns, int | np.integer) or not 0 <= stamp_ns <= LARGEST_STAMP_NS:
        raise Rejected("stamp_out_of_range")
    if received(detections) > limit:
        raise Rejected("too_many_detections")
    position, orientation = _pose(detections)
    range_m = numbers(detections.range_m)
    n = len(range_m)
    azimuth = column(detections.azimuth_rad, n)
    quantities = {name: optional(getattr(detections, name), n) for name in OPTIONAL_QUANTITIES}
    elevation, range_rate, rcs, offset = quantities.values()
    measured = [q for q in (range_m, azimuth, elevation, range_rate) if q is not None]

    if detections.covariance is not None:
        covariance, good = _given_covariance(detections.covariance, n, len(measured))
    elif all(getattr(detections, name) is None for name in DEVIATIONS):
        covariance, good = _from_parameters(detections, noise, n)
    else:
        covariance, good = _from_deviations(detections, noise, n)
    counts: Counter[str] = Counter()
    if _all_sound(range_m, [q for q in measured if q is not range_m], offset) and good.all():
        rows = np.arange(n)
    else:
        rows = _sound_rows(range_m, measured, offset, good, counts)
    azimuth = azimuth[rows]
    beyond = np.abs(azimuth) > math.pi
    if beyond.any():
        counts["azimuth_wrapped"] += int(np.count_nonzero(beyond))
        azimuth[beyond] = math.pi - (math.pi - azimuth[beyond]) % (2.0 * math.pi)
    rcs, known = radar_cross_section(rcs, detections.rcs_valid, rows, n, counts)
    names, values, valid = further_attributes(detections, rows, n, counts)
    scan = Scan(
        key=ScanKey(epoch, detections.sensor_id, int(stamp_ns)),
        frame_id=tracking_frame,
        sensor_position_m=position,
        sensor_orientation_xyzw=orientation,
        source_index=rows.astype(np.int32),
        range_m=range_m[rows],
        azimuth_rad=azimuth,
        noise_covariance=covariance[rows],
        rcs_m2=rcs,
        rcs_valid=known,
        elevation_rad=None if elevation is None else elevation[rows],
        range_rate_mps=None if range_rate is None else range_rate[rows],
        time_offset_s=None if offset is None else offset[rows],
        attribute_names=names,
        attribute_values=values,
        attribute_valid=valid,
    )
    return scan, counts


def _all_sound(range_m: FloatArray, others: list[FloatArray], offset: FloatArray | None) -> bool:
    """Whether no detection gives any cause for a closer look, as is usual."""
    if not len(range_m) or offset is not None:
        return False
    # NaN fails every comparison.
    if not (range_m.min() > 0.0 and range_m.max() <= LARGEST_RANGE_M):
        return False
    return all(np.isfinite(q).all() for q in others)


def _sound_rows(
    range_m: FloatArray,
    measured: list[FloatArray],
    offset: FloatArray | None,
    good: BoolArray,
    counts: Counter[str],
) -> np.ndarray:
    """Rows of the detections that stay; the others are counted by reason."""
    keep = np.ones(len(range_m), dtype=bool)
    needed = measured if offset is None else [*measured, offset]
    finite = np.logical_and.reduce([np.isfinite(q) for q in needed])
    leave_out(keep, ~finite, "not_finite", counts)
    leave_out(keep, range_m < 0.0, "negative_range", counts)
    leave_out(keep, range_m == 0.0, "zero_range", counts)
    leave_out(keep, range_m > LARGEST_RANGE_M, "range_too_large", counts)
    if offset is not None:
        too_far = np.abs(offset) > LARGEST_TIME_OFFSET_S
        leave_out(keep, too_far, "time_offset_too_large", counts)
    leave_out(keep, ~good, "bad_noise", counts)
    return np.flatnonzero(keep)


def received(detections: Detections) -> int:
    """Number of detections that a source sent, whatever they are."""
    try:
        return len(detections.range_m)
    except TypeError:
        return 0


def _pose(detections: Detections) -> tuple[FloatArray, FloatArray]:
    """Position (3,) and unit quaternion (4,); a quaternion of zeros stands for no turn."""
    try:
        position = np.array(detections.sensor_position_m, dtype=np.float64)
        orientation = np.array(detections.sensor_orientation_xyzw, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise Rejected("bad_sensor_pose") from None
    if position.shape != (3,) or orientation.shape != (4,):
        raise Rejected("bad_sensor_pose")
    x, y, z = position.tolist()
    # NaN fails every comparison.
    if not all(abs(part) <= LARGEST_RANGE_M for part in (x, y, z)):
        raise Rejected("bad_sensor_pose")
    turn = orientation.tolist()
    if not any(turn):
        return position, np.array(IDENTITY_QUATERNION)
    length = math.hypot(*turn)
    if not abs(length - 1.0) < 1e-3:
        raise Rejected("bad_sensor_pose")
    return position, orientation / length


def _from_deviations(
    detections: Detections, noise: DefaultNoise, n: int
) -> tuple[FloatArray, BoolArray]:
    """Noise covariance (n, d, d) from standard deviations, and whether it is good."""
    sources = [
        (True, detections.range_std_m, noise.range_std_m),
        (True, detections.azimuth_std_rad, noise.azimuth_std_rad),
        (
            detections.elevation_rad is not None,
            detections.elevation_std_rad,
            noise.elevation_std_rad,
        ),
        (
            detections.range_rate_mps is not None,
            detections.range_rate_std_mps,
            noise.range_rate_std_mps,
        ),
    ]
    deviations: list[FloatArray | float] = []
    for measured, own, default in sources:
        values: FloatArray | float = default
        if own is not None:
            values = numbers(own)
            if len(values) not in (n, 1):
                raise Rejected("array_length_mismatch")
        if measured:
            deviations.append(values)
    variance = np.empty((n, len(deviations)))
    with np.errstate(over="ignore", invalid="ignore"):
        for i, deviation in enumerate(deviations):
            # A negative deviation stays visible as a negative variance.
            variance[:, i] = deviation * np.abs(deviation)
    covariance = np.zeros((n, len(deviations), len(deviations)))
    diagonal = np.arange(len(deviations))
    covariance[:, diagonal, diagonal] = variance
    return covariance, _plausible(variance)


def _from_parameters(
    detections: Detections, noise: DefaultNoise, n: int
) -> tuple[FloatArray, BoolArray]:
    """Noise covariance (n, d, d) of a scan without noise of its own, and whether it is good."""
    covariance, good = _default_covariance(
        noise, detections.elevation_rad is not None, detections.range_rate_mps is not None
    )
    return np.repeat(covariance, n, axis=0), np.repeat(good, n)


@lru_cache(maxsize=64)
def _default_covariance(
    noise: DefaultNoise, elevation: bool, range_rate: bool
) -> tuple[FloatArray, BoolArray]:
    deviations = [noise.range_std_m, noise.azimuth_std_rad]
    if elevation:
        deviations.append(noise.elevation_std_rad)
    if range_rate:
        deviations.append(noise.range_rate_std_mps)
    # As a product: a power of Python floats raises where it overflows.
    variance = np.array([[deviation * abs(deviation) for deviation in deviations]])
    return np.diag(variance[0])[None], _plausible(variance)


def _given_covariance(values: Any, n: int, d: int) -> tuple[FloatArray, BoolArray]:
    """Noise covariance (n, d, d) as it came, made symmetric, and whether it is good."""
    try:
        covariance = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise Rejected("malformed_array") from None
    if covariance.shape != (n, d, d):
        raise Rejected("array_length_mismatch")
    good = np.logical_and.reduce(np.isfinite(covariance), axis=(1, 2))
    safe = np.where(good[:, None, None], covariance, np.eye(d))
    variance = np.diagonal(safe, axis1=1, axis2=2)
    good &= _plausible(variance)
    scale = np.sqrt(np.where(good[:, None], variance, 1.0))
    correlation = np.where(
        good[:, None, None], safe / (scale[:, :, None] * scale[:, None, :]), np.eye(d)
    )
    transposed = correlation.transpose(0, 2, 1)
    good &= (np.abs(correlation - transposed) <= 1e-6).all(axis=(1, 2))
    for size in range(2, d + 1):
        good &= np.linalg.det(correlation[:, :size, :size]) > SMALLEST_MINOR
    # Halves first: sums of the largest numbers would overflow.
    half = 0.5 * covariance
    return half + half.transpose(0, 2, 1), good


def _plausible(variance: FloatArray) -> BoolArray:
    """Whether the variances (n, d) of each row are all numbers to work with."""
    inside = (variance >= SMALLEST_VARIANCE) & (variance <= LARGEST_VARIANCE)
    return np.logical_and.reduce(inside, axis=1)
