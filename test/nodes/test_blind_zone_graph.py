"""A blind zone over the real graph: through a stop the offline ring's tracks, bit for bit."""

from __future__ import annotations

from dataclasses import replace

from graph_helpers import differences, offline, play_in_one_process

from gda_tracker.simulation.playback import of_recording, with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.simulation.simulate import simulate
from gda_tracker.simulation.world_sections import Stop


def test_a_vehicle_stops_in_one_process(domain):
    scenario = load_scenario("stop_and_go")
    target = replace(scenario.targets[0], stops=(Stop(8.0, 20.0, 3.0),))
    scenario = replace(
        scenario, targets=(target,), time=replace(scenario.time, n_scans=26, n_initiation_scans=2)
    )
    recording = simulate(scenario, 1, 0, initiation="automatic")
    parameters = with_method(tracker_preset(scenario, "automatic"), "mht/none/imm")
    plays = [of_recording(recording)]
    played = play_in_one_process(plays, parameters, domain)
    expected = offline(plays, parameters)
    assert differences(played.tracks, expected) == []
    assert [report.outcome for report in played.reports] == ["tracked"] * 26
    silent = [k for k, truth in enumerate(recording.truth) if 1 not in truth.source_id]
    assert len(silent) > 8
