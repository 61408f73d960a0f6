"""Tracks as messages, made for people: nested, with names for the focal elements."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from gda_tracker.io.fields import (
    MessageError,
    floats_from_field,
    floats_to_field,
    int64_from_field,
    int64_to_field,
    make_header,
    reshape,
    signed,
    split_stamp,
    stamp_from_time,
    unsigned,
)
from gda_tracker.io.scan_messages import key_from_message, key_to_message
from gda_tracker.vocabulary.arrays import FloatArray, MaskArray
from gda_tracker.vocabulary.tracks import Tracks

STATE_SIZE = 4  # of a message without tracks: x, y, vx, vy


@lru_cache(maxsize=64)
def _element_names(frame: tuple[str, ...], masks: tuple[int, ...]) -> list[str]:
    if not masks:
        return []
    from gda_tracker.attributes.frames import element_name

    return [element_name(frame, mask) for mask in masks]


@lru_cache(maxsize=64)
def _element_masks(frame: tuple[str, ...], names: tuple[str, ...]) -> MaskArray:
    if not names:
        return np.zeros(0, dtype=np.uint32)
    from gda_tracker.attributes.frames import parse_element

    try:
        masks = np.array([parse_element(frame, name) for name in names], dtype=np.uint32)
    except ValueError as error:
        raise MessageError(f"focal_elements: {error}") from error
    masks.flags.writeable = False
    return masks


def tracks_to_message(tracks: Tracks) -> Any:
    """Return a ``TrackArray`` message, stamped with the time of the scan.

    Raises
    ------
    MessageError
        If a stamp, an id or a count does not fit its field.
    """
    from builtin_interfaces.msg import Time
    from gda_tracker_msgs.msg import Track, TrackArray
    from unique_identifier_msgs.msg import UUID

    message = TrackArray(
        header=make_header(tracks.key.stamp_ns, tracks.frame_id), key=key_to_message(tracks.key)
    )
    if len(tracks.system_uuid) != 16:
        raise MessageError(f"system_uuid has {len(tracks.system_uuid)} bytes, 16 expected")
    message.system_uuid = UUID(uuid=np.frombuffer(tracks.system_uuid, dtype=np.uint8).copy())
    message.class_names = [str(name) for name in tracks.class_names]
    message.frame = [str(name) for name in tracks.frame]
    message.focal_elements = list(
        _element_names(tuple(tracks.frame), tuple(int(mask) for mask in tracks.focal))
    )
    message.degraded = bool(tracks.degraded)
    message.deleted_track_ids = int64_to_field(tracks.deleted_track_id)

    count = len(tracks)
    # one conversion per column, then slices of array.array: no numpy call per track
    columns = [
        (name, floats_to_field(values), values.size // count if count else 0)
        for name, values in (
            ("state", tracks.mean),
            ("covariance", tracks.covariance),
            ("class_probability", tracks.class_probability),
            ("masses", tracks.masses),
        )
    ]
    conflict = tracks.conflict.tolist()
    for row in range(count):
        track = Track()
        track.track_id = signed(tracks.track_id[row], 64, "track_id")
        track.hypothesis_id = signed(tracks.hypothesis_id[row], 64, "hypothesis_id")
        track.status = unsigned(tracks.status[row], 8, "status")
        for name, values, width in columns:
            setattr(track, name, values[row * width : (row + 1) * width])
        track.conflict = float(conflict[row])
        track.hits = unsigned(tracks.hits[row], 32, "hits")
        track.misses = unsigned(tracks.misses[row], 32, "misses")
        track.coasted_scans = unsigned(tracks.coasted_scans[row], 32, "coasted_scans")
        track.detection_index = signed(tracks.detection_index[row], 32, "detection_index")
        seconds, nanoseconds = split_stamp(tracks.first_detection_ns[row], "first_detection")
        track.first_detection = Time(sec=seconds, nanosec=nanoseconds)
        seconds, nanoseconds = split_stamp(tracks.last_detection_ns[row], "last_detection")
        track.last_detection = Time(sec=seconds, nanosec=nanoseconds)
        message.tracks.append(track)
    return message


def tracks_from_message(message: Any) -> Tracks:
    """Return the tracks in a ``TrackArray`` message; these arrays are copies.

    Without tracks the state dimension is not in the message: it comes back as 4.

    Raises
    ------
    MessageError
        If a stamp is not valid, a focal element has no meaning in the frame, or the size of a field
        does not fit.
    """
    tracks = message.tracks
    count = len(tracks)
    frame = tuple(str(name) for name in message.frame)
    focal = _element_masks(frame, tuple(str(name) for name in message.focal_elements))
    class_names = tuple(str(name) for name in message.class_names)
    size = len(tracks[0].state) if count else STATE_SIZE

    def integers(name: str) -> Any:
        return np.array([int(getattr(track, name)) for track in tracks], dtype=np.int64)

    def stamps(name: str) -> Any:
        return np.array(
            [stamp_from_time(getattr(track, name), name) for track in tracks], dtype=np.int64
        )

    return Tracks(
        key=key_from_message(message.key),
        frame_id=str(message.header.frame_id),
        system_uuid=bytes(np.asarray(message.system_uuid.uuid, dtype=np.uint8)),
        track_id=integers("track_id"),
        hypothesis_id=integers("hypothesis_id"),
        status=integers("status"),
        mean=_stack(tracks, "state", size),
        covariance=_stack(tracks, "covariance", size, size),
        frame=frame,
        focal=focal,
        masses=_stack(tracks, "masses", len(focal)),
        class_names=class_names,
        class_probability=_stack(tracks, "class_probability", len(class_names)),
        conflict=np.array([float(track.conflict) for track in tracks], dtype=np.float64),
        hits=integers("hits"),
        misses=integers("misses"),
        coasted_scans=integers("coasted_scans"),
        first_detection_ns=stamps("first_detection"),
        last_detection_ns=stamps("last_detection"),
        detection_index=integers("detection_index").astype(np.int32),
        deleted_track_id=int64_from_field(message.deleted_track_ids),
        degraded=bool(message.degraded),
    )


def _stack(tracks: Any, name: str, *shape: int) -> FloatArray:
    stacked = np.zeros((len(tracks), *shape))
    for row, track in enumerate(tracks):
        stacked[row] = reshape(floats_from_field(getattr(track, name)), shape, name)
    return stacked
