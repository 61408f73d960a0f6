"""Splits: has a new track departed from another.

A track that begins within the neighbourhood of a confirmed one is watched: where the distance
between them comes to exceed a bound, the one split off from the other. Not told apart from a
target that happens to appear there; what appears far from all others is never told.
"""

from __future__ import annotations

import numpy as np

from gda_tracker.events.found import SPLIT_OFF, Finding
from gda_tracker.events.parameters import EventParameters
from gda_tracker.events.samples import States, memory_s, wait_ns
from gda_tracker.events.sequential import (
    DIRECTION_COUNT,
    H1,
    Decisions,
    advance,
    departure_increments,
    test_columns,
)
from gda_tracker.vocabulary.arrays import BoolArray, IntArray

_COLUMNS = test_columns(
    DIRECTION_COUNT, ("parent", np.int64), ("until_ns", np.int64), ("next_ns", np.int64)
)


class SplitTest:
    """New tracks near others, and how far their tests are."""

    def __init__(self, parameters: EventParameters) -> None:
        self._parameters = parameters
        self._test = parameters.thresholds()
        self._rows = np.zeros(0, dtype=_COLUMNS)
        self._known: IntArray | None = None

    def watched(self) -> tuple[IntArray, IntArray]:
        """Return the tracks that are watched, and beside which track each of them began."""
        return self._rows["track_id"].copy(), self._rows["parent"].copy()

    def step(
        self, states: States, confirmed: BoolArray, track_id: IntArray
    ) -> tuple[list[Finding], Decisions]:
        """Take the states of a scan, of tentative tracks too.

        Parameters
        ----------
        states
            Of all tracks.
        confirmed
            (N,) which of them are.
        track_id
            (M,) of all tracks, of those that cannot be tested too.
        """
        self._drop(states)
        findings, decisions = self._advance(states, confirmed)
        if self._known is not None:
            self._watch(states, confirmed, np.isin(states.track_id, self._known))
        # Ids are never used again: what is not here any more need not be remembered.
        self._known = np.array(track_id)
        return findings, decisions

    def _drop(self, states: States) -> None:
        rows = self._rows
        alive = np.isin(rows["track_id"], states.track_id) & np.isin(
            rows["parent"], states.track_id
        )
        self._rows = rows[alive & (rows["until_ns"] >= states.stamp_ns)]

    def _watch(self, states: States, confirmed: BoolArray, known: BoolArray) -> None:
        born, old = np.flatnonzero(~known), np.flatnonzero(known & confirmed)
        if not len(born) or not len(old):
            return
        apart = states.position[born, None, :] - states.position[None, old, :]
        distance = np.hypot(apart[..., 0], apart[..., 1])
        nearest = np.argmin(distance, axis=1)
        near = distance[np.arange(len(born)), nearest] <= self._parameters.split_radius_m
        rows = np.zeros(int(near.sum()), dtype=_COLUMNS)
        rows["track_id"] = states.track_id[born[near]]
        rows["parent"] = states.track_id[old[nearest[near]]]
        watch_ns = round(self._parameters.split_watch_s * 1e9)
        rows["until_ns"] = states.stamp_ns + watch_ns
        rows["next_ns"] = np.iinfo(np.int64).min
        self._rows = np.concatenate([self._rows, rows])

    def _advance(self, states: States, confirmed: BoolArray) -> tuple[list[Finding], Decisions]:
        rows = self._rows
        child = np.searchsorted(states.track_id, rows["track_id"])
        parent = np.searchsorted(states.track_id, rows["parent"])
        due = (
            (rows["next_ns"] <= states.stamp_ns)
            & confirmed[child]
            & states.detected[child]
            & states.detected[parent]
        )
        which = np.flatnonzero(due)
        child, parent = child[due], parent[due]
        covariance = states.covariance
        memory = np.maximum(memory_s(covariance[child]), memory_s(covariance[parent]))
        rows["next_ns"][which] = states.stamp_ns + wait_ns(
            memory, self._parameters.independence_factor
        )
        apart = states.position[child] - states.position[parent]
        together = states.position_covariance()[child] + states.position_covariance()[parent]
        increments = departure_increments(
            apart,
            together,
            self._parameters.split_radius_m,
            np.asarray(self._parameters.split_departure_m),
        )
        decisions = advance(rows, which, increments, states.stamp_ns, self._test)
        split = np.flatnonzero(decisions.verdict == H1)
        findings = [
            Finding(
                SPLIT_OFF,
                int(child[index]),
                index,
                float(np.hypot(*apart[index])),
                other_track_id=int(rows["parent"][which[index]]),
            )
            for index in split.tolist()
        ]
        self._rows = np.delete(rows, which[split])
        return findings, decisions
