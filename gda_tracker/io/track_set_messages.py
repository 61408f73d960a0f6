"""Track sets as messages, nested and made for people, and their ellipses as markers."""

from __future__ import annotations

from typing import Any

import numpy as np

from gda_tracker.io.fields import (
    MessageError,
    bools_from_field,
    floats_from_field,
    floats_to_field,
    int32_from_field,
    int32_to_field,
    int64_from_field,
    int64_to_field,
    make_header,
    reshape,
    split_stamp,
    stamp_from_time,
)
from gda_tracker.io.scan_messages import key_from_message, key_to_message
from gda_tracker.io.track_messages import check_integers
from gda_tracker.vocabulary.track_sets import TrackSetArray

STATE_SIZE = 4
# Field of the message, column of the array, elements per set.
NUMBERS = (
    ("centroid", "centroid", (STATE_SIZE,)),
    ("covariance", "covariance", (STATE_SIZE, STATE_SIZE)),
    ("set_matrix", "matrix", (STATE_SIZE, STATE_SIZE)),
)
REALS = ("position_radius_m", "speed_radius_mps", "score")
INTEGERS = (
    ("track_id", "track_id", -(2**63), 2**63 - 1),
    ("branch_id", "branch_id", -(2**63), 2**63 - 1),
    ("parent_branch_id", "parent_branch_id", -(2**63), 2**63 - 1),
    ("status", "status", 0, 255),
    ("detection_index", "detection_index", -(2**31), 2**31 - 1),
    ("hits", "hits", 0, 2**32 - 1),
    ("misses", "misses", 0, 2**32 - 1),
    ("coasted_scans", "coasted_scans", 0, 2**32 - 1),
)
STAMPS = (("first_detection", "first_detection_ns"), ("last_detection", "last_detection_ns"))


def track_sets_to_message(sets: TrackSetArray) -> Any:
    """Return a ``TrackSetArray`` message, stamped with the time of the scan.

    Raises
    ------
    MessageError
        If a stamp, an id or a count does not fit its field.
    """
    from gda_tracker_msgs.msg import TrackSet
    from gda_tracker_msgs.msg import TrackSetArray as Message
    from unique_identifier_msgs.msg import UUID

    message = Message(
        header=make_header(sets.key.stamp_ns, sets.frame_id), key=key_to_message(sets.key)
    )
    if len(sets.system_uuid) != 16:
        raise MessageError(f"system_uuid has {len(sets.system_uuid)} bytes, 16 expected")
    message.system_uuid = UUID(uuid=np.frombuffer(sets.system_uuid, dtype=np.uint8).copy())
    message.deleted_track_ids = int64_to_field(sets.deleted_track_id)
    message.deleted_branch_ids = int64_to_field(sets.deleted_branch_id)
    check_integers(sets.may_own_index, "detection_indices", -(2**31), 2**31 - 1)
    for _, column, low, high in INTEGERS:
        check_integers(getattr(sets, column), column, low, high)
    integers = [(name, getattr(sets, column).tolist()) for name, column, *_ in INTEGERS]
    reals = [(name, getattr(sets, name).tolist()) for name in REALS]
    numbers = [(name, getattr(sets, column)) for name, column, _ in NUMBERS]
    stamps = [
        (name, [split_stamp(stamp, name) for stamp in getattr(sets, column).tolist()])
        for name, column in STAMPS
    ]
    best = np.asarray(sets.best, dtype=bool).tolist()
    for row in range(len(sets)):
        one = TrackSet(best=best[row])
        one.detection_indices = int32_to_field(sets.may_own(row))
        for name, values in numbers:
            setattr(one, name, floats_to_field(values[row]))
        for name, values in (*integers, *reals):
            setattr(one, name, values[row])
        for name, values in stamps:
            time = getattr(one, name)
            time.sec, time.nanosec = values[row]
        message.track_sets.append(one)
    return message


def track_sets_from_message(message: Any) -> TrackSetArray:
    """Return the sets in a ``TrackSetArray`` message; these arrays are copies.

    Raises
    ------
    MessageError
        If a stamp is not valid or the size of a field does not fit.
    """
    sets = message.track_sets
    columns: dict[str, Any] = {}
    for name, column, shape in NUMBERS:
        values = np.zeros((len(sets), *shape))
        for row, one in enumerate(sets):
            values[row] = reshape(floats_from_field(getattr(one, name)), shape, name)
        columns[column] = values
    for name, column, *_ in INTEGERS:
        columns[column] = np.array([int(getattr(one, name)) for one in sets], dtype=np.int64)
    for name in REALS:
        columns[name] = np.array([float(getattr(one, name)) for one in sets], dtype=np.float64)
    for name, column in STAMPS:
        stamps = [stamp_from_time(getattr(one, name), name) for one in sets]
        columns[column] = np.array(stamps, dtype=np.int64)
    owned = [int32_from_field(one.detection_indices).astype(np.int64) for one in sets]
    return TrackSetArray(
        key=key_from_message(message.key),
        frame_id=str(message.header.frame_id),
        system_uuid=bytes(np.asarray(message.system_uuid.uuid, dtype=np.uint8)),
        best=bools_from_field(np.array([one.best for one in sets], dtype=np.uint8)),
        may_own_start=np.cumsum([0, *map(len, owned)], dtype=np.int64),
        may_own_index=np.concatenate([np.zeros(0, dtype=np.int64), *owned]),
        deleted_track_id=int64_from_field(message.deleted_track_ids),
        deleted_branch_id=int64_from_field(message.deleted_branch_ids),
        **columns,
    )
