"""Closing a scan: what the decision makes of the hypotheses, scan by scan or in trees."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np

from gda_tracker.association.choices import JPDA
from gda_tracker.tracking.births import begin_tracks
from gda_tracker.tracking.blind_zone import apply_zone, count_blind, zone_of
from gda_tracker.tracking.clutter import clutter_after
from gda_tracker.tracking.detection_map import detection_map_after
from gda_tracker.tracking.extended.updates import update_extents, update_extents_by_marginals
from gda_tracker.tracking.extraction import scan_increments
from gda_tracker.tracking.gaussian_sums import merge_components
from gda_tracker.tracking.group_update import assigned_alone, update_chosen_groups
from gda_tracker.tracking.history_window import remember
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.initiation import StartPoints
from gda_tracker.tracking.jpda_update import update_by_marginals
from gda_tracker.tracking.life import judge
from gda_tracker.tracking.manager_state import ManagerState, OpenScan
from gda_tracker.tracking.measurement_clutter import measurement_clutter_after
from gda_tracker.tracking.mht.couplings import Couplings
from gda_tracker.tracking.mht.delayed import past_of
from gda_tracker.tracking.mht.generations import Generation, settle
from gda_tracker.tracking.mht.growth import coast, grow
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.tracking.signal_strength import update_strengths, update_strengths_by_marginals
from gda_tracker.tracking.state_update import count_detections, update_beliefs, update_states
from gda_tracker.tracking.statement_update import (
    heard_rows,
    update_heard_beliefs,
    update_heard_states,
)
from gda_tracker.vocabulary.arrays import Int32Array, IntArray
from gda_tracker.vocabulary.beliefs import AttributeScores, Evidence
from gda_tracker.vocabulary.hypotheses import Associations

MHT = "mht"
TRACKED, DEGRADED, GAVE_UP = "tracked", "degraded", "gave_up"


@dataclass(slots=True)
class ClosedScan:
    """What a scan leaves: hypotheses, start points, tracks that ended, and how it was answered.

    ``assigned`` (H,) is the detection that each hypothesis of the scan's predictions was given by
    those that speak for the tracks now, -1 for none. ``past`` are the trees' generations before
    the scan; none but under ``mht``.
    """

    table: HypothesisTable
    points: StartPoints
    deleted_track_id: IntArray
    outcome: str
    assigned: Int32Array
    past: list[Generation] = field(default_factory=list)


def close_by_decision(
    opened: OpenScan,
    evidence: Evidence | None,
    scores: AttributeScores | None,
    associations: Associations,
    state: ManagerState,
    parameters: TrackManagerParameters,
    counters: Counter[str],
) -> ClosedScan:
    """Apply the decision on an open scan; ids and clutter of the state move on.

    Raises
    ------
    Inconsistent
        For a log likelihood that is NaN or infinite; nothing has changed then.
    """
    parameters = parameters.of_sensor(opened.scan.key.sensor_id)
    if opened.predictions.settings.attribute_term == "none":
        # The attribute was not asked: tracks carry no belief about it.
        evidence = scores = None
    outcome = DEGRADED if associations.degraded else TRACKED
    if associations.degraded:
        scores = None
    close = _close_trees if opened.predictions.settings.decision == MHT else _close_single
    closed = close(opened, evidence, scores, associations, state, parameters, counters)
    closed.outcome = outcome
    return closed


def close_unanswered(
    opened: OpenScan, state: ManagerState, parameters: TrackManagerParameters
) -> ClosedScan:
    """Close a scan without an answer: tracks are predicted, no miss counts."""
    past: list[Generation] = []
    if opened.predictions.settings.decision == MHT:
        past = [] if opened.started else past_of(state)
        table = _renamed(*coast(opened, past, parameters, state.couplings), state)
    else:
        table, state.couplings = opened.table.copy(), Couplings()
        table.detection_index = np.full(len(table), -1, dtype=np.int64)
    merge_components(table, parameters)
    points = StartPoints() if opened.started else state.points
    none = np.full(len(opened.table), -1, dtype=np.int32)
    return ClosedScan(table, points, opened.ended_track_id, GAVE_UP, none, past)


def _close_single(
    opened: OpenScan,
    evidence: Evidence | None,
    scores: AttributeScores | None,
    associations: Associations,
    state: ManagerState,
    parameters: TrackManagerParameters,
    counters: Counter[str],
) -> ClosedScan:
    """Close the open scan with one hypothesis for each track."""
    p, table = parameters, opened.table.copy()
    if len(state.couplings):
        state.couplings = Couplings()
    assigned = associations.assigned_detection
    if evidence is not None:
        table.use_frame(evidence.frame, evidence.class_names)
    if associations.decision == JPDA:
        if scores is not None:
            every = np.arange(len(scores.updated_hypothesis))
            update_heard_beliefs(table, scores, scores.updated_hypothesis.astype(np.int64), every)
        zone = zone_of(opened.scan, p)
        update_by_marginals(table, opened.scan, scores, associations, p.use_range_rate, zone)
        count_blind(table, opened, np.arange(len(table)), assigned >= 0, zone)
        update_strengths_by_marginals(table, opened.scan, associations, p.signal_threshold)
    else:
        single = assigned_alone(associations)
        update_states(table, opened.scan, single, p.use_range_rate)
        update_chosen_groups(table, opened.table, opened.scan, associations)
        apply_zone(table, opened, np.arange(len(table)), assigned >= 0, p)
        update_strengths(table, opened.scan, assigned, p.signal_threshold)
        if scores is not None:
            update_beliefs(table, scores, associations.chosen)
            update_heard_beliefs(
                table, scores, *heard_rows(scores, np.arange(len(table)), single < 0)
            )
    if opened.scan.statements:
        update_heard_states(
            table, opened.table, opened.scan.statements, with_classes=scores is not None
        )
    merge_components(table, p)
    if opened.scan.cells is not None and associations.decision == JPDA:
        update_extents_by_marginals(table, opened.table, opened.scan, associations, p)
    elif opened.scan.cells is not None:
        update_extents(table, opened.table, opened.scan, assigned, p)
    if scores is not None and evidence is not None:
        taken = np.flatnonzero(associations.chosen)
        remember(table, evidence, scores.hypothesis[taken], scores.detection[taken])

    count_detections(table, opened.scan, assigned)
    density = opened.clutter_density
    gone = judge(
        table,
        lambda: scan_increments(opened.predictions, scores, associations, density),
        p,
        opened.scan.key.stamp_ns,
    )
    state.clutter = clutter_after(state.clutter, opened.scan, table.status, assigned, p)
    state.measurement_clutter = measurement_clutter_after(
        state.measurement_clutter, opened.scan, table.status, assigned, p
    )
    state.looks = detection_map_after(state.looks, opened, associations, assigned, p)
    deleted = np.concatenate([opened.ended_track_id, table.track_id[gone]])
    if gone.any():
        table = table.select(~gone)
    table, points = _begin_tracks(opened, table, associations, evidence, state, p, counters)
    return ClosedScan(table, points, deleted, TRACKED, assigned)


def _close_trees(
    opened: OpenScan,
    evidence: Evidence | None,
    scores: AttributeScores | None,
    associations: Associations,
    state: ManagerState,
    parameters: TrackManagerParameters,
    counters: Counter[str],
) -> ClosedScan:
    """Close the open scan by growing the hypothesis trees."""
    past = [] if opened.started else past_of(state)
    growth = grow(
        opened,
        past,
        evidence,
        scores,
        associations,
        state.next_detection_number,
        parameters,
        state.couplings,
    )
    settle(past, growth.ended_parent_id)
    table = _renamed(growth.table, growth.couplings, state)
    deleted = np.concatenate([opened.ended_track_id, growth.ended_track_id])
    decided = replace(associations, assigned_detection=growth.assigned)
    state.clutter = clutter_after(
        state.clutter, opened.scan, opened.table.status, growth.assigned, parameters
    )
    state.measurement_clutter = measurement_clutter_after(
        state.measurement_clutter,
        opened.scan,
        opened.table.status,
        growth.assigned,
        parameters,
    )
    state.looks = detection_map_after(
        state.looks, opened, associations, growth.assigned, parameters
    )
    table, points = _begin_tracks(opened, table, decided, evidence, state, parameters, counters)
    return ClosedScan(table, points, deleted, TRACKED, growth.assigned, past)


def _renamed(table: HypothesisTable, couplings: Couplings, state: ManagerState) -> HypothesisTable:
    """Give every row an id of its own, and the couplings these ids."""
    first, places = state.next_hypothesis_id, table.hypothesis_id
    state.next_hypothesis_id = first + len(table)
    table.hypothesis_id = np.arange(first, first + len(table), dtype=np.int64)
    state.couplings = couplings.renamed(places, table.hypothesis_id)
    return table


def _begin_tracks(
    opened: OpenScan,
    table: HypothesisTable,
    associations: Associations,
    evidence: Evidence | None,
    state: ManagerState,
    parameters: TrackManagerParameters,
    counters: Counter[str],
) -> tuple[HypothesisTable, StartPoints]:
    """Append what starts from the unassigned detections, as far as there is room."""
    grown, points, refused = begin_tracks(opened, table, associations, evidence, state, parameters)
    if refused:
        counters["max_tracks_reached"] += refused
    return grown, points
