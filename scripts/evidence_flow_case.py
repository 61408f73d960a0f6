"""Which scan ``docs/evidence-flow.md`` shows: the rule, and the search for it."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from gda_tracker.simulation.playback import with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import Scenario, load_scenario
from gda_tracker.simulation.simulate import simulate
from gda_tracker.tracking.labelled import labelled_tracks
from gda_tracker.tracking.manager import TrackManager
from gda_tracker.tracking.ring import Ring, RingResult
from gda_tracker.vocabulary.recordings import Recording
from gda_tracker.vocabulary.scans import ScanTruth

SCENARIO = "crossing_targets"
RUNS, SEED = 60, 1
KINEMATICS, CHAPTER, LIKELIHOOD = METHODS = ("gda/none/cv", "gda/dsm_classic/cv", "map/bayes/cv")
# Kinematics must favour the swap by this much: else the example would be a coin toss.
ODDS = 2.0
# Detection of track 1 and of track 2, 0 for none, in the order of the chapter's table 14.2.
HYPOTHESES = ((0, 0), (1, 0), (2, 0), (0, 1), (0, 2), (1, 2), (2, 1))


@dataclass(frozen=True)
class Case:
    """One run tracked by all methods, and the scan to show: entry ``shown`` of the lists.

    ``rows`` are the detections of target 1 and 2 in that scan; ``contested`` counts scans by the
    methods that decided them right (see :func:`search`).
    """

    runs: int
    run: int
    shown: int
    play: Recording
    rings: dict[str, Ring]
    results: dict[str, list[RingResult]]
    rows: np.ndarray
    contested: Counter[tuple[bool, ...]]

    def result(self, method: str) -> RingResult:
        """What the ring made of the scan to show."""
        return self.results[method][self.shown]

    def pairs(self) -> np.ndarray:
        """Rows (2, 2) of the pairs, tracks by detections."""
        found = self.result(CHAPTER).scores
        index = {p: i for i, p in enumerate(zip(found.hypothesis, found.detection, strict=True))}
        return np.array([[index[track, row] for row in self.rows] for track in (0, 1)])

    @property
    def number(self) -> int:
        """Number of the scan in its run, from 1, the scans of the initiation included."""
        return self.play.detections[self.shown].sequence + 1

    def table(self, method: str, stage: str, name: str) -> np.ndarray:
        """Values (2, 2) of the pairs in a field of ``scores`` or ``associations``."""
        return getattr(getattr(self.result(method), stage), name)[self.pairs()]


def make_rings(scenario: Scenario) -> dict[str, Ring]:
    """A ring per method."""
    preset = tracker_preset(scenario)
    return {method: Ring(with_method(preset, method)) for method in METHODS}


def start(rings: dict[str, Ring], scenario: Scenario, seed: int, run: int) -> Recording:
    """Simulate a run, start every ring on its labelled detections, return the scans after them."""
    recording = simulate(scenario, seed, run)
    skip = scenario.time.n_initiation_scans
    for ring in rings.values():
        # All but the track manager keep nothing from run to run.
        ring.manager = TrackManager(ring.manager.parameters)
        ring.initialise(labelled_tracks(recording, skip, ring))
    assert recording.truth is not None
    return replace(recording, detections=recording.detections[skip:], truth=recording.truth[skip:])


def own_rows(result: RingResult, truth: ScanTruth) -> np.ndarray:
    """Rows in the scan of the detections of the targets by rising id, -1 for a missed one."""
    source = truth.source_id[result.scan.source_index]
    rows = [np.flatnonzero(source == target) for target in np.sort(truth.target_id)]
    return np.array([row[0] if len(row) else -1 for row in rows])


def contested(result: RingResult, rows: np.ndarray) -> bool:
    """Whether both tracks have gated both targets' detections and nothing else."""
    found = zip(result.associations.hypothesis, result.associations.detection, strict=True)
    return rows.min() >= 0 and set(found) == {(track, row) for track in (0, 1) for row in rows}


def own_probability(result: RingResult, rows: np.ndarray) -> float:
    """P_k of the first track and its own target's detection."""
    found = result.associations
    return float(found.p_kinematic[(found.hypothesis == 0) & (found.detection == rows[0])][0])


def search(runs: int, seed: int) -> Case:
    """Find the scan, and count how such scans end.

    Runs are looked at in order, each as long as every method gives each track its own target's
    detection; so up to there all of them have the same kinematic tracks. Contested scans are
    counted by who is right. The first one is shown in which kinematics prefer the swap by ``ODDS``
    to one, and the chapter's term and the class likelihoods both decide right.

    Raises
    ------
    RuntimeError
        If there is no such scan.
    """
    counts: Counter[tuple[bool, ...]] = Counter()
    found = None
    scenario = load_scenario(SCENARIO)
    rings = make_rings(scenario)
    for run in range(runs):
        play = start(rings, scenario, seed, run)
        for step, (detections, truth) in enumerate(zip(play.detections, play.truth, strict=True)):
            results = [ring.process(detections) for ring in rings.values()]
            rows = own_rows(results[0], truth)
            verdict = tuple(
                np.array_equal(r.associations.assigned_detection, rows) for r in results
            )
            if contested(results[0], rows):
                counts[verdict] += 1
                wanted = verdict == (False, True, True) and found is None
                if wanted and own_probability(results[0], rows) <= 1.0 / (1.0 + ODDS):
                    found = run, step, rows
            if rows.min() < 0 or not all(verdict):
                break
    if found is None:
        raise RuntimeError(f"no scan in {runs} runs of seed {seed} is as the rule wants it")
    run, shown, rows = found
    play = start(rings, scenario, seed, run)
    results = {name: [ring.process(d) for d in play.detections] for name, ring in rings.items()}
    return Case(runs, run, shown, play, rings, results, rows, counts)


def weights(case: Case) -> dict[str, np.ndarray]:
    """Normalised weights (7,) of the joint hypotheses, written out from the pairs' own numbers.

    The ring computes its probabilities without this list; they are sums over it.
    """
    predictions = case.result(CHAPTER).predictions
    p_d, beta = predictions.detection_probability[0], predictions.settings.clutter_density
    g = np.exp(case.table(CHAPTER, "associations", "kinematic_log_likelihood"))
    distance = case.table(CHAPTER, "scores", "distance")
    bayes = case.result(LIKELIHOOD).scores
    likelihood = np.exp(bayes.log_likelihood[case.pairs()])
    clutter = np.exp(bayes.clutter_log_likelihood[case.rows])

    def weigh(pair: np.ndarray, idle: float, free: np.ndarray, fullest: bool) -> np.ndarray:
        found = []
        for hypothesis in HYPOTHESES:
            taken = [(track, d - 1) for track, d in enumerate(hypothesis) if d]
            left = [d for d in (0, 1) if d + 1 not in hypothesis]
            weight = idle ** (2 - len(taken)) * np.prod(free[left])
            weight *= np.prod([pair[p] for p in taken])
            found.append(weight if len(taken) == 2 or not fullest else 0.0)
        return np.array(found) / np.sum(found)

    assert predictions.settings.missed_track_hypotheses == "zero"
    ones = np.ones(2)
    return {
        "kinematics": weigh(p_d * g, 1.0 - p_d, beta * ones, fullest=False),
        "distances": weigh(distance, 1.0, ones, fullest=True),
        "likelihoods": weigh(p_d * g * likelihood, 1.0 - p_d, beta * clutter, fullest=False),
    }
