"""What comes in wrong is refused with a reason, and nothing else changes."""

from __future__ import annotations

import dataclasses
from functools import lru_cache

import numpy as np
import pytest
from set_tracker_examples import CLUTTERED, parameters, scan_at, scans, tracker_of

from gda_tracker.parameters import specifications
from gda_tracker.tracking.set_valued.parameters import SetValuedParameters
from gda_tracker.tracking.set_valued.tracker import SetValuedTracker


def fed(count=5):
    tracker = tracker_of()
    for scan in scans()[0][:count]:
        tracker.process(scan)
    return tracker


def test_scans_that_are_refused_change_nothing():
    good = scans()[0]
    tracker, wrong = fed(), tracker_of()
    for k, scan in enumerate(good[:5]):
        wrong.process(scan)
        for bad, reason in (
            (dataclasses.replace(scan, sensor_id=""), "missing_sensor_id"),
            (dataclasses.replace(scan, stamp_ns=-1), "stamp_out_of_range"),
            (
                dataclasses.replace(scan, sensor_id="b", azimuth_rad=scan.azimuth_rad[1:]),
                "array_length_mismatch",
            ),
            (scan_at(2.0 * k - 0.5, [(0.0, 1.0)], sensor="other"), "late"),
            (scan_at(100.0, np.ones((1001, 2))), "too_many_detections"),
        ):
            if reason == "late" and k == 0:
                continue
            sets, report = wrong.process(bad)
            assert sets is None
            assert (report.outcome, report.reason) == ("rejected", reason)
            assert wrong.counters[f"rejected_{reason}"] >= 1
    one, _ = tracker.process(good[5])
    other, _ = wrong.process(good[5])
    for field in dataclasses.fields(one):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name))


def test_detections_that_are_no_numbers_are_left_out():
    clean, dirty = fed(), fed()
    scan = scans()[0][5]
    one, _ = clean.process(scan)
    worse = dataclasses.replace(
        scan,
        range_m=np.append([np.nan, -5.0, 0.0, 1e12], scan.range_m),
        azimuth_rad=np.append([0.0, 0.0, 0.0, 0.0], scan.azimuth_rad),
    )
    other, report = dirty.process(worse)
    np.testing.assert_array_equal(one.centroid, other.centroid)
    np.testing.assert_array_equal(one.detection_index + 4, other.detection_index)
    np.testing.assert_array_equal(one.may_own_index + 4, other.may_own_index)
    assert report.rejected == {
        "not_finite": 1,
        "negative_range": 1,
        "zero_range": 1,
        "range_too_large": 1,
    }
    assert (report.detections_received, report.detections_admitted) == (7, 3)


def test_an_azimuth_that_tells_nothing_is_left_out_and_counted():
    tracker = tracker_of()
    scan = scan_at(0.0, [(0.0, 5000.0), (0.0, 6000.0)], azimuth_std_rad=np.array([0.01, 0.7]))
    sets, report = tracker.process(scan)
    assert len(sets) == 1
    assert report.rejected == {"azimuth_too_coarse": 1}
    assert tracker.counters["azimuth_too_coarse"] == 1


def test_the_last_scan_once_more_is_answered_as_before():
    tracker = fed()
    scan = scans()[0][5]
    sets, report = tracker.process(scan)
    again, repeated = tracker.process(scan)
    assert again is sets
    assert repeated == dataclasses.replace(report, repeated=True)
    assert tracker.counters["repeated"] == 1


def test_when_time_begins_anew_all_sets_end_and_ids_go_on():
    tracker = fed()
    ids = tracker.branches.track_id.tolist()
    # By more than time_jump_s before the newest.
    scan = dataclasses.replace(scans()[0][12], stamp_ns=0)
    tracker.process(scan_at(100.0, []))
    sets, report = tracker.process(scan)
    assert report.outcome == "tracked"
    assert min(sets.track_id) > max(ids)
    assert sets.deleted_track_id.tolist() == [1, 2, 3]
    assert (sets.hits == 1).all()
    assert tracker.counters["reset_time_jump"] == 1


def test_after_a_reset_the_next_scan_tells_what_has_ended():
    tracker = fed()
    branches = np.sort(tracker.branches.branch_id)
    tracker.reset()
    sets, report = tracker.process(scan_at(0.0, [(0.0, 5000.0)]))
    assert report.outcome == "tracked"
    assert sets.deleted_track_id.tolist() == [1, 2, 3]
    assert sets.deleted_branch_id.tolist() == branches.tolist()
    assert sets.track_id.tolist() == [4]
    sets, _ = tracker.process(scan_at(2.0, []))
    assert sets.deleted_track_id.tolist() == []


def test_scans_of_several_sensors_and_of_one_time():
    tracker = tracker_of()
    for k in range(6):
        for sensor in ("a", "b"):
            sets, report = tracker.process(scan_at(2.0 * k, [(100.0 * k, 5000.0)], sensor))
            assert report.outcome == "tracked"
    assert sets.track_id.tolist() == [1]
    assert sets.hits.tolist() == [12]


def test_a_flood_of_detections_is_capped():
    rng = np.random.default_rng(3)
    tracker = tracker_of(max_sets=60)
    for k in range(3):
        sets, report = tracker.process(scan_at(2.0 * k, rng.uniform(1e3, 3e3, (250, 2))))
        assert report.outcome == "tracked"
        assert len(sets) <= 60
    assert tracker.counters["sets_over_limit"] > 0


@pytest.mark.parametrize("values", [{"range_std_m": [1e-9]}, {"range_std_m": [1e9]}])
def test_noise_at_the_ends_of_what_is_allowed(values):
    tracker = tracker_of()
    further = {name: np.array(value) for name, value in values.items()}
    for k in range(4):
        sets, report = tracker.process(scan_at(2.0 * k, [(100.0 * k, 5000.0)], **further))
        assert report.outcome == "tracked"
        assert np.isfinite(sets.centroid).all()
        assert np.isfinite(sets.score).all()


# What another value of each live parameter changes; on the crossing tracks, after sample 4.
CHANGES = {
    "boldness": 0.0,
    "theta": 1.0,
    "test_space": "state",
    "range_std_m": 60.0,
    "azimuth_std_rad": 0.01,
    "detection_probability": 0.5,
    "clutter_density_per_m_rad": 1e-3,
    "process_noise_std_mps2": 5.0,
    "initial_position_radius_m": 100.0,
    "initial_position_std_m": 500.0,
    "initial_speed_radius_mps": 50.0,
    "initial_speed_std_mps": 5.0,
    "miss_branches": "never",
    "leading_sets": "each",
    "initiation_claims": "confirmed",
    "confirmation_hits": 2,
    "confirmation_scans": 8,
    "max_coasted_scans": 0,
    "tentative_max_coasted_scans": 3,
    "score_margin": 1e-6,
    "merge_distance": 3.0,
    "merge_scans": 16,
    "duplicate_scans": 0,
    "max_sets_per_track": 1,
    "max_sets": 5,
}
# These act on what comes in, on elevations, or in the node.
ELSEWHERE = {"elevation_std_rad", "max_detections_per_scan", "time_jump_s", "ellipse_scale"}


def test_every_live_parameter_has_a_case():
    live = {name for name, item in specifications(SetValuedParameters).items() if item.live}
    assert live == set(CHANGES) | ELSEWHERE


# So many branches that what limits them shows, and misses that are not out of the question.
MANY = {"score_margin": 40.0, "merge_distance": 0.5, "max_coasted_scans": 3}


@lru_cache
def told_with(name="", **base):
    """Sets after each scan; from the fifth on with another value of ``name``."""
    tracker = SetValuedTracker(parameters(CLUTTERED, **MANY, **base))
    told = []
    for k, scan in enumerate(scans(CLUTTERED, 2)[0][:12]):
        if k == 4 and name:
            tracker.set_parameters(parameters(CLUTTERED, **{**MANY, **base, name: CHANGES[name]}))
        told.append(tracker.process(scan)[0])
    return told


@pytest.mark.parametrize("name", CHANGES)
def test_a_live_parameter_acts_on_the_next_scan(name):
    base = {"confirmation_hits": 4} if name == "confirmation_scans" else {}
    without, with_it = told_with(**base), told_with(name, **base)
    for before, after in zip(without[:4], with_it[:4], strict=True):
        np.testing.assert_array_equal(before.centroid, after.centroid)
    assert any(
        len(a) != len(b)
        or not np.array_equal(a.centroid, b.centroid)
        or not np.array_equal(a.status, b.status)
        or not np.array_equal(a.score, b.score)
        for a, b in zip(without[4:], with_it[4:], strict=True)
    )


def test_limits_of_the_door_act_on_the_next_scan():
    tracker = fed()
    tracker.set_parameters(parameters(max_detections_per_scan=2))
    assert tracker.process(scans()[0][5])[1].reason == "too_many_detections"
    tracker.set_parameters(parameters(time_jump_s=1.0))
    assert tracker.process(scan_at(4.0, [(0.0, 5000.0)]))[1].outcome == "tracked"
    assert tracker.counters["reset_time_jump"] == 1
    spreads = []
    for std in (0.001, 0.2):
        tracker = tracker_of(elevation_std_rad=std)
        sets, _ = tracker.process(scan_at(0.0, [(0.0, 5000.0)], elevation_rad=np.array([0.5])))
        spreads.append(np.trace(sets.covariance[0, :2, :2]))
    assert spreads[1] > 1.1 * spreads[0]


def test_branches_of_one_track_do_not_share_their_covariance():
    """With noise that depends on the detection P and K differ from branch to branch."""
    tracker = tracker_of(merge_distance=0.0, miss_branches="never")
    tracker.process(scan_at(0.0, [(0.0, 5000.0)]))
    sets, _ = tracker.process(scan_at(2.0, [(150.0, 5000.0), (-150.0, 5000.0)]))
    first, second = sets.covariance
    assert np.abs(first - second).max() > 1e-6 * np.abs(first).max()
