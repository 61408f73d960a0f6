"""Formations of tracks made by hand: beginning, number, split, merger, lineage, bad input."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from formation_examples import (
    COVARIANCE,
    NORTH,
    STEP_S,
    events_of,
    flight,
    live,
    predictions_of,
    scan_of,
    states_of,
)
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse.csgraph import connected_components

from gda_tracker.events.detector import TracksRejected
from gda_tracker.formations.lineage import regroup
from gda_tracker.formations.observations import number_evidence, places_of
from gda_tracker.formations.parameters import FormationParameters
from gda_tracker.formations.tracker import FormationTracker
from gda_tracker.parameters import ParameterError

THREE = [[-400.0, 20_000.0], [0.0, 20_000.0], [400.0, 20_000.0]]
FAR = [[9000.0, 20_000.0]]


def test_two_formations_are_formed_and_counted():
    tracker = FormationTracker()
    found = flight(tracker, [*THREE, *FAR], 20)
    assert [e[1:] for e in events_of(found)][:2] == [("formed", 1, ()), ("formed", 2, ())]
    last = found[-1].formations
    assert [f.track_ids.tolist() for f in last] == [[1, 2, 3], [4]]
    assert [f.number for f in last] == [3, 1]
    assert tracker.counters["formation event number_changed"] == 2
    three = last[0]
    np.testing.assert_allclose(three.position, [0.0, 20_000.0 + 150.0 * 19 * STEP_S])
    np.testing.assert_allclose(three.velocity, NORTH)
    np.testing.assert_allclose(three.extent, np.diag([2.0 / 3.0 * 400.0**2, 0.0]), atol=1e-6)
    np.testing.assert_allclose(three.position_covariance, COVARIANCE[:2, :2] / 3.0)
    assert math.isclose(three.number_probabilities.sum(), 1.0)
    assert abs(three.expected_number - 3.0) < 0.1


def test_an_object_without_a_track_is_counted_too():
    # Four objects fly, three have a track; the fourth is 150 m beside one of them.
    found = flight(FormationTracker(), [*THREE, [150.0, 20_000.0]], 30, ids=[1, 2, 3])
    assert found[-1].formations[0].track_ids.tolist() == [1, 2, 3]
    assert found[-1].formations[0].number == 4


def test_a_false_track_is_no_formation_of_one_object():
    tracker = FormationTracker()
    seen = [[k < 2] for k in range(20)]
    found = flight(tracker, FAR, 20, detected=seen)
    assert found[-1].formations[0].number == 0


def test_unresolved_objects_need_the_resolution_to_be_counted():
    # Five objects 150 m apart in a line, half of the pairs at 120 m not resolved.
    half_m, p_d, ids = 120.0, 0.9, [1, 2, 3, 4, 5]
    cell = {"resolution_range_m": half_m, "resolution_azimuth_rad": half_m / 25_000.0}
    generator = np.random.default_rng(1)
    trackers = [
        FormationTracker(FormationParameters(**options, spread_std_m=10.0))
        for options in ({}, cell)
    ]
    courses = [[], []]
    for k in range(40):
        now = states_of([[150.0 * i, 25_000.0] for i in range(5)])
        gap = now[:, None, :2] - now[None, :, :2]
        squared = (gap**2).sum(axis=2) / half_m**2
        linked = np.triu(generator.random((5, 5)) < 0.5**squared, 1)
        groups = connected_components(linked, directed=False)[1]
        seen = [g for g in range(groups.max() + 1) if generator.random() < p_d]
        places = [now[groups == g, :2].mean(axis=0) for g in seen]
        index = [seen.index(g) if g in seen else -1 for g in groups]
        scan = scan_of(STEP_S * k, places)
        live_tracks = live(STEP_S * k, ids, now, detection=index)
        for tracker, course in zip(trackers, courses, strict=True):
            found = tracker.take(live_tracks, scan, predictions_of(STEP_S * k, ids, now))
            course += [f.expected_number for f in found.formations[:1]]
    resolved, limited = (np.mean(course[-15:]) for course in courses)
    assert resolved < 4.2
    assert abs(limited - 5.0) < 0.8


def test_a_formation_splits_and_merges_and_keeps_its_lineage():
    tracker = FormationTracker()
    found = []
    for k in range(85):
        time_s = STEP_S * k
        # From scan 15 to 35 the third leaves to the East, then flies on in parallel, and returns.
        apart = 60.0 * STEP_S * float(np.clip(k - 15, 0, 20) - np.clip(k - 40, 0, 20))
        drift = 60.0 if 15 <= k < 35 else -60.0 if 40 <= k < 60 else 0.0
        now = states_of(np.array(THREE) + np.array(NORTH) * time_s)
        now[2, 0] += apart
        now[2, 2] += drift
        found.append(
            tracker.take(
                live(time_s, [1, 2, 3], now),
                scan_of(time_s, now[:, :2]),
                predictions_of(time_s, [1, 2, 3], now),
            )
        )
    events = [e for e in events_of(found) if e[1] != "number_changed"]
    assert [e[1:] for e in events] == [
        ("formed", 1, ()),
        ("split", 1, (2,)),
        ("merged", 1, (2,)),
    ]
    assert 15 < events[1][0] < 35
    assert 55 < events[2][0]
    between = found[events[1][0]].formations
    assert [f.track_ids.tolist() for f in between] == [[1, 2], [3]]
    assert (between[0].child_ids, between[1].parent_ids) == ((2,), (1,))
    assert between[1].since_ns == found[events[1][0]].key.stamp_ns
    (last,) = found[-1].formations
    assert (last.parent_ids, last.child_ids) == ((2,), (2,))
    numbers = [e.number for f in found for e in f.events if e.kind == "number_changed"]
    assert numbers[0] == 3
    assert sorted(numbers[1:3]) == [1, 2]
    assert numbers[3:] == [3]
    (split,) = [e for e in found[events[1][0]].events if e.kind == "split"]
    assert split.track_ids == (1, 2)
    assert split.false_alarm_probability == 0.001


def test_a_track_that_begins_beside_another_has_it_as_its_parent():
    tracker = FormationTracker()
    found = flight(tracker, THREE, 8, ids=[1, 2])
    found += flight(tracker, THREE, 8, ids=[1, 2, 7], begin=8)
    assert [e[1] for e in events_of(found)].count("formed") == 1
    assert "merged" not in [e[1] for e in events_of(found)]
    (last,) = found[-1].formations
    assert last.track_ids.tolist() == [1, 2, 7]
    assert last.parent_track_ids.tolist() == [-1, -1, 2]


def test_between_the_bounds_a_pair_stays_what_it_was():
    for before, linked in ((300.0, True), (6000.0, False)):
        tracker = FormationTracker()
        for k in range(30):
            gap = before if k < 10 else 1466.0  # the middle of 1000 m and 2000 m speaks for neither
            now = states_of([[0.0, 20_000.0], [gap, 20_000.0]])
            found = tracker.take(live(STEP_S * k, [1, 2], now))
        assert (len(found.formations) == 1) is linked
        assert tracker.counters["formation_scans_without_count"] == 30


def test_detections_of_another_formations_track_do_not_count():
    # Two tracks cross at 150 m/s: neither formation takes the other's object for its own.
    tracker = FormationTracker()
    for k in range(21):
        x = 150.0 * STEP_S * (k - 10)
        now = np.array([[x, 20_000.0, 150.0, 0.0], [-x, 20_100.0, -150.0, 0.0]])
        time_s = STEP_S * k
        found = tracker.take(
            live(time_s, [1, 2], now),
            scan_of(time_s, now[:, :2]),
            predictions_of(time_s, [1, 2], now),
        )
    assert [f.number for f in found.formations] == [1, 1]
    assert tracker.counters["formation event number_changed"] == 2


@given(st.permutations(range(5)), st.randoms(use_true_random=False))
def test_lineage_does_not_depend_on_the_order(order, random):
    before = [np.array([1, 2, 3]), np.array([4, 5]), np.array([6]), np.array([9]), np.array([12])]
    after = [np.array([1, 2]), np.array([3, 4, 5]), np.array([6, 9]), np.array([10, 11])]
    random.shuffle(after)
    mixed = [before[row] for row in order]
    found = regroup(mixed, after)
    names = {
        tuple(group.tolist()): (
            None if row < 0 else mixed[row].tolist(),
            None if parent < 0 else mixed[parent].tolist(),
        )
        for group, row, parent in zip(after, found.continues, found.parent, strict=True)
    }
    assert names == {
        (1, 2): ([1, 2, 3], None),
        (3, 4, 5): ([4, 5], None),
        (6, 9): ([6], None),
        (10, 11): (None, None),
    }
    assert [mixed[row].tolist() for row in found.ended] == [[12]]
    joined = {
        tuple(mixed[row].tolist()): after[c].tolist() for row, c in enumerate(found.joins) if c >= 0
    }
    assert joined == {(9,): [6, 9]}


def test_of_the_parts_the_larger_goes_on():
    found = regroup([np.array([1, 2, 3])], [np.array([1]), np.array([2, 3])])
    assert found.continues.tolist() == [-1, 0]
    assert found.parent.tolist() == [0, -1]


def test_bad_input_is_refused_and_changes_nothing():
    tracker = FormationTracker()
    good = flight(tracker, THREE, 3)[-1]
    now = states_of(THREE)
    for bad, reason in (
        (live(0.0, [1, 2, 3], now), "tracks_time_backwards"),
        (live(50.0, [1, 2, 3], now, epoch=0), "older_epoch"),
        (live(8.0, [1, 2, 3], now), "formation_scan_repeated"),
        (live(50.0, [1, 1, 3], now), "tracks_duplicate_track_id"),
        (replace(live(50.0, [1], now[:1]), mean=np.zeros((1, 2))), "tracks_state_too_small"),
    ):
        with pytest.raises(TracksRejected, match=reason):
            tracker.take(bad)
    broken = states_of(THREE)
    broken[1, 0] = np.nan
    flat = np.tile(COVARIANCE, (3, 1, 1))
    flat[2, 0, 0] = -1.0
    found = tracker.take(live(50.0, [1, 2, 3], broken, covariance=flat))
    assert tracker.counters["formation_track_not_finite"] == 1
    assert tracker.counters["formation_track_bad_covariance"] == 1
    assert found.formations[0].formation_id == good.formations[0].formation_id
    again = tracker.take(live(0.0, [1, 2, 3], now, epoch=2))
    assert tracker.counters["formations_began_anew"] == 1
    assert [e.kind for e in again.events] in ([], ["formed"])


def test_predictions_that_are_no_numbers_are_not_counted():
    now = states_of(THREE)
    broken = predictions_of(0.0, [1, 2, 3], now.copy())
    broken.component_mean[1, 0] = np.inf
    places, seen, there = places_of(broken, np.array([1, 2, 3]), np.array([0, 0, 1]), 2)
    assert there.tolist() == [False, True]
    evidence = number_evidence(
        scan_of(0.0, now[:, :2]),
        places,
        seen,
        there,
        np.zeros((2, 3), dtype=bool),
        1e-4,
        FormationParameters(),
    )
    assert evidence.observed.tolist() == [False, True]
    assert np.isfinite(evidence.log_ratio).all()


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"apart_distance_m": 1010.0}, "apart_distance_m = 1010.0: allowed is a number > 1035"),
        ({"together_speed_mps": 40.0}, "apart_speed_mps = 40.0: .* together_speed_mps = 40.0"),
        ({"resolution_range_m": 10.0}, "resolution_range_m = 10.0 and resolution_azimuth_rad = 0"),
        (
            {
                "resolution_range_m": 10.0,
                "resolution_azimuth_rad": 0.1,
                "largest_number": 7,
            },
            "largest_number = 7: allowed are numbers <= 6, as resolution_range_m = 10.0",
        ),
    ],
)
def test_parameters_that_do_not_go_together_are_refused(values, words):
    with pytest.raises(ParameterError, match=words):
        FormationParameters(**values)
