"""Lanes and plans round the ring: NEES of keepers, those who leave, every decision, restarts."""

from __future__ import annotations

import math
from dataclasses import replace

import context_examples as roads
import numpy as np
import pytest
from tracking_examples import SECOND, assert_same, initial_tracks, same_tracks, simulated

from gda_tracker.kinematics.lane_motion import offset_motion
from gda_tracker.parameters import ParameterError
from gda_tracker.tracking import checkpoint
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.tracking.ring import Ring
from gda_tracker.vocabulary import CONFIRMED, Detections


@pytest.fixture
def road(tmp_path):
    path = tmp_path / "roads.yaml"
    path.write_text(roads.MAP)
    return path


def belief(ring, row=0):
    """Weight of the last model of a track."""
    table = ring.manager.state.table
    return float(table.model_weight[np.flatnonzero(table.chosen)[row], -1])


def test_the_filter_is_consistent_on_keepers(tmp_path):
    """NEES of vehicles that all keep to their roads, round the bends, with misses: 4 at most.

    Each has a road of its own, far from the others: the test is of the filter, not of the
    association.
    """
    n, scans = 24, 40
    states = roads.keepers(n, scans + 1, 3)
    aside = np.zeros((n, 4))
    aside[:, 1] = 300.0 * (np.arange(n) - n / 2)
    path = tmp_path / "many.yaml"
    path.write_text(roads.parallel(aside[:, 1]))
    spread = np.diag([400.0, 400.0, 9.0, 9.0])
    rng = np.random.default_rng(9)
    first = initial_tracks(
        n,
        mean=states[0] + aside + rng.multivariate_normal(np.zeros(4), spread, n),
        covariance=np.tile(spread, (n, 1, 1)),
    )
    manager = roads.settings(
        path,
        initiation="labelled",
        deletion_misses=0,
        azimuth_std_rad=0.002,
        lane_keeping_share=0.9999,
        lane_keeping_s=1e4,
    )
    ring = Ring({"track_manager": manager})
    ring.initialise(first)
    found = []
    begin = first.key.stamp_ns // SECOND + 1
    scanned = roads.seen(states[1:] + aside, 100, begin, azimuth_std_rad=0.002)
    for scan, truth in zip(scanned, states[1:] + aside, strict=True):
        found.append(roads.squared_errors(ring.process(scan).tracks, truth))
    assert ring.manager.state.table.model_weight[:, -1].min() > 0.95
    # Scans hang together: the scatter of each vehicle's mean tells how far off that of all may be.
    mean = np.mean(found, axis=0)
    error = mean.std(ddof=1) / math.sqrt(n)
    assert error < 0.4
    # Not too sure of itself; what is left is the doubt whether they keep to their road at all.
    assert 3.0 < mean.mean() < 4.0 + 2.6 * error


def test_an_artificial_measurement_on_each_scan_would_be_too_sure():
    """What is not done here: the lane measured anew on each scan, on the same vehicles.

    Across a straight road, by a Kalman filter with the same detections: NEES of offset and rate.
    """
    rng = np.random.default_rng(1)
    std, noise_m, n = 12.0 / math.sqrt(12.0), 10.0, 300
    step, noise = offset_motion(1.0, 10.0)
    free = np.array([[1.0, 1.0], [0.0, 1.0]]), np.diag([0.0, 0.2**2])
    true = rng.normal(size=(n, 2)) * [std, std / 10.0]
    start = np.diag([std**2, (std / 10.0) ** 2])
    found = {}
    for name, (f, q), again in (("once", (step, std**2 * noise), False), ("each", free, True)):
        x, mean, covariance, squared = true.copy(), np.zeros((n, 2)), start.copy(), []
        draw = np.random.default_rng(2)
        for _ in range(80):
            x = x @ step.T + draw.multivariate_normal([0.0, 0.0], std**2 * noise, n)
            mean, covariance = mean @ f.T, f @ covariance @ f.T + q
            z = x[:, 0] + draw.normal(0.0, noise_m, n)
            for value, r in ((z, noise_m**2), *(((np.zeros(n), std**2),) if again else ())):
                gain = covariance[:, 0] / (covariance[0, 0] + r)
                mean = mean + (value - mean[:, 0])[:, None] * gain
                covariance = covariance - np.outer(gain, covariance[0])
            gap = mean - x
            squared.append(np.sum(gap * np.linalg.solve(covariance, gap.T).T, axis=1).mean())
        found[name] = np.mean(squared[20:])
    assert found["once"] == pytest.approx(2.0, abs=0.1)
    assert found["each"] > 3.5


@pytest.mark.parametrize(
    ("decision", "motion"), [("gda", "cv"), ("map", "cv"), ("jpda", "imm"), ("mht", "cv")]
)
def test_keepers_are_known_better_and_those_who_leave_are_let_go(road, decision, motion):
    keeper = roads.keepers(1, 56, 12, start=(430.0, 431.0))[:, 0]
    straight = keeper.copy()
    # Where the road bends it drives on straight.
    bend = int(np.argmax(keeper[:, 0] > 1480.0))
    speed = keeper[bend, 2]
    straight[bend:, :2] = keeper[bend, :2] + np.outer(np.arange(56 - bend), [speed, 0.0])
    straight[bend:, 2:] = [speed, 0.0]
    errors, beliefs = {}, []
    paths = [("keeps", keeper)] + [("leaves", straight)] * (decision in ("map", "jpda"))
    for told in (str(road), ""):
        for name, states in paths:
            changes = {"decision": decision, "filter": motion}
            ring = Ring({"track_manager": roads.settings(told, **changes)})
            gaps = []
            for scan, truth in zip(roads.seen(states[:, None], 5), states, strict=True):
                tracks = ring.process(scan).tracks
                live = np.flatnonzero(tracks.status == CONFIRMED)
                gaps.append(np.hypot(*(tracks.mean[live, :2] - truth[:2]).T).min(initial=np.inf))
                if told and name == "leaves" and len(live):
                    beliefs.append(belief(ring))
            errors[name, bool(told)] = np.array(gaps[12:])
    rms = {key: math.sqrt(np.mean(gap**2)) for key, gap in errors.items()}
    assert rms["keeps", True] < 0.8 * rms["keeps", False]
    if ("leaves", True) not in errors:
        return
    # Nobody is held on a road that he has left: in the end the two are the same.
    assert np.isfinite(errors["leaves", True]).all()
    late = errors["leaves", True][-8:], errors["leaves", False][-8:]
    assert np.abs(late[0][-4:] - late[1][-4:]).max() < 2.0
    assert max(beliefs[:bend]) > 0.7
    assert max(beliefs[-5:]) < 0.01


def test_lanes_that_no_one_is_near_change_next_to_nothing(tmp_path):
    """Free models are the same filter: what is on no lane and has no plan is tracked as ever."""
    far = tmp_path / "far.yaml"
    far.write_text(
        "lanes: [{name: far, width_m: 9, margin_m: 5, points_m: [[9e5, 9e5], [9e5, 9.1e5]]}]\n"
    )
    for motion in ("cv", "imm"):
        results = []
        for path in ("", str(far)):
            manager = {"filter": motion, "attribute_term": "none", "context_file": path}
            ring = Ring({"track_manager": manager})
            results.append([ring.process(scan).tracks for scan in simulated(15)])
        for one, other in zip(*results, strict=True):
            assert one.track_id.tolist() == other.track_id.tolist()
            np.testing.assert_allclose(one.mean, other.mean, rtol=1e-9, atol=1e-7)
            np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-7, atol=1e-9)


def patrol(path, tolerance, at=(40, 80), late=0.0):
    """A plan of track 1: from (1000, 0) by (1500, 300) to (1700, 900)."""
    path.write_text(
        "plans:\n  - {name: patrol, track_id: 1, margin_m: 40, waypoints: [\n"
        "    {time_s: 0, position_m: [1000, 0], tolerance_m: 50},\n"
        f"    {{time_s: {at[0]}, position_m: [1500, 300], tolerance_m: {tolerance}, "
        f"tolerance_s: {late}}},\n"
        f"    {{time_s: {at[1]}, position_m: [1700, 900], tolerance_m: {tolerance}}}]}}\n"
    )
    return path


def patrol_states(keeps=True, scans=79):
    """Where the plan has it, or straight on from the second waypoint."""
    time = np.arange(scans, dtype=float)[:, None]
    first = np.array([12.5, 7.5])
    second = np.array([5.0, 15.0]) if keeps else first
    place = np.array([1000.0, 0.0]) + first * np.minimum(time, 40.0)
    place += second * np.maximum(time - 40.0, 0.0)
    velocity = np.where(time < 40.0, first, second)
    return np.hstack([place, velocity])


@pytest.mark.parametrize("decision", ["mht"])
def test_a_plan_is_used_by_those_who_keep_it(tmp_path, decision):
    path = patrol(tmp_path / "plan.yaml", 15.0)
    found = {}
    for keeps in (True, False):
        states = patrol_states(keeps)
        scans = roads.seen(states[:, None], 6, missed=0.3)
        # Around the second waypoint nothing is seen for a while.
        silent = [replace(s, range_m=s.range_m[:0], azimuth_rad=s.azimuth_rad[:0]) for s in scans]
        scans[35:47] = silent[35:47]
        if not keeps:
            states, scans = states[:60], scans[:60]
        for told in (str(path), "") if keeps else (str(path),):
            manager = roads.settings(told, decision=decision, deletion_misses=15)
            ring = Ring({"track_manager": manager})
            gap, beliefs = [], []
            for scan, truth in zip(scans, states, strict=True):
                tracks = ring.process(scan).tracks
                one = np.flatnonzero(tracks.track_id == 1)
                gap.append(
                    float(np.hypot(*(tracks.mean[one[0], :2] - truth[:2]))) if len(one) else np.inf
                )
                if told and len(one):
                    beliefs.append(belief(ring))
            found[keeps, bool(told)] = np.array(gap), beliefs
    with_plan, without = found[True, True][0], found[True, False][0]
    # Through the silence it follows the plan, also round its corner.
    assert with_plan[35:47].max() < 0.7 * without[35:47].max()
    assert np.mean(with_plan[10:]) < np.mean(without[10:])
    assert found[True, True][1][34] > 0.8
    # Who does not keep it is soon known not to.
    assert np.isfinite(found[False, True][0][3:]).all()
    assert found[False, True][1][-1] < 0.05
    assert found[False, True][0][-10:].max() < 30.0


def test_a_plan_speaks_of_its_track_alone_and_ends(tmp_path):
    path = patrol(tmp_path / "plan.yaml", 15.0, at=(20, 40))
    states = np.stack([patrol_states(), patrol_states() + [0.0, 400.0, 0.0, 0.0]], axis=1)
    ring = Ring({"track_manager": roads.settings(path)})
    for scan in roads.seen(states[:30], 2, missed=0.0):
        ring.process(scan)
    table = ring.manager.state.table
    other = table.model_weight[table.track_id == 2, -1]
    assert len(other) == 1
    assert other[0] == 0.0
    assert 0.0 < table.model_weight[table.track_id == 1, -1][0] < 1.0
    # It is too slow for the plan; after its end nobody has one.
    for scan in roads.seen(states[30:43], 3, first_s=30, missed=0.0):
        ring.process(scan)
    assert not ring.manager.state.table.model_weight[:, -1].any()


@pytest.mark.parametrize("decision", ["mht"])
def test_checkpoint_on_the_road(road, tmp_path, decision):
    manager = {"track_manager": roads.settings(road, decision=decision, filter="imm")}
    scans = roads.seen(roads.keepers(3, 26, 3), 4)
    ring = Ring(manager)
    for scan in scans[:20]:
        ring.process(scan)
    assert ring.manager.state.table.models[-1] == "lane_keeping"
    checkpoint.save(ring.manager, tmp_path / "state")
    other = Ring(manager)
    assert checkpoint.load(other.manager, tmp_path / "state")
    for scan in scans[20:]:
        same_tracks(ring.process(scan).tracks, other.process(scan).tracks)


def test_a_map_comes_changes_and_goes_while_tracks_live(road, tmp_path):
    scans = roads.seen(roads.keepers(3, 40, 3), 4)
    plan = patrol(tmp_path / "plan.yaml", 15.0)
    both = tmp_path / "both.yaml"
    both.write_text(road.read_text() + plan.read_text())
    ring = Ring({"track_manager": roads.settings("")})
    ids = []
    for k, scan in enumerate(scans):
        for at, path in ((10, road), (20, both), (30, "")):
            if k == at:
                changed = replace(ring.manager.parameters, context_file=str(path))
                ring.manager.set_parameters(changed)
        ids.append(set(ring.process(scan).tracks.track_id.tolist()))
        models = ring.manager.state.table.models
        keeping = sum(name.endswith("keeping") for name in models)
        assert keeping == (0 if k < 10 else 1 if k < 20 else 2 if k < 30 else 0)
    assert ids[-1] == ids[9]
    assert len(ids[9]) == 3


def test_sums_of_bearings_and_scans_at_one_time(road):
    """Lanes go with sensors that start Gaussian sums, and with two scans of one stamp."""
    manager = roads.settings(
        road,
        sensor_ids=["finder"],
        sensor_models=["bearing"],
        sensor_clutter_densities=[1e-3],
    )
    states = roads.keepers(1, 30, 3)
    ring = Ring({"track_manager": manager})
    # What the file has become since is of no account before the next change of a parameter.
    road.unlink()
    for scan, truth in zip(roads.seen(states, 4, missed=0.0), states, strict=True):
        azimuth = np.arctan2(truth[:, 1] + 300.0, truth[:, 0])
        place = np.array([0.0, -300.0, 0.0])
        finder = Detections("finder", scan.stamp_ns, None, azimuth, sensor_position_m=place)
        ring.process(finder)
        tracks = ring.process(scan).tracks
    assert np.isfinite(tracks.covariance).all()
    assert np.hypot(*(tracks.mean[:, :2] - truth[0, :2]).T).min() < 20.0
    assert ring.manager.parameters.of_sensor("finder").courses.names == ("lane_keeping",)


def test_off_by_default_and_bit_for_bit():
    """Without a file no model is added, under any filter, and states are those of its absence."""
    for motion, models in (("cv", ()), ("imm", ("constant_velocity",) * 2)):
        rings = [
            Ring({"track_manager": {"filter": motion, **changes}})
            for changes in ({}, {"lane_keeping_share": 0.2, "plan_keeping_s": 3.0})
        ]
        for scan in simulated(12):
            one, other = (ring.process(scan).tracks for ring in rings)
            assert_same(one.mean, other.mean)
            assert_same(one.covariance, other.covariance)
        assert rings[0].manager.state.table.models == models


def test_files_and_parameters_that_do_not_go_together(road, tmp_path):
    def made(**changes):
        return TrackManagerParameters(**{"context_file": str(road), **changes})

    assert made().courses.names == ("lane_keeping",)
    with pytest.raises(ParameterError, match=r"context_file = .*: allowed is '' with filter"):
        made(filter="gpb2")
    with pytest.raises(ParameterError, match="context_file = .*absent.*No such file"):
        made(context_file=str(tmp_path / "absent"))
    road.write_text("frame_id: odom\n" + roads.MAP)
    with pytest.raises(ParameterError, match="frame_id is 'odom': allowed is tracking_frame"):
        made()
    assert made(tracking_frame="odom").courses.lanes is not None
    road.write_text(roads.MAP.replace("width_m: 12.0", "width_m: .nan"))
    with pytest.raises(ParameterError, match=r"lane 1 \(road\): width_m = nan"):
        made()
    plan = patrol(tmp_path / "plan.yaml", 15.0, late=-1.0)
    with pytest.raises(ParameterError, match=r"waypoint 2: tolerance_s = -1.0: allowed"):
        made(context_file=str(plan))
