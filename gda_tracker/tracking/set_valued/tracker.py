"""The set-valued tracker without ROS: a scan in, track sets out.

>>> tracker = SetValuedTracker(SetValuedParameters())                          # doctest: +SKIP
>>> sets, report = tracker.process(detections)                                 # doctest: +SKIP
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

from gda_tracker.kinematics.motion_models import constant_velocity
from gda_tracker.kinematics.set_valued.filter import predict_sets
from gda_tracker.kinematics.set_valued.positions import Positions, positions_of_scan
from gda_tracker.tracking.door import Rejected, received, validate
from gda_tracker.tracking.set_valued.branches import no_branches, with_ids
from gda_tracker.tracking.set_valued.growth import ambiguous, claimed, grow, start
from gda_tracker.tracking.set_valued.parameters import SetValuedParameters
from gda_tracker.tracking.set_valued.thinning import cap, thin
from gda_tracker.tracking.waiting_room import WaitingRoom
from gda_tracker.vocabulary.arrays import IntArray
from gda_tracker.vocabulary.scans import Detections, Scan, ScanKey, ScanReport
from gda_tracker.vocabulary.track_sets import TrackSetArray
from gda_tracker.vocabulary.tracks import CONFIRMED, TENTATIVE

POSITION, VELOCITY = slice(0, 2), slice(2, 4)
TRACKED, REJECTED = "tracked", "rejected"


class SetValuedTracker:
    """Validates scans, predicts sets, tests associations, branches, merges, starts and ends sets.

    Scans are worked off as they come: one that is older than the last is late and rejected, or by
    more than ``time_jump_s`` begins a new time axis, on which no set lives.
    """

    def __init__(
        self,
        parameters: SetValuedParameters,
        epoch: int = 0,
        system_uuid: bytes = bytes(16),
    ) -> None:
        self.parameters = parameters
        self.epoch = epoch
        self.system_uuid = system_uuid
        self.counters: Counter[str] = Counter()
        self.branches = no_branches()
        # Of the last scan: sets that might own several detections or share one, and all sets.
        self.ambiguous_sets = 0
        self._last_ns: int | None = None
        self._last_key: ScanKey | None = None
        self._last: tuple[TrackSetArray, ScanReport] | None = None
        self._room = WaitingRoom()
        self._generation = 0
        self._next_track_id = self._next_branch_id = 1
        self._next_serial = 0
        # Ended outside any scan.
        self._ended_track_id: IntArray = np.zeros(0, dtype=np.int64)
        self._ended_branch_id: IntArray = np.zeros(0, dtype=np.int64)

    def set_parameters(self, parameters: SetValuedParameters) -> None:
        """Change parameters; acts at the next scan."""
        self.parameters = parameters

    def process(self, detections: Detections) -> tuple[TrackSetArray | None, ScanReport]:
        """Track one scan.

        Returns
        -------
        sets, report
            All sets after the scan, ``None`` where it was rejected, and the answer. The last scan
            once more is answered with what it was answered with, marked as repeated.
        """
        key = ScanKey(self.epoch, detections.sensor_id, detections.stamp_ns)
        if self._last is not None and key == self._last_key:
            self.counters["repeated"] += 1
            return self._last[0], replace(self._last[1], repeated=True)
        p = self.parameters
        try:
            scan, counts = validate(
                detections, p.noise, p.tracking_frame, p.max_detections_per_scan, self.epoch
            )
            generation = self._room.check_time(scan.key, p.time_jump_s)
        except Rejected as rejection:
            self.counters[f"rejected_{rejection}"] += 1
            return None, ScanReport(
                key, REJECTED, str(rejection), detections_received=received(detections)
            )
        positions = positions_of_scan(scan)
        if positions.left_out:
            counts["azimuth_too_coarse"] += positions.left_out
        self.counters.update(counts)
        self._room.put(scan, generation, 0.0, received(detections), counts)
        self._room.take()
        sets = self._track(scan, positions, generation != self._generation)
        self._generation = generation
        confirmed = np.unique(sets.track_id[sets.status == CONFIRMED])
        report = ScanReport(
            scan.key,
            TRACKED,
            detections_received=received(detections),
            detections_admitted=len(positions),
            rejected=dict(counts),
            tracks_confirmed=len(confirmed),
            tracks_tentative=len(np.unique(sets.track_id)) - len(confirmed),
        )
        self._last_key, self._last = key, (sets, report)
        return sets, report

    def reset(self) -> None:
        """End all sets, as if the next scan were the first; ids go on.

        The next scan tells which have ended.
        """
        self._ended_track_id = np.union1d(self._ended_track_id, self.branches.track_id)
        self._ended_branch_id = np.union1d(self._ended_branch_id, self.branches.branch_id)
        self._room, self._generation = WaitingRoom(), 0
        self._last_ns, self._last, self._last_key = None, None, None
        self.branches = no_branches()
        self.counters["reset_reset"] += 1

    def _track(self, scan: Scan, positions: Positions, restarted: bool) -> TrackSetArray:
        p, stamp_ns = self.parameters, scan.key.stamp_ns
        before = self.branches
        if restarted:
            self.counters["reset_time_jump"] += 1
            self.branches = no_branches()
        elif self._last_ns is not None:
            dt_s = (stamp_ns - self._last_ns) / 1e9
            transition, noise = constant_velocity(dt_s, p.process_noise_std_mps2)
            self.branches = replace(
                self.branches, sets=predict_sets(self.branches.sets, transition, noise)
            )
        serial = self._next_serial + np.arange(len(positions), dtype=np.int64)
        self._next_serial += len(positions)
        grown = grow(self.branches, positions, serial, stamp_ns, p)
        living = thin(grown, p, self.counters)
        self.ambiguous_sets = int(np.count_nonzero(ambiguous(living)))
        taken = claimed(grown, living, p.initiation_claims)
        begun = start(living, taken, positions, serial, stamp_ns, self._next_track_id, p)
        self._next_track_id += len(begun)
        self.counters["tracks_started"] += len(begun)
        living = cap(living.joined(begun).by_track(), p, self.counters)
        living = with_ids(living, self._next_branch_id)
        self._next_branch_id = max(self._next_branch_id, int(living.branch_id.max(initial=0)) + 1)
        self.branches, self._last_ns = living, stamp_ns
        followed = np.union1d(living.branch_id, living.parent_id)
        tracks = np.union1d(self._ended_track_id, np.setdiff1d(before.track_id, living.track_id))
        sets = np.union1d(self._ended_branch_id, np.setdiff1d(before.branch_id, followed))
        self.counters["tracks_ended"] += len(tracks)
        self._ended_track_id = self._ended_branch_id = np.zeros(0, dtype=np.int64)
        return self._output(scan, positions.source_index, tracks, sets)

    def _output(
        self, scan: Scan, index: IntArray, tracks: IntArray, sets: IntArray
    ) -> TrackSetArray:
        """Everything that lives, with the rows of the source's detections."""
        living = self.branches
        row, detection = np.nonzero(living.may_own)
        own = np.full(len(living), -1, dtype=np.int64)
        with_detection = living.detection >= 0
        own[with_detection] = index[living.detection[with_detection]]
        return TrackSetArray(
            key=scan.key,
            frame_id=scan.frame_id,
            system_uuid=self.system_uuid,
            track_id=living.track_id.copy(),
            branch_id=living.branch_id.copy(),
            parent_branch_id=living.parent_id.copy(),
            status=np.where(living.confirmed, CONFIRMED, TENTATIVE).astype(np.int64),
            best=living.rank() == 0,
            centroid=living.sets.centroid.copy(),
            covariance=living.sets.covariance.copy(),
            matrix=living.sets.matrix.copy(),
            position_radius_m=living.sets.radius(POSITION),
            speed_radius_mps=living.sets.radius(VELOCITY),
            score=living.score.copy(),
            detection_index=own,
            may_own_start=np.searchsorted(row, np.arange(len(living) + 1)),
            may_own_index=index[detection],
            hits=living.hits.copy(),
            misses=living.misses.copy(),
            coasted_scans=living.coasted.copy(),
            first_detection_ns=living.first_ns.copy(),
            last_detection_ns=living.last_ns.copy(),
            deleted_track_id=tracks,
            deleted_branch_id=sets,
        )
