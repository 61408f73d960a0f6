"""Plans: does a track keep to the one it was given.

Koch (2014), section 1.3.6, takes a waypoint for an artificial measurement with the tolerance as its
error, and the association of plan and object for given. So it is here, but that the tolerance is a
bound and not a spread: an object may lie behind its plan by the same distance for an hour, and a
hundred independent errors do not describe that.
"""

from __future__ import annotations

import numpy as np

from gda_tracker.events.found import OFF_PLAN, ON_PLAN, Finding
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
    test_columns,
)
from gda_tracker.kinematics.context import Plan

_COLUMNS = test_columns(DIRECTION_COUNT)
_NEW = np.zeros((), dtype=_COLUMNS)


class PlanTest:
    """The plans and how far their tests are; a row for each track that has one."""

    def __init__(self, plans: tuple[Plan, ...], parameters: EventParameters) -> None:
        self._plans = plans
        self._track_id = np.array([plan.track_id for plan in plans], dtype=np.int64)
        self._test = parameters.thresholds()
        self._rows = np.zeros(0, dtype=_COLUMNS)

    def step(self, states: States) -> tuple[list[Finding], Decisions]:
        """Take the states of a scan."""
        rows = self._rows = aligned(self._rows, states.track_id, _NEW)
        which, plans, points, tolerances = [], [], [], []
        place = np.searchsorted(states.track_id, self._track_id)
        there = np.flatnonzero(place < len(rows))
        there = there[states.track_id[place[there]] == self._track_id[there]]
        for number in there[states.due[place[there]]].tolist():
            plan, row = self._plans[number], int(place[number])
            planned = plan.at(states.stamp_ns)
            if planned is None:
                continue
            which.append(row)
            plans.append(plan)
            points.append(planned[0])
            tolerances.append(planned[1])
        chosen = np.array(which, dtype=np.int64)
        departure = states.position[chosen] - np.reshape(points, (-1, 2))
        usual = np.array(tolerances)
        increments = departure_increments(
            departure,
            states.position_covariance()[chosen],
            usual,
            usual + [plan.margin_m for plan in plans],
        )
        before = rows["status"][chosen]
        decisions = advance(rows, chosen, increments, states.stamp_ns, self._test)
        news = (decisions.verdict != OPEN) & (decisions.verdict != before)
        return [
            Finding(
                {H0: ON_PLAN, H1: OFF_PLAN}[int(decisions.verdict[index])],
                which[index],
                index,
                float(np.hypot(*departure[index])),
                plans[index].name,
            )
            for index in np.flatnonzero(news).tolist()
        ], decisions
