"""Tracks in, events out: all tests together, and what is not taken."""

from __future__ import annotations

from collections import Counter

import numpy as np

from gda_tracker.events.found import Design, TrackEvent, TrackEvents
from gda_tracker.events.lane_test import LaneTest
from gda_tracker.events.motion_tests import AccelerationTest, StopTest
from gda_tracker.events.parameters import EventParameters
from gda_tracker.events.plan_test import PlanTest
from gda_tracker.events.samples import SampleClock, States
from gda_tracker.events.split_test import SplitTest
from gda_tracker.kinematics.context import Context, LaneMap
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks

_SIZE = 4  # x, y, vx, vy; what further components a state has is not looked at
# No position, speed or variance of a track; squares and quotients of them stay far from overflow.
LARGEST_NUMBER, SMALLEST_VARIANCE = 1e12, 1e-12


class TracksRejected(ValueError):
    """Tracks of a scan that are not taken; the message is the reason, one word."""

    def __init__(self, reason: str, detail: str = "") -> None:
        super().__init__(reason)
        self.detail = detail


class TrackEventDetector:
    """Tests the tracks of one tracker, scan after scan.

    Parameters
    ----------
    parameters
        The table of the node.
    context
        Lanes and plans.

    Attributes
    ----------
    counters
        What was left out, by reason, and events by kind.
    """

    def __init__(self, parameters: EventParameters, context: Context | None = None) -> None:
        self.parameters = parameters
        self.context = context or Context()
        self.counters: Counter[str] = Counter()
        test = parameters.thresholds()
        self._design = Design(
            test.log_reject,
            test.log_accept,
            parameters.false_alarm_probability,
            parameters.miss_probability,
        )
        self.reset()

    def reset(self) -> None:
        """Forget all tracks; the counters stay."""
        parameters, chosen = self.parameters, self.parameters.tests
        self._epoch: int | None = None
        self._system_uuid = b""
        self._last_ns = 0
        self._clock = SampleClock(parameters.independence_factor)
        self._lanes = LaneTest(LaneMap(self.context.lanes), parameters)
        self._tests: list[LaneTest | PlanTest | StopTest | AccelerationTest] = []
        if "lanes" in chosen and self.context.lanes:
            self._tests.append(self._lanes)
        if "plans" in chosen and self.context.plans:
            self._tests.append(PlanTest(self.context.plans, parameters))
        if "stops" in chosen:
            self._tests.append(StopTest(parameters))
        if "accelerations" in chosen:
            self._tests.append(AccelerationTest(parameters))
        self._splits = SplitTest(parameters) if "splits" in chosen else None

    def take(self, tracks: Tracks) -> TrackEvents:
        """Test the tracks of a scan; a new epoch or another tracker begins anew.

        Raises
        ------
        TracksRejected
            ``older_epoch``, ``tracks_time_backwards``, ``tracks_other_frame``,
            ``tracks_state_too_small`` or ``tracks_duplicate_track_id``; nothing is changed.
        """
        self._check(tracks)
        key = tracks.key
        if (key.epoch, tracks.system_uuid) != (self._epoch, self._system_uuid):
            if self._epoch is not None:
                self.counters["began_anew"] += 1
            self.reset()
        self._epoch, self._system_uuid = key.epoch, tracks.system_uuid
        self._last_ns = key.stamp_ns
        states, confirmed = self._states(tracks)
        events: list[TrackEvent] = []
        if self._splits is not None:
            findings, decisions = self._splits.step(states, confirmed, tracks.track_id)
            events += [self._design.event(found, states, decisions) for found in findings]
        tested = self._with_due(states.select(confirmed))
        for test in self._tests:
            findings, decisions = test.step(tested)
            events += [self._design.event(found, tested, decisions) for found in findings]
        self.counters.update(self._lanes.counters)
        self._lanes.counters.clear()
        self.counters.update(f"event {event.kind}" for event in events)
        return TrackEvents(key, tracks.frame_id, tracks.system_uuid, events)

    def _check(self, tracks: Tracks) -> None:
        key = tracks.key
        if self._epoch is not None and key.epoch < self._epoch:
            raise TracksRejected("older_epoch")
        same = (key.epoch, tracks.system_uuid) == (self._epoch, self._system_uuid)
        if same and key.stamp_ns < self._last_ns:
            raise TracksRejected(
                "tracks_time_backwards", f"{key.stamp_ns} ns after {self._last_ns} ns"
            )
        wanted = self.context.frame_id
        if wanted and tracks.frame_id != wanted:
            raise TracksRejected(
                "tracks_other_frame",
                f"tracks in {tracks.frame_id!r}, lanes and plans in {wanted!r}",
            )
        if len(tracks) and tracks.mean.shape[1] < _SIZE:
            raise TracksRejected("tracks_state_too_small", f"{tracks.mean.shape[1]} components")
        if len(np.unique(tracks.track_id)) != len(tracks):
            raise TracksRejected("tracks_duplicate_track_id")

    def _states(self, tracks: Tracks) -> tuple[States, BoolArray]:
        """States that can be tested, by rising id, and which of them are confirmed."""
        mean = tracks.mean[:, :_SIZE]
        covariance = tracks.covariance[:, :_SIZE, :_SIZE]
        with np.errstate(invalid="ignore"):
            small = np.abs(
                np.concatenate([mean, covariance.reshape(len(mean), _SIZE * _SIZE)], axis=1)
            )
            numbers = np.asarray((small < LARGEST_NUMBER).all(axis=1), dtype=bool)
        covariance = np.where(numbers[:, None, None], covariance, np.eye(_SIZE))
        covariance = (covariance + covariance.swapaxes(1, 2)) / 2.0
        definite = _positive_definite(covariance)
        self._leave_out(~numbers, "event_track_not_finite")
        self._leave_out(numbers & ~definite, "event_track_bad_covariance")
        good = np.flatnonzero(numbers & definite)
        good = good[np.argsort(tracks.track_id[good])]
        detected = tracks.detection_index[good] >= 0
        states = States(
            tracks.key.stamp_ns,
            tracks.track_id[good],
            mean[good, :2],
            mean[good, 2:],
            covariance[good] * self.parameters.covariance_factor,
            detected,
            np.zeros(len(good), dtype=bool),
            not tracks.degraded,
        )
        return states, tracks.status[good] == CONFIRMED

    def _leave_out(self, which: BoolArray, reason: str) -> None:
        if which.any():
            self.counters[reason] += int(which.sum())

    def _with_due(self, states: States) -> States:
        due = self._clock.due(states.stamp_ns, states.track_id, states.covariance, states.detected)
        return States(
            states.stamp_ns,
            states.track_id,
            states.position,
            states.velocity,
            states.covariance,
            states.detected,
            due,
            states.looked,
        )


def _positive_definite(covariance: FloatArray) -> BoolArray:
    """Whether each (N, 4, 4) is, in units in which its variances are 1."""
    variance = np.einsum("nii->ni", covariance)
    positive: BoolArray = (variance >= SMALLEST_VARIANCE).all(axis=1)
    scale = np.sqrt(np.where(positive[:, None], variance, 1.0))
    correlation = covariance / scale[:, :, None] / scale[:, None, :]
    smallest = np.linalg.eigvalsh(correlation)[:, 0]
    definite: BoolArray = positive & (smallest > 1e-12)
    return definite
