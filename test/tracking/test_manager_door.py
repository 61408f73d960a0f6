"""Admission: order of time, duplicates, repeated answers, the queue; bad scans touch no other."""

import math

import numpy as np
import pytest
from tracking_examples import answers, moving, ring_of, same_tracks, scan_at, simulated

from gda_tracker.tracking.answers import Inconsistent
from gda_tracker.vocabulary import Detections


def tracking_ring(until=5, **parameters):
    ring = ring_of(**parameters)
    for k in range(until):
        result = ring.process(scan_at(k, [moving(k)]))
        assert result.report.outcome == "tracked"
    return ring


def close_all(ring):
    """Run every waiting scan through the stages; return the keys in the order of opening."""
    keys = []
    while ring.manager.ready:
        keys.append(ring.manager.open().scan.key[1:])
        ring.manager.close(*answers(ring))
    return keys


# --- time


def test_a_stamp_going_backwards_a_little_is_late_and_changes_nothing():
    ring = tracking_ring(time_jump_s=10.0)
    before = ring.manager.tracks()
    for stamp in (3.999, 3.0, 0.0):
        report = ring.manager.admit(scan_at(stamp, [moving(stamp)]))
        assert (report.outcome, report.reason) == ("rejected", "late")
    assert ring.manager.counters["rejected_late"] == 3
    assert ring.manager.waiting == 0
    same_tracks(ring.manager.tracks(), before)
    result = ring.process(scan_at(5, [moving(5)]))
    assert result.tracks.track_id.tolist() == [1]


def test_a_stamp_going_backwards_far_resets_the_tracks_and_ids_go_on():
    ring = tracking_ring(until=20, time_jump_s=10.0)
    result = ring.process(scan_at(8.9, [moving(0)]))
    assert result.report.outcome == "tracked"
    assert len(result.tracks) == 0
    assert result.tracks.deleted_track_id.tolist() == [1]
    assert ring.manager.counters["reset_time_jump"] == 1
    # The start points of the old axis are gone too: a second detection is needed again.
    result = ring.process(scan_at(9.9, [moving(1)]))
    assert result.tracks.track_id.tolist() == [2]
    assert result.tracks.hits.tolist() == [2]
    np.testing.assert_allclose(result.tracks.mean[0, 2:], [10.0, -5.0], atol=2.0)
    # And the new axis has its own order.
    assert ring.manager.admit(scan_at(9.0, [])).reason == "late"


@pytest.mark.parametrize(("back_s", "reason"), [(10.0, "late"), (10.001, "")])
def test_the_jump_begins_right_after_its_limit(back_s, reason):
    ring = tracking_ring(until=20, time_jump_s=10.0)
    report = ring.manager.admit(scan_at(19.0 - back_s, []))
    assert (report.reason if report else "") == reason


def test_scans_of_the_old_axis_that_wait_come_before_the_jump():
    ring = tracking_ring(until=20, time_jump_s=10.0)
    for stamp in (21.0, 20.0, 1.0, 22.0 - 20.0):
        assert ring.manager.admit(scan_at(stamp, [moving(stamp)])) is None
    stamps = [stamp / 1e9 for _, stamp in close_all(ring)]
    assert stamps == [20.0, 21.0, 1.0, 2.0]
    assert ring.manager.counters["reset_time_jump"] == 1
    assert ring.manager.tracks().track_id.tolist() == [2]


def test_a_long_silence_starts_anew():
    ring = tracking_ring(max_gap_s=60.0)
    result = ring.process(scan_at(64.0, [moving(64)]))
    assert result.tracks.deleted_track_id.tolist() == []
    assert ring.manager.counters["reset_gap"] == 0
    result = ring.process(scan_at(124.5, [moving(124.5)]))
    assert result.tracks.deleted_track_id.tolist() == [1]
    assert ring.manager.counters["reset_gap"] == 1
    assert len(result.tracks) == 0


def test_no_track_starts_across_a_long_silence():
    """A detection before and one after would be a slow target; the silence is longer than that."""
    for silence_s, count in ((59.0, 1), (61.0, 0)):
        ring = ring_of(max_gap_s=60.0)
        ring.process(scan_at(0.0, [moving(0)]))
        assert len(ring.process(scan_at(silence_s, [moving(1)])).tracks) == count


def test_waiting_scans_are_opened_in_time_order():
    ring = tracking_ring()
    for stamp in (9, 7, 8, 5, 6):
        assert ring.manager.admit(scan_at(stamp, [moving(stamp)])) is None
    assert [stamp // 10**9 for _, stamp in close_all(ring)] == [5, 6, 7, 8, 9]
    straight = tracking_ring(until=10).manager
    for name in ("mean", "covariance", "masses", "class_probability"):
        np.testing.assert_array_equal(
            getattr(ring.manager.tracks(), name), getattr(straight.tracks(), name)
        )


def test_a_stamp_between_open_and_waiting_scans_is_in_time():
    ring = tracking_ring()
    ring.manager.admit(scan_at(5, []))
    ring.manager.open()
    assert ring.manager.admit(scan_at(9, [])) is None
    assert ring.manager.admit(scan_at(6, [])) is None
    assert ring.manager.admit(scan_at(4.5, [])).reason == "late"


# --- duplicates and repeats


def test_a_duplicate_of_a_waiting_or_open_scan_is_dropped_and_counted():
    ring = tracking_ring()
    first = scan_at(5, [moving(5)])
    for _ in range(3):
        assert ring.manager.admit(first) is None
    assert ring.manager.waiting == 1
    ring.manager.open()
    assert ring.manager.admit(first) is None
    assert ring.manager.waiting == 0
    assert ring.manager.counters["duplicate"] == 3


def test_the_last_closed_scan_is_answered_again_with_its_tracks():
    ring = tracking_ring()
    detections = scan_at(5, [moving(5)])
    first = ring.process(detections)
    state = ring.manager.state
    again = ring.process(detections)
    assert again.report.repeated
    assert not first.report.repeated
    for name in ("outcome", "key", "detections_admitted", "tracks_confirmed", "rejected"):
        assert getattr(again.report, name) == getattr(first.report, name)
    same_tracks(again.tracks, first.tracks)
    assert ring.manager.state is state
    assert ring.manager.counters["repeated"] == 1
    # Whatever the copy holds: the key decides.
    assert ring.process(scan_at(5, [])).report.repeated


def test_sensors_of_one_stamp_are_each_taken_once():
    ring = ring_of()
    for k in range(4):
        for sensor in ("north", "south"):
            result = ring.process(scan_at(k, [moving(k)], sensor_id=sensor))
            assert result.report.outcome == "tracked"
    assert result.tracks.hits.tolist() == [7]
    # south was last: north's own scan of that stamp is neither waiting, open nor the last one.
    report = ring.process(scan_at(3, [moving(3)], sensor_id="north")).report
    assert (report.outcome, report.reason) == ("rejected", "late")
    assert ring.process(scan_at(3, [moving(3)], sensor_id="west")).report.outcome == "tracked"
    assert ring.manager.tracks().hits.tolist() == [8]


def test_no_time_between_sensors_means_no_prediction():
    ring = tracking_ring()
    before = ring.manager.tracks()
    ring.manager.admit(scan_at(4, [], sensor_id="other"))
    opened = ring.manager.open()
    np.testing.assert_array_equal(opened.predictions.component_mean, before.mean)
    np.testing.assert_array_equal(opened.predictions.component_covariance, before.covariance)


# --- the queue


def test_a_full_queue_rejects_what_comes_and_keeps_what_waits():
    ring = ring_of(queue_depth=3, detections_depth=3)
    for k in range(3):
        assert ring.manager.admit(scan_at(k, [moving(k)])) is None
    report = ring.manager.admit(scan_at(3, [moving(3)]))
    assert (report.outcome, report.reason) == ("rejected", "queue_full")
    assert report.queue_length == 3
    assert report.detections_received == 1
    # A duplicate of a waiting scan is one all the same.
    assert ring.manager.admit(scan_at(1, [])) is None
    ring.manager.open()
    assert ring.manager.admit(scan_at(3, [moving(3)])) is None
    ring.manager.close(*answers(ring))
    assert len(close_all(ring)) == 3
    assert ring.manager.counters["rejected_queue_full"] == 1


def test_opening_needs_a_waiting_scan_and_none_open():
    ring = ring_of()
    with pytest.raises(Inconsistent, match="no scan is ready"):
        ring.manager.open()
    ring.manager.admit(scan_at(0, []))
    ring.manager.admit(scan_at(1, []))
    ring.manager.open()
    assert not ring.manager.ready
    with pytest.raises(Inconsistent, match="no scan is ready"):
        ring.manager.open()
    with pytest.raises(Inconsistent, match="no scan has been closed"):
        ring.manager.tracks()


def test_closing_needs_an_open_scan():
    ring = tracking_ring()
    ring.manager.admit(scan_at(5, []))
    ring.manager.open()
    last = answers(ring)
    ring.manager.close(*last)
    with pytest.raises(Inconsistent, match="no scan is open"):
        ring.manager.close(*last)
    with pytest.raises(Inconsistent, match="no scan is open"):
        ring.manager.give_up()


# --- bad scans between good ones

NAN = math.nan
BAD = {
    "nothing": Detections("", 0, np.zeros(0), np.zeros(0)),
    "lengths": Detections("radar", 10**12, np.ones(3), np.ones(2)),
    "flood": Detections("radar", 10**12, np.ones(100_000), np.zeros(100_000)),
    "pose": Detections("radar", 10**12, np.ones(1), np.ones(1), sensor_position_m=np.full(3, NAN)),
    "stamp": Detections("radar", -5, np.ones(1), np.ones(1)),
    "none": Detections("radar", None, None, None),
}


def test_bad_scans_between_good_ones_change_no_track():
    clean, dirty = ring_of(), ring_of()
    bad = list(BAD.values())
    for k, scan in enumerate(simulated(20)):
        report = dirty.process(bad[k % len(bad)]).report
        assert report.outcome == "rejected"
        assert report.reason
        same_tracks(dirty.process(scan).tracks, clean.process(scan).tracks)
    rejected = {n: c for n, c in dirty.manager.counters.items() if n.startswith("rejected_")}
    assert sum(rejected.values()) == 20
    assert set(rejected) == {
        "rejected_missing_sensor_id",
        "rejected_array_length_mismatch",
        "rejected_too_many_detections",
        "rejected_bad_sensor_pose",
        "rejected_stamp_out_of_range",
    }


def test_bad_detections_among_good_ones_change_no_track():
    """Rows of garbage are left out; the others give the tracks they give alone."""
    clean, dirty = ring_of(), ring_of()
    for scan in simulated(20):
        n = len(scan.range_m)
        polluted = Detections(
            scan.sensor_id,
            scan.stamp_ns,
            np.concatenate([[NAN, -3.0], scan.range_m, [0.0, 1e300, 100.0]]),
            np.concatenate([[0.0, 0.0], scan.azimuth_rad, [0.0, 0.0, math.inf]]),
            rcs_m2=np.concatenate([[1.0, 1.0], scan.rcs_m2, [1.0, 1.0, 1.0]]),
        )
        result, expected = dirty.process(polluted), clean.process(scan)
        assert result.report.detections_received == n + 5
        assert result.report.detections_admitted == n
        counted = {k: v for k, v in result.report.rejected.items() if k != "rcs_not_finite"}
        assert counted == {
            "not_finite": 2,
            "negative_range": 1,
            "zero_range": 1,
            "range_too_large": 1,
        }
        tracks = result.tracks
        own = tracks.detection_index >= 0
        np.testing.assert_array_equal(
            np.where(own, tracks.detection_index - 2, -1),  # two bad rows in front
            expected.tracks.detection_index,
        )
        tracks.detection_index = expected.tracks.detection_index
        same_tracks(tracks, expected.tracks)
    assert dirty.manager.counters["zero_range"] == 20
