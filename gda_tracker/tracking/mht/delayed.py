"""The past as the present sees it: tracks of the scan N scans ago.

Which detections a track had is read off the path to its chosen leaf; its states are retrodicted
along this path, from the present back (Koch 2014, 3.4).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.manager_state import ManagerState
from gda_tracker.tracking.mht.generations import Generation, path
from gda_tracker.vocabulary.arrays import IntArray
from gda_tracker.vocabulary.scans import ScanKey
from gda_tracker.vocabulary.tracks import Tracks

Tell = Callable[[HypothesisTable, ScanKey, IntArray, bool], Tracks]
"""Makes tracks of a table with one row for each, a key, deleted ids and ``degraded``."""
StepBack = Callable[[HypothesisTable, HypothesisTable, float], HypothesisTable]
"""Retrodicts a table by the one after it, row by row, over the time between them [s]."""
_STATE_FIELDS = ("mean", "covariance", "model_weight", "model_mean", "model_covariance")


def generation_of(state: ManagerState) -> Generation | None:
    """Nodes of the last closed scan; none but under ``mht``."""
    if state.last_key is None or not state.table.detection_numbers.shape[1]:
        return None
    settled = np.zeros(len(state.table), dtype=np.bool_)
    return Generation(state.last_key, state.table, settled, state.deleted_track_id, state.degraded)


def past_of(state: ManagerState) -> list[Generation]:
    """Return the generations up to the last closed scan, oldest first; none but under ``mht``.

    They are copies: to mark what has settled in them leaves the state as it is.
    """
    newest = generation_of(state)
    if newest is None:
        return []
    return [*(replace(generation) for generation in state.generations), newest]


def pass_on(
    past: Sequence[Generation],
    leaves: Generation,
    keep: int,
    tell: Tell,
    step_back: StepBack | None,
) -> tuple[list[Generation], list[Tracks]]:
    """Tell the past of the generations beyond the ``keep`` newest.

    Parameters
    ----------
    past
        Oldest first.
    leaves
        The scan after the newest of them; its chosen rows decide.
    keep
        Number of generations to keep.
    tell
        Makes the tracks.
    step_back
        Retrodicts the states; ``None`` leaves them as they were filtered.

    Returns
    -------
    kept, told
        The generations that stay, and the tracks of those that went, oldest first.
    """
    surplus = max(len(past) - keep, 0)
    if not surplus:
        return list(past), []
    later, chosen = leaves, leaves.table.select(leaves.table.chosen)
    rows = path(past, chosen.parent_id)
    told = []
    for place in range(len(past) - 1, -1, -1):
        generation = past[place]
        if place >= surplus and step_back is None:
            continue
        table = generation.table.select(rows[place])
        if step_back is not None:
            dt_s = (later.key.stamp_ns - generation.key.stamp_ns) / 1e9
            table = retrodicted(table, chosen, dt_s, step_back)
        if place < surplus:
            told.append(
                tell(table, generation.key, generation.deleted_track_id, generation.degraded)
            )
        later, chosen = generation, table
    return list(past[surplus:]), told[::-1]


def tell_all(state: ManagerState, tell: Tell, step_back: StepBack | None) -> list[Tracks]:
    """Tell the past of all scans that is still open, as the chosen leaves have it now."""
    newest = generation_of(state)
    if newest is None:
        return []
    told = pass_on(state.generations, newest, 0, tell, step_back)[1]
    chosen = newest.table.select(newest.table.chosen)
    return [*told, tell(chosen, newest.key, newest.deleted_track_id, newest.degraded)]


def retrodicted(
    table: HypothesisTable, later: HypothesisTable, dt_s: float, step_back: StepBack
) -> HypothesisTable:
    """The table with the states of those tracks that live in ``later`` retrodicted."""
    if not len(table) or not len(later):
        return table
    place = np.minimum(np.searchsorted(later.track_id, table.track_id), len(later) - 1)
    live = np.flatnonzero(later.track_id[place] == table.track_id)
    if len(live) == len(table) == len(later):
        return step_back(table, later, dt_s)
    found = step_back(table.select(live), later.select(place[live]), dt_s)
    mended = table.copy()
    for name in _STATE_FIELDS:
        values = getattr(table, name).copy()
        values[live] = getattr(found, name)
        setattr(mended, name, values)
    return mended
