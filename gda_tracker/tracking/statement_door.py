"""The door for statements: validates what people and other sensors say.

A statement is admitted as a whole or rejected with a reason; nothing of it is mended. What it means
is in :mod:`gda_tracker.attributes.statement_meaning`.

That somebody is at a place, without a word on the class, is rejected (``place_without_classes``):
it would be evidence that a detection there is no false alarm, as strong as the chance of such a
report about a target over its chance about nothing, which no statement tells; and it does not help
to say which track the detection belongs to.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

from gda_tracker.attributes.statement_meaning import covering_function
from gda_tracker.tracking.door import LARGEST_RANGE_M, LARGEST_STAMP_NS
from gda_tracker.vocabulary.statements import (
    BOX,
    EVERYWHERE,
    FDS,
    GAUSSIAN,
    KINDS,
    PLACE,
    POLYGON,
    REGION,
    RULE,
    RULES,
    SECTOR,
    SHAPES,
    SUBJECTS,
    Statement,
    StatementPiece,
    StatementRegion,
)

LONGEST_NAME = 200
LARGEST_PIECE_COUNT = 16
LARGEST_VERTEX_COUNT = 32
LARGEST_CLASS_COUNT = 16
LARGEST_SEQUENCE = 2**64 - 1
LARGEST_TRACK_ID = 2**63 - 1
MASS_TOLERANCE = 1e-6
# What is thinner or smaller is no region that anybody could mean.
SMALLEST_EXTENT_M = 1e-3
SMALLEST_OPENING_RAD = 1e-6


# What each reason for a rejection means, those of the desk too.
EXPLANATIONS = {
    "malformed": "a field is of another type than declared",
    "missing_source": f"source is a name of at most {LONGEST_NAME} letters",
    "missing_sequence": "sequence is an integer from 1, a new one for every statement of a source",
    "stamp_out_of_range": "the stamp is no time",
    "unknown_frame": "frame_id is the tracking frame of the ring",
    "unknown_kind": f"kind is one of {', '.join(KINDS)}",
    "unknown_about": f"about is one of {', '.join(SUBJECTS)}",
    "unknown_rule": f"rule is one of {', '.join(RULES)} for the kind rule, else empty",
    "not_finite": "all numbers are finite",
    "bad_reliability": "reliability is a number from 0 to 1",
    "wrong_number_of_pieces": f"a statement has one piece, of kind fds 1 to {LARGEST_PIECE_COUNT}",
    "bad_masses": "masses are above 0 and have the sum 1",
    "bad_classes": f"at most {LARGEST_CLASS_COUNT} class names that differ",
    "bad_grades": "each class has a grade from 0 to 1, and one of a piece is above 0",
    "unknown_shape": f"shape is one of {', '.join(SHAPES)}",
    "bad_gaussian": "centre_m is x, y; covariance_m2 is xx, xy, yx, yy, symmetric and positive",
    "bad_box": "low_m and high_m are x, y, low below high",
    "bad_polygon": f"vertices_m are x, y of 3 to {LARGEST_VERTEX_COUNT} corners, no edges cross",
    "bad_sector": "centre_m is x, y; 0 < opening_rad <= 2 pi; 0 <= nearest_m < farthest_m, "
    "or both 0; with limits opening_rad < 2 pi",
    "not_crisp": "of kind region: no gaussian, grades 0 or 1; else it is of kind fuzzy",
    "incomplete_rule": "a rule has a region with an edge and classes",
    "rule_of_two_fuzzy_sets": "in a rule the region is no gaussian or the grades are 0 or 1",
    "place_without_classes": "that something is at a place tells no track from another",
    "says_nothing": "a statement names a region, classes, or both",
    "duplicate": "this source has used this sequence number before",
    "too_old": "the stamp is before the newest scan by more than statement_max_age_s",
    "too_far_ahead": "the stamp is ahead of the newest scan by more than statement_max_ahead_s",
    "unknown_track": "no track with this track_id lives",
    "queue_full": "max_statements wait already",
}


class StatementRejected(ValueError):
    """A statement is refused; the message is the reason's name."""


def validate_statement(statement: Statement, tracking_frame: str) -> Statement:
    """Return an admissible statement in its plain form; it depends on no state.

    Raises
    ------
    StatementRejected
        ``missing_source``, ``missing_sequence``, ``stamp_out_of_range``, ``unknown_frame``,
        ``unknown_kind``, ``unknown_about``, ``unknown_rule``, ``not_finite``,
        ``bad_reliability``, ``wrong_number_of_pieces``, ``bad_masses``, ``bad_classes``,
        ``bad_grades``, ``unknown_shape``, ``bad_gaussian``, ``bad_box``, ``bad_polygon``,
        ``bad_sector``, ``not_crisp``, ``incomplete_rule``, ``rule_of_two_fuzzy_sets``,
        ``place_without_classes``, ``says_nothing`` or ``malformed``.
    """
    try:
        return _validated(statement, tracking_frame)
    except StatementRejected:
        raise
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
        # Fields of other types than declared, as a caller without messages may pass them.
        raise StatementRejected("malformed") from None


def _validated(statement: Statement, tracking_frame: str) -> Statement:
    if not _is_name(statement.source):
        raise StatementRejected("missing_source")
    if not _is_integer(statement.sequence, 1, LARGEST_SEQUENCE):
        raise StatementRejected("missing_sequence")
    if not _is_integer(statement.stamp_ns, 0, LARGEST_STAMP_NS):
        raise StatementRejected("stamp_out_of_range")
    if statement.frame_id != tracking_frame:
        raise StatementRejected("unknown_frame")
    if statement.kind not in KINDS:
        raise StatementRejected("unknown_kind")
    if statement.about not in SUBJECTS:
        raise StatementRejected("unknown_about")
    if not _is_integer(statement.track_id, -LARGEST_TRACK_ID - 1, LARGEST_TRACK_ID):
        raise StatementRejected("malformed")
    if statement.rule not in (RULES if statement.kind == RULE else ("",)):
        raise StatementRejected("unknown_rule")
    _check_finite([statement.reliability])
    if not 0.0 <= statement.reliability <= 1.0:
        raise StatementRejected("bad_reliability")
    count = len(statement.pieces)
    if not 1 <= count <= (LARGEST_PIECE_COUNT if statement.kind == FDS else 1):
        raise StatementRejected("wrong_number_of_pieces")
    pieces = tuple(_piece(piece) for piece in statement.pieces)
    masses = [piece.mass for piece in pieces]
    if not all(mass > 0.0 for mass in masses) or abs(sum(masses) - 1.0) > MASS_TOLERANCE:
        raise StatementRejected("bad_masses")
    _check_kind(statement.kind, pieces[0])
    with_classes = any(piece.class_names for piece in pieces)
    if statement.about == PLACE and not with_classes:
        raise StatementRejected("place_without_classes")
    if not with_classes and all(piece.region.shape == EVERYWHERE for piece in pieces):
        raise StatementRejected("says_nothing")
    return replace(
        statement, pieces=pieces, track_id=0 if statement.about == PLACE else statement.track_id
    )


def _piece(piece: StatementPiece) -> StatementPiece:
    _check_finite([piece.mass, *piece.class_grades])
    names = piece.class_names
    if len(names) > LARGEST_CLASS_COUNT or len(set(names)) < len(names):
        raise StatementRejected("bad_classes")
    if not all(_is_name(name) for name in names):
        raise StatementRejected("bad_classes")
    grades = piece.class_grades
    if len(grades) != len(names) or not all(0.0 <= grade <= 1.0 for grade in grades):
        raise StatementRejected("bad_grades")
    if names and not any(grades):
        raise StatementRejected("bad_grades")
    return StatementPiece(
        _region(piece.region), tuple(names), tuple(map(float, grades)), float(piece.mass)
    )


def _region(region: StatementRegion) -> StatementRegion:
    """The region with the fields of its shape alone, so that equal ones are equal."""
    shape = region.shape or EVERYWHERE
    if shape not in SHAPES:
        raise StatementRejected("unknown_shape")
    if shape == EVERYWHERE:
        return StatementRegion()
    centre, covariance = _numbers(region.centre_m), _numbers(region.covariance_m2)
    low, high, vertices = map(_numbers, (region.low_m, region.high_m, region.vertices_m))
    angles = (region.first_bearing_rad, region.opening_rad, region.nearest_m, region.farthest_m)
    _check_finite([*centre, *covariance, *low, *high, *vertices, *angles])
    plain = {
        GAUSSIAN: StatementRegion(shape, centre_m=centre, covariance_m2=covariance),
        BOX: StatementRegion(shape, low_m=low, high_m=high),
        POLYGON: StatementRegion(shape, vertices_m=vertices),
        SECTOR: StatementRegion(shape, centre, (), (), (), (), *map(float, angles)),
    }[shape]
    if not _sound(plain):
        raise StatementRejected(f"bad_{shape}")
    try:
        covering_function(plain)
    except ValueError:
        raise StatementRejected(f"bad_{shape}") from None
    return plain


def _sound(region: StatementRegion) -> bool:
    """Whether the numbers of a region are as many and as large as they should be."""
    places = (region.centre_m, region.low_m, region.high_m, region.vertices_m)
    if any(abs(value) > LARGEST_RANGE_M for numbers in places for value in numbers):
        return False
    if region.shape == GAUSSIAN:
        if (len(region.centre_m), len(region.covariance_m2)) != (2, 4):
            return False
        xx, xy, yx, yy = region.covariance_m2
        least = SMALLEST_EXTENT_M**2
        good = least <= xx <= LARGEST_RANGE_M**2 and least <= yy <= LARGEST_RANGE_M**2
        return good and xy == yx and xy * xy <= (1.0 - 1e-9) * xx * yy
    if region.shape == BOX:
        if (len(region.low_m), len(region.high_m)) != (2, 2):
            return False
        sides = zip(region.low_m, region.high_m, strict=True)
        return all(high - low >= SMALLEST_EXTENT_M for low, high in sides)
    if region.shape == POLYGON:
        count = len(region.vertices_m)
        return count % 2 == 0 and 6 <= count <= 2 * LARGEST_VERTEX_COUNT
    near, far = region.nearest_m, region.farthest_m
    if len(region.centre_m) != 2 or not 0.0 <= near <= LARGEST_RANGE_M:
        return False
    limited = far > 0.0 or near > 0.0
    if limited and not near + SMALLEST_EXTENT_M <= far <= LARGEST_RANGE_M:
        return False
    return (
        SMALLEST_OPENING_RAD <= region.opening_rad <= 2.0 * math.pi
        and abs(region.first_bearing_rad) <= 1e3
    )


def _check_kind(kind: str, piece: StatementPiece) -> None:
    """Check what the kind of a statement promises of its (first) piece."""
    crisp_region = piece.region.shape != GAUSSIAN
    crisp_classes = all(grade in (0.0, 1.0) for grade in piece.class_grades)
    if kind == REGION and not (crisp_region and crisp_classes):
        raise StatementRejected("not_crisp")
    if kind == RULE:
        if piece.region.shape == EVERYWHERE or not piece.class_names:
            raise StatementRejected("incomplete_rule")
        if not (crisp_region or crisp_classes):
            raise StatementRejected("rule_of_two_fuzzy_sets")


def _numbers(values: Iterable[float]) -> tuple[float, ...]:
    return tuple(float(value) for value in values)


def _check_finite(values: Iterable[float]) -> None:
    if not all(math.isfinite(value) for value in values):
        raise StatementRejected("not_finite")


def _is_name(value: object) -> bool:
    return isinstance(value, str) and 0 < len(value) <= LONGEST_NAME


def _is_integer(value: object, least: int, largest: int) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and least <= value <= largest
