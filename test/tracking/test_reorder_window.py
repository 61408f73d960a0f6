"""The reorder window: scans of several sensors, late by less than it, are worked off in order."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tracking_examples import moving, ring_of, same_tracks, scan_at

from gda_tracker.parameters import ParameterError
from gda_tracker.tracking.parameters import TrackManagerParameters


def keys(results):
    """Sensor and second of each answered scan."""
    return [(r.report.key.sensor_id, r.report.key.stamp_ns / 1e9) for r in results]


def two_sensors(n_scans=20):
    """Scans of a target by two sensors, half a second apart, in the order of time."""
    return [
        scan_at(k / 2, [moving(k / 2)], sensor_id="east" if k % 2 else "west")
        for k in range(n_scans)
    ]


def tracked(ring, scans):
    results = [result for scan in scans for result in ring.feed(scan)]
    return results + ring.finish()


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(0.0, 1.9), min_size=20, max_size=20))
def test_any_order_of_arrival_within_the_window_gives_the_same_tracks(delays):
    scans = two_sensors()
    arrival = np.argsort([k / 2 + delay for k, delay in enumerate(delays)], kind="stable")
    ring = ring_of(reorder_window_s=2.0)
    found = tracked(ring, [scans[k] for k in arrival])
    expected = tracked(ring_of(), scans)
    assert keys(found) == keys(expected)
    assert {r.report.outcome for r in found} == {"tracked"}
    for one, other in zip(found, expected, strict=True):
        same_tracks(one.tracks, other.tracks)


def test_without_a_window_each_scan_is_taken_as_it_comes():
    ring = ring_of()
    assert keys(ring.feed(scan_at(1.0, []))) == [("radar", 1.0)]
    assert [r.report.reason for r in ring.feed(scan_at(0.5, [], sensor_id="other"))] == ["late"]


def test_a_scan_waits_until_one_newer_by_the_window_has_come():
    ring = ring_of(reorder_window_s=1.0)
    assert ring.feed(scan_at(10.0, [])) == []
    assert ring.feed(scan_at(10.999, [])) == []
    assert keys(ring.feed(scan_at(11.0, []))) == [("radar", 10.0)]
    assert ring.manager.waiting == 2
    assert keys(ring.feed(scan_at(10.5, [], sensor_id="slow"))) == []
    assert keys(ring.finish()) == [("slow", 10.5), ("radar", 10.999), ("radar", 11.0)]


def test_what_is_late_by_more_than_the_window_is_rejected_and_counted():
    ring = ring_of(reorder_window_s=1.0)
    ring.feed(scan_at(10.0, []))
    ring.feed(scan_at(11.0, []))
    late = ring.feed(scan_at(9.5, [], sensor_id="slow"))
    assert [(r.report.outcome, r.report.reason) for r in late] == [("rejected", "late")]
    assert ring.manager.counters["rejected_late"] == 1
    # What stands between the one that was opened and those that wait is in time.
    assert ring.feed(scan_at(10.2, [], sensor_id="slow")) == []


def test_named_sensors_end_the_wait_as_soon_as_each_has_sent_something_as_new():
    ring = ring_of(reorder_window_s=5.0, reorder_sensors=["east", "west"])
    assert ring.feed(scan_at(10.0, [], sensor_id="east")) == []
    assert keys(ring.feed(scan_at(10.2, [], sensor_id="west"))) == [("east", 10.0)]
    assert keys(ring.feed(scan_at(11.0, [], sensor_id="east"))) == [("west", 10.2)]
    # A third sensor is put in order, but not waited for.
    assert ring.feed(scan_at(10.5, [], sensor_id="third")) == []
    assert keys(ring.feed(scan_at(11.0, [], sensor_id="west"))) == [
        ("third", 10.5),
        ("east", 11.0),
        ("west", 11.0),
    ]
    # One that falls silent is waited for no longer than the window.
    assert ring.feed(scan_at(12.0, [], sensor_id="east")) == []
    assert keys(ring.feed(scan_at(17.0, [], sensor_id="east"))) == [("east", 12.0)]


def test_what_has_waited_long_enough_is_released_with_all_that_is_earlier():
    manager = ring_of(reorder_window_s=5.0).manager
    manager.admit(scan_at(12.0, []), now=1.0)
    manager.admit(scan_at(13.0, []), now=2.0)
    manager.admit(scan_at(11.0, [], sensor_id="slow"), now=2.5)
    assert not manager.release(0.9)
    assert not manager.ready
    assert manager.release(1.0)
    assert manager.ready
    assert manager.open().scan.key.sensor_id == "slow"


def test_a_full_queue_waits_no_longer():
    ring = ring_of(reorder_window_s=10.0, queue_depth=3)
    assert ring.feed(scan_at(1.0, [])) == []
    assert ring.feed(scan_at(2.0, [])) == []
    assert keys(ring.feed(scan_at(3.0, []))) == [("radar", 1.0)]
    assert ring.manager.counters["rejected_queue_full"] == 0


def test_a_jump_of_time_releases_the_former_axis():
    ring = ring_of(reorder_window_s=2.0, time_jump_s=10.0)
    ring.feed(scan_at(100.0, []))
    ring.feed(scan_at(101.0, []))
    assert keys(ring.feed(scan_at(50.0, []))) == [("radar", 100.0), ("radar", 101.0)]
    assert keys(ring.finish()) == [("radar", 50.0)]
    assert ring.manager.counters["reset_time_jump"] == 1


def test_process_says_that_the_scan_waits():
    with pytest.raises(RuntimeError, match=r"reorder window: use feed\(\)"):
        ring_of(reorder_window_s=1.0).process(scan_at(1.0, []))


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"reorder_window_s": 11.0, "time_jump_s": 10.0}, r"reorder_window_s = 11.0.*time_jump_s"),
        ({"reorder_sensors": ["a"]}, r"reorder_sensors = \['a'\].*reorder_window_s"),
    ],
)
def test_parameters_that_contradict_each_other_are_refused(parameters, message):
    with pytest.raises(ParameterError, match=message):
        TrackManagerParameters(**parameters)
