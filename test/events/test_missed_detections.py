"""Stops that are not seen: worked values, bounds, error rates against exact ones, the ring."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from event_examples import happenings, tracks
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.events.detector import TrackEventDetector
from gda_tracker.events.missed_detections import (
    clear_courses,
    least_range_rates,
    look_increments,
)
from gda_tracker.events.parameters import EventParameters
from gda_tracker.kinematics.blind_zone import BlindZone, detection_probability_at
from gda_tracker.parameters import ParameterError
from gda_tracker.simulation.playback import with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.simulation.simulate import simulate
from gda_tracker.simulation.world_sections import Stop
from gda_tracker.tracking.ring import Ring

RADAR = {"blind_speed_mps": 2.0, "stopped_speed_mps": 1.0, "moving_speed_mps": 6.0}
STOPS = {"tests": ["stops"], **RADAR}
KNOWN = {"blind_speed": 2.0, "detection_probability": 0.9, "false_detection_probability": 0.05}
SEEN = np.array([True, False])


def increments(rate, stopped=1.0, **changes):
    """What a hit and a miss add."""
    return look_increments(SEEN, np.full(2, rate), stopped=stopped, **{**KNOWN, **changes})


def test_worked_values():
    """At 2 m/s half of 0.9 is left; a stop is never seen but for one false alarm in twenty."""
    told = increments(2.0, stopped=0.0)
    np.testing.assert_allclose(told, np.log([0.05 / 0.45, 0.95 / 0.55]))
    # Across the line of sight, and where P0 falls below P1, nothing is told.
    np.testing.assert_array_equal(increments(0.0), [0.0, 0.0])
    np.testing.assert_array_equal(increments(0.9), [0.0, 0.0])
    # The detection probability is that of the blind zone of the ring.
    zone = BlindZone(2.0, 0.9, np.zeros(2))
    told = increments(5.0, stopped=1.0, false_detection_probability=0.0)
    low, high = detection_probability_at(np.array([1.0, 5.0]), zone)
    np.testing.assert_allclose(told, np.log([low / high, (1.0 - low) / (1.0 - high)]))


@settings(max_examples=25, deadline=None)
@given(st.floats(0.0, 30.0), st.floats(0.0, 1.9), st.floats(0.0, 1.0))
def test_the_ratio_is_a_supermartingale_for_all_that_a_hypothesis_allows(rate, stopped, share):
    """For any P_D above P0 under h0, and below P1 under h1, the mean factor is at most one."""
    hit, miss = increments(rate, stopped)
    p0 = 0.9 * -np.expm1(-np.log(2.0) * (rate / 2.0) ** 2)
    usual = p0 + share * (1.0 - p0)
    assert usual * np.exp(hit) + (1.0 - usual) * np.exp(miss) <= 1.0 + 1e-12
    p1 = 1.0 - (1.0 - 0.9 * -np.expm1(-np.log(2.0) * (stopped / 2.0) ** 2)) * 0.95
    unusual = share * p1
    assert unusual * np.exp(-hit) + (1.0 - unusual) * np.exp(-miss) <= 1.0 + 1e-12


@settings(max_examples=25, deadline=None)
@given(st.floats(-3.2, 3.2), st.floats(-3.2, 3.2), st.floats(0.0, 1.6))
def test_the_least_range_rate_is_that_of_all_courses_allowed(heading, bearing, spread):
    course = np.array([[np.cos(heading), np.sin(heading)]])
    sight = 3000.0 * np.array([[np.cos(bearing), np.sin(bearing)]])
    turns = heading + np.linspace(-spread, spread, 4001)
    brute = np.abs(np.cos(turns - bearing)).min() * 8.0
    (found,) = least_range_rates(course, np.array([spread]), sight, 8.0)
    assert found == pytest.approx(brute, abs=0.02)
    assert found <= brute + 1e-9


def test_courses_are_clear_while_a_track_is_fast_for_its_errors():
    velocity = np.array([[10.0, 0.0], [1.0, 0.0], [0.0, 0.0]])
    covariance = np.tile(np.diag([9.0, 0.25]), (3, 1, 1))
    clear, course, spread = clear_courses(velocity, covariance)
    assert clear.tolist() == [True, False, False]
    np.testing.assert_array_equal(course[0], [1.0, 0.0])
    assert spread[0] == pytest.approx(2.0 * 0.5 / 10.0)


def exact_rate(seen, add, low, high, longest=400):
    """Chance that a walk of hits and misses ends at the upper threshold, by dynamic programming."""
    open_, accepted = {(0, 0): 1.0}, 0.0
    for _ in range(longest):
        after: dict[tuple[int, int], float] = {}
        for (hits, misses), chance in open_.items():
            for hit, p in ((1, seen), (0, 1.0 - seen)):
                place = hits + hit, misses + 1 - hit
                ratio = place[0] * add[0] + place[1] * add[1]
                if ratio >= high:
                    accepted += chance * p
                elif ratio > low:
                    after[place] = after.get(place, 0.0) + chance * p
        open_ = after
    assert sum(open_.values()) < 1e-9
    return accepted


@pytest.mark.parametrize("speed", [6.0, 1.0])
def test_error_rates_are_the_exact_ones_and_keep_to_the_design(speed):
    """Targets at the bound of a hypothesis, straight on to the radar, seen by chance alone."""
    design = 0.05
    p = EventParameters(
        **STOPS,
        false_alarm_probability=design,
        miss_probability=design,
        blind_turn_rad=0.0,
        blind_false_detection_probability=0.0,
    )
    n, scans, random = 200, 120, np.random.default_rng(8)
    zone = BlindZone(2.0, 0.9, np.zeros(2))
    low, high = detection_probability_at(np.array([1.0, 6.0]), zone)
    add = np.log([low / high, (1.0 - low) / (1.0 - high)])
    seen = high if speed == 6.0 else low
    test = p.thresholds()
    exact = exact_rate(seen, add, test.log_reject, test.log_accept)
    wrong = exact if speed == 6.0 else 1.0 - exact
    assert wrong < design
    detector = TrackEventDetector(p)
    stop, ids = detector._tests[0], np.arange(1, n + 1)
    verdicts = []
    # Far away, so that the aspect stays; states that tell nothing of the speed.
    vague = np.diag([4.0, 4.0, 1e6, 1e-4])
    for k in range(scans):
        mean = np.tile([1e6, 0.0, -20.0, 0.0], (n, 1))
        was = random.random(n) < seen if k else True
        told = tracks(2.0 * k, ids, mean, detected=was, covariance=vague)
        states, _ = detector._states(told)
        _, decisions = stop.step(states)
        verdicts.append(decisions.verdict)
    verdict = np.concatenate(verdicts)
    done = verdict[verdict != 0]
    share = np.mean(done == 1)
    # Tests of one target follow each other and are independent.
    assert abs(share - exact) < 4.0 * np.sqrt(exact * (1.0 - exact) / len(done)) + 0.002


def vehicle(unseen, course=(-10.0, 0.0), start=(5000.0, 0.0), scans=30, degraded=()):
    """A vehicle of constant speed; not detected on the scans ``unseen``, where it stays."""
    place, told = np.array(start), []
    for k in range(scans):
        stands = k in unseen
        if not stands:
            place = place + 2.0 * np.array(course)
        mean = [*place, *(np.zeros(2) if stands else course)]
        one = tracks(2.0 * k, [1], mean, detected=not stands)
        told.append(replace(one, degraded=k in degraded))
    return told


def test_a_stop_that_is_not_seen_is_told_with_its_end():
    away = range(12, 22)
    found = happenings(TrackEventDetector(EventParameters(**STOPS)), vehicle(away))
    assert [kind for kind, *_ in found] == ["stopped", "moves"]
    (stopped, moves) = (scan for *_, scan in found)
    # A test under way has some hits in it; then each miss counts log((1 - 0.19) / (1 - 0.9)).
    assert 15 <= stopped <= 18
    assert 22 <= moves <= 26
    # Without the blind zone states alone speak, and there are none.
    plain = EventParameters(**{**STOPS, "blind_speed_mps": 0.0})
    assert happenings(TrackEventDetector(plain), vehicle(away)) == []


def test_what_may_be_hidden_for_another_reason_is_not_told():
    away = range(12, 22)
    across = vehicle(away, course=(0.0, 10.0))
    given_up = vehicle(away, degraded=away)
    never_clear = [replace(s, covariance=s.covariance * 1e5) for s in vehicle(away)]
    for scans in (across, given_up, never_clear):
        told = happenings(TrackEventDetector(EventParameters(**STOPS)), scans)
        assert "stopped" not in [kind for kind, *_ in told]
    # A radar elsewhere sees it across no more.
    other = EventParameters(**STOPS, sensor_position_m=[5000.0, -4000.0])
    assert [k for k, *_ in happenings(TrackEventDetector(other), across)][0] == "stopped"


def test_parameters_that_do_not_go_together_are_refused():
    with pytest.raises(ParameterError, match="stopped_speed_mps"):
        EventParameters(**{**STOPS, "blind_speed_mps": 0.8})
    with pytest.raises(ParameterError, match="sensor_position_m"):
        EventParameters(sensor_position_m=[1.0])


@pytest.mark.parametrize("method", ["map/none/imm", "mht/none/imm"])
def test_a_stop_round_the_ring(method):
    scenario = load_scenario("stop_and_go")
    scenario = replace(
        scenario,
        targets=(replace(scenario.targets[0], stops=(Stop(12.0, 32.0, 2.5),)),),
        time=replace(scenario.time, n_scans=40),
        clutter=replace(scenario.clutter, mean_false_alarms_per_scan=0.5),
    )
    recording = simulate(scenario, 4, 0, initiation="automatic")
    ring = Ring(with_method(tracker_preset(scenario, "automatic"), method))
    detector = TrackEventDetector(EventParameters(**STOPS))
    told = happenings(detector, [ring.process(scan).tracks for scan in recording.detections])
    assert [kind for kind, *_ in told] == ["stopped", "moves"]
    # It stands from scan 15 to scan 32, counted from 1.
    assert 14 < told[0][2] < 30
    assert told[1][2] > 31
