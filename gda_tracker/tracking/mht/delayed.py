"""The past as the present sees it: tracks of the scan N scans ago."""

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


def past_of(state: ManagerState) -> list[Generation]:
    """Return the generations up to the last closed scan, oldest first; none but under ``mht``.

    They are copies: to mark what has settled in them leaves the state as it is.
    """
    if state.last_key is None or not state.table.detection_numbers.shape[1]:
        return []
    nothing = np.zeros(len(state.table), dtype=np.bool_)
    newest = Generation(
        state.last_key, state.table, nothing, state.deleted_track_id, state.degraded
    )
    return [*(replace(generation) for generation in state.generations), newest]


def pass_on(
    generations: Sequence[Generation], parent_id: IntArray, keep: int, tell: Tell
) -> tuple[list[Generation], list[Tracks]]:
    """Tell the past of the generations beyond the ``keep`` newest.

    ``parent_id`` (T,) are the parents of the chosen leaves, in the newest of the generations.

    Returns
    -------
    kept, told
        The generations that stay, and the tracks of those that went, oldest first.
    """
    surplus = max(len(generations) - keep, 0)
    if not surplus:
        return list(generations), []
    rows = path(generations, parent_id)
    told = [
        tell(g.table.select(spoken), g.key, g.deleted_track_id, g.degraded)
        for g, spoken in zip(generations[:surplus], rows, strict=False)
    ]
    return list(generations[surplus:]), told


def tell_all(state: ManagerState, tell: Tell) -> list[Tracks]:
    """Tell the past of all scans that is still open, as the chosen leaves have it now."""
    generations = past_of(state)
    chosen = state.table.hypothesis_id[state.table.chosen]
    return pass_on(generations, chosen, 0, tell)[1]
