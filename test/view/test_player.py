"""The player: the same tracks as the ring, steps and pauses, changes that act at the next scan."""

from __future__ import annotations

import time

import numpy as np
import pytest

from gda_tracker.formations.parameters import FormationParameters
from gda_tracker.formations.tracker import FormationTracker
from gda_tracker.parameters import ParameterError
from gda_tracker.view.history import History
from gda_tracker.view.player import Player

TIMEOUT_S = 30.0


def wait_for(condition):
    deadline = time.monotonic() + TIMEOUT_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.002)


@pytest.fixture
def make(gda):
    players = []

    def start(**options):
        player = Player(gda.play, gda.parameters, History(), **options)
        players.append(player)
        player.start()
        return player

    yield start
    for player in players:
        player.close()


def test_it_makes_the_tracks_of_the_ring(make, gda):
    player = make(rate=0.0)
    wait_for(lambda: player.finished and player.history.newest == len(gda.results))
    for result, (_, picture) in zip(gda.results, player.history.between(1, 999), strict=True):
        assert np.array_equal(picture.tracks.track_id, result.tracks.track_id)
        assert np.array_equal(picture.tracks.mean, result.tracks.mean)
    assert player.status()["position"] == len(gda.results)
    assert not player.status()["playing"]


def test_it_follows_formations_from_the_beginning(make, gda):
    player = make(rate=0.0, formations=FormationParameters())
    tracker = FormationTracker()
    expected = [
        tracker.take(result.tracks, result.scan, result.predictions) for result in gda.results
    ]
    for _ in range(2):
        wait_for(lambda: player.finished and player.history.newest == len(gda.results))
        shown = [picture.formations for _, picture in player.history.between(1, 999)]
        assert [[one.number for one in found.formations] for found in shown] == [
            [one.number for one in found.formations] for found in expected
        ]
        assert any(len(found) for found in shown)
        player.restart()


def test_it_stands_until_told_and_steps_one_scan_at_a_time(make):
    player = make(rate=0.0, playing=False)
    time.sleep(0.05)
    assert player.history.newest == 0
    for number in (1, 2, 3):
        player.step()
        wait_for(lambda n=number: player.history.newest == n)
    time.sleep(0.05)
    assert player.history.newest == 3
    player.play()
    wait_for(lambda: player.finished)


def test_the_rate_is_that_of_the_recording(make, gda):
    period_s = (gda.play.detections[1].stamp_ns - gda.play.detections[0].stamp_ns) * 1e-9
    player = make(rate=period_s / 0.1)  # ten scans a second
    began = time.monotonic()
    wait_for(lambda: player.history.newest == 6)
    assert time.monotonic() - began > 0.45  # the first one comes at once
    player.pause()
    at = player.history.newest
    time.sleep(0.25)
    assert player.history.newest <= at + 1
    with pytest.raises(ParameterError, match="rate = -1"):
        player.set_rate(-1.0)


def test_a_change_acts_at_the_next_scan(make):
    player = make(rate=0.0, playing=False)
    player.step()
    wait_for(lambda: player.history.newest == 1)
    answer = player.change("track_manager", {"gate_probability": 0.5, "decision": "map"})
    assert (answer.accepted, answer.acts_from_scan) == (True, 2)
    player.step()
    wait_for(lambda: player.history.newest == 2)
    (_, before), (_, after) = player.history.between(1, 2)
    assert (before.settings.gate_probability, before.settings.decision) == (0.99, "gda")
    assert (after.settings.gate_probability, after.settings.decision) == (0.5, "map")
    assert after.gates.threshold < before.gates.threshold
    assert after.decision.associations.decision == "map"
    assert player.values()["track_manager"]["gate_probability"] == 0.5


def test_changes_of_the_other_stages_act_too(make):
    """Every radar cross section out of range: the attribute says nothing any more."""
    player = make(rate=0.0, playing=False)
    assert player.change("rcs_fuzzifier", {"rcs_max_m2": 2e-6, "rcs_min_m2": 1e-6}).accepted
    assert player.change("association", {"max_exact_size": 1}).accepted
    player.step()
    wait_for(lambda: player.history.newest == 1)
    picture = player.history.between(1, 1)[0][1]
    assert not picture.decision.scores.informative.any()


@pytest.mark.parametrize(
    ("node", "values", "reason"),
    [
        ("track_manager", {"gate_probability": 1.5}, "gate_probability = 1.5: allowed is"),
        ("track_manager", {"decision": "mht", "mht_scans": 0}, "mht_scans = 0"),
        ("track_manager", {"gate_probabilty": 0.9}, "did you mean gate_probability"),
        ("track_manager", {"confirmation_hits": 9, "confirmation_scans": 3}, "confirmation"),
        ("rcs_fuzzifier", {"membership": "density"}, "membership is fixed at start-up"),
        ("rcs_fuzzifier", {"rcs_max_m2": 1e-9}, "rcs_max_m2"),
        ("radar", {"x": 1}, "node radar: unknown"),
    ],
)
def test_a_refused_change_says_why_and_changes_nothing(make, node, values, reason):
    player = make(playing=False)
    before = player.values()
    answer = player.change(node, values)
    assert not answer.accepted
    assert reason in answer.reason
    assert player.values() == before


def test_restart_begins_again_with_the_parameters_as_they_are(make, gda):
    player = make(rate=0.0)
    wait_for(lambda: player.finished)
    generation = player.history.generation
    player.pause()
    player.change("track_manager", {"gate_probability": 0.9})
    player.restart()
    assert (player.history.newest, player.status()["position"]) == (0, 0)
    assert player.history.generation == generation + 1
    player.step()
    wait_for(lambda: player.history.newest == 1)
    picture = player.history.between(1, 1)[0][1]
    assert picture.settings.gate_probability == 0.9
    assert picture.tracks.hits.max() <= gda.results[0].tracks.hits.max()
