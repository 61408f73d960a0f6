"""Every attribute term in the whole ring, on a scenario, and changed while it runs."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from gda_tracker.association.choices import DECISIONS
from gda_tracker.attributes.terms import ATTRIBUTE_TERMS, DISTANCE_TERMS
from gda_tracker.simulation.playback import of_scenario, with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.tracking.ring import Ring


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("crossing_targets")


def check_beliefs(tracks, term):
    assert np.isfinite(tracks.mean).all()
    if term == "none":
        return
    assert (tracks.class_probability >= 0.0).all()
    np.testing.assert_allclose(tracks.class_probability.sum(axis=1), 1.0, atol=1e-9)
    if term in DISTANCE_TERMS:
        assert (tracks.masses >= 0.0).all()
        np.testing.assert_allclose(tracks.masses.sum(axis=1), 1.0, atol=1e-9)


def check_scores(scores):
    assert np.isfinite(scores.distance).all()
    assert np.isfinite(scores.log_likelihood).all()
    assert ((scores.conflict >= 0.0) & (scores.conflict <= 1.0 + 1e-12)).all()


@pytest.mark.parametrize("decision", DECISIONS)
@pytest.mark.parametrize("term", ATTRIBUTE_TERMS)
def test_a_run_of_the_crossing_targets(scenario, term, decision):
    method = f"{decision}/{term}/cv"
    (play,) = of_scenario(scenario, 1, 1, method)
    ring = Ring(with_method(tracker_preset(scenario), method))
    ring.initialise(play.initial)
    asked = 0
    for detections in play.detections:
        result = ring.process(detections)
        assert result.report.outcome == "tracked"
        assert result.scores.attribute_term == term
        check_scores(result.scores)
        check_beliefs(result.tracks, term)
        asked += int(np.count_nonzero(result.associations.p_attribute < 1.0))
    # The distance speaks under gda, and there alone.
    assert (asked > 0) is (decision == "gda" and term in DISTANCE_TERMS)


def test_the_term_changes_with_every_scan(scenario):
    """All ordered pairs of terms, one after the other; the tracks go on."""
    method = "gda/dsm_classic/cv"
    plays = of_scenario(scenario, 7, 2, method)
    changes = itertools.cycle(
        term for pair in itertools.permutations(ATTRIBUTE_TERMS, 2) for term in pair
    )
    ring = Ring(with_method(tracker_preset(scenario), method))
    seen = set()
    for play in plays:
        ring.initialise(play.initial)
        previous = ring.manager.parameters.attribute_term
        for detections in play.detections:
            term = next(changes)
            ring.manager.set_parameters(replace(ring.manager.parameters, attribute_term=term))
            result = ring.process(detections)
            assert result.report.outcome == "tracked"
            assert result.scores.attribute_term == term
            check_scores(result.scores)
            check_beliefs(result.tracks, term)
            seen.add((previous, term))
            previous = term
    assert {(a, b) for a, b in itertools.permutations(ATTRIBUTE_TERMS, 2)} <= seen


def test_forgetting_changes_every_term_with_a_history(scenario):
    for term in ATTRIBUTE_TERMS:
        method = f"map/{term}/cv"
        preset = with_method(tracker_preset(scenario), method)
        (play,) = of_scenario(scenario, 1, 3, method)
        ends = []
        for factor in (1.0, 0.6):
            policy = {"history_policy": "none" if factor == 1.0 else "forgetting"}
            manager = {**preset["track_manager"], **policy, "forgetting_factor": factor}
            ring = Ring({**preset, "track_manager": manager})
            ring.initialise(play.initial)
            for detections in play.detections[:6]:
                tracks = ring.process(detections).tracks
            ends.append(tracks.class_probability)
        if term == "none":
            np.testing.assert_array_equal(*ends)
        else:
            assert np.abs(ends[0] - ends[1]).max() > 1e-3, term
