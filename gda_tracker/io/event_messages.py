"""Track events as messages, and back."""

from __future__ import annotations

from typing import Any

import numpy as np

from gda_tracker.events.found import TrackEvent, TrackEvents
from gda_tracker.io.fields import (
    floats_from_field,
    make_header,
    reshape,
    signed,
    stamp_from_time,
    stamp_to_time,
    unsigned,
)
from gda_tracker.io.scan_messages import key_from_message, key_to_message

_SAME = (
    "kind",
    "context",
    "hypothesis",
    "log_likelihood_ratio",
    "lower_threshold",
    "upper_threshold",
    "false_alarm_probability",
    "miss_probability",
    "value",
)


def events_to_message(events: TrackEvents) -> Any:
    """Return a ``TrackEventArray`` message, stamped with the time of the scan.

    Raises
    ------
    MessageError
        If a stamp, an id or a count does not fit its field.
    """
    from gda_tracker_msgs.msg import TrackEventArray
    from unique_identifier_msgs.msg import UUID

    return TrackEventArray(
        header=make_header(events.key.stamp_ns, events.frame_id),
        key=key_to_message(events.key),
        system_uuid=UUID(uuid=np.frombuffer(events.system_uuid, dtype=np.uint8).copy()),
        events=[_to_message(event) for event in events.events],
    )


def _to_message(event: TrackEvent) -> Any:
    from gda_tracker_msgs.msg import TrackEvent as Message

    return Message(
        track_id=signed(event.track_id, 64, "track_id"),
        other_track_id=signed(event.other_track_id, 64, "other_track_id"),
        began=stamp_to_time(event.began_ns, "began"),
        stamp=stamp_to_time(event.stamp_ns),
        samples=unsigned(event.samples, 32, "samples"),
        position=np.asarray(event.position, dtype=np.float64),
        position_covariance=np.asarray(event.position_covariance, dtype=np.float64).ravel(),
        **{name: getattr(event, name) for name in _SAME},
    )


def events_from_message(message: Any) -> TrackEvents:
    """Return the events in a ``TrackEventArray`` message.

    Raises
    ------
    MessageError
        If a stamp is not valid, or the size of a field does not fit.
    """
    return TrackEvents(
        key_from_message(message.key),
        str(message.header.frame_id),
        bytes(np.asarray(message.system_uuid.uuid, dtype=np.uint8)),
        [_from_message(event) for event in message.events],
    )


def _from_message(message: Any) -> TrackEvent:
    covariance = floats_from_field(message.position_covariance)
    return TrackEvent(
        track_id=int(message.track_id),
        other_track_id=int(message.other_track_id),
        began_ns=stamp_from_time(message.began, "began"),
        stamp_ns=stamp_from_time(message.stamp, "stamp"),
        samples=int(message.samples),
        position=reshape(floats_from_field(message.position), (2,), "position"),
        position_covariance=reshape(covariance, (2, 2), "position_covariance"),
        **{name: getattr(message, name) for name in _SAME},
    )
