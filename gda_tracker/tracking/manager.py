"""The track manager: the one door and the only state of the ring, without ROS.

One scan is open at a time::

    manager.admit(detections)            # validated, queued
    manager.tell(statement)              # validated, waits for the next scan
    opened = manager.open()              # scan and predictions, for the other stages
    manager.close(evidence, scores, associations)   # tracks and report

Between scans the state is at rest; :mod:`gda_tracker.tracking.checkpoint` writes and reads it.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace

import numpy as np

from gda_tracker.association.choices import JPDA
from gda_tracker.tracking.answers import Inconsistent, check_answers
from gda_tracker.tracking.births import begin_tracks
from gda_tracker.tracking.clutter import clutter_after, densities_of_hypotheses
from gda_tracker.tracking.door import DefaultNoise, Rejected, received, validate
from gda_tracker.tracking.extraction import scan_increments
from gda_tracker.tracking.history_window import remember, with_window
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.initial_tracks import fault_of_initial_tracks, hypotheses_of_tracks
from gda_tracker.tracking.initiation import StartPoints
from gda_tracker.tracking.jpda_update import update_by_marginals
from gda_tracker.tracking.life import judge
from gda_tracker.tracking.manager_state import ManagerState, OpenScan
from gda_tracker.tracking.mht.delayed import StepBack, generation_of, pass_on, past_of, tell_all
from gda_tracker.tracking.mht.generations import Generation, settle
from gda_tracker.tracking.mht.growth import coast, grow
from gda_tracker.tracking.mht.start import fit
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.tracking.predictions import predictions_of
from gda_tracker.tracking.state_retrodiction import retrodict_states
from gda_tracker.tracking.state_update import (
    count_detections,
    predict_states,
    update_beliefs,
    update_states,
)
from gda_tracker.tracking.statement_desk import DeskLimits, StatementDesk
from gda_tracker.tracking.statement_door import StatementRejected, validate_statement
from gda_tracker.tracking.statement_update import (
    heard_rows,
    update_heard_beliefs,
    update_heard_states,
)
from gda_tracker.tracking.track_output import tracks_of
from gda_tracker.tracking.waiting_room import ReorderWindow, WaitingRoom
from gda_tracker.vocabulary.arrays import IntArray
from gda_tracker.vocabulary.beliefs import AttributeScores, Evidence
from gda_tracker.vocabulary.hypotheses import Associations
from gda_tracker.vocabulary.scans import Detections, Scan, ScanKey, ScanReport
from gda_tracker.vocabulary.statements import Statement, StatementReport
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks


class TrackManager:
    """Admits scans, predicts, applies associations, starts, confirms and ends tracks."""

    def __init__(
        self,
        parameters: TrackManagerParameters,
        epoch: int = 0,
        system_uuid: bytes = bytes(16),
    ) -> None:
        self.parameters = parameters
        self.epoch = epoch
        self.system_uuid = system_uuid
        self.state = ManagerState()
        self.opened: OpenScan | None = None
        self.counters: Counter[str] = Counter()
        # Tracks of earlier scans whose past the last call has made final, oldest first.
        self.delayed: list[Tracks] = []
        self._room = WaitingRoom()
        self._generation = 0
        self._next_parameters: TrackManagerParameters | None = None

    # --- the door -----------------------------------------------------------------------------

    def validate(self, detections: Detections) -> tuple[Scan, Counter[str]]:
        """Return the admitted scan, and how many detections were left out or mended, by reason.

        It depends on the parameters alone, not on the state.

        Raises
        ------
        Rejected
            With the reason, if the scan is refused as a whole.
        """
        p = self.parameters
        noise = DefaultNoise(
            p.range_std_m, p.azimuth_std_rad, p.elevation_std_rad, p.range_rate_std_mps
        )
        return validate(detections, noise, p.tracking_frame, p.max_detections_per_scan, self.epoch)

    def admit(
        self,
        detections: Detections,
        now: float = 0.0,
        validated: tuple[Scan, Counter[str]] | None = None,
    ) -> ScanReport | None:
        """Take a scan in. Returns ``None`` if it waits or is open already, else the answer at once.

        ``now`` [s] is any steady clock; it only serves the latency of the report. ``validated`` is
        what :meth:`validate` makes of these detections, if that is known already.
        """
        key = ScanKey(self.epoch, detections.sensor_id, detections.stamp_ns)
        state = self.state
        if state.last_key is not None and key[1:] == state.last_key[1:]:
            self.counters["repeated"] += 1
            assert state.last_report is not None
            return replace(state.last_report, key=key, repeated=True, queue_length=len(self._room))
        waits = self._room.holds(*key[1:])
        if waits or (self.opened is not None and self.opened.scan.key[1:] == key[1:]):
            self.counters["duplicate"] += 1
            return None
        p = self.parameters
        try:
            if len(self._room) >= p.queue_depth:
                raise Rejected("queue_full")
            scan, counts = validated or self.validate(detections)
            generation = self._room.check_time(scan.key, p.time_jump_s)
        except Rejected as rejection:
            reason = str(rejection)
            self.counters[f"rejected_{reason}"] += 1
            return ScanReport(
                key,
                "rejected",
                reason=reason,
                detections_received=received(detections),
                queue_length=len(self._room),
            )
        for reason, count in counts.items():
            self.counters[reason] += count
        self._room.put(scan, generation, now, received(detections), counts)
        return None

    def tell(self, statement: Statement) -> StatementReport:
        """Take a statement in for the next scan that is opened and not older than it."""
        p, state = self.parameters, self.state
        table = state.table if self.opened is None else self.opened.table
        reason = ""
        try:
            statement = validate_statement(statement, p.tracking_frame)
            state.desk = state.desk.admit(
                statement, self._room.newest_ns, table.track_id.tolist(), self._desk_limits
            )
        except StatementRejected as rejection:
            reason = str(rejection)
        outcome = "rejected" if reason else "admitted"
        self.counters[f"statement_{outcome}" + (f"_{reason}" if reason else "")] += 1
        return StatementReport(
            statement.source,
            statement.sequence,
            statement.stamp_ns,
            outcome,
            reason,
            len(state.desk.waiting),
        )

    @property
    def _desk_limits(self) -> DeskLimits:
        p = self.parameters
        age_ns = round(p.statement_max_age_s * 1e9)
        return DeskLimits(p.max_statements, age_ns, round(p.statement_max_ahead_s * 1e9))

    @property
    def waiting(self) -> int:
        """Number of scans that wait."""
        return len(self._room)

    @property
    def ready(self) -> bool:
        """Whether :meth:`open` has a scan to open."""
        p = self._next_parameters or self.parameters
        order = ReorderWindow(
            round(p.reorder_window_s * 1e9), tuple(p.reorder_sensors), p.queue_depth
        )
        if self.opened is not None or not self._room.ripe(order):
            return False
        return self.parameters.initiation != "labelled" or self.state.initialised_from is not None

    def release(self, admitted_until: float = math.inf) -> bool:
        """Let scans wait no longer for earlier ones: those admitted until then, or all.

        For the end of a recording, and for sensors that fall silent. Returns whether there are any.
        """
        return self._room.release(admitted_until)

    def set_parameters(self, parameters: TrackManagerParameters) -> None:
        """Change parameters at the next scan boundary."""
        self._next_parameters = parameters
        if self.opened is None:
            self._apply_parameters()

    def _apply_parameters(self) -> None:
        if self._next_parameters is not None:
            self.parameters, self._next_parameters = self._next_parameters, None

    def initialise(self, initial: Tracks) -> ScanReport:
        """Start from labelled tracks: what lived ends, ids go on, beliefs are taken over.

        The same initial tracks (system UUID and stamp) act once; later copies are only answered.
        Scans that have waited for the first initial tracks wait on; what waits when others follow
        is dropped and counted.
        """
        identity = (initial.system_uuid, initial.key.stamp_ns)
        state = self.state
        n = len(initial)
        report = ScanReport(initial.key, "initialised", tracks_confirmed=n)
        if identity == state.initialised_from:
            return replace(report, repeated=True)
        reason = fault_of_initial_tracks(initial)
        if reason:
            self.counters[f"rejected_{reason}"] += 1
            return replace(report, outcome="rejected", reason=reason, tracks_confirmed=0)
        self.opened = None
        self._apply_parameters()
        self.delayed = self.rest_of_delayed()
        self.state = ManagerState(
            table=hypotheses_of_tracks(initial, state.next_track_id, state.next_hypothesis_id),
            next_track_id=state.next_track_id + n,
            next_hypothesis_id=state.next_hypothesis_id + n,
            next_detection_number=state.next_detection_number,
            last_ns=initial.key.stamp_ns,
            last_sensors=(initial.key.sensor_id,),
            initialised_from=identity,
            scans_closed=state.scans_closed,
            # Like scans, statements may have waited for the first tracks.
            desk=state.desk if state.initialised_from is None else StatementDesk(),
        )
        waiting, self._room, self._generation = self._room, WaitingRoom(), 0
        self._room.begin(initial.key.stamp_ns, self.state.last_sensors)
        left = len(waiting)
        if state.initialised_from is None:
            # These have waited for the tracks; later on they are another run's.
            left = self._room.move_in(waiting)
        if left:
            self.counters["dropped_at_initialisation"] += left
        return report

    def resume(self) -> None:
        """Take up the time axis where a restored state left it."""
        state = self.state
        self._room, self._generation, self.opened = WaitingRoom(), 0, None
        if state.last_ns is not None:
            self._room.begin(state.last_ns, state.last_sensors)

    # --- one scan ---------------------------------------------------------------------------------

    def open(self) -> OpenScan:
        """Open the earliest waiting scan: predict every hypothesis to its time.

        Raises
        ------
        Inconsistent
            If a scan is open already, none waits, or the initial tracks have not come.
        """
        if not self.ready:
            raise Inconsistent("no scan is ready to be opened")
        self._apply_parameters()
        waiting = self._room.take()
        state, p = self.state, self.parameters
        scan = waiting.scan
        table, ended_ids, started = state.table, np.zeros(0, dtype=np.int64), state.last_ns is None
        dt_s = 0.0 if state.last_ns is None else (scan.key.stamp_ns - state.last_ns) / 1e9
        if waiting.generation != self._generation or dt_s > p.max_gap_s:
            reason = "time_jump" if waiting.generation != self._generation else "gap"
            self.counters[f"reset_{reason}"] += 1
            if reason == "time_jump":
                state.desk = state.desk.forget()
            self._generation = waiting.generation
            ended_ids, started, dt_s = table.track_id[table.chosen], True, 0.0
            table = table.select(np.zeros(len(table), dtype=bool))
        table = fit(table, p.mht_scans if p.decision == "mht" else 0)
        table = with_window(predict_states(table, dt_s, p), p.window_rows)
        density = densities_of_hypotheses(state.clutter, scan, table.mean, p)
        if state.desk.waiting:
            scan = self._with_statements(scan, table)
        self.opened = OpenScan(
            scan,
            predictions_of(scan.key, table, p, density),
            table,
            ended_ids,
            started,
            waiting.admitted_at,
            waiting.received,
            waiting.counts,
            density,
        )
        return self.opened

    def _with_statements(self, scan: Scan, table: HypothesisTable) -> Scan:
        """Return the scan with the statements that are due."""
        state, stamp_ns = self.state, scan.key.stamp_ns
        state.desk = state.desk.clear_up(
            stamp_ns, table.track_id.tolist(), self._desk_limits, self.counters
        )
        return replace(scan, statements=state.desk.due(stamp_ns))

    def close(
        self,
        evidence: Evidence | None,
        scores: AttributeScores | None,
        associations: Associations,
        *,
        trusted: bool = False,
    ) -> tuple[Tracks, ScanReport]:
        """Apply the decision on the open scan.

        ``trusted`` answers come from the same process, not in messages, and are not checked.

        Raises
        ------
        Inconsistent
            If an answer does not fit the open scan; nothing has changed then.
        """
        opened = self._require_open()
        if not trusted:
            check_answers(
                opened.scan.key, len(opened.table), len(opened.scan), evidence, scores, associations
            )
        if opened.predictions.settings.attribute_term == "none":
            # The attribute was not asked: tracks carry no belief about it.
            evidence = scores = None
        if opened.predictions.settings.decision == "mht":
            return self._close_trees(opened, evidence, scores, associations)
        table = opened.table.copy()
        assigned = associations.assigned_detection
        if evidence is not None:
            table.use_frame(evidence.frame, evidence.class_names)
        if associations.degraded:
            scores = None
        if associations.decision == JPDA:
            if scores is not None:
                every = np.arange(len(scores.updated_hypothesis))
                update_heard_beliefs(
                    table, scores, scores.updated_hypothesis.astype(np.int64), every
                )
            update_by_marginals(
                table, opened.scan, scores, associations, self.parameters.use_range_rate
            )
        else:
            update_states(table, opened.scan, assigned, self.parameters.use_range_rate)
            if scores is not None:
                update_beliefs(table, scores, associations.chosen)
                update_heard_beliefs(
                    table, scores, *heard_rows(scores, np.arange(len(table)), assigned < 0)
                )
        if opened.scan.statements:
            update_heard_states(
                table, opened.table, opened.scan.statements, with_classes=scores is not None
            )
        if scores is not None and evidence is not None:
            taken = np.flatnonzero(associations.chosen)
            remember(table, evidence, scores.hypothesis[taken], scores.detection[taken])

        p = self.parameters
        count_detections(table, opened.scan, assigned)
        density = opened.clutter_density
        gone = judge(
            table, lambda: scan_increments(opened.predictions, scores, associations, density), p
        )
        self.state.clutter = clutter_after(
            self.state.clutter, opened.scan, table.status, assigned, p
        )
        deleted = np.concatenate([opened.ended_track_id, table.track_id[gone]])
        if gone.any():
            table = table.select(~gone)
        table, points = self._begin_tracks(opened, table, associations, evidence)
        outcome = "degraded" if associations.degraded else "tracked"
        return self._finish(opened, table, points, deleted, outcome, [])

    def _close_trees(
        self,
        opened: OpenScan,
        evidence: Evidence | None,
        scores: AttributeScores | None,
        associations: Associations,
    ) -> tuple[Tracks, ScanReport]:
        """Close the open scan by growing the hypothesis trees."""
        past = [] if opened.started else past_of(self.state)
        growth = grow(
            opened,
            past,
            evidence,
            None if associations.degraded else scores,
            associations,
            self.state.next_detection_number,
            self.parameters,
        )
        settle(past, growth.ended_parent_id)
        table = self._renamed(growth.table)
        deleted = np.concatenate([opened.ended_track_id, growth.ended_track_id])
        decided = replace(associations, assigned_detection=growth.assigned)
        self.state.clutter = clutter_after(
            self.state.clutter, opened.scan, opened.table.status, growth.assigned, self.parameters
        )
        grown, points = self._begin_tracks(opened, table, decided, evidence)
        outcome = "degraded" if associations.degraded else "tracked"
        return self._finish(opened, grown, points, deleted, outcome, past)

    def give_up(self) -> tuple[Tracks, ScanReport]:
        """Close the open scan without an answer: tracks are predicted, no miss counts."""
        opened = self._require_open()
        past: list[Generation] = []
        if opened.predictions.settings.decision == "mht":
            past = [] if opened.started else past_of(self.state)
            table = self._renamed(coast(opened, past, self.parameters))
        else:
            table = opened.table.copy()
            table.detection_index = np.full(len(table), -1, dtype=np.int64)
        points = StartPoints() if opened.started else self.state.points
        return self._finish(opened, table, points, opened.ended_track_id, "gave_up", past)

    def _renamed(self, table: HypothesisTable) -> HypothesisTable:
        """Give every row an id of its own."""
        first = self.state.next_hypothesis_id
        self.state.next_hypothesis_id = first + len(table)
        table.hypothesis_id = np.arange(first, first + len(table), dtype=np.int64)
        return table

    def _require_open(self) -> OpenScan:
        if self.opened is None:
            raise Inconsistent("no scan is open")
        return self.opened

    def _begin_tracks(
        self,
        opened: OpenScan,
        table: HypothesisTable,
        associations: Associations,
        evidence: Evidence | None,
    ) -> tuple[HypothesisTable, StartPoints]:
        """Append what starts from the unassigned detections, as far as there is room."""
        grown, points, refused = begin_tracks(
            opened, table, associations, evidence, self.state, self.parameters
        )
        if refused:
            self.counters["max_tracks_reached"] += refused
        return grown, points

    def _finish(
        self,
        opened: OpenScan,
        table: HypothesisTable,
        points: StartPoints,
        deleted: IntArray,
        outcome: str,
        past: list[Generation],
    ) -> tuple[Tracks, ScanReport]:
        """Move the state on; ``past`` are the trees' generations before this scan."""
        state = self.state
        if not past:
            self.delayed = self.rest_of_delayed()
            state.generations = []
        state.table, state.points = table, points
        state.next_detection_number += len(opened.scan)
        if outcome != "gave_up":
            state.desk = state.desk.without(opened.scan.statements)
        key = opened.scan.key
        others = state.last_sensors if key.stamp_ns == state.last_ns else ()
        state.last_sensors = (*others, key.sensor_id)
        state.last_key, state.last_ns = key, key.stamp_ns
        state.deleted_track_id = deleted
        state.degraded = outcome != "tracked"
        newest = generation_of(state)
        if past and newest is not None:
            state.generations, self.delayed = pass_on(
                past, newest, self.parameters.mht_scans - 1, self._tell, self._step_back
            )
        state.scans_closed += 1
        tracks = int(np.count_nonzero(table.chosen))
        confirmed_tracks = int(np.count_nonzero(table.chosen & (table.status == CONFIRMED)))
        state.last_report = ScanReport(
            opened.scan.key,
            outcome,
            detections_received=opened.received,
            detections_admitted=len(opened.scan),
            rejected=dict(opened.rejected),
            tracks_confirmed=confirmed_tracks,
            tracks_tentative=tracks - confirmed_tracks,
            queue_length=len(self._room),
        )
        self.opened = None
        self.counters[outcome] += 1
        return self.tracks(), state.last_report

    def tracks(self) -> Tracks:
        """The tracks after the last closed scan."""
        state = self.state
        if state.last_key is None:
            raise Inconsistent("no scan has been closed")
        table = state.table
        if table.detection_numbers.shape[1]:
            table = table.select(table.chosen)
        return self._tell(table, state.last_key, state.deleted_track_id, state.degraded)

    def rest_of_delayed(self) -> list[Tracks]:
        """Tracks of the last scans with their revised past, as if no further scan came."""
        return tell_all(self.state, self._tell, self._step_back)

    @property
    def _step_back(self) -> StepBack | None:
        """How states of ``tracks_delayed`` are retrodicted, if they are."""
        p = self.parameters
        if not p.mht_retrodiction:
            return None
        return lambda earlier, later, dt_s: retrodict_states(earlier, later, dt_s, p)

    def _tell(
        self, table: HypothesisTable, key: ScanKey, deleted: IntArray, degraded: bool
    ) -> Tracks:
        frame_id = self.parameters.tracking_frame
        key = ScanKey(self.epoch, *key[1:])
        return tracks_of(table, key, frame_id, self.system_uuid, deleted, degraded)
