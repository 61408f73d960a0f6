"""Lanes: does a track keep to its own.

A track is taken to be on a lane from a state that lies in it and moves along it; the test begins
with the next, so that the choice does not speak in it. It *leaves* only what it was found to keep:
what merely passes over a lane is forgotten in silence, and counted.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

import numpy as np

from gda_tracker.events.found import KEEPS_LANE, LEAVES_LANE, WRONG_WAY, Finding
from gda_tracker.events.parameters import EventParameters
from gda_tracker.events.samples import States
from gda_tracker.events.sequential import (
    H0,
    H1,
    OPEN,
    Decisions,
    advance,
    aligned,
    bound_increments,
    test_columns,
)
from gda_tracker.kinematics.context import LaneMap, LanePlaces
from gda_tracker.vocabulary.arrays import FloatArray, IntArray

LEFT, RIGHT, BACKWARD = range(3)
_COLUMNS = test_columns(3, ("lane", np.int64))
_NEW = np.zeros((), dtype=_COLUMNS)
_NEW["lane"] = -1
# A heading is known where the speed is so many of its standard deviations.
_KNOWN_HEADING = 3.0


class LaneTest:
    """The lanes of all tracks and how far their tests are."""

    def __init__(self, lanes: LaneMap, parameters: EventParameters) -> None:
        self._map = lanes
        self._parameters = parameters
        self._test = parameters.thresholds()
        self._rows = np.zeros(0, dtype=_COLUMNS)
        self.counters: Counter[str] = Counter()

    def step(self, states: States) -> tuple[list[Finding], Decisions]:
        """Take the states of a scan."""
        rows = self._rows = aligned(self._rows, states.track_id, _NEW)
        due = np.flatnonzero(states.due)
        unassigned = due[rows["lane"][due] < 0]
        on_lane = due[rows["lane"][due] >= 0]
        places = self._map.on_lane(states.position[on_lane], rows["lane"][on_lane])
        self._forget(rows, on_lane[places.beyond])
        which = on_lane[~places.beyond]
        places = _chosen(places, ~places.beyond)
        before = rows["status"][which]
        decisions = advance(
            rows, which, self._increments(states, which, places), states.stamp_ns, self._test
        )
        findings = self._findings(states, which, places, before, decisions)
        left = (decisions.verdict == H1) & (decisions.side != BACKWARD)
        self._forget(rows, which[left])
        self.counters["passed_over_a_lane"] += int(np.count_nonzero(left & (before == OPEN)))
        self._assign(states, unassigned)
        return findings, decisions

    def lane_of(self, track_id: IntArray) -> IntArray:
        """Lane (N,) that each track is on, -1 for none."""
        lanes: IntArray = aligned(self._rows, track_id, _NEW)["lane"]
        return lanes

    def _increments(self, states: States, which: IntArray, places: LanePlaces) -> FloatArray:
        half, margin = self._map.half_width[places.lane], self._map.margin[places.lane]
        across = _variance(places.normal, states.position_covariance()[which])
        backward = -np.einsum("ni,ni->n", states.velocity[which], places.along)
        wrong_way = bound_increments(
            backward,
            _variance(places.along, states.velocity_covariance()[which]),
            0.0,
            self._parameters.wrong_way_speed_mps,
        )
        sides = [
            bound_increments(places.offset_m, across, half, half + margin),
            bound_increments(-places.offset_m, across, half, half + margin),
            # Where both directions are allowed this side never speaks.
            np.where(self._map.one_way[places.lane], wrong_way, -np.inf),
        ]
        return np.stack(sides, axis=-1)

    def _findings(
        self,
        states: States,
        which: IntArray,
        places: LanePlaces,
        before: IntArray,
        decisions: Decisions,
    ) -> list[Finding]:
        found = []
        for index in np.flatnonzero(decisions.verdict != OPEN).tolist():
            row, value = int(which[index]), float(places.offset_m[index])
            if decisions.verdict[index] == H0:
                if before[index] == H0:
                    continue
                kind = KEEPS_LANE
            elif decisions.side[index] == BACKWARD:
                if before[index] == H1:
                    continue
                kind = WRONG_WAY
                value = float(states.velocity[row] @ places.along[index])
            elif before[index] == OPEN:
                continue
            else:
                kind = LEAVES_LANE
            name = self._map.lanes[int(places.lane[index])].name
            found.append(Finding(kind, row, index, value, name))
        return found

    def _assign(self, states: States, which: IntArray) -> None:
        velocity = states.velocity[which]
        spread = np.trace(states.velocity_covariance()[which], axis1=1, axis2=2)
        known = np.einsum("ni,ni->n", velocity, velocity) > _KNOWN_HEADING**2 * spread
        self._rows["lane"][which] = self._map.lane_of(
            states.position[which],
            velocity,
            known,
            math.cos(self._parameters.lane_heading_tolerance_rad),
        )

    @staticmethod
    def _forget(rows: Any, which: IntArray) -> None:
        kept = rows["track_id"][which]
        rows[which] = _NEW
        rows["track_id"][which] = kept


def _chosen(places: LanePlaces, which: Any) -> LanePlaces:
    return LanePlaces(
        places.lane[which],
        places.offset_m[which],
        places.normal[which],
        places.along[which],
        places.beyond[which],
    )


def _variance(direction: FloatArray, covariance: FloatArray) -> FloatArray:
    variance: FloatArray = np.einsum("ni,nij,nj->n", direction, covariance, direction)
    return variance
