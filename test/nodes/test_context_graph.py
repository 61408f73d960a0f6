"""Lanes and a plan over the real graph: the offline ring's tracks, bit for bit."""

from __future__ import annotations

from dataclasses import replace

from graph_helpers import differences, offline, play_in_one_process

from gda_tracker.simulation.playback import of_scenario, with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario


def test_vehicles_on_roads_in_one_process(domain):
    method = "mht/none/cv"
    scenario = load_scenario("road_network")
    scenario = replace(scenario, time=replace(scenario.time, n_scans=20))
    parameters = with_method(tracker_preset(scenario), method)
    plays = of_scenario(scenario, 1, 1, method)
    played = play_in_one_process(plays, parameters, domain)
    expected = offline(plays, parameters)
    assert differences(played.tracks, expected) == []
    assert [report.outcome for report in played.reports] == ["tracked"] * 18
    # The map says something of them.
    untold = with_method(tracker_preset(load_scenario("road_network_untold")), method)
    assert differences(offline(plays, untold), expected) != []
