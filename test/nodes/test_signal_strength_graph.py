"""Signal strength over the real graph: the offline ring's tracks, bit for bit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from graph_helpers import differences, offline, play_in_one_process

from gda_tracker.simulation.playback import of_recording, with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.simulation.simulate import simulate


def test_strengths_travel_through_the_nodes(domain):
    scenario = load_scenario("weak_targets")
    scenario = replace(scenario, time=replace(scenario.time, n_scans=14))
    parameters = with_method(tracker_preset(scenario, "automatic"), "mht/bayes/cv")
    plays = [of_recording(simulate(scenario, 1))]
    played = play_in_one_process(plays, parameters, domain)
    expected = offline(plays, parameters)
    assert differences(played.tracks, expected) == []
    assert [report.outcome for report in played.reports] == ["tracked"] * 14
    last = expected[max(expected, key=lambda key: key[1])]
    assert len(last) > 0
    assert np.isfinite(last.signal_strength).all()
