"""Motion as class evidence over the real graph: the offline ring's beliefs, bit for bit."""

from __future__ import annotations

from dataclasses import replace

from graph_helpers import differences, offline, play_in_one_process

from gda_tracker.simulation.playback import of_recording, with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.simulation.simulate import simulate


def test_classes_by_motion_in_one_process(domain):
    scenario = load_scenario("class_by_motion")
    scenario = replace(
        scenario, targets=scenario.targets[:2], time=replace(scenario.time, n_scans=26)
    )
    recording = simulate(scenario, 1, 0, initiation="automatic")
    parameters = with_method(tracker_preset(scenario, "automatic"), "mht/dempster/imm")
    plays = [of_recording(recording)]
    played = play_in_one_process(plays, parameters, domain)
    expected = offline(plays, parameters)
    assert differences(played.tracks, expected) == []
    parameters["track_manager"]["class_motion"] = "off"
    plain = offline(plays, parameters)
    last = max(expected)
    # The motion is in the beliefs: helicopters by their speed, though the RCS cannot tell.
    assert len(expected[last]) >= 2
    assert (expected[last].class_probability[:2, 1] > 0.6).all()
    assert (plain[last].class_probability[:2, 1] < 0.6).all()
