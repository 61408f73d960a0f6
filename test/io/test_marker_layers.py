"""Layers of markers: what each shows of a run, and when it is deleted."""

import dataclasses

import numpy as np
import pytest
from marker_run import ALL_LIVE, PER_TRACK, Watched, marker_array, marker_results
from visualization_msgs.msg import Marker

from gda_tracker.io.markers import layers, shapes
from gda_tracker.io.markers.parameters import (
    LAYERS,
)
from gda_tracker.kinematics.sensor_models import polar_measurements


@pytest.fixture(scope="module")
def run():
    """Results of the ring on the crossing targets."""
    return marker_results()


def ids(tracks):
    return sorted(tracks.track_id.tolist())


def test_after_every_scan_the_layers_show_exactly_what_is_there(run):
    watched = Watched()
    view = watched.viewers
    past = {}
    seen_status = set()
    for result in run:
        watched.scan(result)
        tracks, scan = result.tracks, result.scan
        for name in PER_TRACK:
            assert view[name].ids() == ids(tracks), name
        by_status = {
            status: sorted(tracks.track_id[tracks.status == number].tolist())
            for number, status in enumerate(("tentative", "confirmed"))
        }
        seen_status |= {s for s, ids_of in by_status.items() if ids_of}
        for status, expected in by_status.items():
            assert view["tracks"].ids(status) == expected
        past = {i: past.get(i, []) for i in ids(tracks)}
        for row, i in enumerate(tracks.track_id.tolist()):
            past[i].append(tracks.mean[row, :2])
            status = "confirmed" if tracks.status[row] else "tentative"
            marker = view["tracks"].shown[status, i]
            at = [marker.pose.position.x, marker.pose.position.y]
            np.testing.assert_array_equal(at, tracks.mean[row, :2])
            assert marker.header.frame_id == tracks.frame_id == "map"
            stamp = marker.header.stamp
            assert stamp.sec * 10**9 + stamp.nanosec == result.report.key.stamp_ns
            assert view["labels"].shown[status, i].text.startswith(f"{i} ")
            if len(past[i]) > 1:
                np.testing.assert_array_equal(view["trails"].points(("trails", i)), past[i][-50:])
        assert view["trails"].ids() == sorted(i for i, points in past.items() if len(points) > 1)
        assert len(view["detections"].shown) == (len(scan) > 0)
        if len(scan):
            polar = polar_measurements(scan)
            x = polar.sensor_xy_m[0] + polar.range_m * np.cos(polar.azimuth_rad)
            (name,) = view["detections"].shown
            np.testing.assert_allclose(view["detections"].points(name)[:, 0], x, rtol=1e-12)
        taken = np.count_nonzero(tracks.detection_index >= 0)
        lines = view["associations"].shown.values()
        assert sum(len(marker.points) for marker in lines) == 2 * taken
        gated = ids(result.predictions) if len(scan) else []
        assert view["gates"].ids() == sorted(set(gated))
        assert len(view["sensors"].shown) == 2
    assert seen_status == {"confirmed", "tentative"}
    assert any(update.layer == "tracks_delayed" and update.shapes for update in watched.updates)


def test_associations_end_at_the_detection_and_the_track(run):
    watched = Watched(("associations",))
    result = next(r for r in run[5:] if (r.tracks.detection_index >= 0).sum() >= 2)
    watched.scan(result)
    ((name, _),) = watched.viewers["associations"].shown.items()
    lines = watched.viewers["associations"].points(name).reshape(-1, 2, 2)
    tracks, scan = result.tracks, result.scan
    position = shapes.detection_positions(scan)
    expected = {
        (tuple(tracks.mean[row, :2]), tuple(position[scan.source_index.tolist().index(index)]))
        for row, index in enumerate(tracks.detection_index.tolist())
        if index >= 0
    }
    assert {(tuple(a), tuple(b)) for a, b in lines} == expected


@pytest.mark.parametrize("order", ["tps", "pst"])
def test_the_order_in_which_messages_come_makes_no_difference(run, order):
    usual, other = Watched(), Watched()
    for result in run[:7]:
        usual.scan(result)
        takers = {
            "s": lambda r: other.layers.take_scan(r.scan, other.p),
            "p": lambda r: other.layers.take_predictions(r.predictions, other.p),
            "t": lambda r: other.layers.take_tracks(r.tracks, other.p),
        }
        for letter in order:
            other._show(takers[letter](result))
        for tracks in result.delayed:
            other._show(other.layers.take_delayed(tracks, other.p))
        other._show(other.layers.take_formations(other._found(result), other.p))
        assert other.content() == usual.content()


def test_a_message_that_comes_again_changes_nothing(run):
    watched = Watched(detection_persistence_s=1000.0)
    for result in run[:8]:
        watched.scan(result)
    before = watched.content()
    watched.scan(dataclasses.replace(run[7], delayed=[]))
    assert watched.content() == before


def test_who_looks_later_sees_the_same_but_for_the_past(run):
    early, late = Watched(), Watched(looked_at=())
    for number, result in enumerate(run[:15]):
        if number == 10:
            late.looked_at = set(LAYERS)
        early.scan(result)
        late.scan(result)
        if number < 10:
            assert not late.updates
    for name in (*PER_TRACK, "velocities", "associations", "gates", "sensors"):
        assert late.content()[name] == early.content()[name], name
    seen = [[m.points for m in w.viewers["detections"].shown.values()] for w in (early, late)]
    assert seen[0] == seen[1]
    # Whatever an earlier run of the node has left in the viewer goes first.
    assert late.updates[0].anew
    array = marker_array(late.updates[0], late.p)
    assert array.markers[0].action == Marker.DELETEALL
    (trail,) = {len(m.points) for m in late.viewers["trails"].shown.values()} - {2, 3, 4}
    assert trail == 5


def test_nothing_is_made_for_layers_that_nobody_looks_at(run, monkeypatch):
    def never(*_):
        raise AssertionError("was made though nobody looks")

    for name in ("detections", "sensor", "gate_lines", "associations", "track_spheres",
                 "velocity_arrows", "covariance_ellipses", "colours"):  # fmt: skip
        monkeypatch.setattr(shapes, name, never)
    watched = Watched(("labels",))
    monkeypatch.setattr(shapes, "labels", lambda *_: [])
    for result in run[:5]:
        watched.scan(result)
    assert {update.layer for update in watched.updates} == {"labels"}


@pytest.mark.parametrize("change", ["epoch", "time"])
def test_a_restarted_manager_and_time_set_back_begin_anew(run, change):
    watched = Watched(detection_persistence_s=1000.0)
    for result in run[:12]:
        watched.scan(result)
    assert len(watched.viewers["detections"].shown) == 12

    def shifted(part):
        key = part.key
        if change == "epoch":
            key = key._replace(epoch=key.epoch + 1)
        fields = {"key": key}
        if hasattr(part, "mean"):
            fields["track_id"] = part.track_id + 100
        return dataclasses.replace(part, **fields)

    first = len(watched.updates)
    for result in run[:3]:
        again = dataclasses.replace(
            result,
            scan=shifted(result.scan),
            predictions=shifted(result.predictions),
            tracks=shifted(result.tracks),
            delayed=[],
        )
        watched.scan(again)
    anew = [update.layer for update in watched.updates[first:] if update.anew]
    assert sorted(anew) == sorted(ALL_LIVE)
    assert watched.viewers["tracks"].ids() == (run[2].tracks.track_id + 100).tolist()
    assert len(watched.viewers["detections"].shown) == 3
    assert watched.layers.is_old(run[0].tracks.key) == (change == "epoch")


def test_detections_stay_as_long_as_is_asked_for_and_never_without_bound(run):
    step_s = (run[1].scan.key.stamp_ns - run[0].scan.key.stamp_ns) * 1e-9
    watched = Watched(("detections",), detection_persistence_s=3.2 * step_s)
    for number, result in enumerate(run[:10], 1):
        watched.scan(result)
        assert len(watched.viewers["detections"].shown) == min(number, 4)


def test_however_long_detections_stay_their_number_is_bounded(run, monkeypatch):
    monkeypatch.setattr(layers, "MOST_SCANS", 30)
    many = Watched(("detections",), detection_persistence_s=3600.0)
    scan = run[3].scan
    for k in range(50):
        later = dataclasses.replace(scan, key=scan.key._replace(stamp_ns=10**9 + k))
        many._show(many.layers.take_scan(later, many.p))
    assert len(many.viewers["detections"].shown) == 30


def test_detections_of_each_sensor_stay_until_its_next_scan(run):
    watched = Watched(("detections", "sensors"))
    for sensor, result in zip(("bow", "stern", "bow", "mast"), run, strict=False):
        key = result.scan.key._replace(sensor_id=sensor)
        scan = dataclasses.replace(result.scan, key=key)
        watched._show(watched.layers.take_scan(scan, watched.p))
    for name in ("detections", "sensors"):
        assert {ns for ns, _ in watched.viewers[name].shown} == {"bow", "stern", "mast"}


def test_tracks_without_finite_states_are_left_out(run):
    tracks = next(r.tracks for r in run if len(r.tracks) >= 2)
    mean, covariance = tracks.mean.copy(), tracks.covariance.copy()
    mean[0, 1] = np.nan
    broken = dataclasses.replace(tracks, mean=mean)
    watched = Watched()
    watched._show(watched.layers.take_tracks(broken, watched.p))
    assert watched.viewers["tracks"].ids() == ids(tracks)[1:]
    covariance[1, 0, 0] = np.inf
    broken = dataclasses.replace(tracks, covariance=covariance, key=tracks.key)
    assert shapes.drawable(broken).tolist() == [True, False, *[True] * (len(tracks) - 2)]
    short = dataclasses.replace(tracks, mean=mean[:, :2], covariance=covariance[:, :2, :2])
    assert not shapes.drawable(short).any()


def test_numbers_of_64_bits_fit_and_stay(run):
    tracks = next(r.tracks for r in run if len(r.tracks) >= 2)
    large = dataclasses.replace(tracks, track_id=tracks.track_id + 2**40)
    watched = Watched(("tracks", "labels"))
    watched._show(watched.layers.take_tracks(large, watched.p))
    assert watched.viewers["tracks"].ids() == [(i + 2**40) % 2**31 for i in ids(tracks)]
    texts = {m.text.split()[0] for m in watched.viewers["labels"].shown.values()}
    assert texts == {str(i + 2**40) for i in ids(tracks)}
