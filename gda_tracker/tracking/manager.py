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

from gda_tracker.tracking.answers import Inconsistent, check_answers
from gda_tracker.tracking.class_motion import histories_after, with_class_motion
from gda_tracker.tracking.closing import (
    GAVE_UP,
    TRACKED,
    ClosedScan,
    close_by_decision,
    close_unanswered,
)
from gda_tracker.tracking.door import DefaultNoise, Rejected, received, validate
from gda_tracker.tracking.door_models import ModelSetting, validate_with_model
from gda_tracker.tracking.extended.output import cells_of_report
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.initial_tracks import (
    fault_of_initial_tracks,
    identity_of,
    state_of_initial_tracks,
)
from gda_tracker.tracking.manager_state import ManagerState, OpenScan
from gda_tracker.tracking.mht.delayed import StepBack, generation_of, pass_on, tell_all
from gda_tracker.tracking.opening import desk_limits, open_scan
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.tracking.state_retrodiction import retrodict_states
from gda_tracker.tracking.statement_door import StatementRejected, validate_statement
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
        # Detections of the last scan, as ``ClosedScan.assigned``.
        self.assigned = np.zeros(0, dtype=np.int32)
        self._room = WaitingRoom()
        self._generation = 0
        # Tracks that ended outside any scan; the next scan tells.
        self._ended_track_id: IntArray = np.zeros(0, dtype=np.int64)
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
        sensor_id = detections.sensor_id
        p = self._at_the_door.of_sensor(sensor_id)
        noise = DefaultNoise(
            p.range_std_m, p.azimuth_std_rad, p.elevation_std_rad, p.range_rate_std_mps
        )
        if model := p.model_of(sensor_id):
            setting = ModelSetting(model, p.reference_of(sensor_id))
            return validate_with_model(
                detections,
                setting,
                noise,
                p.tracking_frame,
                p.max_detections_per_scan,
                self.epoch,
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
        p = self._at_the_door
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
        p, state = self._at_the_door, self.state
        table = state.table if self.opened is None else self.opened.table
        reason = ""
        try:
            statement = validate_statement(statement, p.tracking_frame)
            state.desk = state.desk.admit(
                statement, self._room.newest_ns, table.track_id.tolist(), desk_limits(p)
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
    def waiting(self) -> int:
        """Number of scans that wait."""
        return len(self._room)

    @property
    def ready(self) -> bool:
        """Whether :meth:`open` has a scan to open."""
        p = self._at_the_door
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

    @property
    def _at_the_door(self) -> TrackManagerParameters:
        """The newest parameters: what comes in while a scan is open belongs to the next one."""
        return self._next_parameters or self.parameters

    def _apply_parameters(self) -> None:
        if self._next_parameters is not None:
            self.parameters, self._next_parameters = self._next_parameters, None

    def initialise(self, initial: Tracks) -> ScanReport:
        """Start from labelled tracks: what lived ends, ids go on, beliefs are taken over.

        The same initial tracks (system UUID and stamp) act once; later copies are only answered.
        Scans that have waited for the first initial tracks wait on; what waits when others follow
        is dropped and counted.
        """
        state = self.state
        report = ScanReport(initial.key, "initialised", tracks_confirmed=len(initial))
        if identity_of(initial) == state.initialised_from:
            return replace(report, repeated=True)
        reason = fault_of_initial_tracks(initial)
        if reason:
            self.counters[f"rejected_{reason}"] += 1
            return replace(report, outcome="rejected", reason=reason, tracks_confirmed=0)
        self.opened = None
        self._apply_parameters()
        self.delayed = self.rest_of_delayed()
        self.state = state_of_initial_tracks(initial, state)
        waiting, self._room, self._generation = self._room, WaitingRoom(), 0
        self._room.begin(initial.key.stamp_ns, self.state.last_sensors)
        left = len(waiting)
        if state.initialised_from is None:
            # These have waited for the tracks; later on they are another run's.
            left = self._room.move_in(waiting)
        if left:
            self.counters["dropped_at_initialisation"] += left
        return report

    def reset(self, epoch: int, reason: str = "reset") -> list[ScanReport]:
        """End all tracks and forget all but the ids, as if the next scan were the first.

        ``epoch`` is a new one, above the last: what stages still answer to earlier scans is not
        taken for an answer to later ones of the same time. The tracks that lived are told as ended
        with the next scan.

        Returns
        -------
        list of ScanReport
            Answers to the scans that were open or waited, ``rejected`` for the reason given.

        Raises
        ------
        ValueError
            If the epoch is not above the last.
        """
        if epoch <= self.epoch:
            raise ValueError(f"epoch = {epoch}: allowed is an integer > {self.epoch}")
        state, opened = self.state, self.opened
        dropped = [(w.scan.key, w.received) for w in self._room.content()]
        pending = self._ended_track_id
        if opened is not None:
            dropped.insert(0, (opened.scan.key, opened.received))
            pending = np.union1d(pending, opened.ended_track_id)
        living = state.table.track_id[state.table.chosen]
        self.delayed = self.rest_of_delayed()
        self._ended_track_id = np.union1d(pending, living)
        self.epoch = epoch
        self.state = ManagerState(
            next_track_id=state.next_track_id,
            next_hypothesis_id=state.next_hypothesis_id,
            next_detection_number=state.next_detection_number,
            scans_closed=state.scans_closed,
        )
        self.resume()
        self._apply_parameters()
        self.counters[f"reset_{reason}"] += 1
        if dropped:
            self.counters[f"rejected_{reason}"] += len(dropped)
        if state.desk.waiting:
            self.counters[f"statement_dropped_{reason}"] += len(state.desk.waiting)
        return [
            ScanReport(ScanKey(epoch, *key[1:]), "rejected", reason, detections_received=received)
            for key, received in dropped
        ]

    def restore(self, state: ManagerState, system_uuid: bytes, epoch: int) -> list[ScanReport]:
        """Go on from another state; the same as :meth:`reset` for what is under way.

        No id that was issued under the same system UUID is issued again.
        """
        now = self.state
        answers = self.reset(epoch, "state_loaded")
        if system_uuid == self.system_uuid:
            state.next_track_id = max(state.next_track_id, now.next_track_id)
            state.next_hypothesis_id = max(state.next_hypothesis_id, now.next_hypothesis_id)
            self._ended_track_id = np.setdiff1d(self._ended_track_id, state.table.track_id)
        else:
            self._ended_track_id = np.zeros(0, dtype=np.int64)  # ids of another system
        self.state, self.system_uuid = state, system_uuid
        self.resume()
        return answers

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
        restarted = waiting.generation != self._generation
        self._generation = waiting.generation
        self.opened = open_scan(
            self.state, waiting, self._ended_track_id, restarted, self.parameters, self.counters
        )
        return self.opened

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
        return self._finish(
            opened,
            close_by_decision(
                opened, evidence, scores, associations, self.state, self.parameters, self.counters
            ),
        )

    def give_up(self) -> tuple[Tracks, ScanReport]:
        """Close the open scan without an answer: tracks are predicted, no miss counts."""
        opened = self._require_open()
        return self._finish(opened, close_unanswered(opened, self.state, self.parameters))

    def _require_open(self) -> OpenScan:
        if self.opened is None:
            raise Inconsistent("no scan is open")
        return self.opened

    def _finish(self, opened: OpenScan, closed: ClosedScan) -> tuple[Tracks, ScanReport]:
        """Move the state on."""
        state, past, table = self.state, closed.past, closed.table
        self.assigned = closed.assigned
        if not past:
            self.delayed = self.rest_of_delayed()
            state.generations = []
        state.table, state.points = table, closed.points
        state.next_detection_number += len(opened.scan)
        if closed.outcome != GAVE_UP:
            state.desk = state.desk.without(opened.scan.statements)
        key = opened.scan.key
        state.motion = histories_after(
            state.motion, table, key.stamp_ns, self.parameters, self.counters
        )
        others = state.last_sensors if key.stamp_ns == state.last_ns else ()
        state.last_sensors = (*others, key.sensor_id)
        state.last_key, state.last_ns = key, key.stamp_ns
        state.deleted_track_id = closed.deleted_track_id
        state.degraded = closed.outcome != TRACKED
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
            closed.outcome,
            detections_received=opened.received,
            detections_admitted=opened.scan.detections,
            rejected=dict(opened.rejected),
            tracks_confirmed=confirmed_tracks,
            tracks_tentative=tracks - confirmed_tracks,
            queue_length=len(self._room),
            **cells_of_report(opened.scan),
        )
        self.opened = None
        self._ended_track_id = np.zeros(0, dtype=np.int64)
        self.counters[closed.outcome] += 1
        return self.tracks(), state.last_report

    def tracks(self) -> Tracks:
        """The tracks after the last closed scan."""
        state = self.state
        if state.last_key is None:
            raise Inconsistent("no scan has been closed")
        table = state.table
        if table.detection_numbers.shape[1]:
            table = table.select(table.chosen)
        tracks = self._tell(table, state.last_key, state.deleted_track_id, state.degraded)
        return with_class_motion(tracks, state.motion, state.table.chosen, self.parameters)

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
        lambda_ = self.parameters.signal_threshold
        return tracks_of(table, key, frame_id, self.system_uuid, deleted, degraded, lambda_)
