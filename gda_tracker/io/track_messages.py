"""Tracks as messages, made for people: nested, with names for the focal elements."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gda_tracker.evidence.frames import (
    element_name,
    parse_element,
    parts,
    total_ignorance,
    upward_closure,
)
from gda_tracker.io.extent_messages import extent_columns, extents_of_track_messages
from gda_tracker.io.fields import (
    MessageError,
    floats_from_field,
    floats_to_field,
    int32_to_field,
    int64_from_field,
    int64_to_field,
    make_header,
    reshape,
    split_stamp,
    stamp_from_time,
)
from gda_tracker.io.scan_messages import key_from_message, key_to_message
from gda_tracker.vocabulary.arrays import FloatArray, MaskArray
from gda_tracker.vocabulary.tracks import Tracks

STATE_SIZE = 4  # of a message without tracks: x, y, vx, vy


@lru_cache(maxsize=64)
def _focal_names(frame: tuple[str, ...], masks: tuple[int, ...]) -> tuple[str, ...]:
    return tuple(focal_name(frame, mask) for mask in masks)


@lru_cache(maxsize=64)
def _focal_masks(frame: tuple[str, ...], names: tuple[str, ...]) -> MaskArray:
    masks = np.array([parse_focal_name(frame, name) for name in names], dtype=np.uint32)
    masks.flags.writeable = False
    return masks


def focal_name(frame: tuple[str, ...], mask: int) -> str:
    """Return the name of a focal element, from which its Venn bitmask can be told.

    Elements of the hyper-power set are written as unions of intersections. Where a model has
    emptied some of the Venn parts the rest is written part by part: ``<VS>`` is VS outside the
    others, ``<VS&S>`` is inside these two and outside the others. On Shafer's model of VS, S, B the
    union of VS and S is ``<VS>|<S>``.

    Raises
    ------
    MessageError
        If the mask is empty or not of this frame.
    """
    if not 0 < mask <= total_ignorance(len(frame)):
        raise MessageError(f"focal mask {mask:#x}: allowed are elements of the frame {list(frame)}")
    if upward_closure(len(frame), mask) == mask:
        return element_name(frame, mask)
    return "|".join(
        "<" + "&".join(name for bit, name in enumerate(frame) if part >> bit & 1) + ">"
        for part in parts(mask)
    )


def parse_focal_name(frame: tuple[str, ...], name: str) -> int:
    """Return the Venn bitmask of a focal element, the inverse of :func:`focal_name`.

    Raises
    ------
    MessageError
        If the name has no meaning in the frame.
    """
    try:
        if not name.startswith("<"):
            return parse_element(frame, name)
        mask = 0
        for part in name.split("|"):
            if not (part.startswith("<") and part.endswith(">")):
                raise ValueError(f"element {name!r}: cannot be read")
            inside = sum(1 << frame.index(item) for item in part[1:-1].split("&"))
            mask |= 1 << (inside - 1)
        return mask
    except ValueError as error:
        raise MessageError(f"focal_elements: {error}") from error


def tracks_to_message(tracks: Tracks, *, with_tracks: bool = True) -> Any:
    """Return a ``TrackArray`` message, stamped with the time of the scan.

    Without tracks it is what all tracks have in common, with an empty list of them. To publish,
    :func:`~gda_tracker.io.track_cdr.tracks_to_cdr` does the same without an object per track.

    Raises
    ------
    MessageError
        If a stamp, an id or a count does not fit its field.
    """
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
    message.focal_elements = list(_focal_names(tuple(tracks.frame), tuple(tracks.focal.tolist())))
    message.degraded = bool(tracks.degraded)
    message.deleted_track_ids = int64_to_field(tracks.deleted_track_id)
    message.detection_counts = int32_to_field(tracks.detection_count)
    message.detection_rows = int32_to_field(tracks.detection_rows)
    if not with_tracks:
        return message

    count, extents = len(tracks), extent_columns(tracks)
    # one conversion per column, then slices of array.array: no numpy call per track
    columns = [
        (name, floats_to_field(values), values.size // count if count else 0)
        for name, values in (
            ("state", tracks.mean),
            ("covariance", tracks.covariance),
            ("extent", extents["extent"]),
            ("class_probability", tracks.class_probability),
            ("masses", tracks.masses),
        )
    ]
    numbers = [(name, _integers(tracks, name, *limits)) for name, *limits in INTEGER_LIMITS]
    reals = [(name, np.asarray(getattr(tracks, name), dtype=np.float64).tolist()) for name in REALS]
    reals += [(name, extents[name].tolist()) for name in ("extent_weight", "expected_detections")]
    stamps = [
        (name, [split_stamp(stamp, name) for stamp in values.tolist()])
        for name, values in (
            ("first_detection", tracks.first_detection_ns),
            ("last_detection", tracks.last_detection_ns),
        )
    ]
    for row in range(count):
        track = Track()
        for name, values, width in columns:
            setattr(track, name, values[row * width : (row + 1) * width])
        for name, values in numbers:
            setattr(track, name, values[row])
        for name, values in reals:
            setattr(track, name, values[row])
        for name, values in stamps:
            time = getattr(track, name)
            time.sec, time.nanosec = values[row]
        message.tracks.append(track)
    return message


# Fields of one real number.
REALS = (
    "conflict",
    "existence_probability",
    "signal_strength",
    "signal_strength_std_db",
    "detection_probability",
)
# Fields of integers, with the least and the largest number that they hold.
INTEGER_LIMITS = (
    ("track_id", -(2**63), 2**63 - 1),
    ("hypothesis_id", -(2**63), 2**63 - 1),
    ("status", 0, 255),
    ("hits", 0, 2**32 - 1),
    ("misses", 0, 2**32 - 1),
    ("coasted_scans", 0, 2**32 - 1),
    ("detection_index", -(2**31), 2**31 - 1),
)


def check_integers(values: NDArray[np.integer], name: str, lowest: int, highest: int) -> None:
    """Refuse integers that do not fit their field.

    Raises
    ------
    MessageError
        With the first of the extremes that does not fit.
    """
    for number in (int(values.min()), int(values.max())) if len(values) else ():
        if not lowest <= number <= highest:
            raise MessageError(f"{name} = {number}: allowed is {lowest} to {highest}")


def _integers(tracks: Tracks, name: str, lowest: int, highest: int) -> list[int]:
    values = np.asarray(getattr(tracks, name))
    check_integers(values, name, lowest, highest)
    numbers: list[int] = values.tolist()
    return numbers


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
    focal = _focal_masks(frame, tuple(str(name) for name in message.focal_elements))
    class_names = tuple(str(name) for name in message.class_names)
    size = len(tracks[0].state) if count else STATE_SIZE

    def integers(name: str) -> Any:
        return np.array([int(getattr(track, name)) for track in tracks], dtype=np.int64)

    def reals(name: str) -> FloatArray:
        return np.array([float(getattr(track, name)) for track in tracks], dtype=np.float64)

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
        conflict=reals("conflict"),
        existence_probability=reals("existence_probability"),
        signal_strength=reals("signal_strength"),
        signal_strength_std_db=reals("signal_strength_std_db"),
        detection_probability=reals("detection_probability"),
        hits=integers("hits"),
        misses=integers("misses"),
        coasted_scans=integers("coasted_scans"),
        first_detection_ns=stamps("first_detection"),
        last_detection_ns=stamps("last_detection"),
        detection_index=integers("detection_index").astype(np.int32),
        deleted_track_id=int64_from_field(message.deleted_track_ids),
        degraded=bool(message.degraded),
        **extents_of_track_messages(message),
    )


def _stack(tracks: Any, name: str, *shape: int) -> FloatArray:
    stacked = np.zeros((len(tracks), *shape))
    for row, track in enumerate(tracks):
        stacked[row] = reshape(floats_from_field(getattr(track, name)), shape, name)
    return stacked
