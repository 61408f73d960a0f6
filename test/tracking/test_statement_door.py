"""The door for statements: every fault has a name, whatever comes in changes nothing but counts."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.attributes.statement_meaning import place_meaning, track_meaning
from gda_tracker.tracking.statement_desk import (
    MEMORY,
    DeskLimits,
    StatementDesk,
    desk_from_plain,
    desk_to_plain,
)
from gda_tracker.tracking.statement_door import (
    EXPLANATIONS,
    StatementRejected,
    validate_statement,
)
from gda_tracker.vocabulary import Statement, StatementPiece, StatementRegion

CLASSES = ("false_alarm", "fighter", "cargo")
BOX = StatementRegion("box", low_m=(0.0, 0.0), high_m=(10.0, 20.0))
GAUSSIAN = StatementRegion("gaussian", centre_m=(1.0, 2.0), covariance_m2=(4.0, 1.0, 1.0, 9.0))
POLYGON = StatementRegion("polygon", vertices_m=(0.0, 0.0, 4.0, 0.0, 4.0, 4.0))
SECTOR = StatementRegion("sector", (0.0, 0.0), first_bearing_rad=0.5, opening_rad=0.2)
FIGHTER = {"class_names": ("fighter",), "class_grades": (1.0,)}
GOOD = Statement("pilot", 1, 5, "region", "place", (StatementPiece(BOX, **FIGHTER),), 0, 0.9)
GOOD = replace(GOOD, frame_id="map")


def with_piece(**changes):
    return replace(GOOD, kind="fuzzy", pieces=(replace(GOOD.pieces[0], **changes),))


def with_region(region, **changes):
    return with_piece(region=replace(region, **changes))


def ruled(**changes):
    values = {"kind": "rule", "rule": "region_implies_classes", **changes}
    return replace(GOOD, **values)


FAULTS = {
    "missing_source": [replace(GOOD, source=""), replace(GOOD, source="x" * 201)],
    "missing_sequence": [replace(GOOD, sequence=0), replace(GOOD, sequence=2**64)],
    "stamp_out_of_range": [replace(GOOD, stamp_ns=-1), replace(GOOD, stamp_ns=2**63)],
    "unknown_frame": [replace(GOOD, frame_id=""), replace(GOOD, frame_id="odom")],
    "unknown_kind": [replace(GOOD, kind="rumour")],
    "unknown_about": [replace(GOOD, about="ship")],
    "unknown_rule": [ruled(rule=""), ruled(rule="and"), replace(GOOD, rule="and")],
    "not_finite": [
        replace(GOOD, reliability=math.nan),
        with_piece(mass=math.inf),
        with_piece(class_grades=(math.nan,)),
        with_region(BOX, low_m=(-math.inf, 0.0)),
        with_region(SECTOR, opening_rad=math.nan),
    ],
    "bad_reliability": [replace(GOOD, reliability=1.1), replace(GOOD, reliability=-0.1)],
    "wrong_number_of_pieces": [
        replace(GOOD, pieces=()),
        replace(GOOD, pieces=GOOD.pieces * 2),
        replace(GOOD, kind="fds", pieces=(replace(GOOD.pieces[0], mass=1 / 17),) * 17),
    ],
    "bad_masses": [
        with_piece(mass=0.5),
        with_piece(mass=-1.0),
        replace(GOOD, kind="fds", pieces=(replace(GOOD.pieces[0], mass=0.4),) * 2),
    ],
    "bad_classes": [
        with_piece(class_names=("",)),
        with_piece(class_names=("a", "a"), class_grades=(1.0, 1.0)),
        with_piece(class_names=tuple("abcdefghijklmnopq"), class_grades=(1.0,) * 17),
    ],
    "bad_grades": [
        with_piece(class_grades=()),
        with_piece(class_grades=(1.5,)),
        with_piece(class_grades=(0.0,)),
        with_piece(class_names=()),
    ],
    "unknown_shape": [with_region(BOX, shape="blob")],
    "bad_gaussian": [
        with_region(GAUSSIAN, centre_m=(1.0,)),
        with_region(GAUSSIAN, covariance_m2=(1.0, 2.0, 2.0, 1.0)),
        with_region(GAUSSIAN, covariance_m2=(1.0, 0.1, 0.0, 1.0)),
        with_region(GAUSSIAN, covariance_m2=(0.0, 0.0, 0.0, 0.0)),
    ],
    "bad_box": [
        with_region(BOX, high_m=(0.0, 1.0)),
        with_region(BOX, low_m=(0.0, 0.0, 0.0)),
        with_region(BOX, high_m=(2e9, 1.0)),
    ],
    "bad_polygon": [
        with_region(POLYGON, vertices_m=(0.0, 0.0, 1.0, 0.0)),
        with_region(POLYGON, vertices_m=(0.0, 0.0, 1.0, 0.0, 1.0)),
        with_region(POLYGON, vertices_m=(0.0, 0.0, 1.0, 1.0, 2.0, 2.0)),
        with_region(POLYGON, vertices_m=(0.0, 0.0, 3.0, 3.0, 3.0, 0.0, 0.0, 2.0)),
        with_region(POLYGON, vertices_m=tuple(np.arange(130.0) ** 2)),
    ],
    "bad_sector": [
        with_region(SECTOR, opening_rad=0.0),
        with_region(SECTOR, opening_rad=7.0),
        with_region(SECTOR, nearest_m=5.0),
        with_region(SECTOR, nearest_m=5.0, farthest_m=4.0),
        with_region(SECTOR, opening_rad=2.0 * math.pi, farthest_m=4.0),
        with_region(SECTOR, centre_m=()),
    ],
    "not_crisp": [
        replace(with_region(GAUSSIAN), kind="region"),
        replace(with_piece(class_grades=(0.5,)), kind="region"),
    ],
    "incomplete_rule": [
        ruled(pieces=(StatementPiece(BOX),), about="track"),
        ruled(pieces=(StatementPiece(**FIGHTER),)),
    ],
    "rule_of_two_fuzzy_sets": [
        ruled(pieces=(StatementPiece(GAUSSIAN, ("fighter",), (0.5,)),)),
    ],
    "place_without_classes": [with_piece(class_names=(), class_grades=())],
    "says_nothing": [replace(GOOD, kind="fuzzy", about="track", pieces=(StatementPiece(),))],
    "malformed": [
        replace(GOOD, pieces=None),
        replace(GOOD, pieces=(None,)),
        with_region(BOX, low_m=("a", "b")),
        replace(GOOD, track_id="1"),
    ],
}


@pytest.mark.parametrize("reason", FAULTS)
def test_every_fault_has_its_name(reason):
    for statement in FAULTS[reason]:
        with pytest.raises(StatementRejected) as caught:
            validate_statement(statement, "map")
        assert str(caught.value) == reason, statement


def test_every_reason_is_explained():
    desk = {"duplicate", "too_old", "too_far_ahead", "unknown_track", "queue_full"}
    assert set(EXPLANATIONS) == {*FAULTS, *desk}


@pytest.mark.parametrize("region", [BOX, GAUSSIAN, POLYGON, SECTOR, StatementRegion()])
def test_good_ones_come_through(region):
    for about in ("place", "track"):
        statement = replace(with_region(region), about=about)
        assert validate_statement(statement, "map") == statement
    limited = with_region(SECTOR, nearest_m=5.0, farthest_m=9.0)
    assert validate_statement(limited, "map") == limited


def test_fields_that_do_not_count_are_left_out():
    """Equal statements are equal: what the shape does not read is gone."""
    cluttered = with_region(BOX, centre_m=(1.0, 2.0), opening_rad=3.0)
    assert validate_statement(cluttered, "map") == with_region(BOX)
    unnamed = with_region(StatementRegion(shape=""))
    assert validate_statement(unnamed, "map").pieces[0].region == StatementRegion()


numbers = st.one_of(
    st.floats(),
    st.floats(-100.0, 100.0),
    st.sampled_from([0.0, 1.0, 0.5, 2.0 * math.pi, 1e9, 1e-3, -1.0]),
)
lists = st.lists(numbers, max_size=6).map(tuple)
regions = st.builds(
    StatementRegion,
    st.sampled_from(["", "everywhere", "gaussian", "box", "polygon", "sector", "blob"]),
    *[lists] * 5,
    *[numbers] * 4,
)
names = st.lists(st.sampled_from(["fighter", "cargo", "false_alarm", "zeppelin", ""]), max_size=3)
pieces = st.builds(StatementPiece, regions, names.map(tuple), lists, numbers)
sound = st.sampled_from([BOX, GAUSSIAN, POLYGON, SECTOR, StatementRegion()])
good_pieces = st.builds(
    lambda region, grades, mass: StatementPiece(region, CLASSES[1:], grades, mass),
    st.one_of(sound, regions),
    st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 1.0)),
    st.sampled_from([1.0, 0.5]),
)
statements = st.builds(
    Statement,
    st.sampled_from(["pilot", ""]),
    st.integers(0, 3),
    st.integers(-1, 2**63),
    st.sampled_from(["region", "fuzzy", "fds", "rule", "rumour"]),
    st.sampled_from(["place", "track", "ship"]),
    st.lists(st.one_of(pieces, good_pieces), max_size=3).map(tuple),
    st.integers(-1, 2),
    st.one_of(st.floats(0.0, 1.0), numbers),
    st.sampled_from(["", "region_implies_classes", "classes_imply_region", "and"]),
    st.sampled_from(["map", "odom"]),
)


@settings(derandomize=True, deadline=None, max_examples=100)
@given(statements)
def test_whatever_comes_is_rejected_by_name_or_means_something(statement):
    try:
        admitted = validate_statement(statement, "map")
    except StatementRejected as rejection:
        reason = str(rejection)
    else:
        reason = ""
    assert reason in ("", *FAULTS)
    if reason:
        return
    position = np.array([[0.0, 0.0], [1e6, -5.0]])
    covariance = np.array([np.eye(2), 1e4 * np.eye(2)])
    meanings = [track_meaning(admitted, names) for names in ((), CLASSES)]
    if admitted.about == "place":
        meanings.append(place_meaning(admitted, CLASSES))
    for meaning in meanings:
        value = meaning.expectation(position, covariance)
        assert np.isfinite(value).all()
        assert (value > 0.0).all()
        assert (value <= 2.0 + 1e-9).all()
    assert validate_statement(admitted, "map") == admitted


# --- the desk

LIMITS = DeskLimits(3, 10, 10)


def numbered(sequence, stamp_ns=100, **changes):
    return replace(GOOD, sequence=sequence, stamp_ns=stamp_ns, **changes)


def refused(desk, statement, newest_ns=100, track_ids=(1,)):
    with pytest.raises(StatementRejected) as caught:
        desk.admit(statement, newest_ns, track_ids, LIMITS)
    return str(caught.value)


def test_what_the_desk_refuses():
    desk = StatementDesk().admit(numbered(1), 100, (), LIMITS)
    assert refused(desk, numbered(1)) == "duplicate"
    assert refused(desk, numbered(2, 89)) == "too_old"
    assert refused(desk, numbered(2, 111)) == "too_far_ahead"
    assert refused(desk, numbered(2, about="track", track_id=7)) == "unknown_track"
    for sequence in (2, 3):
        desk = desk.admit(numbered(sequence), 100, (), LIMITS)
    assert refused(desk, numbered(4)) == "queue_full"
    # Before the first scan there is no time to compare with.
    assert StatementDesk().admit(numbered(1, 10**15), None, (), LIMITS).waiting


def test_each_is_due_until_it_is_used():
    desk = StatementDesk()
    for sequence, stamp in ((1, 100), (2, 105), (3, 95)):
        desk = desk.admit(numbered(sequence, stamp), 100, (), LIMITS)
    assert [s.sequence for s in desk.due(100)] == [1, 3]
    after = desk.without(desk.due(100))
    assert [s.sequence for s in after.waiting] == [2]
    assert refused(after, numbered(1)) == "duplicate"
    assert after.forget().seen == (("pilot", 2),)


def test_what_no_scan_can_use_is_dropped_and_counted():
    desk = StatementDesk((numbered(1, 80), numbered(2, 120), numbered(3)))
    desk = StatementDesk((*desk.waiting, numbered(4, about="track", track_id=7)))
    counts = Counter()
    assert [s.sequence for s in desk.clear_up(100, (1,), LIMITS, counts).waiting] == [3]
    assert counts == {
        "dropped_statement_too_old": 1,
        "dropped_statement_too_far_ahead": 1,
        "dropped_statement_gone_track": 1,
    }


def test_memory_is_bounded():
    desk = StatementDesk()
    for sequence in range(1, MEMORY + 10):
        desk = desk.admit(numbered(sequence), 100, (), LIMITS)
        desk = desk.without(desk.waiting)
    assert len(desk.seen) == MEMORY
    assert refused(desk, numbered(MEMORY)) == "duplicate"


def test_a_desk_survives_json():
    import json

    desk = StatementDesk()
    for sequence, region in enumerate((BOX, GAUSSIAN, POLYGON), start=1):
        statement = with_region(region)
        desk = desk.admit(replace(statement, sequence=sequence), None, (), LIMITS)
    again = desk_from_plain(json.loads(json.dumps(desk_to_plain(desk))))
    assert again == desk
    assert {f.name for f in fields(StatementDesk)} == set(desk_to_plain(desk))
