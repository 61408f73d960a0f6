"""Messages of radars, as frames: ``PointCloud2``, ``RadarScan``, ``RadarTracks``.

Works on messages of rclpy and of the rosbags library alike, and imports neither.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from gda_tracker.errors import UserError
from gda_tracker.io.fields import MessageError, stamp_from_time
from gda_tracker.io.radar.conversion import RadarScan
from gda_tracker.io.radar.frames import Fields, RadarFrame, detections_of_frame, frame_of_columns
from gda_tracker.io.radar.input_parameters import RadarInputParameters
from gda_tracker.io.radar.parameter_groups.source import (
    POINT_CLOUD,
    RADAR_SCAN,
    RADAR_TRACKS,
    RADAR_TYPES,
)
from gda_tracker.io.radar.point_cloud import field_types, read_fields
from gda_tracker.vocabulary.arrays import FloatArray

__all__ = [
    "POINT_CLOUD",
    "RADAR_SCAN",
    "RADAR_TRACKS",
    "RADAR_TYPES",
    "RadarMessageError",
    "detections_of_message",
    "frame_of_message",
]

RETURN_FIELDS = ("range", "azimuth", "elevation", "doppler_velocity", "amplitude")
# Six numbers of a symmetric matrix: xx, xy, xz, yy, yz, zz.
UPPER_TRIANGLE = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])


class RadarMessageError(UserError):
    """A message of a radar cannot be read; the message is one line."""


def frame_of_message(message: Any, kind: str, received_ns: int | None = None) -> RadarFrame:
    """Return a message as a frame.

    Parameters
    ----------
    message
        Of rclpy or of the rosbags library.
    kind
        Its type, one of :data:`RADAR_TYPES`.
    received_ns
        Time that takes the place of the message's own stamp.

    Raises
    ------
    RadarMessageError
        If it is of another type or its stamp is not a time.
    """
    if kind not in RADAR_TYPES:
        raise RadarMessageError(f"type {kind}: allowed is one of {', '.join(RADAR_TYPES)}")
    try:
        stamp_ns = stamp_from_time(message.header.stamp, "header.stamp")
    except MessageError as error:
        if received_ns is None:
            raise RadarMessageError(str(error)) from error
        stamp_ns = received_ns
    if received_ns is not None:
        stamp_ns = received_ns
    frame_id = str(message.header.frame_id)
    if kind == RADAR_SCAN:
        return frame_of_columns(kind, stamp_ns, frame_id, _columns_of_returns(message.returns))
    if kind == RADAR_TRACKS:
        return frame_of_columns(kind, stamp_ns, frame_id, _columns_of_tracks(message.tracks))

    def read(names: Iterable[str], overrides: Mapping[str, str]) -> Fields:
        return read_fields(message, names, overrides)

    return RadarFrame(kind, stamp_ns, frame_id, field_types(message), read)


def detections_of_message(
    message: Any,
    kind: str,
    parameters: RadarInputParameters,
    sequence: int = 0,
    received_ns: int = 0,
) -> RadarScan:
    """Make detections of a message; ``received_ns`` counts if the parameters say so.

    Raises
    ------
    UserError
        If the message cannot be read or does not fit the parameters.
    """
    own = parameters.stamp_source == "header"
    frame = frame_of_message(message, kind, None if own else received_ns)
    return detections_of_frame(frame, parameters, sequence)


def _columns_of_returns(returns: Any) -> Fields:
    return {
        name: np.array([getattr(item, name) for item in returns], dtype=np.float64)
        for name in RETURN_FIELDS
    }


def _columns_of_tracks(tracks: Any) -> Fields:
    """Return columns of the tracks of a sensor: positions, radial speeds, sizes.

    ``range_rate`` is the velocity's part along the line of sight. ``range_std`` and ``azimuth_std``
    come from the position's covariance, where every track has one.
    """
    position = _vectors(tracks, "position")
    velocity = _vectors(tracks, "velocity")
    size = _vectors(tracks, "size")
    distance = np.linalg.norm(position, axis=1)
    towards = np.where(distance > 0.0, 1.0, np.nan)[:, None] * position
    towards = towards / np.where(distance > 0.0, distance, 1.0)[:, None]
    x, y, z = position.T
    columns = {
        "x": x,
        "y": y,
        "z": z,
        "range_rate": np.einsum("ni,ni->n", towards, velocity),
        "length": size[:, 0],
        "width": size[:, 1],
        "height": size[:, 2],
    }
    classes = [getattr(track, "classification", None) for track in tracks]
    # Earlier versions of the message have a text here.
    if all(isinstance(value, int | np.integer) for value in classes):
        columns["classification"] = np.array(classes, dtype=np.float64)
    columns.update(_deviations(tracks, position))
    return columns


def _vectors(tracks: Any, name: str) -> FloatArray:
    """Return a vector (n, 3) of each track."""
    rows = [(v.x, v.y, v.z) for v in (getattr(track, name) for track in tracks)]
    return np.array(rows, dtype=np.float64).reshape(len(rows), 3)


def _deviations(tracks: Any, position: FloatArray) -> Fields:
    """Return standard deviations of range and azimuth, or none where a track has no covariance."""
    given = [getattr(track, "position_covariance", ()) for track in tracks]
    if not given or any(len(values) != 6 for values in given):
        return {}
    covariance = np.array(given, dtype=np.float64)[:, UPPER_TRIANGLE]
    ground = np.hypot(position[:, 0], position[:, 1])
    distance = np.linalg.norm(position, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        along = position / distance[:, None]
        across = np.stack([-position[:, 1], position[:, 0], np.zeros(len(position))], axis=1)
        across = across / ground[:, None] ** 2
        range_variance = np.einsum("ni,nij,nj->n", along, covariance, along)
        azimuth_variance = np.einsum("ni,nij,nj->n", across, covariance, across)
        # NaN fails the comparison.
        if not ((range_variance > 0.0).all() and (azimuth_variance > 0.0).all()):
            return {}
        return {"range_std": np.sqrt(range_variance), "azimuth_std": np.sqrt(azimuth_variance)}
