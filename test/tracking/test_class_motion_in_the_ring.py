"""Motion as class evidence round the ring: every decision, against a smoother, restarts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tracking_examples import SECOND, ring_of, same_tracks, scan_at

from gda_tracker.kinematics.motion_models import constant_velocity
from gda_tracker.kinematics.retrodiction import fixed_interval
from gda_tracker.parameters import ParameterError
from gda_tracker.simulation.playback import with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.simulation.simulate import simulate
from gda_tracker.tracking import checkpoint
from gda_tracker.tracking.ring import Ring
from gda_tracker.vocabulary import CONFIRMED

METHODS = ["gda/dsm_classic/cv", "map/bayes/imm", "jpda/pcr5/imm", "mht/bayes/imm"]
# A fighter and a cargo aircraft as the defaults have them; nothing is known of false alarms.
KNOWN = {
    "attribute_term": "bayes",
    "class_motion": "ranges",
    "class_motion_names": ["cargo", "fighter"],
    "class_speed_mps": [0.0, 0.0, 20.0, 25.0, 0.0, 0.0, 100.0, 110.0],
    "class_acceleration_mps2": [0.0, 0.0, 1.0, 2.0, 0.0, 0.0, 50.0, 60.0],
    "class_motion_reliability": 0.9,
}


def by_motion(n_scans=34, targets=slice(None)):
    """Parameters and one run of the scenario."""
    scenario = load_scenario("class_by_motion")
    scenario = replace(
        scenario,
        targets=scenario.targets[targets],
        time=replace(scenario.time, n_scans=n_scans),
        clutter=replace(scenario.clutter, mean_false_alarms_per_scan=2.0),
    )
    return tracker_preset(scenario, "automatic"), simulate(scenario, 2, 0, initiation="automatic")


def play(parameters, scans, **manager):
    table = {**parameters, "track_manager": {**parameters["track_manager"], **manager}}
    ring = Ring(table)
    return ring, [ring.process(scan) for scan in scans]


@pytest.mark.parametrize("method", METHODS)
def test_the_ring_goes_on_as_without_and_tells_the_class(method):
    parameters, recording = by_motion(targets=slice(0, 3))
    parameters = with_method(parameters, method)
    # The radar cross section tells nothing.
    parameters["rcs_fuzzifier"]["rcs_reliability"] = 0.0
    ring, told = play(parameters, recording.detections)
    _, plain = play(parameters, recording.detections, class_motion="off")
    for one, two in zip(told, plain, strict=True):
        for name in ("mean", "covariance", "track_id", "status", "detection_index"):
            np.testing.assert_array_equal(getattr(one.tracks, name), getattr(two.tracks, name))
        np.testing.assert_array_equal(
            one.predictions.class_probability, two.predictions.class_probability
        )
        np.testing.assert_array_equal(one.predictions.masses, two.predictions.masses)
        if one.tracks.masses.shape[1]:
            np.testing.assert_allclose(one.tracks.masses.sum(axis=1), 1.0)
        if len(one.tracks):
            np.testing.assert_allclose(one.tracks.class_probability.sum(axis=1), 1.0)
    last, truth = told[-1].tracks, recording.truth[-1].target_state
    gap = np.linalg.norm(last.mean[:, None, :2] - truth[None, :, :2], axis=2)
    row = gap.argmin(axis=0)
    assert (gap[row, np.arange(3)] < 400.0).all()
    believed = last.class_probability[row]
    # false alarm, helicopter, fighter, transport: two helicopters, and a fighter that has turned.
    assert (believed[:2, 1] > 2.0 * believed[:2, 2:].max(axis=1)).all()
    assert believed[2, 2] > 2.0 * believed[2, [1, 3]].max()
    # Told again it is the same.
    same_tracks(ring.manager.tracks(), last)


def test_extremes_are_those_of_a_smoother_of_the_whole_history():
    """With a window as long as the history: fixed interval, written down here anew."""
    parameters, recording = by_motion(24, slice(2, 3))
    parameters = with_method(parameters, "map/bayes/cv")
    ring, told = play(parameters, recording.detections, class_motion_scans=40)
    last = told[-1].tracks
    (row,) = np.flatnonzero((last.status == CONFIRMED) & (last.hits > 15))
    states = [
        (r.tracks.mean[at[0]], r.tracks.covariance[at[0]])
        for r in told
        if len(at := np.flatnonzero(r.tracks.track_id == last.track_id[row]))
    ]
    mean, covariance = (np.array(part) for part in zip(*states, strict=True))
    f, q = constant_velocity(2.0, parameters["track_manager"]["process_noise_std_mps2"])
    steps = len(mean) - 1
    mean, covariance = fixed_interval(
        mean, covariance, np.tile(f, (steps, 1, 1)), np.tile(q, (steps, 1, 1))
    )
    v, c = mean[:, 2:], covariance[:, 2:, 2:]
    speed = np.hypot(*v.T)
    along = np.array([u @ s @ u for u, s in zip(v / speed[:, None], c, strict=True)])
    across = np.trace(c, axis1=1, axis2=2) - along
    speed = np.sqrt(speed**2 - across)
    found = ring.manager.state.motion.extremes[row]
    fastest = np.argmax(speed - 2.0 * np.sqrt(along))
    slowest = np.argmin(speed + 2.0 * np.sqrt(along))
    expected = [[speed[k], np.sqrt(along[k])] for k in (fastest, slowest)]
    np.testing.assert_allclose(found[:2], expected, rtol=1e-6)
    # 6 s are three scans.
    change, spread = (v[3:] - v[:-3]) / 6.0, (c[3:] + c[:-3]) / 36.0
    greatest = []
    for a, s in zip(change, spread, strict=True):
        squared = a @ a
        moving = squared > np.trace(s)
        var = a @ s @ a / squared if moving else np.trace(s) / 2.0
        greatest.append((np.sqrt(max(squared - (np.trace(s) - var), 0.0)), np.sqrt(var)))
    greatest = np.array(greatest)
    best = np.argmax(greatest[:, 0] - 2.0 * greatest[:, 1])
    np.testing.assert_allclose(found[2], greatest[best], rtol=1e-6)


def test_a_short_window_finds_nearly_the_same():
    parameters, recording = by_motion(20, slice(2, 3))
    found = {}
    for scans in (8, 40):
        ring, told = play(parameters, recording.detections, class_motion_scans=scans)
        row = int(np.argmax(told[-1].tracks.hits))
        found[scans] = ring.manager.state.motion.extremes[row]
        assert len(ring.manager.state.motion.past) == min(scans + 1, 20)
    np.testing.assert_allclose(found[8][:2, 0], found[40][:2, 0], rtol=0.05)
    assert abs(found[8][2, 0] - found[40][2, 0]) < found[8][2, 1]


def test_a_long_steady_flight_counts_once():
    """Exact detections of 30 m/s: what excludes a cargo aircraft does so no more after 45 scans."""
    ring = ring_of(**KNOWN, confirmation_hits=3)
    told = []
    for k in range(45):
        scan = scan_at(float(k), [[3000.0 + 30.0 * k, 500.0]], rcs=np.nan)
        told.extend(ring.process(scan).tracks.class_probability[:1])
    assert len(told) > 40
    np.testing.assert_allclose(told[-1], [0.0, 1.0 / 1.1, 0.1 / 1.1], atol=2e-3)
    np.testing.assert_allclose(told[20], told[-1], atol=5e-3)
    # The belief that the ring goes on with has none of it.
    np.testing.assert_allclose(ring.manager.state.table.class_probability[0], [0.0, 0.5, 0.5])


def test_a_turn_is_remembered_after_it_has_left_the_window():
    """40 m/s at all times, but 8 m/s2 for six seconds: no cargo aircraft, for good."""
    turns_alone = {**KNOWN, "class_speed_mps": [], "class_motion_scans": 8}
    ring = ring_of(**turns_alone, confirmation_hits=3, process_noise_std_mps2=3.0)
    place, heading, told = np.array([3000.0, 500.0]), 0.0, []
    for k in range(50):
        tracks = ring.process(scan_at(float(k), [place], rcs=np.nan)).tracks
        told.append(tracks.class_probability[0, 1] if len(tracks) else 0.0)
        heading += 8.0 / 40.0 if 20 <= k < 26 else 0.0
        place = place + 40.0 * np.array([np.cos(heading), np.sin(heading)])
    assert told[18] < 0.55
    assert told[32] > 0.85
    np.testing.assert_allclose(told[32:], told[-1], atol=1e-9)


@pytest.mark.parametrize("method", ["map/bayes/imm", "mht/dempster/imm"])
def test_a_restart_goes_on_bit_for_bit(method, tmp_path):
    parameters, recording = by_motion(18)
    parameters = with_method(parameters, method)
    ring, _ = play(parameters, recording.detections[:12])
    checkpoint.save(ring.manager, tmp_path / "state")
    other = Ring(parameters)
    assert checkpoint.load(other.manager, tmp_path / "state")
    same_tracks(ring.manager.tracks(), other.manager.tracks())
    for scan in recording.detections[12:]:
        same_tracks(ring.process(scan).tracks, other.process(scan).tracks)


def test_off_keeps_nothing_and_a_new_time_axis_begins_anew():
    ring = ring_of(attribute_term="bayes")
    for k in range(3):
        ring.process(scan_at(float(k), [[3000.0, 500.0]]))
    assert ring.manager.state.motion is None
    ring = ring_of(**KNOWN)
    for k in range(8):
        ring.process(scan_at(float(k), [[3000.0 + 9.0 * k, 500.0]]))
    assert len(ring.manager.state.motion.past) == 8
    ring.process(scan_at(-5000.0 + 10_000.0, [[3000.0, 500.0]]))  # a gap ends all tracks
    motion = ring.manager.state.motion
    assert len(motion.final) == len(ring.manager.state.table)
    assert np.isnan(motion.extremes[:, 2]).all()
    assert motion.past[-1].stamp_ns == 5000 * SECOND


def test_parameters_that_do_not_go_together_are_refused():
    for change, said in (
        ({"class_speed_mps": [0.0, 1.0]}, "class_motion_names"),
        ({"class_speed_mps": [9.0, 1.0, 2.0, 3.0] * 2}, "a <= b <= c <= d"),
        ({"class_speed_mps": [], "class_acceleration_mps2": []}, "without class_speed_mps"),
        ({"class_motion_names": ["cargo", "cargo"]}, "names that differ"),
        ({"class_motion_names": ["cargo", "bird"]}, "there is no class bird"),
    ):
        with pytest.raises(ParameterError, match=said):
            ring_of(**{**KNOWN, **change})


def test_a_class_that_the_evidence_has_not_is_counted():
    """In the node the classes come with the evidence."""
    ring = ring_of(**KNOWN)
    ring.process(scan_at(0.0, [[3000.0, 500.0]]))
    other = replace(ring.manager.parameters, class_motion_names=["cargo", "bird"])
    ring.manager.set_parameters(other)
    ring.process(scan_at(1.0, [[3000.0, 500.0]]))
    assert ring.manager.counters["class_motion_unknown_class"] == 1


def test_extremes_of_a_straight_flight_stay_near_the_truth():
    """Of 34 states the most extreme one: an extreme of noise, but picked by what it surely is."""
    parameters, recording = by_motion(targets=slice(3, 5))
    ring, told = play(with_method(parameters, "map/bayes/imm"), recording.detections)
    last, truth = told[-1].tracks, recording.truth[-1].target_state
    row = np.linalg.norm(last.mean[:, None, :2] - truth[None, :, :2], axis=2).argmin(axis=0)
    (greatest, least, acceleration) = ring.manager.state.motion.extremes[row].swapaxes(0, 1)
    speed = np.hypot(*truth[:, 2:].T)
    assert (np.abs(greatest[:, 0] - speed) < 2.5 * greatest[:, 1]).all()
    assert (np.abs(least[:, 0] - speed) < 2.5 * least[:, 1]).all()
    assert (acceleration[:, 0] < 2.5 * acceleration[:, 1]).all()
