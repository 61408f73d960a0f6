"""The detector on tracks: what each kind of event needs, what never makes one, what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from event_examples import (
    CONTEXT,
    COVARIANCE,
    LANE,
    STEP_S,
    happenings,
    on_lane_then_off,
    plan,
    tracks,
    walk,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from gda_tracker.events.detector import TrackEventDetector, TracksRejected
from gda_tracker.events.parameters import EventParameters
from gda_tracker.kinematics.context import ANY_DIRECTION, Context, Lane, LaneMap
from gda_tracker.parameters import ParameterError

PARAMETERS = EventParameters()


def detector(context=CONTEXT, **options):
    return TrackEventDetector(EventParameters(**options), context)


def test_a_lane_is_kept_then_left_and_the_event_says_all_about_it():
    found = []
    tested = detector()
    for scan in walk(on_lane_then_off()):
        found += tested.take(scan).events
    kept, left = (e for e in found if e.context)
    assert (kept.kind, kept.hypothesis) == ("keeps_lane", "h0")
    assert (left.kind, left.hypothesis, left.track_id) == ("leaves_lane", "h1", 1)
    assert left.context == "fairway"
    assert left.value == 60.0  # to the left
    assert left.log_likelihood_ratio >= left.upper_threshold
    assert kept.log_likelihood_ratio <= kept.lower_threshold
    assert (left.false_alarm_probability, left.miss_probability) == (0.001, 0.01)
    # B = 0.99 / 0.001, A = 0.01 / 0.999
    assert_allclose(np.exp([left.upper_threshold, left.lower_threshold]), [990.0, 0.01 / 0.999])
    assert (left.began_ns, left.stamp_ns) == (round(6 * STEP_S * 1e9), round(6 * STEP_S * 1e9))
    assert left.position.tolist() == [100.0 + 60.0 * STEP_S, 60.0]
    assert_allclose(left.position_covariance, COVARIANCE[:2, :2])


def test_what_passes_over_a_lane_or_runs_off_its_end_makes_no_event():
    times = STEP_S * np.arange(10)
    crossing = np.column_stack(
        [np.full(10, 500.0), 10.0 * times - 400.0, np.zeros(10), np.full(10, 10.0)]
    )
    slowly = np.column_stack([8.0 * times, 4.0 * times - 15.0, np.full(10, 8.0), np.full(10, 4.0)])
    off_the_end = np.column_stack([2700.0 + 10.0 * times, 0 * times, 10 + 0 * times, 0 * times])
    for states, kinds in ((crossing, []), (slowly, []), (off_the_end, ["keeps_lane"])):
        tested = detector(tests=["lanes"])
        assert [kind for kind, *_ in happenings(tested, walk(states))] == kinds
    tested = detector(tests=["lanes"])
    happenings(tested, walk(slowly))
    assert tested.counters["passed_over_a_lane"] == 1


def test_the_wrong_way_is_told_once_and_only_where_the_lane_has_a_direction():
    times = STEP_S * np.arange(8)
    back = np.column_stack([2000.0 - 10.0 * times, 0 * times, -10 + 0 * times, 0 * times])
    assert [k for k, *_ in happenings(detector(tests=["lanes"]), walk(back))] == ["wrong_way"]
    both = Context("map", (replace(LANE, direction=ANY_DIRECTION),))
    assert [k for k, *_ in happenings(detector(both), walk(back))] == ["keeps_lane"]


def test_a_plan_is_kept_left_and_taken_up_again():
    times = STEP_S * np.arange(18)
    y = np.where((times > 70.0) & (times < 160.0), 80.0, 0.0)
    states = np.column_stack([10.0 * times, y, 10 + 0 * times, 0 * times])
    tested = detector(Context("map", (), (plan(),)), tests=["plans"])
    kinds = [kind for kind, *_ in happenings(tested, walk(states, ids=(1, 2)))]
    assert kinds == ["on_plan", "off_plan", "on_plan"]
    # Behind the plan in time is off it, too; another track has none.
    late = np.column_stack([10.0 * times - 80.0, 0 * y, 10 + 0 * times, 0 * times])
    tested = detector(Context("map", (), (plan(),)), tests=["plans"])
    assert [k for k, *_ in happenings(tested, walk(late))] == ["off_plan"]
    tested = detector(Context("map", (), (plan(),)), tests=["plans"])
    assert not happenings(tested, walk(late, ids=(2, 3)))


def test_a_stop_and_an_acceleration_are_told_with_their_end():
    speed = np.array([10.0] * 5 + [0.0] * 5 + [10.0] * 5)
    states = np.column_stack([np.cumsum(speed) * STEP_S, 0 * speed, speed, 0 * speed])
    tested = detector(tests=["stops"])
    assert [k for k, *_ in happenings(tested, walk(states))] == ["stopped", "moves"]
    stays = np.zeros((10, 4))
    assert not happenings(detector(tests=["stops"]), walk(stays))
    speed = np.concatenate([np.full(6, 10.0), 10.0 + 40.0 * np.arange(1, 7), np.full(6, 250.0)])
    states = np.column_stack([np.cumsum(speed) * STEP_S, 0 * speed, speed, 0 * speed])
    tested = detector(tests=["accelerations"])
    assert [k for k, *_ in happenings(tested, walk(states))] == ["accelerates", "steady"]


def splitting(distance_at_birth, departs, status=1):
    scans = []
    for k in range(10):
        t = STEP_S * k
        mean, ids, stati = [[10.0 * t, 0, 10, 0]], [1], [1]
        if k >= 3:
            apart = distance_at_birth + (15.0 * (t - 3 * STEP_S) if departs else 0.0)
            mean.append([10.0 * t, apart, 10, 15.0 if departs else 0.0])
            ids.append(2)
            stati.append(status)
        scans.append(tracks(t, ids, mean, status=stati))
    return scans


def test_what_begins_near_a_track_and_departs_has_split_off():
    tested = detector(tests=["splits"])
    found = [event for scan in splitting(20.0, True) for event in tested.take(scan).events]
    assert [(e.kind, e.track_id, e.other_track_id) for e in found] == [("split_off", 2, 1)]
    assert found[0].value > PARAMETERS.split_radius_m
    for scans in (splitting(20.0, False), splitting(300.0, True), splitting(20.0, True, status=0)):
        assert not happenings(detector(tests=["splits"]), scans)
    # Those that are there from the beginning have not split off.
    assert not happenings(detector(tests=["splits"]), splitting(20.0, True)[3:])


@settings(max_examples=8, deadline=None)
@given(
    angle=st.floats(0.0, 6.28),
    shift=st.tuples(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4)),
)
def test_events_are_the_same_in_another_frame(angle, shift):
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    both = np.kron(np.eye(2), rotation)
    states = on_lane_then_off()
    moved = states @ both.T + [*shift, 0, 0]
    lane = replace(LANE, points=LANE.points @ rotation.T + np.array(shift))
    context = Context("map", (lane,), ())
    one, other = detector(), detector(context)
    covariance = both @ COVARIANCE @ both.T
    assert happenings(one, walk(states)) == happenings(other, walk(moved, covariance=covariance))
    assert one.counters == other.counters


def test_other_tracks_change_nothing_and_their_order_neither():
    states = on_lane_then_off()
    alone = happenings(detector(), walk(states, ids=(5,)))
    generator = np.random.default_rng(3)
    scans = []
    for k, state in enumerate(states):
        others = generator.normal(0.0, 3e4, (3, 4))
        mean = np.vstack([others[:2], state, others[2:]])
        ids = np.array([9, 2, 5, 7])
        order = generator.permutation(4)
        scans.append(tracks(STEP_S * k, ids[order].tolist(), mean[order]))
    tested = detector()
    assert [found for found in happenings(tested, scans) if found[1] == 5] == alone


def test_states_that_are_not_new_are_not_used():
    states = on_lane_then_off()
    undetected = detector()
    assert not happenings(undetected, walk(states, detected=False))
    # Scans that follow each other fast bring no more samples than slow ones.
    often = detector(tests=["lanes"])
    scans = [
        tracks(t, [1], [[100.0 + 10.0 * t, 0.0, 10.0, 0.0]]) for t in np.arange(0.0, 25.0, 0.5)
    ]
    found = [event for scan in scans for event in often.take(scan).events]
    assert [(e.kind, e.samples, e.stamp_ns) for e in found] == [("keeps_lane", 1, 12 * 10**9)]


def test_only_confirmed_tracks_are_tested():
    assert not happenings(detector(), walk(on_lane_then_off(), status=0))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"epoch": 0}, "older_epoch"),
        ({"time_s": -50.0}, "time_backwards"),
    ],
)
def test_tracks_out_of_order_are_refused_and_change_nothing(change, reason):
    scans = walk(on_lane_then_off())
    expected = happenings(detector(), scans)
    tested = detector()
    found = happenings(tested, scans[:4])
    wrong = tracks(**{"time_s": 50.0, "epoch": 1, **change}, ids=[1], mean=[[9e3, 9e3, 0.0, 0.0]])
    with pytest.raises(TracksRejected, match=reason):
        tested.take(wrong)
    rest = happenings(tested, scans[4:])
    assert found + [(kind, track, number + 4) for kind, track, number in rest] == expected


def test_tracks_that_cannot_be_tested_are_refused_by_reason():
    good = walk(on_lane_then_off())[0]
    for wrong, reason in (
        (replace(good, frame_id="odom"), "other_frame"),
        (tracks(0.0, [1, 1], np.zeros((2, 4))), "duplicate_track_id"),
        (tracks(0.0, [1], np.zeros((1, 2)), covariance=np.eye(2)), "state_too_small"),
    ):
        with pytest.raises(TracksRejected, match=reason):
            detector().take(wrong)


def test_a_broken_track_is_left_out_and_counted_and_the_others_go_on():
    states = on_lane_then_off()
    expected = happenings(detector(), walk(states))
    tested = detector()
    scans = []
    for k, state in enumerate(states):
        mean = np.vstack([state, [np.nan, 0, 0, 0], state, state])
        covariance = np.tile(COVARIANCE, (4, 1, 1))
        covariance[2, 0, 0] = np.inf
        covariance[3] = -COVARIANCE
        scans.append(tracks(STEP_S * k, [1, 2, 3, 4], mean, covariance=covariance))
    assert happenings(tested, scans) == expected
    assert tested.counters["event_track_not_finite"] == 2 * len(states)
    assert tested.counters["event_track_bad_covariance"] == len(states)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("size", [1e-11, 1e11])
def test_extreme_tracks_neither_warn_nor_fail(size):
    mean = np.array([[size, -size, size, -size], [0, 0, 0, 0]])
    covariance = np.stack([np.diag([size] * 4), np.diag([1e-11, 1e11, 1e11, 1e-11])])
    tested = detector(Context("map", (LANE,), (plan(),)))
    for k in range(20):
        tested.take(tracks(1e7 * k, [1, 2], mean, covariance=covariance))
    assert "event_track_not_finite" not in tested.counters


def test_a_new_epoch_forgets_everything():
    scans = walk(on_lane_then_off())
    tested = detector()
    happenings(tested, scans[:6])
    again = walk(on_lane_then_off(), epoch=2)
    assert happenings(tested, again) == happenings(detector(), again)
    assert tested.counters["began_anew"] == 1


def test_no_tracks_and_no_context_are_no_trouble():
    tested = TrackEventDetector(PARAMETERS)
    assert len(tested.take(tracks(0.0, [], np.zeros((0, 4)), covariance=np.zeros((0, 4, 4))))) == 0
    assert [k for k, *_ in happenings(tested, walk(on_lane_then_off()))] == []


def test_places_on_a_bent_lane_are_those_of_the_nearest_point():
    bent = LaneMap((Lane("bent", np.array([[0.0, 0], [100, 0], [100, 100]]), 10.0, 5.0),))
    points = np.array([[50.0, 3.0], [103.0, 50.0], [103.0, -4.0], [-5.0, 1.0], [90.0, 110.0]])
    places = bent.on_lane(points, np.zeros(5, dtype=np.int64))
    assert_allclose(places.offset_m, [3.0, -3.0, -5.0, np.hypot(5, 1), np.hypot(10, 10)])
    # A step along the normal changes the offset by its length.
    further = bent.on_lane(points + 0.1 * places.normal, places.lane)
    assert_allclose(further.offset_m - places.offset_m, 0.1)
    assert places.beyond.tolist() == [False, False, False, True, True]


def test_hypotheses_that_do_not_part_are_refused():
    for values, name in (
        ({"stopped_speed_mps": 2.0}, "moving_speed_mps"),
        ({"steady_acceleration_mps2": 1.98}, "event_acceleration_mps2"),
        ({"split_departure_m": 51.0}, "split_departure_m"),
    ):
        with pytest.raises(ParameterError, match=name):
            EventParameters(**values)
