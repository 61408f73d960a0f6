"""What the leaves that share a detection become, and what the chosen ones of them say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gda_tracker.tracking.extraction import GroupMembers
from gda_tracker.tracking.group_update import put_states, updated_by_groups
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.mht.branches import Branches
from gda_tracker.tracking.mht.threes import EventsOfThree
from gda_tracker.vocabulary.arrays import Int32Array, IntArray
from gda_tracker.vocabulary.hypotheses import Associations
from gda_tracker.vocabulary.scans import Scan


def update_members(
    table: HypothesisTable,
    predicted: HypothesisTable,
    scan: Scan,
    branches: Branches,
    partner: IntArray,
) -> None:
    """Give the rows of a table (B,) that share a detection with ``partner`` (B, 2) their states."""
    shares = (partner[:, 0] >= 0) & (branches.detection >= 0)
    third = partner[:, 1] >= 0
    for rows, width in ((np.flatnonzero(shares & ~third), 1), (np.flatnonzero(shares & third), 2)):
        if len(rows):
            parent, partners = branches.parent[rows], partner[rows, :width]
            detection = branches.detection[rows].astype(np.int32)
            members = updated_by_groups(predicted, scan, parent, partners, detection)
            put_states(table, rows, members)


def decided_answer(
    associations: Associations,
    assigned: Int32Array,
    events: IntArray,
    threes: EventsOfThree,
) -> tuple[Associations, GroupMembers | None]:
    """The answer with what the chosen leaves have, and the members of groups of three.

    ``events`` are those of the chosen leaves, -1 for none; those of three come after those of the
    associations.
    """
    answer = replace(associations, assigned_detection=assigned)
    count = len(associations.group_first)
    if not (events >= 0).any():
        return answer, None
    answer.group_chosen = np.zeros(count, dtype=np.bool_)
    answer.group_chosen[events[(events >= 0) & (events < count)]] = True
    of_three = np.unique(events[events >= count]) - count
    of_three = of_three[threes.detection[of_three] >= 0]
    if not len(of_three):
        return answer, None
    return answer, GroupMembers(
        threes.rows[of_three].reshape(-1),
        np.repeat(threes.detection[of_three], 3),
        np.repeat(threes.log_likelihood[of_three], 3),
    )
