"""The graph gives the offline ring's tracks, bit for bit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from graph_helpers import (
    TIMEOUT_S,
    differences,
    offline,
    offline_delayed,
    play,
    play_in_one_process,
    play_in_processes,
    scenario_plays,
    with_statements,
)
from rclpy.parameter import Parameter

from gda_tracker.io.adapters import load_recording
from gda_tracker.io.bags import read_bag
from gda_tracker.io.messages import scan_from_message, tracks_from_message
from gda_tracker.nodes.recorder import RecorderNode
from gda_tracker.nodes.runner import Nodes, RingProcesses, stage_nodes
from gda_tracker.nodes.scan_source import ScanSourceNode
from gda_tracker.simulation.playback import Playback, of_recording
from gda_tracker.tracking.ring import Ring

METHODS = (
    "gda/none/cv",
    "gda/dsm_classic/cv",
    "gda/dempster/cv",
    "gda/pcr5/cv",
    "map/bayes/cv",
    "map/bayes/imm",
    "jpda/bayes/cv",
    "mht/bayes/cv",
)
# Whether the nodes share a process or not makes no difference to what a method says on the topics:
# one method of each kind of answers.
IN_PROCESSES = ("gda/none/cv", "gda/pcr5/cv", "map/bayes/imm", "mht/bayes/cv")


@pytest.mark.parametrize("method", IN_PROCESSES)
def test_four_processes(method, environment):
    plays, parameters = scenario_plays("crossing_targets", method)
    played = play_in_processes(plays, parameters, environment)
    assert differences(played.tracks, offline(plays, parameters)) == []
    assert [r.outcome for r in played.reports] == ["tracked"] * len(plays[0].detections)


@pytest.mark.parametrize("method", METHODS)
def test_four_nodes_in_one_process(method, domain):
    plays, parameters = scenario_plays("closely_spaced_targets", method)
    played = play_in_one_process(plays, parameters, domain)
    assert differences(played.tracks, offline(plays, parameters)) == []


@pytest.mark.parametrize("window", [1, 5])
@pytest.mark.parametrize("method", ["gda/dsm_classic/cv", "map/bayes/cv"])
def test_history_windows(method, window, domain):
    """Beliefs of the last detections: what the nodes need for them is in the predictions."""
    plays, parameters = scenario_plays("closely_spaced_targets", method)
    without = offline(plays, parameters)
    parameters["track_manager"] |= {"history_policy": "window", "history_window": window}
    expected = offline(plays, parameters)
    assert differences(expected, without)
    played = play_in_one_process(plays, parameters, domain)
    assert differences(played.tracks, expected) == []


def test_unresolved_targets(domain):
    """Who may share a detection, and what it tells of both, travels between the nodes."""
    plays, parameters = scenario_plays("unresolved_pair", "jpda/none/cv")
    for item in plays:
        # From shortly before they meet until they have shared some.
        item.detections, item.truth = item.detections[:16], item.truth[:16]
    expected = offline(plays, parameters)
    played = play_in_one_process(plays, parameters, domain)
    assert differences(played.tracks, expected) == []
    untold = {**parameters["track_manager"], "resolution_range_m": 0.0}
    parameters["track_manager"] = {**untold, "resolution_azimuth_rad": 0.0}
    assert differences(expected, offline(plays, parameters))


def test_sequential_extraction_and_estimated_clutter(domain):
    """The density that association is told changes from scan to scan, and travels exactly."""
    plays, parameters = scenario_plays("crossing_targets", "map/bayes/cv")
    parameters["track_manager"] |= {"initiation": "automatic"}
    for item in plays:
        item.initial = None
    without = offline(plays, parameters)
    parameters["track_manager"] |= {"extraction": "sequential", "clutter_density": "estimated"}
    expected = offline(plays, parameters)
    assert differences(expected, without)
    played = play_in_one_process(plays, parameters, domain)
    assert differences(played.tracks, expected) == []


def test_clutter_of_bearings_that_is_estimated(domain):
    """The density at every detection, over the mean one, travels with the scan."""
    plays, parameters = scenario_plays("busy_coast", "jpda/none/cv")
    for item in plays:
        item.detections, item.truth = item.detections[:16], item.truth[:16]
    expected = offline(plays, parameters)
    played = play_in_one_process(plays, parameters, domain)
    assert differences(played.tracks, expected) == []
    parameters["track_manager"] |= {"clutter_density": "given"}
    assert differences(expected, offline(plays, parameters))


@pytest.mark.parametrize("filter_", ["imm", "gpb2"])
def test_models_with_states_of_their_own(filter_, domain):
    """Accelerations and turn rates stay in the track manager; nobody else needs them."""
    plays, parameters = scenario_plays("crossing_targets", f"mht/bayes/{filter_}")
    without = offline(plays, parameters)
    parameters["track_manager"] |= {
        "imm_models": ["constant_velocity", "singer", "coordinated_turn"],
        "imm_process_noise_factors": [0.2, 1.0, 0.3],
        "imm_mean_sojourn_s": [20.0, 20.0, 20.0],
    }
    expected = offline(plays, parameters)
    assert differences(expected, without)
    played = play_in_one_process(plays, parameters, domain)
    assert differences(played.tracks, expected) == []


def test_forgetting_and_a_window_in_processes(environment):
    """Tracks that start by themselves begin their windows, too."""
    plays, parameters = scenario_plays("crossing_targets", "gda/dempster/cv")
    parameters["track_manager"] |= {
        "initiation": "automatic",
        "history_policy": "window",
        "history_window": 3,
    }
    for item in plays:
        item.initial = None
    played = play_in_processes(plays, parameters, environment)
    assert differences(played.tracks, offline(plays, parameters)) == []
    parameters["track_manager"] |= {"history_policy": "forgetting", "forgetting_factor": 0.8}
    played = play_in_processes(plays, parameters, environment)
    assert differences(played.tracks, offline(plays, parameters)) == []


def test_jpda_with_a_coalescence_remedy_and_interacting_models(environment):
    plays, parameters = scenario_plays("closely_spaced_targets", "jpda/dsm_classic/imm")
    plain = offline(plays, parameters)
    parameters["association"] = {"coalescence_remedy": "jpda_star"}
    expected = offline(plays, parameters)
    assert differences(plain, expected) != []
    played = play_in_processes(plays, parameters, environment)
    assert differences(played.tracks, expected) == []


def test_automatic_initiation(environment):
    """Tracks that the tracker starts itself, from all scans of the scenario."""
    plays, parameters = scenario_plays("crossing_targets", "map/bayes/cv")
    parameters["track_manager"]["initiation"] = "automatic"
    parameters["track_manager"]["deletion_misses"] = 3
    for item in plays:
        item.initial = None
    expected = offline(plays, parameters)
    assert max(len(tracks) for tracks in expected.values()) > 2
    played = play_in_processes(plays, parameters, environment)
    assert differences(played.tracks, expected) == []


def test_four_classes_and_further_attributes(environment, domain, monkeypatch):
    """The preset with declared attributes, detections that bring them, tracks of both rings."""
    monkeypatch.syspath_prepend(Path(__file__).parent.parent / "tracking")
    import four_class_examples

    item = four_class_examples.recording(3)
    parameters = four_class_examples.parameters()
    plays = [Playback(item.name, item.detections, item.truth, None)]
    expected = offline(plays, parameters)
    last = expected[("radar", item.detections[-1].stamp_ns)]
    assert last.class_names == four_class_examples.CLASSES
    assert len(last) >= 3
    played = play_in_processes(plays, parameters, environment)
    assert differences(played.tracks, expected) == []
    played = play_in_one_process(plays, parameters, domain)
    assert differences(played.tracks, expected) == []


def test_scans_of_two_sensors_that_arrive_out_of_order(domain):
    """The reorder window puts them in order, and ends when the parameter says so."""
    plays, parameters = scenario_plays("crossing_targets", "map/bayes/cv")
    item = plays[0]
    parameters["track_manager"]["reorder_window_s"] = 12.0
    parameters["track_manager"]["time_jump_s"] = 60.0
    parameters["track_manager"]["reorder_timeout_s"] = 0.0
    for k, detections in enumerate(item.detections):
        detections.sensor_id = ("east", "west")[k % 2]
    expected = offline(
        [item],
        {**parameters, "track_manager": {**parameters["track_manager"], "reorder_window_s": 0.0}},
    )
    # Each scan of the second sensor comes after two that are newer.
    delay = [2.5 if d.sensor_id == "west" else 0.0 for d in item.detections]
    order = sorted(range(len(delay)), key=lambda k: k + delay[k])
    item.detections = [item.detections[k] for k in order]
    assert [d.stamp_ns for d in item.detections] != sorted(d.stamp_ns for d in item.detections)
    item.truth = None
    ring = Ring(parameters)
    ring.initialise(item.initial)
    before = sum(len(ring.feed(detections)) for detections in item.detections)
    assert 0 < before < len(order)
    with Nodes(
        lambda **o: [
            ScanSourceNode({"credits": 8}, plays=plays, collect=True, **o),
            *stage_nodes(parameters, **o),
        ],
        domain,
    ) as nodes:
        source = nodes.nodes[0]
        assert nodes.spin_until(lambda: source.progress.answered == before, TIMEOUT_S)
        manager = next(node for node in nodes.nodes if node.get_name() == "track_manager")
        manager.set_parameters([Parameter("reorder_window_s", value=0.0)])
        played = play(nodes, source)
    assert differences(played.tracks, expected) == []
    assert {r.outcome for r in played.reports} == {"tracked"}
    assert [r.key.stamp_ns for r in played.reports] == sorted(k[1] for k in expected)


def test_a_scan_that_nothing_newer_follows_waits_no_longer_than_the_timeout(domain):
    plays, parameters = scenario_plays("crossing_targets", "map/bayes/cv")
    plays[0].detections, plays[0].truth = plays[0].detections[:4], None
    expected = offline(plays, parameters)
    parameters["track_manager"]["reorder_window_s"] = 7.0
    parameters["track_manager"]["reorder_timeout_s"] = 0.3
    played = play_in_one_process(plays, parameters, domain)
    assert differences(played.tracks, expected) == []


def check_statements(plays, parameters, played):
    """Same tracks as offline, not those of a silent ring; every statement answered."""
    expected = offline(plays, parameters)
    silent = offline([replace(play, statements=[]) for play in plays], parameters)
    assert differences(played.tracks, expected) == []
    assert differences(expected, silent)
    reports = played.progress.statement_reports
    said = [statement for play in plays for _, statement in play.statements]
    assert [r.sequence for r in reports] == [s.sequence for s in said]
    assert {r.reason for r in reports} == {"", "unknown_track"}
    assert sum(r.outcome == "admitted" for r in reports) > 10


@pytest.mark.parametrize(
    "method",
    ["gda/dsm_classic/cv", "gda/none/cv", "map/bayes/cv", "jpda/bayes/imm", "mht/bayes/imm"],
)
def test_statements_in_one_process(method, domain):
    plays, parameters = scenario_plays("crossing_targets", method)
    plays = [with_statements(play) for play in plays]
    check_statements(plays, parameters, play_in_one_process(plays, parameters, domain))


def test_statements_are_recorded_and_played_again(environment, tmp_path):
    """Four processes and a recorder; its bag gives the same tracks, and holds the statements."""
    plays, parameters = scenario_plays("crossing_targets", "map/bayes/cv")
    plays = [with_statements(play) for play in plays]
    bag = tmp_path / "bag"
    played = play_in_processes(
        plays, parameters, environment, lambda **o: [RecorderNode({"bag": str(bag)}, **o)]
    )
    check_statements(plays, parameters, played)
    recording = load_recording(bag, "bag")
    assert recording.statements == plays[0].statements
    scans = [scan_from_message(r.message()) for r in read_bag(bag, {"/scans"})]
    used = [s for scan in scans for s in scan.statements]
    assert len(used) == sum(r.outcome == "admitted" for r in played.progress.statement_reports)
    again = replace(of_recording(recording), initial=plays[0].initial)
    assert differences(offline([again], parameters), played.tracks) == []


@pytest.mark.parametrize("method", ["mht/dsm_classic/cv", "mht/bayes/imm"])
def test_trees_and_their_delayed_tracks(method, environment, domain, tmp_path):
    """Every leaf goes round the ring; the past that is told later is told alike, and recorded."""
    plays, parameters = scenario_plays("closely_spaced_targets", method, runs=2)
    for item in plays:
        item.detections, item.truth = item.detections[:18], item.truth[:18]
    tracks, delayed = offline(plays, parameters), offline_delayed(plays, parameters)
    # What the second run begins with ends the first one, whose past is then told to its end.
    assert len(delayed) == 2 * 18 - 8
    bag = tmp_path / "bag"
    with (
        RingProcesses(parameters, environment) as ring,
        Nodes(
            lambda **o: [
                ScanSourceNode({"autostart": False}, plays=plays, collect=True, **o),
                RecorderNode({"bag": str(bag)}, **o),
            ],
            domain,
        ) as nodes,
    ):
        source, recorder = nodes.nodes

        def listening() -> bool:
            heard = {s.topic_name: s.get_publisher_count() for s in recorder.subscriptions}
            return bool(heard["/tracks_delayed"] and heard["/predictions"])

        source.trigger_configure()
        assert nodes.spin_until(listening, TIMEOUT_S)
        source.trigger_activate()
        played = play(nodes, source, ring)
        wanted = len(delayed)
        assert nodes.spin_until(
            lambda: recorder.counters["recorded /tracks_delayed"] >= wanted, TIMEOUT_S
        )
    assert differences(played.tracks, tracks) == []
    records = list(read_bag(bag, ("/tracks_delayed", "/predictions")))
    told = [tracks_from_message(r.message()) for r in records if r.topic == "/tracks_delayed"]
    assert len(told) == wanted
    found = {(t.key.sensor_id, t.key.stamp_ns): t for t in told}
    assert differences(found, delayed) == []
    leaves = [len(r.message().hypothesis_id) for r in records if r.topic == "/predictions"]
    assert max(leaves) > 4


def test_extended_objects(domain):
    """Cells and extents travel exactly: what association needs of them is in the messages."""
    plays, parameters = scenario_plays("extended_objects", "jpda/bayes/cv")
    plays = [replace(plays[0], detections=plays[0].detections[:12])]
    expected = offline(plays, parameters)
    assert any(len(tracks.extent_weight) for tracks in expected.values())
    played = play_in_one_process(plays, parameters, domain)
    assert differences(played.tracks, expected) == []
