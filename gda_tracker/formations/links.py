"""Which tracks fly together: a sequential test for each pair of them, in place and velocity.

h0, together: distance and difference of velocities are no larger than ``together_distance_m`` and
``together_speed_mps``; h1, apart: one of them is at least ``apart_distance_m`` or
``apart_speed_mps``. The bounds, the directions and the states that may be taken as independent are
those of :mod:`gda_tracker.events`. A pair is linked from h0 accepted to h1 accepted: between the
bounds, and until the next decision, it stays what it was. Formations are the connected parts.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from gda_tracker.events.samples import States, memory_s, wait_ns
from gda_tracker.events.sequential import (
    DIRECTION_COUNT,
    H0,
    OPEN,
    advance,
    departure_increments,
    test_columns,
)
from gda_tracker.formations.parameters import FormationParameters
from gda_tracker.vocabulary.arrays import BoolArray, IntArray

# track_id is the lower id of the pair.
_COLUMNS = test_columns(
    2 * DIRECTION_COUNT, ("other", np.int64), ("next_ns", np.int64), ("patience_ns", np.int64)
)
_AT_ONCE = np.iinfo(np.int64).min
# New tracks wait for the word on their neighbours, but not for one that is no longer detected: so
# many times as long as from one independent state (or scan, if longer) to the next.
PATIENCE = 3


class PairLinks:
    """Tests of all pairs of tracks that are, or were, near each other."""

    def __init__(self, parameters: FormationParameters) -> None:
        self._parameters = parameters
        self._test = parameters.pair_test()
        self._rows = np.zeros(0, dtype=_COLUMNS)
        self._last_ns: int | None = None
        self._period_ns = 0

    def __len__(self) -> int:
        return len(self._rows)

    def step(self, states: States) -> None:
        """Take the confirmed tracks of a scan, by rising id."""
        if self._last_ns is not None:
            self._period_ns = max(states.stamp_ns - self._last_ns, self._period_ns)
        self._last_ns = states.stamp_ns
        rows, ids = self._rows, states.track_id
        rows = rows[np.isin(rows["track_id"], ids) & np.isin(rows["other"], ids)]
        rows = np.concatenate([rows, self._new(states, rows)])
        first = np.searchsorted(ids, rows["track_id"])
        second = np.searchsorted(ids, rows["other"])
        due = (
            (rows["next_ns"] <= states.stamp_ns) & states.detected[first] & states.detected[second]
        )
        which = np.flatnonzero(due)
        a, b = first[which], second[which]
        memory = np.maximum(memory_s(states.covariance[a]), memory_s(states.covariance[b]))
        wait = wait_ns(memory, self._parameters.independence_factor)
        rows["next_ns"][which] = states.stamp_ns + wait
        rows["patience_ns"][which] = self._patience(states.stamp_ns, wait)
        p = self._parameters
        in_place = departure_increments(
            states.position[a] - states.position[b],
            states.position_covariance()[a] + states.position_covariance()[b],
            p.together_distance_m,
            np.asarray(p.apart_distance_m),
        )
        in_velocity = departure_increments(
            states.velocity[a] - states.velocity[b],
            states.velocity_covariance()[a] + states.velocity_covariance()[b],
            p.together_speed_mps,
            np.asarray(p.apart_speed_mps),
        )
        increments = np.concatenate([in_place, in_velocity], axis=1)
        advance(rows, which, increments, states.stamp_ns, self._test)
        # Who is not linked is forgotten as soon as it is far off.
        gap = states.position[first] - states.position[second]
        near = np.hypot(gap[:, 0], gap[:, 1]) <= p.apart_distance_m
        self._rows = rows[(rows["status"] == H0) | near]

    def _new(self, states: States, rows: np.ndarray) -> np.ndarray:
        """Return rows of pairs that are near and not yet watched."""
        x = states.position
        gap = x[:, None, :] - x[None, :, :]
        near = np.hypot(gap[..., 0], gap[..., 1]) <= self._parameters.apart_distance_m
        near[
            np.searchsorted(states.track_id, rows["track_id"]),
            np.searchsorted(states.track_id, rows["other"]),
        ] = False
        first, second = np.nonzero(np.triu(near, 1))
        new = np.zeros(len(first), dtype=_COLUMNS)
        new["track_id"], new["other"] = states.track_id[first], states.track_id[second]
        new["next_ns"] = _AT_ONCE
        memory = memory_s(states.covariance)
        longest = np.maximum(memory[first], memory[second])
        wait = wait_ns(longest, self._parameters.independence_factor)
        new["patience_ns"] = self._patience(states.stamp_ns, wait)
        return new

    def _patience(self, stamp_ns: int, wait: IntArray) -> IntArray:
        """Until when (n,) a pair that has a state now is waited for."""
        return stamp_ns + PATIENCE * np.maximum(wait, self._period_ns)

    def groups(self, track_id: IntArray) -> IntArray:
        """Label (T,) of the formation of each of the confirmed tracks, by rising id."""
        linked = self._rows[self._rows["status"] == H0]
        a = np.searchsorted(track_id, linked["track_id"])
        b = np.searchsorted(track_id, linked["other"])
        count = len(track_id)
        graph = coo_array((np.ones(len(a)), (a, b)), shape=(count, count))
        _, label = connected_components(graph, directed=False)
        return np.asarray(label, dtype=np.int64)

    def undecided(self, track_id: IntArray, stamp_ns: int) -> BoolArray:
        """Whether (T,) a test of a track with a neighbour is to say something soon."""
        rows = self._rows
        fresh = rows[(rows["status"] == OPEN) & (rows["patience_ns"] >= stamp_ns)]
        named = np.concatenate([fresh["track_id"], fresh["other"]])
        return np.isin(track_id, named)
