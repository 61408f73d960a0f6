"""Formations as messages, and back."""

from __future__ import annotations

from typing import Any

import numpy as np

from gda_tracker.formations.found import Formation, FormationEvent, Formations
from gda_tracker.io.fields import (
    MessageError,
    floats_from_field,
    make_header,
    reshape,
    signed,
    stamp_from_time,
    stamp_to_time,
    unsigned,
)
from gda_tracker.io.scan_messages import key_from_message, key_to_message
from gda_tracker.vocabulary.arrays import IntArray

_VECTORS = ("position", "velocity")
_MATRICES = ("position_covariance", "velocity_covariance", "extent")
_EVENT_FLOATS = ("log_likelihood_ratio", "false_alarm_probability", "miss_probability")
_EVENT_COUNTS = ("number", "previous_number", "samples")


def formations_to_message(found: Formations) -> Any:
    """Return a ``FormationArray`` message, stamped with the time of the scan.

    Raises
    ------
    MessageError
        If a stamp, an id or a count does not fit its field.
    """
    from gda_tracker_msgs.msg import FormationArray
    from unique_identifier_msgs.msg import UUID

    return FormationArray(
        header=make_header(found.key.stamp_ns, found.frame_id),
        key=key_to_message(found.key),
        system_uuid=UUID(uuid=np.frombuffer(found.system_uuid, dtype=np.uint8).copy()),
        formations=[_formation_to_message(one) for one in found.formations],
        events=[_event_to_message(one) for one in found.events],
    )


def _formation_to_message(found: Formation) -> Any:
    from gda_tracker_msgs.msg import Formation as Message

    return Message(
        formation_id=signed(found.formation_id, 64, "formation_id"),
        since=stamp_to_time(found.since_ns, "since"),
        track_ids=found.track_ids.tolist(),
        parent_track_ids=found.parent_track_ids.tolist(),
        number_probabilities=found.number_probabilities.tolist(),
        expected_number=found.expected_number,
        number=unsigned(found.number, 32, "number"),
        number_since=stamp_to_time(found.number_since_ns, "number_since"),
        samples=unsigned(found.samples, 32, "samples"),
        log_likelihood_ratio=found.log_likelihood_ratio,
        parent_ids=list(found.parent_ids),
        child_ids=list(found.child_ids),
        **{
            name: np.asarray(getattr(found, name), dtype=np.float64).ravel()
            for name in (*_VECTORS, *_MATRICES)
        },
    )


def _event_to_message(event: FormationEvent) -> Any:
    from gda_tracker_msgs.msg import FormationEvent as Message

    return Message(
        kind=event.kind,
        formation_id=signed(event.formation_id, 64, "formation_id"),
        other_formation_ids=list(event.other_formation_ids),
        track_ids=list(event.track_ids),
        began=stamp_to_time(event.began_ns, "began"),
        stamp=stamp_to_time(event.stamp_ns),
        **{name: unsigned(getattr(event, name), 32, name) for name in _EVENT_COUNTS},
        **{name: getattr(event, name) for name in _EVENT_FLOATS},
    )


def formations_from_message(message: Any) -> Formations:
    """Return the formations in a ``FormationArray`` message.

    Raises
    ------
    MessageError
        If a stamp is not valid, or the size of a field does not fit.
    """
    return Formations(
        key_from_message(message.key),
        str(message.header.frame_id),
        bytes(np.asarray(message.system_uuid.uuid, dtype=np.uint8)),
        [_formation_from_message(one) for one in message.formations],
        [_event_from_message(one) for one in message.events],
    )


def _ids(values: Any) -> IntArray:
    return np.asarray(values, dtype=np.int64)


def _formation_from_message(message: Any) -> Formation:
    tracks, parents = _ids(message.track_ids), _ids(message.parent_track_ids)
    if len(tracks) != len(parents):
        raise MessageError(
            f"parent_track_ids has {len(parents)} entries: allowed are {len(tracks)}, as in "
            "track_ids"
        )
    arrays = {
        name: reshape(floats_from_field(getattr(message, name)), shape, name)
        for names, shape in ((_VECTORS, (2,)), (_MATRICES, (2, 2)))
        for name in names
    }
    return Formation(
        formation_id=int(message.formation_id),
        since_ns=stamp_from_time(message.since, "since"),
        track_ids=tracks,
        parent_track_ids=parents,
        number_probabilities=floats_from_field(message.number_probabilities),
        number=int(message.number),
        number_since_ns=stamp_from_time(message.number_since, "number_since"),
        samples=int(message.samples),
        log_likelihood_ratio=float(message.log_likelihood_ratio),
        parent_ids=tuple(_ids(message.parent_ids).tolist()),
        child_ids=tuple(_ids(message.child_ids).tolist()),
        **arrays,
    )


def _event_from_message(message: Any) -> FormationEvent:
    return FormationEvent(
        kind=str(message.kind),
        formation_id=int(message.formation_id),
        stamp_ns=stamp_from_time(message.stamp, "stamp"),
        began_ns=stamp_from_time(message.began, "began"),
        track_ids=tuple(_ids(message.track_ids).tolist()),
        other_formation_ids=tuple(_ids(message.other_formation_ids).tolist()),
        **{name: int(getattr(message, name)) for name in _EVENT_COUNTS},
        **{name: float(getattr(message, name)) for name in _EVENT_FLOATS},
    )
