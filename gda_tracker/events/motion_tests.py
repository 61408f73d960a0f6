"""Motion: a track has stopped, or it accelerates.

Both are told only of tracks that were found to do the usual before: a buoy that was never seen to
move has not stopped.
"""

from __future__ import annotations

import numpy as np

from gda_tracker.events.found import ACCELERATES, MOVES, STEADY, STOPPED, Finding
from gda_tracker.events.missed_detections import (
    clear_courses,
    least_range_rates,
    look_increments,
)
from gda_tracker.events.parameters import EventParameters
from gda_tracker.events.samples import States
from gda_tracker.events.sequential import (
    DIRECTION_COUNT,
    H0,
    H1,
    OPEN,
    Decisions,
    advance,
    aligned,
    departure_increments,
    stopped_increments,
    test_columns,
)
from gda_tracker.vocabulary.arrays import FloatArray, IntArray

_STOP = test_columns(1, ("course", np.float64, (2,)), ("spread_rad", np.float64))
_NEW_STOP = np.zeros((), dtype=_STOP)
_NEW_STOP["spread_rad"] = np.inf  # no course known yet
_ACCELERATION = test_columns(
    DIRECTION_COUNT,
    ("from_ns", np.int64),
    ("from_velocity", np.float64, (2,)),
    ("from_covariance", np.float64, (2, 2)),
)
_NEW_ACCELERATION = np.zeros((), dtype=_ACCELERATION)
_NOTHING_YET = np.iinfo(np.int64).min
_NEW_ACCELERATION["from_ns"] = _NOTHING_YET


class StopTest:
    """Speeds of all tracks, by their states and by whether a radar with a blind zone sees them."""

    def __init__(self, parameters: EventParameters) -> None:
        self._parameters = parameters
        self._test = parameters.thresholds()
        self._rows = np.zeros(0, dtype=_STOP)

    def step(self, states: States) -> tuple[list[Finding], Decisions]:
        """Take the states of a scan."""
        rows = self._rows = aligned(self._rows, states.track_id, _NEW_STOP)
        looks = self._looks(states)
        due = np.flatnonzero(states.due | (looks != 0.0))
        velocity = states.velocity[due]
        increments = stopped_increments(
            velocity,
            states.velocity_covariance()[due],
            self._parameters.stopped_speed_mps,
            self._parameters.moving_speed_mps,
        )
        # A state that is not due shares its error with the last one: it is not counted again.
        increments = np.where(states.due[due, None], increments, 0.0) + looks[due, None]
        before = rows["status"][due]
        decisions = advance(rows, due, increments, states.stamp_ns, self._test)
        speed = np.hypot(velocity[:, 0], velocity[:, 1])
        # What stands from the first is as if it had never been tested: else its first motion
        # would be told as the end of a stop.
        rows["status"][due[(decisions.verdict == H1) & (before == OPEN)]] = OPEN
        return _changes(due, before, decisions, speed, STOPPED, MOVES), decisions

    def _looks(self, states: States) -> FloatArray:
        """Return what the scan tells of each track (N,) by seeing it or not; 0 without a zone."""
        p, rows = self._parameters, self._rows
        if not p.blind_speed_mps or not states.looked:
            return np.zeros(len(rows))
        known = np.isfinite(rows["spread_rad"])
        sight = states.position - np.array(p.sensor_position_m)
        spread = np.where(known, rows["spread_rad"], 0.0) + p.blind_turn_rad
        rate = least_range_rates(rows["course"], spread, sight, p.moving_speed_mps)
        looks = look_increments(
            states.detected,
            rate,
            stopped=p.stopped_speed_mps,
            blind_speed=p.blind_speed_mps,
            detection_probability=p.detection_probability,
            false_detection_probability=p.blind_false_detection_probability,
        )
        # The course of this scan is for the next ones: given h0 it depends on being seen.
        clear, course, wide = clear_courses(states.velocity, states.velocity_covariance())
        clear &= states.detected
        rows["course"][clear], rows["spread_rad"][clear] = course[clear], wide[clear]
        return np.where(known, looks, 0.0)


class AccelerationTest:
    """Accelerations of all tracks, from pairs of independent states.

    The pairs are disjoint: two that share a state would share its error.
    """

    def __init__(self, parameters: EventParameters) -> None:
        self._parameters = parameters
        self._test = parameters.thresholds()
        self._rows = np.zeros(0, dtype=_ACCELERATION)

    def step(self, states: States) -> tuple[list[Finding], Decisions]:
        """Take the states of a scan."""
        rows = self._rows = aligned(self._rows, states.track_id, _NEW_ACCELERATION)
        due = np.flatnonzero(states.due)
        begun = rows["from_ns"][due] != _NOTHING_YET
        first, second = due[~begun], due[begun]
        elapsed = (states.stamp_ns - rows["from_ns"][second]) * 1e-9
        covariance = states.velocity_covariance()
        acceleration = (states.velocity[second] - rows["from_velocity"][second]) / elapsed[:, None]
        increments = departure_increments(
            acceleration,
            (covariance[second] + rows["from_covariance"][second]) / elapsed[:, None, None] ** 2,
            self._parameters.steady_acceleration_mps2,
            np.asarray(self._parameters.event_acceleration_mps2),
        )
        rows["from_ns"][second] = _NOTHING_YET
        rows["from_ns"][first] = states.stamp_ns
        rows["from_velocity"][first] = states.velocity[first]
        rows["from_covariance"][first] = covariance[first]
        before = rows["status"][second]
        decisions = advance(rows, second, increments, states.stamp_ns, self._test)
        size = np.hypot(acceleration[:, 0], acceleration[:, 1])
        rows["status"][second[(decisions.verdict == H1) & (before == OPEN)]] = OPEN
        return _changes(second, before, decisions, size, ACCELERATES, STEADY), decisions


def _changes(
    which: IntArray,
    before: IntArray,
    decisions: Decisions,
    value: FloatArray,
    unusual: str,
    usual: str,
) -> list[Finding]:
    """Return the changes from h0 to h1 and back."""
    begins = (decisions.verdict == H1) & (before == H0)
    ends = (decisions.verdict == H0) & (before == H1)
    return [
        Finding(unusual if begins[index] else usual, int(which[index]), index, float(value[index]))
        for index in np.flatnonzero(begins | ends).tolist()
    ]
