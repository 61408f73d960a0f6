"""Every live parameter of ``track_events`` changes what is found in tracks that show it."""

import numpy as np
import pytest
from event_examples import CONTEXT, COVARIANCE, STEP_S, on_lane_then_off, tracks

from gda_tracker.events.detector import TrackEventDetector
from gda_tracker.events.parameters import EventParameters
from gda_tracker.parameters import specifications


def along(speed, y=0.0):
    """Positions and speeds along the lane."""
    speed = np.asarray(speed, dtype=np.float64)
    x = np.cumsum(speed) * STEP_S
    y = np.broadcast_to(y, speed.shape)
    return np.column_stack([x, y, speed, np.zeros_like(speed)])


def slanted():
    """In the lane, at 0.5 rad to it."""
    k = np.arange(6)
    return np.column_stack([100.0 + 0 * k, 0.0 * k, 8.78 + 0 * k, 4.79 + 0 * k])


WALK = on_lane_then_off()
SLOW_DOWN = along([10.0] * 5 + [0.8] * 6)
SPEED_UP = along([10.0] * 4 + [10.0 + 26.0 * k for k in range(1, 9)])
BACK = along([-10.0] * 8) + [2000.0, 0.0, 0.0, 0.0]
DRIFT = along([-1.5] * 12) + [2000.0, 0.0, 0.0, 0.0]

# New value, states of track 1, distance of track 2 that begins beside it (0: none).
CASES = {
    "tests": (["stops"], WALK, 0),
    "false_alarm_probability": (0.3, WALK, 0),
    "miss_probability": (0.3, WALK, 0),
    "independence_factor": (6.0, WALK, 0),
    "covariance_factor": (100.0, WALK, 0),
    "lane_heading_tolerance_rad": (0.3, slanted(), 0),
    "wrong_way_speed_mps": (9.0, DRIFT, 0),
    "stopped_speed_mps": (0.1, SLOW_DOWN, 0),
    "moving_speed_mps": (4.0, SLOW_DOWN, 0),
    "steady_acceleration_mps2": (1.9, SPEED_UP, 0),
    "event_acceleration_mps2": (9.0, SPEED_UP, 0),
    "split_radius_m": (10.0, WALK, 20.0),
    "split_departure_m": (400.0, WALK, 20.0),
    "split_watch_s": (5.0, WALK, 20.0),
}

# Of a radar with a blind zone, on tracks that come towards it and vanish after ten scans.
ZONE = {"blind_speed_mps": 1.0, "moving_speed_mps": 6.0}
BLIND = {
    "blind_speed_mps": 0.0,
    "detection_probability": 0.5,
    "sensor_position_m": [5000.0, -9000.0],
    "blind_turn_rad": 1.5,
    "blind_false_detection_probability": 0.5,
}


def told_of_stops(**parameters):
    detector = TrackEventDetector(EventParameters(**{**ZONE, **parameters}, tests=["stops"]))
    told = []
    for k in range(24):
        state = [9000.0 - 20.0 * min(k, 10), 0.0, -10.0, 0.0]
        told += detector.take(tracks(2.0 * k, [1], state, detected=k < 10)).events
    return [(event.kind, event.stamp_ns, event.log_likelihood_ratio) for event in told]


@pytest.mark.parametrize("name", BLIND)
def test_a_change_shows_in_stops_that_are_not_seen(name):
    assert told_of_stops(**{name: BLIND[name]}) != told_of_stops()


def found(states, second, **parameters):
    detector = TrackEventDetector(EventParameters(**parameters), CONTEXT)
    events = []
    for k, state in enumerate(states):
        mean, ids = [state], [1]
        if second and k >= 3:
            apart = second + 200.0 * (k - 3)
            mean.append(state + np.array([0.0, apart, 0.0, 15.0]))
            ids.append(2)
        for event in detector.take(tracks(STEP_S * k, ids, mean, covariance=COVARIANCE)).events:
            told = (event.kind, event.track_id, event.stamp_ns, event.log_likelihood_ratio)
            events.append((*told, event.upper_threshold, event.lower_threshold))
    return events


def test_every_live_parameter_has_a_case():
    live = {name for name, item in specifications(EventParameters).items() if item.live}
    # The file is read by the node: test/nodes/test_track_events_node.py.
    assert live == {*CASES, *BLIND, "context_file"}


@pytest.mark.parametrize("name", CASES)
def test_a_change_shows_in_the_events(name):
    value, states, second = CASES[name]
    assert found(states, second, **{name: value}) != found(states, second)
