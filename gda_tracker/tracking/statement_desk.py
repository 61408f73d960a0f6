"""The desk: admitted statements that wait for the scan they will be used with.

A statement waits from its admission until a scan that is not older than it has been *closed*, so
that a scan which is sent again, given up, or opened anew after a restart brings it again, and none
that was closed does.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from dataclasses import asdict, dataclass
from typing import Any

from gda_tracker.tracking.statement_door import StatementRejected
from gda_tracker.vocabulary.statements import TRACK, Statement, StatementPiece, StatementRegion

# Identities that are remembered, to tell a statement that comes again.
MEMORY = 1000

Identity = tuple[str, int]


@dataclass(frozen=True)
class DeskLimits:
    """Statements that may wait, and how far from the newest scan a stamp may lie [ns]."""

    count: int
    age_ns: int
    ahead_ns: int


@dataclass(slots=True, frozen=True)
class StatementDesk:
    """Statements that wait, in the order they came, and the identities of the last ones admitted.

    It is a value: every change returns another desk.
    """

    waiting: tuple[Statement, ...] = ()
    seen: tuple[Identity, ...] = ()

    def admit(
        self,
        statement: Statement,
        newest_ns: int | None,
        track_ids: Collection[int],
        limits: DeskLimits,
    ) -> StatementDesk:
        """Take in a statement that the door found good.

        ``newest_ns`` is the stamp of the newest scan admitted, ``track_ids`` are the live tracks.

        Raises
        ------
        StatementRejected
            ``duplicate``, ``too_old``, ``too_far_ahead``, ``unknown_track`` or ``queue_full``.
        """
        identity = (statement.source, statement.sequence)
        if identity in self.seen:
            raise StatementRejected("duplicate")
        if newest_ns is not None:
            if statement.stamp_ns < newest_ns - limits.age_ns:
                raise StatementRejected("too_old")
            if statement.stamp_ns > newest_ns + limits.ahead_ns:
                raise StatementRejected("too_far_ahead")
        if statement.about == TRACK and statement.track_id not in track_ids:
            raise StatementRejected("unknown_track")
        if len(self.waiting) >= limits.count:
            raise StatementRejected("queue_full")
        return StatementDesk((*self.waiting, statement), (*self.seen, identity)[-MEMORY:])

    def clear_up(
        self, stamp_ns: int, track_ids: Collection[int], limits: DeskLimits, counts: Counter[str]
    ) -> StatementDesk:
        """Drop what no scan from ``stamp_ns`` on can use any more, counted by reason."""
        kept = []
        for statement in self.waiting:
            if statement.stamp_ns < stamp_ns - limits.age_ns:
                reason = "too_old"
            elif statement.stamp_ns > stamp_ns + limits.ahead_ns:
                reason = "too_far_ahead"
            elif statement.about == TRACK and statement.track_id not in track_ids:
                reason = "gone_track"
            else:
                kept.append(statement)
                continue
            counts[f"dropped_statement_{reason}"] += 1
        return StatementDesk(tuple(kept), self.seen)

    def forget(self) -> StatementDesk:
        """Remember only what still waits: on another time axis the same statements come again."""
        return StatementDesk(self.waiting, tuple((s.source, s.sequence) for s in self.waiting))

    def due(self, stamp_ns: int) -> tuple[Statement, ...]:
        """Statements for a scan: those that are not of a later time."""
        return tuple(s for s in self.waiting if s.stamp_ns <= stamp_ns)

    def without(self, used: tuple[Statement, ...]) -> StatementDesk:
        """Take out what a closed scan has used."""
        gone = {(s.source, s.sequence) for s in used}
        waiting = tuple(s for s in self.waiting if (s.source, s.sequence) not in gone)
        return StatementDesk(waiting, self.seen)


def desk_to_plain(desk: StatementDesk) -> dict[str, Any]:
    """Return a desk as lists and numbers that JSON keeps exactly."""
    return {"waiting": [asdict(statement) for statement in desk.waiting], "seen": desk.seen}


def desk_from_plain(plain: dict[str, Any]) -> StatementDesk:
    """Return the desk that :func:`desk_to_plain` wrote."""
    waiting = tuple(
        Statement(
            **{**fields, "pieces": tuple(_piece_from_plain(piece) for piece in fields["pieces"])}
        )
        for fields in plain["waiting"]
    )
    return StatementDesk(waiting, tuple((source, number) for source, number in plain["seen"]))


def _piece_from_plain(plain: dict[str, Any]) -> StatementPiece:
    region: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in plain["region"].items()
    }
    return StatementPiece(
        StatementRegion(**region),
        tuple(plain["class_names"]),
        tuple(plain["class_grades"]),
        plain["mass"],
    )
