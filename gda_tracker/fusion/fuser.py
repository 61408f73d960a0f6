"""Track fusion without ROS: tracks of several radars in, fused tracks out.

>>> fuser = TrackFuser(parameters)                                            # doctest: +SKIP
>>> for fused, associations in fuser.take("radar_1", tracks):                 # doctest: +SKIP
...     print(fused.fused_track_id, fused.mean, associations.bias)

The common time of a fusion is the newest stamp of the reports that it takes in. It is made as soon
as every radar that is not silent has brought tracks that are newer than the last fusion, or when
one of them brings such tracks for the second time. Stamps alone decide, so the same reports in the
same order give the same tracks.
"""

from __future__ import annotations

import uuid
from collections import Counter, deque

import numpy as np

from gda_tracker.fusion.association import FAILED, TrackAssociation, associate
from gda_tracker.fusion.biases import bias_unknowns
from gda_tracker.fusion.class_beliefs import class_likelihoods, common_classes, prior_of
from gda_tracker.fusion.identities import continue_identities
from gda_tracker.fusion.motion import (
    new_information,
    predict,
    predict_information,
    tracker_noise_covariance,
    white_noise_covariance,
)
from gda_tracker.fusion.output import associations_of, fused_tracks_of
from gda_tracker.fusion.parameters import TrackFusionParameters
from gda_tracker.fusion.reports import Refused, Report, report_of, with_company
from gda_tracker.fusion.snapshot import Snapshot
from gda_tracker.fusion.suspicion import Suspicion
from gda_tracker.fusion.targets import FusedTargets
from gda_tracker.kinematics.rigid_transforms import RigidTransform
from gda_tracker.vocabulary.arrays import FloatArray, IntArray
from gda_tracker.vocabulary.fused_tracks import (
    LATE,
    NEVER_HEARD,
    OK,
    SILENT,
    FusedTracks,
    TrackAssociations,
)
from gda_tracker.vocabulary.tracks import Tracks

NANOSECONDS = 1_000_000_000
INTERVALS = 9

Fusion = tuple[FusedTracks, TrackAssociations]


class TrackFuser:
    """Keeps the last report of each radar and the fused targets.

    Attributes
    ----------
    parameters
        May be exchanged between fusions for one with the same radars and bias priors.
    counters
        What was refused or special, by reason.
    """

    def __init__(self, parameters: TrackFusionParameters, system_uuid: bytes | None = None) -> None:
        self.parameters = parameters
        self.system_uuid = uuid.uuid4().bytes if system_uuid is None else system_uuid
        self.counters: Counter[str] = Counter()
        self._next_id, self._sequence = 1, 0
        self._reports: list[Report | None] = []
        self._begin()

    def _begin(self) -> None:
        n_radars = len(self.parameters.radars)
        self._targets = FusedTargets(bias_unknowns(self.parameters.bias_std_m, n_radars), n_radars)
        self._reports = [None] * n_radars
        self._pending: list[Report] = []
        # The last times between reports, whose median is the radar's period.
        self._intervals_s = [deque[float](maxlen=INTERVALS) for _ in range(n_radars)]
        self._suspicion = Suspicion()
        self._deleted: list[int] = []

    def begin_anew(self) -> None:
        """Forget all tracks and biases; ids go on."""
        deleted = self._deleted + self._targets.identity.tolist()
        self._begin()
        self._deleted = deleted

    # --- reports ----------------------------------------------------------------------------

    def take(
        self, radar: str, tracks: Tracks, transform: RigidTransform | None = None
    ) -> list[Fusion]:
        """Take the tracks of a radar in; return the fusions that were made, none to two.

        ``transform`` takes points of the tracks' frame into the common one.

        Raises
        ------
        Refused
            If the message cannot be used; nothing is changed but the counters.
        """
        try:
            number = self.parameters.radars.index(radar)
            report = report_of(number, tracks, self.parameters, transform, self.counters)
            self._check_time(report)
        except Refused as error:
            self.counters[error.reason] += 1
            raise
        made = []
        if report.radar in self._round():
            made.append(self._fuse())
        self._pending.append(report)
        if self._complete():
            made.append(self._fuse())
        return made

    def _newest(self, radar: int) -> Report | None:
        waiting = [report for report in self._pending if report.radar == radar]
        return waiting[-1] if waiting else self._reports[radar]

    def _check_time(self, report: Report) -> None:
        last, name = self._newest(report.radar), self.parameters.radars[report.radar]
        if last is not None and last.system_uuid != report.system_uuid:
            self.counters["radar_restarted"] += 1
            self._forget(report.radar)
        elif last is not None:
            if last.epoch != report.epoch:
                self.counters["radar_resumed"] += 1
            back_s = (last.stamp_ns - report.stamp_ns) / NANOSECONDS
            if back_s > self.parameters.time_jump_s:
                self.counters["fusion_began_anew"] += 1
                self.begin_anew()
            elif back_s >= 0.0:
                reason = "refused_repeated" if back_s == 0.0 else "refused_backwards"
                raise Refused(
                    reason,
                    f"{name}: tracks of {report.stamp_ns} ns after those of {last.stamp_ns} ns",
                )
        behind_s = (self._targets.stamp_ns - report.stamp_ns) / NANOSECONDS
        if behind_s > self.parameters.silent_after_s:
            raise Refused(
                "refused_too_old",
                f"{name}: {behind_s:.3f} s before the last fusion; allowed are "
                f"{self.parameters.silent_after_s:g} s (silent_after_s)",
            )

    def _forget(self, radar: int) -> None:
        """Forget the tracks of a radar that was started anew."""
        self._reports[radar] = None
        self._pending = [report for report in self._pending if report.radar != radar]

    def clock_ns(self) -> int:
        """Return the newest stamp of all reports, -1 before the first."""
        stamps = [r.stamp_ns for r in (*self._reports, *self._pending) if r is not None]
        return max(stamps, default=-1)

    def ages_s(self) -> list[float]:
        """Return how far the last report of each radar lies behind the newest of all."""
        now = self.clock_ns()
        last = [self._newest(radar) for radar in range(len(self._reports))]
        return [np.inf if r is None else (now - r.stamp_ns) / NANOSECONDS for r in last]

    def radar_states(self) -> tuple[str, ...]:
        """Return the state of each radar by the stamps of its reports."""
        return tuple(self._state(age) for age in self.ages_s())

    def _state(self, age_s: float) -> str:
        if np.isinf(age_s):
            return NEVER_HEARD
        if age_s > self.parameters.silent_after_s:
            return SILENT
        return LATE if age_s > self.parameters.late_after_s else OK

    def _round(self) -> set[int]:
        """Radars that wait with tracks newer than the last fusion."""
        return {r.radar for r in self._pending if r.stamp_ns > self._targets.stamp_ns}

    def _complete(self) -> bool:
        live = {r for r, state in enumerate(self.radar_states()) if state in (OK, LATE)}
        waiting = self._round()
        return bool(waiting) and live <= waiting

    # --- fusion -----------------------------------------------------------------------------

    def _fuse(self) -> Fusion:
        for report in sorted(self._pending, key=lambda r: r.stamp_ns):
            self._learn(report)
        self._pending = []
        p, targets = self.parameters, self._targets
        classes, snapshot = self._snapshot()
        class_prior = prior_of(classes, p.class_weights())
        found = self._associate(snapshot, class_prior)
        if found.method == FAILED:
            self.counters["tracks_left_as_they_were"] += 1
        identity, self._next_id = continue_identities(found.chosen, snapshot.company, self._next_id)
        mine = identity[found.chosen]
        self._rearrange(snapshot, mine)
        rows = np.searchsorted(targets.identity, identity)
        targets.probability[rows] = found.cluster_probability
        targets.fusions += 1
        targets.remember(p.bias_minimum_probability, p.track_memory_s)
        self._sequence += 1
        deleted = np.array(sorted(self._deleted), dtype=np.int64)
        self._deleted = []
        head = (targets.stamp_ns, self.system_uuid, self._sequence)
        return (
            fused_tracks_of(
                head, p, self.radar_states(), classes, class_prior, snapshot, mine, targets, deleted
            ),
            associations_of(head, p, snapshot, mine, found, targets),
        )

    def _learn(self, report: Report) -> None:
        """Take in what a radar learnt of the tracks that it had reported before."""
        p, before = self.parameters, self._reports[report.radar]
        self._targets.predict(report.stamp_ns, p.process_noise_density_m2ps3, p.bias_memory_s)
        company = np.full(len(report), -1)
        if before is not None and len(before) and len(report):
            _, old, new = np.intersect1d(
                before.track_id, report.track_id, assume_unique=True, return_indices=True
            )
            company[new] = before.company[old]
            known = np.isin(before.company[old], self._targets.identity)
            # A track that no detection has been given since tells nothing new.
            fresh = report.last_detection_ns[new] != before.last_detection_ns[old]
            fresh |= report.last_detection_ns[new] == 0
            old, new = old[known & fresh], new[known & fresh]
            self._learn_rows(before, report, old, new)
        company[~np.isin(company, self._targets.identity)] = -1
        self._reports[report.radar] = with_company(report, company)

    def _learn_rows(self, before: Report, report: Report, old: IntArray, new: IntArray) -> None:
        if not len(new):
            return
        p = self.parameters
        dt_s = (report.stamp_ns - before.stamp_ns) / NANOSECONDS
        intervals = self._intervals_s[report.radar]
        intervals.append(dt_s)
        noise = tracker_noise_covariance(
            dt_s, float(np.median(intervals)), p.track_process_noise_std_mps2
        )
        step = np.full(len(old), dt_s)
        expected = predict(before.mean[old], before.covariance[old], step, noise)
        information, vector, clipped = new_information(
            expected, (report.mean[new], report.covariance[new])
        )
        if clipped.any():
            self.counters["track_noise_larger_than_told"] += int(clipped.sum())
        late_s = (self._targets.stamp_ns - report.stamp_ns) / NANOSECONDS
        learnt = predict_information(information, vector, late_s, p.process_noise_density_m2ps3)
        self._targets.learn(report.radar, before.company[old], learnt)

    def _snapshot(self) -> tuple[tuple[str, ...], Snapshot]:
        """Bring the tracks of all radars that are not silent to the common time."""
        p, now = self.parameters, self._targets.stamp_ns
        live = [
            report
            for report, state in zip(self._reports, self.radar_states(), strict=True)
            if report is not None and state in (OK, LATE)
        ]
        classes = common_classes([r.class_names for r in self._reports if r is not None])
        weights = p.class_weights()
        means, covariances = [np.zeros((0, 4))], [np.zeros((0, 4, 4))]
        likelihoods = [np.ones((0, len(classes)))]
        for report in live:
            step = np.full(len(report), (now - report.stamp_ns) / NANOSECONDS)
            noise = white_noise_covariance(step, p.process_noise_density_m2ps3)
            mean, covariance = predict(report.mean, report.covariance, step, noise)
            means.append(mean)
            covariances.append(covariance)
            likelihoods.append(
                class_likelihoods(
                    report.belief, report.class_names, classes, weights, p.class_reliability
                )
            )

        def joined(name: str, kind: type) -> np.ndarray:
            return np.concatenate([np.zeros(0, kind), *(getattr(r, name) for r in live)])

        radar = np.repeat([r.radar for r in live], [len(r) for r in live]).astype(np.int64)
        return classes, Snapshot(
            radar,
            joined("track_id", np.int64),
            np.concatenate(means),
            np.concatenate(covariances),
            np.concatenate(likelihoods),
            joined("existence", np.float64),
            joined("company", np.int64),
        )

    def _associate(self, snapshot: Snapshot, class_prior: FloatArray) -> TrackAssociation:
        p, targets = self.parameters, self._targets
        prior, informed = targets.biases_before(p.track_memory_s)
        found = associate(snapshot, p, prior, class_prior)
        if not informed or not self._suspicion.looks(snapshot, found):
            return found
        other = associate(snapshot, p, targets.prior(), class_prior)
        if self._suspicion.confirmed(found, other, prior, p.bias_reset_fusions):
            self.counters["biases_begun_anew"] += 1
            targets.forget_biases()
            self._drop_companies()
            return other
        return found

    def _drop_companies(self) -> None:
        """What the targets held was forgotten: all tracks have to tell it again."""
        self._reports = [
            None if r is None else with_company(r, np.full(len(r), -1)) for r in self._reports
        ]

    def _rearrange(self, snapshot: Snapshot, mine: IntArray) -> None:
        """Let targets begin, end, and begin anew, so that each holds just its tracks (M,)."""
        p, targets = self.parameters, self._targets
        company = snapshot.company
        held = company.copy()
        for radar, report in enumerate(self._reports):
            rows = snapshot.radar == radar
            if report is not None and rows.any():
                held[rows] = report.company
        left = np.unique(company[(company >= 0) & (company != mine)])
        present = np.unique(mine)
        gone = np.setdiff1d(targets.identity, present)
        targets.end(gone, ~np.isin(gone, left), p.bias_minimum_probability)
        self._deleted += gone.tolist()
        # A target that a track has left holds what that track told.
        anew = np.intersect1d(left, present)
        targets.begin_anew(anew)
        targets.begin(np.setdiff1d(present, targets.identity))
        joined = (held != mine) | np.isin(mine, anew)
        for radar in np.unique(snapshot.radar[joined]).tolist():
            rows = joined & (snapshot.radar == radar)
            inverse = np.linalg.inv(snapshot.covariance[rows])
            vector = np.einsum("mij,mj->mi", inverse, snapshot.mean[rows])
            targets.learn(radar, mine[rows], (inverse, vector))
        for radar, report in enumerate(self._reports):
            if report is None:
                continue
            # Tracks of silent radars stay with targets that still hold what they told.
            kept = report.company.copy()
            kept[np.isin(kept, gone) | np.isin(kept, anew)] = -1
            rows = snapshot.radar == radar
            if rows.any():
                kept = mine[rows]
            self._reports[radar] = with_company(report, kept)
