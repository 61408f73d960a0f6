"""Motion: a track has stopped, or it accelerates.

Both are told only of tracks that were found to do the usual before: a buoy that was never seen to
move has not stopped.
"""

from __future__ import annotations

import numpy as np

from gda_tracker.events.found import ACCELERATES, MOVES, STEADY, STOPPED, Finding
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

_STOP = test_columns(1)
_NEW_STOP = np.zeros((), dtype=_STOP)
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
    """Speeds of all tracks."""

    def __init__(self, parameters: EventParameters) -> None:
        self._parameters = parameters
        self._test = parameters.thresholds()
        self._rows = np.zeros(0, dtype=_STOP)

    def step(self, states: States) -> tuple[list[Finding], Decisions]:
        """Take the states of a scan."""
        rows = self._rows = aligned(self._rows, states.track_id, _NEW_STOP)
        due = np.flatnonzero(states.due)
        velocity = states.velocity[due]
        increments = stopped_increments(
            velocity,
            states.velocity_covariance()[due],
            self._parameters.stopped_speed_mps,
            self._parameters.moving_speed_mps,
        )
        before = rows["status"][due]
        decisions = advance(rows, due, increments, states.stamp_ns, self._test)
        speed = np.hypot(velocity[:, 0], velocity[:, 1])
        # What stands from the first is as if it had never been tested: else its first motion
        # would be told as the end of a stop.
        rows["status"][due[(decisions.verdict == H1) & (before == OPEN)]] = OPEN
        return _changes(due, before, decisions, speed, STOPPED, MOVES), decisions


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
