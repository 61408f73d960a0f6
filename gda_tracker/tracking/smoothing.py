"""Fixed-interval smoothing of a whole recording: every state in the light of all that came later.

``tracks_delayed`` looks N scans ahead, under ``mht`` alone; this looks to the end of each track,
whatever decides. It keeps the hypotheses of every scan, so it is for recordings, not for the nodes.

A track's past is the path to its last leaf: under ``mht`` also its detections are those that turned
out right. The step back is that of the filter (Koch 2014, 3.4), of the mixture by its moments where
a decision mixes (``jpda``).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.manager import TrackManager
from gda_tracker.tracking.mht.delayed import retrodicted
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.tracking.state_retrodiction import retrodict_states
from gda_tracker.tracking.track_output import tracks_of
from gda_tracker.vocabulary.arrays import IntArray
from gda_tracker.vocabulary.scans import ScanKey
from gda_tracker.vocabulary.tracks import Tracks


@dataclass(frozen=True, slots=True)
class _Closed:
    """What the manager held after a scan; the parameters are those of the step to it."""

    key: ScanKey
    table: HypothesisTable
    deleted_track_id: IntArray
    degraded: bool
    parameters: TrackManagerParameters
    system_uuid: bytes


class Smoother:
    """Keeps what the track manager holds after each scan, and smooths it in the end."""

    def __init__(self) -> None:
        self._closed: list[_Closed] = []

    def add(self, manager: TrackManager) -> None:
        """Keep the state after a scan; to be called after each one."""
        state = manager.state
        assert state.last_key is not None, "no scan has been closed"
        self._closed.append(
            _Closed(
                state.last_key,
                state.table,
                state.deleted_track_id,
                state.degraded,
                manager.parameters,
                manager.system_uuid,
            )
        )

    def tracks(self) -> list[Tracks]:
        """Smoothed tracks after each scan, in the order of the scans.

        A track that ended keeps the past that its last leaf had.
        """
        told: list[Tracks] = []
        later: _Closed | None = None
        smoothed = HypothesisTable()
        for closed in reversed(self._closed):
            table = closed.table.select(_rows(closed.table, smoothed))
            if later is not None:
                dt_s = (later.key.stamp_ns - closed.key.stamp_ns) / 1e9
                step_back = partial(retrodict_states, parameters=later.parameters)
                table = retrodicted(table, smoothed, dt_s, step_back)
            told.append(
                tracks_of(
                    table,
                    closed.key,
                    closed.parameters.tracking_frame,
                    closed.system_uuid,
                    closed.deleted_track_id,
                    closed.degraded,
                    closed.parameters.signal_threshold,
                )
            )
            later, smoothed = closed, table
        return told[::-1]


def _rows(table: HypothesisTable, later: HypothesisTable) -> IntArray:
    """Rows by rising track id: on the path of the tracks that go on, chosen of the rest."""
    # In trees every row is new and names its parent; else a hypothesis keeps its id.
    same = np.isin(later.hypothesis_id, table.hypothesis_id)
    wanted = np.where(same, later.hypothesis_id, later.parent_id)
    rows = np.flatnonzero(np.isin(table.hypothesis_id, wanted))
    going = table.track_id[rows]
    ended = np.flatnonzero(table.chosen & ~np.isin(table.track_id, going))
    both = np.concatenate([rows, ended])
    return both[np.argsort(table.track_id[both], kind="stable")]
