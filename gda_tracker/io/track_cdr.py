"""Tracks straight to the bytes of a ``TrackArray``, all tracks at once.

A ``TrackArray`` is nested, for people; built as objects, a hundred tracks cost the ring more than
all its computing. Every track of a scan has the same sizes, so that its bytes are a record of fixed
layout: one structured array holds them all. The form is plain CDR (XCDR1), little endian, which the
ROS 2 middlewares write and read; publishers take it in place of a message.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from gda_tracker.io.extent_messages import extent_columns
from gda_tracker.io.fields import LARGEST_STAMP_NS, NANOSECONDS
from gda_tracker.io.track_messages import (
    INTEGER_LIMITS,
    REALS,
    check_integers,
    tracks_to_message,
)
from gda_tracker.vocabulary.tracks import Tracks

ENCAPSULATION_BYTES = 4


@lru_cache(maxsize=64)
def _record(state: int, extent: int, classes: int, focal: int) -> np.dtype[Any]:
    """Layout of one ``Track`` with these sizes; 8-byte fields lie on multiples of 8."""
    names: list[str] = []
    formats: list[Any] = []
    offsets: list[int] = []
    end = 0

    def put(name: str, kind: str, count: int | None = None) -> None:
        nonlocal end
        size = np.dtype(kind).itemsize
        end += -end % size
        names.append(name)
        formats.append(kind if count is None else (kind, (count,)))
        offsets.append(end)
        end += size * (1 if count is None else count)

    def put_sequence(name: str, count: int) -> None:
        put(f"{name}_length", "<u4")
        if count:
            put(name, "<f8", count)

    put("track_id", "<i8")
    put("hypothesis_id", "<i8")
    put("status", "u1")
    put_sequence("state", state)
    put_sequence("covariance", state * state)
    put_sequence("extent", extent)
    put("extent_weight", "<f8")
    put("expected_detections", "<f8")
    put_sequence("class_probability", classes)
    put_sequence("masses", focal)
    for name in REALS:
        put(name, "<f8")
    for name in ("hits", "misses", "coasted_scans"):
        put(name, "<u4")
    put("detection_index", "<i4")
    for name in ("first_detection", "last_detection"):
        put(f"{name}_sec", "<i4")
        put(f"{name}_nanosec", "<u4")
    # A track begins with an 8-byte field; the padding after the last one is cut off.
    return np.dtype(
        {"names": names, "formats": formats, "offsets": offsets, "itemsize": end + -end % 8}
    )


def _content_bytes(record: np.dtype[Any]) -> int:
    """Bytes of one record without the padding at its end."""
    assert record.fields is not None
    return max(kind.itemsize + int(rest[0]) for kind, *rest in record.fields.values())


class _Writer:
    """Bytes of a message; alignment counts from behind the encapsulation."""

    def __init__(self) -> None:
        self._bytes = bytearray(b"\x00\x01\x00\x00")  # plain CDR, little endian

    def align(self, size: int) -> None:
        self._bytes += bytes(-(len(self._bytes) - ENCAPSULATION_BYTES) % size)

    def integers(self, size: int, *values: int) -> None:
        """Integers without a sign, or two's complements of ``size`` bytes."""
        self.align(size)
        for value in values:
            self._bytes += (value % (1 << 8 * size)).to_bytes(size, "little")

    def raw(self, content: bytes) -> None:
        self._bytes += content

    def text(self, *values: str) -> None:
        for value in values:
            encoded = value.encode() + b"\x00"
            self.integers(4, len(encoded))
            self.raw(encoded)

    def content(self, *parts: bytes | memoryview) -> bytes:
        return b"".join((self._bytes, *parts))


def _head(message: Any) -> _Writer:
    """All of a ``TrackArray`` but the sequence of tracks, which comes last."""
    writer = _Writer()
    writer.integers(4, message.header.stamp.sec, message.header.stamp.nanosec)
    writer.text(message.header.frame_id)
    writer.integers(8, message.key.epoch)
    writer.text(message.key.sensor_id)
    writer.integers(8, message.key.stamp_ns)
    writer.raw(bytes(message.system_uuid.uuid))
    for names in (message.class_names, message.frame, message.focal_elements):
        writer.integers(4, len(names))
        writer.text(*names)
    writer.integers(1, message.degraded)
    writer.integers(4, len(message.deleted_track_ids))
    if len(message.deleted_track_ids):
        writer.integers(8, *message.deleted_track_ids)
    for rows in (message.detection_counts, message.detection_rows):
        writer.integers(4, len(rows), *rows)
    return writer


def tracks_to_cdr(tracks: Tracks) -> bytes:
    """Return the tracks as a serialised ``TrackArray``.

    It is what the middleware makes of :func:`~gda_tracker.io.track_messages.tracks_to_message`.

    Raises
    ------
    MessageError
        If a stamp, an id or a count does not fit its field.
    """
    count = len(tracks)
    writer = _head(tracks_to_message(tracks, with_tracks=False))
    writer.integers(4, count)
    if not count:
        return writer.content()
    extents = extent_columns(tracks)
    record = _record(
        tracks.mean.shape[1],
        extents["extent"].size // count,
        len(tracks.class_names),
        len(tracks.focal),
    )
    # Zeros, so that padding is the same every time.
    records = np.zeros(count, dtype=record)
    columns = {
        "state": tracks.mean,
        "covariance": tracks.covariance,
        "extent": extents["extent"],
        "class_probability": tracks.class_probability,
        "masses": tracks.masses,
    }
    for name, values in columns.items():
        width = values.size // count
        records[f"{name}_length"] = width
        if width:
            records[name] = values.reshape(count, width)
    for name, lowest, highest in INTEGER_LIMITS:
        values = getattr(tracks, name)
        check_integers(values, name, lowest, highest)
        records[name] = values
    for name in REALS:
        records[name] = getattr(tracks, name)
    for name in ("extent_weight", "expected_detections"):
        records[name] = extents[name]
    for name in ("first_detection", "last_detection"):
        stamps = getattr(tracks, f"{name}_ns")
        check_integers(stamps, name, 0, LARGEST_STAMP_NS)
        records[f"{name}_sec"], records[f"{name}_nanosec"] = np.divmod(stamps, NANOSECONDS)
    writer.align(8)
    used = (count - 1) * record.itemsize + _content_bytes(record)
    return writer.content(memoryview(records.view(np.uint8))[:used])
