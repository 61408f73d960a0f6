"""Nodes are killed and come back: the tracks are those of the offline ring, bit for bit."""

from __future__ import annotations

import random

import pytest
from graph_helpers import (
    TIMEOUT_S,
    differences,
    offline,
    play,
    scenario_plays,
    with_statements,
)

from gda_tracker.nodes.runner import STAGES, Nodes, RingProcesses
from gda_tracker.nodes.scan_source import ScanSourceNode
from gda_tracker.resources import resource

KILLS_PER_STAGE = 10
# About once in a hundred kills Fast DDS 2.14 sends a node that came back nothing, for ever. Who
# runs nodes starts such a one again, and so does this test: it is about nothing being lost.
FOUND_S, RESTARTS = 30.0, 3


def reached(nodes, ring, victim, source, answered):
    """Whether so many scans are answered; a victim that is not found is killed once more."""
    for _ in range(RESTARTS):
        if nodes.spin_until(lambda: source.progress.answered >= answered, FOUND_S):
            return True
        ring.kill(victim)
        ring.start(victim)
    return nodes.spin_until(lambda: source.progress.answered >= answered, TIMEOUT_S)


@pytest.fixture
def without_shared_memory(environment, monkeypatch):
    """The profile for nodes that are killed: see the comment in the file."""
    profile = str(resource("params", "fastdds_udp.xml"))
    for name in ("FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE"):
        environment[name] = profile
        monkeypatch.setenv(name, profile)
    return environment


@pytest.mark.timeout(900)
@pytest.mark.parametrize("victim", STAGES)
def test_killed_and_restarted(victim, without_shared_memory, tmp_path):
    """Each stage is killed ten times while a scan is on its way; nothing is lost or changed."""
    environment = without_shared_memory
    method = "gda/dsm_classic/cv"
    plays, parameters = scenario_plays("closely_spaced_targets", method)
    expected = offline(plays, parameters)
    parameters["track_manager"]["checkpoint_path"] = str(tmp_path / "state.npz")
    moments = random.Random(STAGES.index(victim)).sample(
        range(1, len(plays[0].detections) - 1), KILLS_PER_STAGE
    )
    with (
        RingProcesses(parameters, environment) as ring,
        Nodes(
            lambda **o: [ScanSourceNode({}, plays=plays, collect=True, **o)],
            int(environment["ROS_DOMAIN_ID"]),
        ) as nodes,
    ):
        source = nodes.nodes[0]
        for moment in sorted(moments):
            # The next scan goes out with the answer that ends this wait.
            found = reached(nodes, ring, victim, source, moment)
            assert found, f"stuck at {source.progress.answered} answered scans, before {moment}"
            ring.kill(victim)
            ring.start(victim)
        assert reached(nodes, ring, victim, source, max(moments) + 1)
        played = play(nodes, source, ring)
    assert differences(played.tracks, expected) == []
    assert {r.outcome for r in played.reports} == {"tracked"}


def test_a_track_manager_killed_among_statements(without_shared_memory, tmp_path):
    """Restarted from its checkpoint it loses no statement and uses none twice."""
    plays, parameters = scenario_plays("crossing_targets", "map/bayes/cv")
    plays = [with_statements(play) for play in plays]
    expected = offline(plays, parameters)
    parameters["track_manager"]["checkpoint_path"] = str(tmp_path / "state")
    environment = without_shared_memory
    with (
        RingProcesses(parameters, environment) as ring,
        Nodes(
            lambda **o: [ScanSourceNode({}, plays=plays, collect=True, **o)],
            int(environment["ROS_DOMAIN_ID"]),
        ) as nodes,
    ):
        source = nodes.nodes[0]
        for moment in (4, 9, 14):
            assert reached(nodes, ring, "track_manager", source, moment)
            ring.kill("track_manager")
            ring.start("track_manager")
        assert reached(nodes, ring, "track_manager", source, 15)
        played = play(nodes, source, ring)
    assert differences(played.tracks, expected) == []
    assert len(played.progress.statement_reports) == len(plays[0].statements)
