"""Scans as messages: what a source publishes, what is admitted, what is answered, what was true.

Every ``..._to_message`` makes a message of ``gda_tracker_msgs``; every ``..._from_message`` reads
one, whether it came from rclpy or from a bag by way of the rosbags library. Values come back bit
for bit. Arrays are read-only views of the message (see :mod:`gda_tracker.io.fields`).

An optional array that is empty stands for "not measured", so on a scan without detections a
measured quantity comes back as ``None``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gda_tracker.io.extent_messages import (
    cells_from_message,
    cells_of_report_from_message,
    cells_to_message,
)
from gda_tracker.io.fields import (
    MessageError,
    bools_from_field,
    bools_to_field,
    floats_from_field,
    floats_to_field,
    int32_from_field,
    int32_to_field,
    make_header,
    masks_from_field,
    masks_to_field,
    require_size,
    reshape,
    signed,
    stamp_from_time,
    unsigned,
)
from gda_tracker.io.statement_messages import statement_from_message, statement_to_message
from gda_tracker.vocabulary.arrays import FloatArray
from gda_tracker.vocabulary.scans import (
    IDENTITY_QUATERNION,
    Detections,
    Scan,
    ScanKey,
    ScanReport,
    ScanTruth,
)


def key_to_message(key: ScanKey) -> Any:
    """Return a ``ScanKey`` message; raise :class:`MessageError` if a number does not fit."""
    from gda_tracker_msgs.msg import ScanKey as Message

    return Message(
        epoch=unsigned(key.epoch, 64, "key.epoch"),
        sensor_id=str(key.sensor_id),
        stamp_ns=signed(key.stamp_ns, 64, "key.stamp_ns"),
    )


def key_from_message(message: Any) -> ScanKey:
    """Return the key in a ``ScanKey`` message."""
    return ScanKey(int(message.epoch), str(message.sensor_id), int(message.stamp_ns))


def _optional(field: Any) -> FloatArray | None:
    return floats_from_field(field) if len(field) else None


def _optional_of_size(field: Any, size: int, name: str) -> FloatArray | None:
    return require_size(floats_from_field(field), size, name) if len(field) else None


def detections_to_message(detections: Detections) -> Any:
    """Return a ``DetectionArray`` message.

    Raises
    ------
    MessageError
        If the stamp or the sequence number does not fit.
    """
    from gda_tracker_msgs.msg import DetectionArray

    message = DetectionArray(header=make_header(detections.stamp_ns, detections.frame_id))
    message.sensor_id = str(detections.sensor_id)
    message.sequence = unsigned(detections.sequence, 64, "sequence")
    message.sensor_position_m = _fixed(detections.sensor_position_m, 3, "sensor_position_m")
    message.sensor_orientation_xyzw = _fixed(
        detections.sensor_orientation_xyzw, 4, "sensor_orientation_xyzw"
    )
    message.range_m = floats_to_field(detections.range_m)
    message.azimuth_rad = floats_to_field(detections.azimuth_rad)
    message.elevation_rad = floats_to_field(detections.elevation_rad)
    message.range_rate_mps = floats_to_field(detections.range_rate_mps)
    message.rcs_m2 = floats_to_field(detections.rcs_m2)
    message.rcs_valid = bools_to_field(detections.rcs_valid)
    message.range_std_m = floats_to_field(detections.range_std_m)
    message.azimuth_std_rad = floats_to_field(detections.azimuth_std_rad)
    message.elevation_std_rad = floats_to_field(detections.elevation_std_rad)
    message.range_rate_std_mps = floats_to_field(detections.range_rate_std_mps)
    message.covariance = floats_to_field(detections.covariance)
    message.time_offset_s = floats_to_field(detections.time_offset_s)
    _attributes_to_message(detections, message)
    _platforms_to_message(detections, message)
    return message


def _fixed(values: FloatArray, size: int, name: str) -> FloatArray:
    return np.array(require_size(np.ravel(values), size, name), dtype=np.float64)


def detections_from_message(message: Any) -> Detections:
    """Return the detections in a ``DetectionArray`` message, as they are.

    The message may come from a foreign publisher: arrays whose lengths contradict each other are
    handed on, (n,) each with its own n; who admits the scan checks them. An orientation of four
    zeros stands for the identity.

    Raises
    ------
    MessageError
        If the stamp is not valid, or ``covariance`` does not have n d d elements, with n detections
        and d measured quantities.
    """
    range_m = floats_from_field(message.range_m)
    names = tuple(map(str, message.attribute_names))
    elevation_rad = _optional(message.elevation_rad)
    range_rate_mps = _optional(message.range_rate_mps)
    covariance = _optional(message.covariance)
    if covariance is not None:
        size = 2 + (elevation_rad is not None) + (range_rate_mps is not None)
        covariance = reshape(covariance, (len(range_m), size, size), "covariance")
    orientation = floats_from_field(message.sensor_orientation_xyzw)
    if not orientation.any():
        orientation = np.array(IDENTITY_QUATERNION)
    return Detections(
        sensor_id=str(message.sensor_id),
        stamp_ns=stamp_from_time(message.header.stamp, "header.stamp"),
        range_m=range_m,
        azimuth_rad=floats_from_field(message.azimuth_rad),
        elevation_rad=elevation_rad,
        range_rate_mps=range_rate_mps,
        rcs_m2=_optional(message.rcs_m2),
        rcs_valid=bools_from_field(message.rcs_valid) if len(message.rcs_valid) else None,
        range_std_m=_optional(message.range_std_m),
        azimuth_std_rad=_optional(message.azimuth_std_rad),
        elevation_std_rad=_optional(message.elevation_std_rad),
        range_rate_std_mps=_optional(message.range_rate_std_mps),
        covariance=covariance,
        time_offset_s=_optional(message.time_offset_s),
        sensor_position_m=floats_from_field(message.sensor_position_m),
        sensor_orientation_xyzw=orientation,
        frame_id=str(message.header.frame_id),
        sequence=int(message.sequence),
        attribute_names=names,
        attribute_values=_table_if_it_fits(
            floats_from_field(message.attribute_values), len(names), len(range_m)
        ),
        attribute_valid=_table_if_it_fits(
            bools_from_field(message.attribute_valid), len(names), len(range_m)
        )
        if len(message.attribute_valid)
        else None,
        sensor_velocity_mps=_optional(message.sensor_velocity_mps),
        reference_position_m=_optional(message.reference_position_m),
        reference_velocity_mps=_optional(message.reference_velocity_mps),
    )


def _table_if_it_fits(values: NDArray[Any], rows: int, columns: int) -> NDArray[Any] | None:
    """Return row-major elements as (rows, columns); those of another number as they are, (n,)."""
    if not rows and not len(values):
        return None
    return values.reshape(rows, columns) if len(values) == rows * columns else values


def scan_to_message(scan: Scan) -> Any:
    """Return a ``Scan`` message; raise :class:`MessageError` if the key does not fit."""
    from gda_tracker_msgs.msg import Scan as Message

    message = Message(key=key_to_message(scan.key))
    message.frame_id = str(scan.frame_id)
    message.sensor_position_m = _fixed(scan.sensor_position_m, 3, "sensor_position_m")
    message.sensor_orientation_xyzw = _fixed(
        scan.sensor_orientation_xyzw, 4, "sensor_orientation_xyzw"
    )
    message.source_index = int32_to_field(scan.source_index)
    message.range_m = floats_to_field(scan.range_m)
    message.azimuth_rad = floats_to_field(scan.azimuth_rad)
    message.elevation_rad = floats_to_field(scan.elevation_rad)
    message.range_rate_mps = floats_to_field(scan.range_rate_mps)
    message.noise_covariance = floats_to_field(scan.noise_covariance)
    message.rcs_m2 = floats_to_field(scan.rcs_m2)
    message.rcs_valid = bools_to_field(scan.rcs_valid)
    message.time_offset_s = floats_to_field(scan.time_offset_s)
    _attributes_to_message(scan, message)
    if scan.sensor_model:
        message.sensor_model = scan.sensor_model
        _platforms_to_message(scan, message)
    if scan.cells is not None:
        cells_to_message(scan.cells, message)
    message.signal_strength = floats_to_field(scan.signal_strength)
    message.relative_clutter_density = floats_to_field(scan.relative_clutter_density)
    if scan.statements:
        message.statements = [statement_to_message(each) for each in scan.statements]
    return message


def _attributes_to_message(source: Detections | Scan, message: Any) -> None:
    message.attribute_names = [str(name) for name in source.attribute_names]
    message.attribute_values = floats_to_field(source.attribute_values)
    message.attribute_valid = bools_to_field(source.attribute_valid)


def _platforms_to_message(source: Detections | Scan, message: Any) -> None:
    message.sensor_velocity_mps = floats_to_field(source.sensor_velocity_mps)
    message.reference_position_m = floats_to_field(source.reference_position_m)
    message.reference_velocity_mps = floats_to_field(source.reference_velocity_mps)


def scan_from_message(message: Any) -> Scan:
    """Return the scan in a ``Scan`` message.

    Raises
    ------
    MessageError
        If the size of a field does not fit the number of detections.
    """
    range_m = floats_from_field(message.range_m)
    count = len(range_m)
    elevation_rad = _optional_of_size(message.elevation_rad, count, "elevation_rad")
    range_rate_mps = _optional_of_size(message.range_rate_mps, count, "range_rate_mps")
    size = 2 + (elevation_rad is not None) + (range_rate_mps is not None)
    names = tuple(map(str, message.attribute_names))
    values = floats_from_field(message.attribute_values)
    valid = bools_from_field(message.attribute_valid)
    table = (len(names), count)
    values, valid = (
        reshape(values, table, "attribute_values"),
        reshape(valid, table, "attribute_valid"),
    )
    noise_covariance = floats_from_field(message.noise_covariance)
    return Scan(
        key=key_from_message(message.key),
        frame_id=str(message.frame_id),
        sensor_position_m=floats_from_field(message.sensor_position_m),
        sensor_orientation_xyzw=floats_from_field(message.sensor_orientation_xyzw),
        source_index=require_size(int32_from_field(message.source_index), count, "source_index"),
        range_m=range_m,
        azimuth_rad=require_size(floats_from_field(message.azimuth_rad), count, "azimuth_rad"),
        noise_covariance=reshape(noise_covariance, (count, size, size), "noise_covariance"),
        rcs_m2=require_size(floats_from_field(message.rcs_m2), count, "rcs_m2"),
        rcs_valid=require_size(bools_from_field(message.rcs_valid), count, "rcs_valid"),
        elevation_rad=elevation_rad,
        range_rate_mps=range_rate_mps,
        time_offset_s=_optional_of_size(message.time_offset_s, count, "time_offset_s"),
        attribute_names=names,
        attribute_values=values if names else None,
        attribute_valid=valid if names else None,
        statements=tuple(statement_from_message(each) for each in message.statements),
        sensor_model=str(message.sensor_model),
        sensor_velocity_mps=_optional_of_size(
            message.sensor_velocity_mps, 3, "sensor_velocity_mps"
        ),
        reference_position_m=_optional_of_size(
            message.reference_position_m, 3, "reference_position_m"
        ),
        reference_velocity_mps=_optional_of_size(
            message.reference_velocity_mps, 3, "reference_velocity_mps"
        ),
        cells=cells_from_message(message, count),
        signal_strength=_optional_of_size(message.signal_strength, count, "signal_strength"),
        relative_clutter_density=_optional_of_size(
            message.relative_clutter_density, count, "relative_clutter_density"
        ),
    )


def scan_report_to_message(report: ScanReport, frame_id: str = "") -> Any:
    """Return a ``ScanReport`` message, stamped with the time of the scan.

    Raises
    ------
    MessageError
        If the stamp or a count does not fit.
    """
    from gda_tracker_msgs.msg import ScanReport as Message

    message = Message(
        header=make_header(report.key.stamp_ns, frame_id), key=key_to_message(report.key)
    )
    message.outcome = str(report.outcome)
    message.reason = str(report.reason)
    message.repeated = bool(report.repeated)
    message.latency_s = float(report.latency_s)
    message.rejected_reasons = [str(reason) for reason in report.rejected]
    message.rejected_counts = masks_to_field(
        [unsigned(count, 32, "rejected_counts") for count in report.rejected.values()]
    )
    if report.cells is not None:
        message.cells = masks_to_field([unsigned(report.cells, 32, "cells")])
        message.partition_probability = [float(report.partition_probability)]
    for name in _REPORT_COUNTS:
        setattr(message, name, unsigned(getattr(report, name), 32, name))
    return message


_REPORT_COUNTS = (
    "detections_received",
    "detections_admitted",
    "tracks_confirmed",
    "tracks_tentative",
    "queue_length",
    "retries",
)


def scan_report_from_message(message: Any) -> ScanReport:
    """Return the report in a ``ScanReport`` message.

    Raises
    ------
    MessageError
        If the rejected reasons and their counts differ in number.
    """
    reasons = [str(reason) for reason in message.rejected_reasons]
    counts = masks_from_field(message.rejected_counts)
    if len(reasons) != len(counts):
        raise MessageError(f"rejected_counts has {len(counts)} elements, {len(reasons)} expected")
    return ScanReport(
        key=key_from_message(message.key),
        outcome=str(message.outcome),
        reason=str(message.reason),
        repeated=bool(message.repeated),
        latency_s=float(message.latency_s),
        rejected=dict(zip(reasons, counts.tolist(), strict=True)),
        **{name: int(getattr(message, name)) for name in _REPORT_COUNTS},
        **cells_of_report_from_message(message),
    )


def scan_truth_to_message(truth: ScanTruth) -> Any:
    """Return a ``ScanTruth`` message; raise :class:`MessageError` if the stamp does not fit."""
    from gda_tracker_msgs.msg import ScanTruth as Message

    message = Message(header=make_header(truth.stamp_ns, truth.frame_id))
    message.sensor_id = str(truth.sensor_id)
    message.run = signed(truth.run, 32, "run")
    message.labelled = truth.source_id is not None
    message.source_id = int32_to_field(truth.source_id)
    message.target_id = int32_to_field(truth.target_id)
    message.target_class = [str(name) for name in truth.target_class]
    message.target_state = floats_to_field(truth.target_state)
    message.target_extent = floats_to_field(truth.target_extent)
    return message


def scan_truth_from_message(message: Any) -> ScanTruth:
    """Return the truth in a ``ScanTruth`` message.

    Raises
    ------
    MessageError
        If the stamp is not valid or the size of a field does not fit the number of targets.
    """
    target_id = int32_from_field(message.target_id)
    target_class = tuple(str(name) for name in message.target_class)
    if target_class and len(target_class) != len(target_id):
        raise MessageError(
            f"target_class has {len(target_class)} elements, {len(target_id)} expected"
        )
    target_state = floats_from_field(message.target_state)
    target_extent = floats_from_field(message.target_extent)
    return ScanTruth(
        sensor_id=str(message.sensor_id),
        stamp_ns=stamp_from_time(message.header.stamp, "header.stamp"),
        target_id=target_id,
        target_state=reshape(target_state, (len(target_id), 4), "target_state"),
        source_id=int32_from_field(message.source_id) if message.labelled else None,
        target_class=target_class,
        run=int(message.run),
        frame_id=str(message.header.frame_id),
        target_extent=reshape(target_extent, (len(target_id), 2, 2), "target_extent")
        if len(target_extent)
        else None,
    )
