"""Growth of the hypothesis trees by one scan: branch, decide, prune, compute what survives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gda_tracker.association.leaf_pruning import n_scan_decision
from gda_tracker.association.log_ratios import log_ratios
from gda_tracker.association.statements import statement_factors
from gda_tracker.tracking.answers import Inconsistent
from gda_tracker.tracking.blind_zone import apply_zone
from gda_tracker.tracking.existence import log_room
from gda_tracker.tracking.extended.updates import update_extents
from gda_tracker.tracking.extraction import GroupMembers, scan_increments
from gda_tracker.tracking.gaussian_sums import merge_components
from gda_tracker.tracking.history_window import remember
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.life import judge
from gda_tracker.tracking.manager_state import OpenScan
from gda_tracker.tracking.mht.branches import Branches, branch
from gda_tracker.tracking.mht.compounds import coupled_global_hypothesis
from gda_tracker.tracking.mht.couplings import (
    CoupledTracks,
    Couplings,
    held_rows,
    of_leaves,
    settle_couplings,
)
from gda_tracker.tracking.mht.generations import Generation, ancestors, rows_of
from gda_tracker.tracking.mht.members import decided_answer, update_members
from gda_tracker.tracking.mht.pruning import Nearness, leaves_in_all, merge
from gda_tracker.tracking.mht.shared_branches import SharedBranches, nothing_shared, share
from gda_tracker.tracking.mht.threes import no_events_of_three
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.tracking.signal_strength import update_strengths
from gda_tracker.tracking.state_update import count_detections, set_beliefs, update_states
from gda_tracker.tracking.statement_update import (
    heard_rows,
    update_heard_beliefs,
    update_heard_states,
)
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, Int32Array, IntArray
from gda_tracker.vocabulary.beliefs import AttributeScores, Evidence
from gda_tracker.vocabulary.hypotheses import Associations
from gda_tracker.vocabulary.tracks import CONFIRMED


@dataclass(slots=True)
class Growth:
    """The trees after a scan.

    ``table`` has the leaves that live, still without ids of their own; ``parent_id`` is set.
    A row's ``hypothesis_id`` is its place in ``couplings``. ``ended_track_id`` are the tracks that
    ended, ``ended_parent_id`` the parents of their last leaves, but for tracks whose detections
    have gone to others. ``assigned`` (H,) is the detection that the chosen leaves have given to the
    rows of the scan's predictions, -1 for none.
    """

    table: HypothesisTable
    ended_track_id: IntArray
    ended_parent_id: IntArray
    assigned: Int32Array
    couplings: Couplings


def grow(
    opened: OpenScan,
    generations: Sequence[Generation],
    evidence: Evidence | None,
    scores: AttributeScores | None,
    associations: Associations,
    first_number: int,
    parameters: TrackManagerParameters,
    couplings: Couplings,
) -> Growth:
    """Grow the trees by the scan that is open.

    Parameters
    ----------
    opened
        The scan and the leaves, predicted to its time.
    generations
        The last scans, oldest first, with the leaves' own nodes in the newest.
    evidence, scores, associations
        The stages' answers; the scores belong to the associations' pairs.
    first_number
        Running number of the scan's first detection.
    parameters
        Those of the scan.
    couplings
        Of the leaves.

    Raises
    ------
    Inconsistent
        For a log likelihood that is NaN or infinite.
    """
    pair_score, miss_score = log_ratios(
        associations.hypothesis,
        associations.detection,
        associations.kinematic_log_likelihood,
        None if scores is None else associations.attribute_log_likelihood,
        None if scores is None else scores.clutter_log_likelihood,
        opened.predictions.detection_probability,
        opened.predictions.settings.clutter_density,
    )
    idle = np.zeros(len(miss_score))
    if opened.scan.statements:
        said = statement_factors(
            opened.scan,
            opened.predictions,
            scores,
            associations.hypothesis,
            associations.detection,
        )
        if said is not None:
            idle = said.log_idle
            pair_score, miss_score = pair_score + said.log_pair, miss_score + idle
    wrong = ~(pair_score < np.inf)  # True for NaN
    if wrong.any():
        raise Inconsistent(
            f"associations: log likelihood ratio {pair_score[wrong][0]} of a pair: allowed are "
            "finite values and -inf"
        )
    branches = branch(
        opened.table,
        associations.hypothesis,
        associations.detection,
        pair_score,
        miss_score,
        first_number,
    )
    track = ranks(opened.table.track_id)
    shared = None
    if len(associations.group_first):
        shared = share(
            branches,
            opened.table,
            opened.scan,
            opened.predictions,
            associations,
            couplings,
            track,
            first_number,
            idle,
        )
    elif len(couplings):
        shared = nothing_shared(branches, opened.table, couplings, track)
    decided = decide(branches, opened.table, generations, parameters, shared)
    branches, chosen, room = decided.branches, decided.chosen, decided.log_room
    table = opened.table.select(branches.parent)
    table.chosen, table.log_score, table.log_room = chosen, branches.log_score, room
    table.detection_numbers = branches.detection_numbers[:, : parameters.mht_scans].copy()
    table.parent_id = opened.table.hypothesis_id[branches.parent]
    table.hypothesis_id = np.arange(len(table), dtype=np.int64)
    used = branches.detection.astype(np.int32)
    event = decided.event
    alone = np.where(event >= 0, -1, branches.detection).astype(np.int32)
    update_states(table, opened.scan, alone, parameters.use_range_rate)
    if shared is not None:
        update_members(table, opened.table, opened.scan, branches, decided.partner)
    apply_zone(table, opened, branches.parent, used >= 0, parameters)
    update_strengths(table, opened.scan, used, parameters.signal_threshold)
    if evidence is not None:
        table.use_frame(evidence.frame, evidence.class_names)
    if scores is not None:
        rows = np.flatnonzero(branches.pair >= 0)
        set_beliefs(table, scores, rows, branches.pair[rows])
        if evidence is not None:
            remember(table, evidence, rows.astype(np.int32), used[rows])
        update_heard_beliefs(table, scores, *heard_rows(scores, branches.parent, alone < 0))
    if opened.scan.statements:
        predicted = opened.table.select(branches.parent)
        update_heard_states(table, predicted, opened.scan.statements, scores is not None)
    merge_components(table, parameters)
    if opened.scan.cells is not None:
        predicted = opened.table.select(branches.parent)
        update_extents(table, predicted, opened.scan, used, parameters)
    count_detections(table, opened.scan, used)
    p = parameters
    if p.mht_merge_scans:
        nearness = Nearness(p.mht_merge_scans, p.mht_merge_distance**2, p.mht_merge_belief)
        table = merge(table, nearness, held_rows(decided.couplings, len(table)))
    assigned = np.full(len(opened.table), -1, dtype=np.int32)
    assigned[branches.parent[chosen]] = used[chosen]
    threes = no_events_of_three() if shared is None else shared.threes
    answer, of_three = decided_answer(associations, assigned, event[chosen], threes)
    return _live_and_end(opened, table, scores, answer, p, decided.couplings, of_three)


def coast(
    opened: OpenScan,
    generations: Sequence[Generation],
    parameters: TrackManagerParameters,
    couplings: Couplings,
) -> tuple[HypothesisTable, Couplings]:
    """Return the leaves after a scan of which nothing is known: predicted, nothing counted.

    Ids and couplings are those of :class:`Growth`.
    """
    table = opened.table.copy()
    none = np.zeros(0, dtype=np.int32)
    branches = branch(table, none, none, np.zeros(0), np.zeros(len(table)), 0)
    shared = None
    if len(couplings):
        shared = nothing_shared(branches, table, couplings, ranks(table.track_id))
    decided = decide(branches, table, generations, parameters, shared)
    branches = decided.branches
    table = table.select(branches.parent)
    table.chosen, table.log_score = decided.chosen, branches.log_score
    table.log_room = decided.log_room
    table.parent_id = table.hypothesis_id
    table.hypothesis_id = np.arange(len(table), dtype=np.int64)
    table.detection_numbers = branches.detection_numbers[:, : parameters.mht_scans].copy()
    table.detection_index = np.full(len(table), -1, dtype=np.int64)
    return table, decided.couplings


@dataclass(frozen=True, slots=True)
class Decided:
    """The branches that stay.

    ``chosen`` (B,) are in the best global hypothesis; ``log_room`` (B,) is how much room the other
    tracks leave the branch's one (:func:`~gda_tracker.tracking.existence.log_room`); ``partner``,
    ``event`` as in :class:`~gda_tracker.tracking.mht.shared_branches.SharedBranches`, and the
    couplings of the branches by their places.
    """

    branches: Branches
    chosen: BoolArray
    log_room: FloatArray
    partner: IntArray
    event: IntArray
    couplings: Couplings


def decide(
    branches: Branches,
    table: HypothesisTable,
    generations: Sequence[Generation],
    parameters: TrackManagerParameters,
    shared: SharedBranches | None = None,
) -> Decided:
    """Find the best global hypothesis of the branches and prune what is not worth keeping."""
    none = np.full((len(branches), 2), -1, dtype=np.int64)
    partner, event, coupled = none, none[:, 0], list[CoupledTracks]()
    if shared is not None:
        branches, coupled = shared.branches, shared.coupled
        partner, event = shared.partner, shared.event
    if not len(branches):
        nobody = np.zeros(0, dtype=np.bool_)
        return Decided(branches, nobody, np.zeros(0), partner, event, Couplings())
    p = parameters
    track = ranks(branches.track_id)
    mandatory = np.zeros(track[-1] + 1, dtype=np.bool_)
    mandatory[track] = table.status[branches.parent] == CONFIRMED
    score = branches.log_score + _ground(branches.log_score, track, mandatory)
    optional = np.flatnonzero(~mandatory)
    chosen, probability, absent = coupled_global_hypothesis(
        score, track, branches.detection_numbers, optional, coupled
    )
    room = np.zeros(len(mandatory))
    room[optional] = log_room(score, track, optional, absent)
    if len(generations) >= p.mht_scans:
        root = ancestors(table.hypothesis_id, generations[-p.mht_scans :])[0][branches.parent]
    else:
        root = np.full(len(branches), -1, dtype=np.int64)
    found = np.zeros(len(mandatory), dtype=np.bool_)
    found[track[chosen]] = True
    keep = found[track] & n_scan_decision(
        chosen,
        track,
        root[:, None],
        probability=probability,
        min_probability=p.mht_leaf_probability,
        max_leaves=leaves_in_all(p.mht_leaves_per_track, p.mht_max_leaves, len(mandatory)),
    )
    return Decided(
        branches.select(keep),
        chosen[keep],
        room[track[keep]],
        partner[keep],
        event[keep],
        of_leaves(coupled, track, keep, branches.detection_numbers[:, : p.mht_scans]),
    )


def ranks(track_id: IntArray) -> IntArray:
    """Rank (L,) of each leaf's track, 0 to T - 1; leaves of a track stand one after the other."""
    new = np.empty(len(track_id), dtype=np.bool_)
    new[:1] = True
    np.not_equal(track_id[1:], track_id[:-1], out=new[1:])
    return np.cumsum(new) - 1


def _ground(log_score: FloatArray, track: IntArray, mandatory: BoolArray) -> FloatArray:
    """What lifts tentative tracks (L,) to a score of zero at least.

    A track whose evidence is still against it may go on to collect more as long as no other track
    needs its detections; M-of-N ends it.
    """
    best = np.full(len(mandatory), -np.inf)
    np.maximum.at(best, track, log_score)
    lift = np.where(mandatory, 0.0, np.maximum(-best, 0.0) + 1e-9)
    return lift[track]


def _live_and_end(
    opened: OpenScan,
    table: HypothesisTable,
    scores: AttributeScores | None,
    decided: Associations,
    p: TrackManagerParameters,
    couplings: Couplings,
    of_three: GroupMembers | None,
) -> Growth:
    """Confirm and end tracks by what their chosen leaves have seen; all leaves share the status."""
    before = opened.table
    leaders, track = np.flatnonzero(table.chosen), ranks(table.track_id)
    leading = table.select(leaders)
    parents = rows_of(before.hypothesis_id, leading.parent_id)
    density = opened.clutter_density

    def increments() -> FloatArray:
        return scan_increments(opened.predictions, scores, decided, density, of_three)[parents]

    gone = judge(leading, increments, p, opened.scan.key.stamp_ns)
    table.status = leading.status[track]
    table.log_likelihood_ratio = leading.log_likelihood_ratio[track]
    if gone.any():
        # What ends keeps its detections: no other track may turn out to have had them.
        kept = leading.detection_numbers[gone]
        used_up = np.isin(table.detection_numbers, kept[kept >= 0])
        taken: BoolArray = np.logical_or.reduce(used_up, axis=1)
        if len(couplings):
            taken = settle_couplings(table, couplings, gone[track], taken)
        table = table.select(~gone[track] & (table.chosen | ~taken))
    # The global hypothesis has no room for some: they end too, and leave no past.
    left = before.chosen & ~np.isin(before.track_id, table.track_id)
    return Growth(
        table,
        before.track_id[left],
        leading.parent_id[gone],
        decided.assigned_detection,
        couplings,
    )
