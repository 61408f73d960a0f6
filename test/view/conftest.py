"""Crossing targets through the ring: what came round it, and its pictures."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from gda_tracker.simulation.playback import of_scenario, with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.tracking.ring import Ring
from gda_tracker.view.history import History
from gda_tracker.view.picture import picture_of


def played(method: str, scenario: str = "closely_spaced_targets", seed: int = 3):
    """One run: playback, parameters, results, history with a picture of each."""
    loaded = load_scenario(scenario)
    play = of_scenario(loaded, 1, seed, method)[0]
    parameters = with_method(tracker_preset(loaded), method)
    ring = Ring(parameters)
    ring.initialise(play.initial)
    history, results, previous = History(), [], None
    for detections in play.detections:
        results.append(ring.process(detections))
        history.add(picture_of(results[-1], previous))
        previous = results[-1].tracks
    return SimpleNamespace(play=play, parameters=parameters, results=results, history=history)


@pytest.fixture(scope="session")
def gda():
    """Belief masses, one hypothesis per track."""
    return played("gda/dsm_classic/cv")


@pytest.fixture(scope="session")
def mht():
    """Class likelihoods, hypothesis trees, mixtures."""
    return played("mht/bayes/imm")
