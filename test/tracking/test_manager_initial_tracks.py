"""Labelled tracks reach the manager: once, checked, with ids that go on and scans that waited."""

import dataclasses

import numpy as np
import pytest
from tracking_examples import (
    SECOND,
    answers,
    assert_same,
    initial_tracks,
    moving,
    ring_of,
    scan_at,
)

from gda_tracker.vocabulary import CONFIRMED


def labelled_ring(**parameters):
    return ring_of(initiation="labelled", **parameters)


def test_what_lived_ends_and_beliefs_are_taken_over():
    ring = ring_of()
    for k in range(3):
        ring.process(scan_at(k, [moving(k)]))
    initial = initial_tracks()
    report = ring.initialise(initial)
    assert (report.outcome, report.repeated, report.tracks_confirmed) == ("initialised", False, 2)
    table = ring.manager.state.table
    assert table.track_id.tolist() == [2, 3]  # 1 was issued before
    for name in (
        "mean",
        "covariance",
        "masses",
        "focal",
        "class_probability",
        "conflict",
        "hits",
        "misses",
        "first_detection_ns",
        "last_detection_ns",
    ):
        np.testing.assert_array_equal(getattr(table, name), getattr(initial, name))
    assert table.status.tolist() == [CONFIRMED, CONFIRMED]
    result = ring.process(scan_at(11, [moving(11), moving(11, (3500.0, 1000.0))]))
    assert result.tracks.track_id.tolist() == [2, 3]
    np.testing.assert_array_equal(result.tracks.hits, 3)
    for k in (12, 13):
        newcomer = ring.process(scan_at(k, [moving(k, (1000.0, 3000.0))])).tracks
    assert newcomer.track_id.tolist() == [2, 3, 4]
    assert newcomer.hypothesis_id.tolist() == [2, 3, 4]


def test_the_manager_shares_no_memory_with_the_message():
    ring, initial = labelled_ring(), initial_tracks()
    ring.initialise(initial)
    before = ring.manager.state.table.mean.copy()
    for name in ("mean", "covariance", "masses", "class_probability", "focal"):
        getattr(initial, name)[...] = 0
    np.testing.assert_array_equal(ring.manager.state.table.mean, before)
    assert ring.manager.state.table.masses.sum() == pytest.approx(2.0)


def test_the_same_initial_tracks_act_once():
    ring = labelled_ring()
    ring.initialise(initial_tracks())
    ring.process(scan_at(11, [moving(11)]))
    before = ring.manager.state
    copy = dataclasses.replace(before)
    report = ring.initialise(initial_tracks())
    assert (report.outcome, report.repeated) == ("initialised", True)
    assert ring.manager.state is before
    assert_same(before, copy)


@pytest.mark.parametrize("other", [{"uuid": bytes(16)}, {"stamp_s": 50.0}])
def test_others_start_anew_and_ids_go_on(other):
    ring = labelled_ring()
    ring.initialise(initial_tracks())
    ring.process(scan_at(11, [moving(11)]))
    assert not ring.initialise(initial_tracks(**other)).repeated
    assert ring.manager.state.table.track_id.tolist() == [3, 4]
    assert ring.manager.state.table.hypothesis_id.tolist() == [3, 4]
    stamp = other.get("stamp_s", 10.0) + 1.0
    assert ring.process(scan_at(stamp, [moving(stamp)])).report.outcome == "tracked"


def test_time_goes_on_from_the_initial_tracks():
    ring = labelled_ring()
    ring.initialise(initial_tracks(stamp_s=10.0))
    assert ring.process(scan_at(10.0, [moving(10)])).report.reason == "late"
    assert ring.process(scan_at(9.0, [moving(9)])).report.reason == "late"
    ring.manager.admit(scan_at(12.0, []))
    opened = ring.manager.open()
    np.testing.assert_allclose(opened.predictions.component_mean[0, :2], moving(12.0))


def test_scans_wait_for_the_first_initial_tracks():
    ring = labelled_ring()
    for stamp in (9, 12, 10, 11):
        assert ring.manager.admit(scan_at(stamp, [moving(stamp)])) is None
    assert not ring.manager.ready
    ring.initialise(initial_tracks(stamp_s=10.0))
    # What is not later than the tracks has lost its chance, and is counted.
    assert ring.manager.counters["dropped_at_initialisation"] == 2
    stamps = []
    while ring.manager.ready:
        stamps.append(ring.manager.open().scan.key.stamp_ns // SECOND)
        ring.manager.close(*answers(ring))
    assert stamps == [11, 12]


def test_scans_of_the_run_before_do_not_wait_for_the_next_run():
    ring = labelled_ring()
    ring.initialise(initial_tracks(stamp_s=10.0))
    for stamp in (11, 12, 13):
        ring.manager.admit(scan_at(stamp, [moving(stamp)]))
    ring.manager.open()
    ring.initialise(initial_tracks(stamp_s=5.0, uuid=bytes(16)))
    assert ring.manager.opened is None
    assert ring.manager.waiting == 0
    assert ring.manager.counters["dropped_at_initialisation"] == 2
    assert ring.process(scan_at(6, [moving(6)])).report.outcome == "tracked"


def test_no_initial_tracks_are_initial_tracks_too():
    ring = labelled_ring()
    assert ring.initialise(initial_tracks(n=0)).outcome == "initialised"
    result = ring.process(scan_at(11, [moving(11)]))
    assert len(result.tracks) == 0


NAN = np.nan


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"mean": np.full((2, 4), NAN)}, "initial_tracks_not_finite"),
        ({"masses": np.full((2, 3), NAN)}, "initial_tracks_not_finite"),
        ({"class_probability": np.full((2, 3), np.inf)}, "initial_tracks_not_finite"),
        ({"mean": np.zeros((2, 6))}, "initial_tracks_malformed"),
        ({"mean": np.zeros((3, 4))}, "initial_tracks_malformed"),
        ({"covariance": np.zeros((2, 2, 2))}, "initial_tracks_malformed"),
        ({"masses": np.ones((2, 2))}, "initial_tracks_malformed"),
        ({"class_probability": np.ones((1, 3))}, "initial_tracks_malformed"),
        ({"hits": np.zeros(0, dtype=np.int64)}, "initial_tracks_malformed"),
        ({"detection_index": np.zeros(3, dtype=np.int32)}, "initial_tracks_malformed"),
        ({"covariance": np.zeros((2, 4, 4))}, "initial_tracks_bad_covariance"),
        ({"covariance": -np.tile(np.eye(4), (2, 1, 1))}, "initial_tracks_bad_covariance"),
    ],
)
def test_bad_initial_tracks_are_rejected_and_change_nothing(fields, reason):
    ring = labelled_ring()
    ring.initialise(initial_tracks())
    ring.process(scan_at(11, [moving(11)]))
    ring.manager.admit(scan_at(12, [moving(12)]))
    before, copy = ring.manager.state, dataclasses.replace(ring.manager.state)
    report = ring.initialise(initial_tracks(uuid=bytes(16), **fields))
    assert (report.outcome, report.reason) == ("rejected", reason)
    assert ring.manager.state is before
    assert_same(before, copy)
    assert ring.manager.waiting == 1
    assert ring.manager.counters[f"rejected_{reason}"] == 1
