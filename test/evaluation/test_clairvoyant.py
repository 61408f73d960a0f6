"""Association by the truth."""

from __future__ import annotations

import numpy as np
import pytest

from gda_tracker.evaluation.clairvoyant import Clairvoyant
from gda_tracker.evaluation.runs import Contestant, score_runs
from gda_tracker.kinematics.gating import gate
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.simulation.simulate import simulate
from gda_tracker.tracking.labelled import labelled_tracks
from gda_tracker.tracking.ring import Ring


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("closely_spaced_targets")


def test_own_detection_whenever_detected_and_gated(scenario):
    recording = simulate(scenario, 2)
    parameters = Contestant(scenario, "clairvoyant", "labelled").parameters
    decide = Clairvoyant(recording.truth, {1: 1, 2: 2, 3: 3, 4: 4})
    ring = Ring(parameters, decide)
    ring.initialise(labelled_tracks(recording, 2, Ring(parameters)))
    assigned = missed = 0
    for detections, truth in zip(recording.detections[2:], recording.truth[2:], strict=True):
        result = ring.process(detections)
        pairs = gate(result.scan, result.predictions)
        gated = set(zip(pairs.hypothesis.tolist(), pairs.detection.tolist(), strict=True))
        for row, detection in enumerate(result.associations.assigned_detection):
            own = np.flatnonzero(truth.source_id[result.scan.source_index] == row + 1)
            expected = int(own[0]) if len(own) and (row, int(own[0])) in gated else -1
            assert detection == expected
            assigned += expected >= 0
            missed += expected < 0
    assert assigned > 100
    assert missed > 0


def test_only_own_detections_or_misses_are_scored(scenario):
    for run in score_runs(scenario, ["clairvoyant"], 4, range(3)):
        counts = run[0].counts
        others = counts.copy()
        np.fill_diagonal(others, 0)
        others[:, -2] = 0
        assert not others.any()
        assert counts.trace() > 0.95 * counts.sum()


def test_truth_without_sources_is_named(scenario):
    recording = simulate(scenario, 2)
    parameters = Contestant(scenario, "clairvoyant", "labelled").parameters
    initial = labelled_tracks(recording, 2, Ring(parameters))
    for truth in recording.truth:
        truth.source_id = None
    ring = Ring(parameters, Clairvoyant(recording.truth, {1: 1, 2: 2, 3: 3, 4: 4}))
    ring.initialise(initial)
    with pytest.raises(ValueError, match="source_id of its detections is missing"):
        ring.process(recording.detections[2])
