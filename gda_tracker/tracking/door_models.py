"""The door for sensors with a model of their own: what is not measured is NaN, platforms move."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gda_tracker.kinematics.measurement_kinds import (
    AZIMUTH,
    MEASUREMENT_MODELS,
    RANGE,
    RANGE_RATE,
    MeasurementModel,
)
from gda_tracker.tracking.columns import Rejected, column, numbers
from gda_tracker.tracking.door import LARGEST_RANGE_M, DefaultNoise, validate
from gda_tracker.vocabulary.arrays import FloatArray
from gda_tracker.vocabulary.scans import Detections, Scan

# What is beyond is no speed, and its squares would spoil the arithmetic.
LARGEST_SPEED_MPS = 1e6


@dataclass(frozen=True)
class ModelSetting:
    """Model of a sensor, and where its transmitter or second sensor stands, if that is known."""

    model: str
    reference_m: tuple[float, ...] | None = None


def validate_with_model(
    detections: Detections,
    setting: ModelSetting,
    noise: DefaultNoise,
    tracking_frame: str,
    limit: int,
    epoch: int = 0,
) -> tuple[Scan, Counter[str]]:
    """Turn the ``detections`` of a sensor with a model of its own into an admitted scan.

    Arguments and results are those of :func:`gda_tracker.tracking.door.validate`; a quantity that
    the model does not measure may be anything, and is NaN in the scan, a range rate ``None``.

    Raises
    ------
    Rejected
        As there, and ``range_rate_missing``, ``elevation_with_model``, ``time_offset_with_model``,
        ``tilted_sensor``, ``bad_sensor_velocity``, ``reference_missing``, ``bad_reference``.
    """
    model = MEASUREMENT_MODELS[setting.model]
    if detections.elevation_rad is not None:
        raise Rejected("elevation_with_model")
    if detections.time_offset_s is not None:
        raise Rejected("time_offset_with_model")
    velocity = _vector(detections.sensor_velocity_mps)
    if not _bounded(velocity, LARGEST_SPEED_MPS):
        raise Rejected("bad_sensor_velocity")
    reference, its_velocity = None, None
    if model.has_reference:
        reference = _vector(detections.reference_position_m)
        its_velocity = _vector(detections.reference_velocity_mps)
        if not (_bounded(reference, LARGEST_RANGE_M) and _bounded(its_velocity, LARGEST_SPEED_MPS)):
            raise Rejected("bad_reference")
        if reference is None and setting.reference_m is not None:
            reference = np.array(setting.reference_m)
        if reference is None:
            raise Rejected("reference_missing")
    scan, counts = validate(_stand_ins(detections, model), noise, tracking_frame, limit, epoch)
    x, y, _, _ = (abs(float(part)) for part in scan.sensor_orientation_xyzw)
    if max(x, y) > 1e-6 and AZIMUTH in model.quantities:
        raise Rejected("tilted_sensor")
    rows, nothing = scan.source_index, np.full(len(scan), np.nan)
    measures_range = RANGE in model.quantities
    scan = replace(
        scan,
        range_m=numbers(detections.range_m)[rows] if measures_range else nothing,
        azimuth_rad=scan.azimuth_rad if AZIMUTH in model.quantities else nothing,
        sensor_model=model.name,
        sensor_velocity_mps=np.zeros(3) if velocity is None else velocity,
        reference_position_m=reference,
        reference_velocity_mps=(
            np.zeros(3) if model.has_reference and its_velocity is None else its_velocity
        ),
    )
    return scan, counts


def _stand_ins(detections: Detections, model: MeasurementModel) -> Detections:
    """The detections with sound values in place of what the model does not measure.

    Signed ranges (differences) have stand-ins too: only that they are numbers, and none too large,
    is looked at.
    """
    range_m = numbers(detections.range_m)
    n = len(range_m)
    changes: dict[str, Any] = {}
    if RANGE not in model.quantities:
        changes.update(range_m=np.ones(n), range_std_m=None)
    elif model.reference_sign < 0.0:
        changes.update(range_m=np.abs(range_m) + 1.0)
    if AZIMUTH not in model.quantities:
        changes.update(azimuth_rad=np.zeros(n), azimuth_std_rad=None)
    keeps_rate = RANGE_RATE in model.quantities
    if keeps_rate and detections.range_rate_mps is None:
        if n:
            raise Rejected("range_rate_missing")
        # An array without elements does not arrive as one.
        changes.update(range_rate_mps=np.zeros(0))
    if not keeps_rate:
        changes.update(range_rate_mps=None, range_rate_std_mps=None)
    if detections.covariance is not None:
        changes.update(covariance=_own_noise(detections, model, n))
    return replace(detections, **changes)


def _own_noise(detections: Detections, model: MeasurementModel, n: int) -> FloatArray:
    """Noise covariances as they came, with unit ones for what is not measured."""
    try:
        given = np.array(detections.covariance, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise Rejected("malformed_array") from None
    size = 2 + (detections.range_rate_mps is not None)
    if given.shape != (n, size, size):
        raise Rejected("array_length_mismatch")
    order = (RANGE, AZIMUTH, RANGE_RATE)[:size]
    for place, quantity in enumerate(order):
        if quantity not in model.quantities:
            given[:, place, :] = given[:, :, place] = 0.0
            given[:, place, place] = 1.0
    return given if RANGE_RATE in model.quantities else given[:, :2, :2]


def _vector(values: Any) -> FloatArray | None:
    """Three numbers, or ``None`` where there are none."""
    return None if values is None else column(values, 3)


def _bounded(vector: FloatArray | None, largest: float) -> bool:
    """Whether all of a vector's numbers are finite and none is too large."""
    # NaN fails every comparison.
    return vector is None or bool((np.abs(vector) <= largest).all())
