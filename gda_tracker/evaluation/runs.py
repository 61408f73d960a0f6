"""Monte Carlo runs: simulate once, track with every method, score each of them."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gda_tracker.evaluation.clairvoyant import CLAIRVOYANT, Clairvoyant
from gda_tracker.evaluation.formation_scores import follow_formations, score_formations
from gda_tracker.evaluation.purity import confusion_counts
from gda_tracker.evaluation.quality import Quality, score_quality
from gda_tracker.formations.parameters import FormationParameters
from gda_tracker.parameters import ParameterError
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import Scenario
from gda_tracker.simulation.sensor_network import simulate_network
from gda_tracker.simulation.simulate import simulate
from gda_tracker.simulation.targets import true_states
from gda_tracker.tracking.labelled import labelled_tracks
from gda_tracker.tracking.manager import TrackManager
from gda_tracker.tracking.methods import parse_method
from gda_tracker.tracking.ring import Prepared, Ring, RingResult, stage_parameters
from gda_tracker.tracking.smoothing import Smoother
from gda_tracker.vocabulary.arrays import IntArray
from gda_tracker.vocabulary.recordings import Recording
from gda_tracker.vocabulary.tracks import Tracks

LABELLED = "labelled"
AUTOMATIC = "automatic"
INITIATIONS = (LABELLED, AUTOMATIC)


@dataclass(frozen=True)
class RunScore:
    """What one method reached in one run.

    With labelled initiation ``counts`` is the (T, T + 2) table of
    :func:`~gda_tracker.evaluation.purity.confusion_counts`, with automatic initiation
    ``quality`` is set. ``delayed_counts`` is the table of the tracks with their revised past,
    for methods that revise it. ``cpu_s`` is the processor time of the tracker alone over
    ``n_scans`` scans.
    """

    counts: IntArray | None
    quality: Quality | None
    cpu_s: float
    n_scans: int
    delayed_counts: IntArray | None = None


def method_parameters(
    scenario: Scenario, method: str, initiation: str
) -> dict[str, dict[str, Any]]:
    """Return ``{node: {parameter: value}}``: what the scenario tells the tracker, and the method.

    ``clairvoyant`` stands for association by the truth over the ``cv`` filter.

    Raises
    ------
    ParameterError
        If the method or one of the values is not allowed.
    """
    choice = (
        {"decision": "gda", "attribute_term": "none", "filter": "cv"}
        if method == CLAIRVOYANT
        else parse_method(method)
    )
    if method == CLAIRVOYANT and initiation != LABELLED:
        raise ParameterError(
            f"method {CLAIRVOYANT} with initiation {initiation}: allowed is labelled, since only "
            f"then it is known which track follows which target"
        )
    if scenario.only_automatic and initiation != AUTOMATIC:
        raise ParameterError(
            f"scenario {scenario.name} with initiation {initiation}: allowed is automatic, for "
            f"its sensors need not know where a detection is, or its targets have several"
        )
    preset = tracker_preset(scenario, initiation)
    parameters = {**preset, "track_manager": {**preset["track_manager"], **choice}}
    stage_parameters(parameters)
    return parameters


def default_match_distance_m(scenario: Scenario) -> float:
    """Match distance for continuity: three standard deviations of a position measured midway.

    The larger of the range noise and the azimuth noise at the mean distance of all targets counts.
    A scenario with several sensors, or with extended targets, says what it is.
    """
    if scenario.reach is not None:
        return scenario.reach.match_distance_m
    if scenario.extended is not None:
        return scenario.extended.match_distance_m
    positions = true_states(scenario)[..., :2] - np.array(scenario.sensor.position_m)
    cross_range_m = math.radians(scenario.sensor.azimuth_std_deg) * float(
        np.hypot(positions[..., 0], positions[..., 1]).mean()
    )
    return max(3.0 * max(scenario.sensor.range_std_m, cross_range_m), 1.0)


class Contestant:
    """One method on one scenario, made once for many runs.

    The stages without state, and what they have computed at the start (histograms), are shared by
    all runs; the track manager, the only one with state, is new in every run.
    """

    def __init__(
        self,
        scenario: Scenario,
        method: str,
        initiation: str,
        formations: FormationParameters | None = None,
    ) -> None:
        self.scenario = scenario
        self._formations = formations
        self.method = method
        self.initiation = initiation
        self.parameters = method_parameters(scenario, method, initiation)
        self._ring = Ring(self.parameters)
        # Track ids are the ranks of the target ids, from 1.
        self._target_ids = np.sort(np.array([target.id for target in scenario.targets]))
        self._track_ids = np.arange(1, len(self._target_ids) + 1)

    def prepare(self, recording: Recording) -> tuple[list[Prepared], float]:
        """Prepare the scans of a run for all methods; also the processor time for those scored [s].

        What is prepared depends on the scenario alone, since a method only chooses how detections
        are associated and filtered.
        """
        skip, prepare = self._skip, self._ring.prepare
        first = [prepare(detections) for detections in recording.detections[:skip]]
        start = time.process_time()
        scored = [prepare(detections) for detections in recording.detections[skip:]]
        return first + scored, time.process_time() - start

    @property
    def _skip(self) -> int:
        """Scans that the tracker does not see: those of the labelled initiation."""
        return 0 if self.initiation == AUTOMATIC else self.scenario.time.n_initiation_scans

    def score(
        self,
        recording: Recording,
        match_distance_m: float | None,
        prepared: tuple[list[Prepared], float],
    ) -> RunScore:
        """Track one simulated run and score it; ``prepared`` comes from :meth:`prepare`."""
        assert recording.truth is not None
        ring, skip = self._new_ring(recording), self._skip
        if self.initiation == AUTOMATIC:
            ring.smoother = Smoother()
            results, cpu_s = _track(ring, recording, skip, prepared)
            distance = match_distance_m or default_match_distance_m(self.scenario)
            quality = score_quality(
                results, recording.truth, distance, _delayed(results, ring), ring.smoother.tracks()
            )
            if self._formations is not None:
                quality = self._with_formations(quality, results, recording, distance)
            return RunScore(None, quality, cpu_s, len(results))
        ring.initialise(labelled_tracks(recording, skip, ring, prepared[0]))
        results, cpu_s = _track(ring, recording, skip, prepared)
        tracks = [result.tracks for result in results if result.tracks is not None]
        truth, ids = recording.truth[skip:], (self._track_ids, self._target_ids)
        counts = confusion_counts(tracks, truth, *ids)
        delayed = _delayed(results, ring)
        revised = confusion_counts(delayed, truth, *ids) if delayed else None
        return RunScore(counts, None, cpu_s, len(tracks), delayed_counts=revised)

    def _with_formations(
        self,
        quality: Quality,
        results: Sequence[RingResult],
        recording: Recording,
        match_distance_m: float,
    ) -> Quality:
        assert self._formations is not None
        assert recording.truth is not None
        found = follow_formations(results, self._formations)
        tracks = [result.tracks for result in results if result.tracks is not None]
        score = score_formations(found, tracks, recording.truth, match_distance_m, self._formations)
        return replace(quality, formations=score)

    def _new_ring(self, recording: Recording) -> Ring:
        ring = copy(self._ring)
        ring.manager = TrackManager(self._ring.manager.parameters)
        if self.method == CLAIRVOYANT:
            assert recording.truth is not None
            pairs = zip(self._track_ids.tolist(), self._target_ids.tolist(), strict=True)
            ring.associate = Clairvoyant(recording.truth, dict(pairs))
        return ring


def score_runs(
    scenario: Scenario,
    methods: Sequence[str],
    seed: int,
    runs: Iterable[int],
    initiation: str = LABELLED,
    match_distance_m: float | None = None,
    formations: FormationParameters | None = None,
) -> list[list[RunScore]]:
    """Simulate runs and score every method on the same scans.

    Parameters
    ----------
    scenario, methods, initiation, match_distance_m, formations
        As in :func:`~gda_tracker.evaluation.monte_carlo.monte_carlo`.
    seed, runs
        Which random numbers.

    Returns
    -------
    list of lists of RunScore
        Per run one score per method.
    """
    contestants = [Contestant(scenario, method, initiation, formations) for method in methods]
    scores = []
    for run in runs:
        recording = (
            simulate_network(scenario, seed, run)
            if scenario.sensors
            else simulate(scenario, seed, run, initiation=initiation)
        )
        prepared = contestants[0].prepare(recording)
        scores.append(
            [contestant.score(recording, match_distance_m, prepared) for contestant in contestants]
        )
    return scores


def _delayed(results: Sequence[RingResult], ring: Ring) -> list[Tracks]:
    """Tracks with their revised past, if the method revises it."""
    return [told for result in results for told in result.delayed] + ring.rest_of_delayed()


def _track(
    ring: Ring,
    recording: Recording,
    skip: int,
    prepared: tuple[list[Prepared], float],
) -> tuple[list[RingResult], float]:
    """Take scans round the ring, but the first ``skip``; what came of each, processor time.

    The time of the preparation counts in full, as if it had not been shared.
    """
    results = []
    scans, preparation_s = prepared
    start = time.process_time()
    for detections, known in zip(recording.detections[skip:], scans[skip:], strict=True):
        result = ring.process(detections, known)
        if result.tracks is None:
            report = result.report
            raise RuntimeError(
                f"scan at {detections.stamp_ns} ns of {recording.origin}: {report.outcome} "
                f"({report.reason}), and a scan without tracks cannot be scored"
            )
        results.append(result)
    return results, time.process_time() - start + preparation_s
