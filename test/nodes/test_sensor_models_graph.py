"""Sensors with a model of their own over the real graph: the offline ring's tracks, bit for bit."""

from __future__ import annotations

from dataclasses import replace

from graph_helpers import differences, offline, play_in_one_process, play_in_processes

from gda_tracker.simulation.playback import of_recording, with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.simulation.sensor_network import simulate_network


def _play(name, method, n_scans, **changes):
    scenario = load_scenario(name)
    scenario = replace(
        scenario,
        time=replace(scenario.time, n_scans=n_scans),
        reach=replace(scenario.reach, components=12),
    )
    parameters = with_method(tracker_preset(scenario), method)
    parameters["track_manager"].update(changes)
    return [of_recording(simulate_network(scenario, 1, 0))], parameters


def test_time_and_frequency_differences_in_four_processes(environment):
    plays, parameters = _play("moving_emitter", "mht/bayes/imm", 25)
    played = play_in_processes(plays, parameters, environment)
    expected = offline(plays, parameters)
    assert differences(played.tracks, expected) == []
    assert [report.outcome for report in played.reports] == ["tracked"] * 25
    assert max(len(tracks) for tracks in expected.values()) > 0


def test_three_kinds_of_sensors_in_one_process(domain):
    plays, parameters = _play("mixed_sensors", "jpda/none/cv", 12)
    played = play_in_one_process(plays, parameters, domain)
    expected = offline(plays, parameters)
    assert differences(played.tracks, expected) == []
    assert {sensor for sensor, _ in expected} == {"finder", "passive", "beacon"}
