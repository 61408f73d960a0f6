"""Statements as messages. Values come back bit for bit; who admits them checks them."""

from __future__ import annotations

from typing import Any

from gda_tracker.io.fields import (
    floats_from_field,
    floats_to_field,
    make_header,
    signed,
    stamp_from_time,
    unsigned,
)
from gda_tracker.vocabulary.statements import (
    Statement,
    StatementPiece,
    StatementRegion,
    StatementReport,
)

_REGION_LISTS = ("centre_m", "covariance_m2", "low_m", "high_m", "vertices_m")
_REGION_NUMBERS = ("first_bearing_rad", "opening_rad", "nearest_m", "farthest_m")


def statement_to_message(statement: Statement) -> Any:
    """Return a ``Statement`` message.

    Raises
    ------
    MessageError
        If the stamp, the sequence number or the track id does not fit.
    """
    from gda_tracker_msgs.msg import Statement as Message

    message = Message(header=make_header(statement.stamp_ns, statement.frame_id))
    message.source = str(statement.source)
    message.sequence = unsigned(statement.sequence, 64, "sequence")
    message.kind = str(statement.kind)
    message.about = str(statement.about)
    message.track_id = signed(statement.track_id, 64, "track_id")
    message.reliability = float(statement.reliability)
    message.rule = str(statement.rule)
    message.pieces = [_piece_to_message(piece) for piece in statement.pieces]
    return message


def _piece_to_message(piece: StatementPiece) -> Any:
    from gda_tracker_msgs.msg import StatementPiece as Message

    message = Message(region=_region_to_message(piece.region))
    message.class_names = [str(name) for name in piece.class_names]
    message.class_grades = floats_to_field(piece.class_grades)
    message.mass = float(piece.mass)
    return message


def _region_to_message(region: StatementRegion) -> Any:
    from gda_tracker_msgs.msg import StatementRegion as Message

    message = Message(shape=str(region.shape))
    for name in _REGION_LISTS:
        setattr(message, name, floats_to_field(getattr(region, name)))
    for name in _REGION_NUMBERS:
        setattr(message, name, float(getattr(region, name)))
    return message


def statement_from_message(message: Any) -> Statement:
    """Return the statement in a ``Statement`` message, as it is.

    Raises
    ------
    MessageError
        If the stamp is not valid.
    """
    return Statement(
        source=str(message.source),
        sequence=int(message.sequence),
        stamp_ns=stamp_from_time(message.header.stamp, "header.stamp"),
        kind=str(message.kind),
        about=str(message.about),
        pieces=tuple(_piece_from_message(piece) for piece in message.pieces),
        track_id=int(message.track_id),
        reliability=float(message.reliability),
        rule=str(message.rule),
        frame_id=str(message.header.frame_id),
    )


def _piece_from_message(message: Any) -> StatementPiece:
    return StatementPiece(
        region=_region_from_message(message.region),
        class_names=tuple(str(name) for name in message.class_names),
        class_grades=tuple(floats_from_field(message.class_grades).tolist()),
        mass=float(message.mass),
    )


def _region_from_message(message: Any) -> StatementRegion:
    lists: dict[str, Any] = {
        name: tuple(floats_from_field(getattr(message, name)).tolist()) for name in _REGION_LISTS
    }
    numbers: dict[str, Any] = {name: float(getattr(message, name)) for name in _REGION_NUMBERS}
    return StatementRegion(shape=str(message.shape), **lists, **numbers)


def statement_report_to_message(report: StatementReport) -> Any:
    """Return a ``StatementReport`` message.

    Raises
    ------
    MessageError
        If the stamp or a number does not fit.
    """
    from gda_tracker_msgs.msg import StatementReport as Message

    return Message(
        header=make_header(report.stamp_ns, ""),
        source=str(report.source),
        sequence=unsigned(report.sequence, 64, "sequence"),
        outcome=str(report.outcome),
        reason=str(report.reason),
        waiting=unsigned(report.waiting, 32, "waiting"),
    )


def statement_report_from_message(message: Any) -> StatementReport:
    """Return the report in a ``StatementReport`` message.

    Raises
    ------
    MessageError
        If the stamp is not valid.
    """
    return StatementReport(
        source=str(message.source),
        sequence=int(message.sequence),
        stamp_ns=stamp_from_time(message.header.stamp, "header.stamp"),
        outcome=str(message.outcome),
        reason=str(message.reason),
        waiting=int(message.waiting),
    )
