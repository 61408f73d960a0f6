"""Scores of formations: true ones by hand, counts, events, calibration, and the command."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from gda_tracker.evaluation.command import write_json
from gda_tracker.evaluation.figures import png, stated_numbers
from gda_tracker.evaluation.formation_results import calibration_bins, formation_values
from gda_tracker.evaluation.formation_scores import (
    follow_formations,
    score_formations,
    true_formations,
)
from gda_tracker.evaluation.monte_carlo import monte_carlo
from gda_tracker.evaluation.table import format_result
from gda_tracker.formations.found import MERGED, SPLIT, Formation, FormationEvent, Formations
from gda_tracker.formations.parameters import FormationParameters
from gda_tracker.parameters import ParameterError
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.simulation.simulate import simulate
from gda_tracker.tracking.ring import Ring
from gda_tracker.vocabulary.scans import ScanKey, ScanTruth
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks
from scripts import measure_formations

BOUNDS = FormationParameters(largest_number=3)


def truth_of(places, k=0, speeds=None):
    """Targets 10, 20, .. on a line at these places [m]."""
    x = np.asarray(places, dtype=float)
    state = np.zeros((len(x), 4))
    state[:, 0], state[:, 2] = x, 0.0 if speeds is None else speeds
    return ScanTruth("radar", k * 10**9, 10 * np.arange(1, len(x) + 1, dtype=np.int32), state)


def tracks_of(truth):
    """Exact confirmed tracks 1, 2, .. of the targets."""
    n = len(truth.target_id)
    ids = np.arange(1, n + 1)
    return Tracks(
        key=ScanKey(0, "radar", truth.stamp_ns),
        frame_id="map",
        system_uuid=bytes(16),
        track_id=ids,
        hypothesis_id=ids,
        status=np.full(n, CONFIRMED),
        mean=truth.target_state,
        covariance=np.tile(np.eye(4), (n, 1, 1)),
        existence_probability=np.ones(n),
    )


def formation(number_id, tracks, number, probabilities):
    two = np.zeros(2)
    return Formation(
        number_id,
        0,
        np.array(tracks),
        np.full(len(tracks), -1),
        two,
        np.eye(2),
        two,
        np.eye(2),
        np.eye(2),
        np.array(probabilities),
        number,
        0,
        1,
        0.0,
    )


def told(truth, formations, events=()):
    return Formations(
        ScanKey(0, "radar", truth.stamp_ns), formations=formations, events=list(events)
    )


def test_true_formations_keep_together_between_the_bounds():
    gaps = [900.0, 1500.0, 1900.0, 2100.0, 1500.0, 800.0]
    found = true_formations([truth_of([0.0, gap]) for gap in gaps], BOUNDS)
    assert [len(groups) for groups in found] == [1, 1, 1, 2, 2, 1]
    # Velocities part as distances do, and a chain is one formation.
    found = true_formations(
        [truth_of([0, 900, 1800]), truth_of([0, 900, 1800], speeds=[0.0, 0.0, 50.0])], BOUNDS
    )
    assert [[ids.tolist() for ids in groups] for groups in found] == [
        [[10, 20, 30]],
        [[10, 20], [30]],
    ]
    unknown = truth_of([0.0, 100.0])
    unknown.target_state[1] = np.nan
    assert [ids.tolist() for ids in true_formations([unknown], BOUNDS)[0]] == [[10]]


def test_numbers_and_delays_by_hand():
    truth = [truth_of([0.0, 500.0, 9000.0], k) for k in range(4)]
    sure, unsure = [0.1, 0.9, 0.0], [0.6, 0.3, 0.1]
    scans = [
        [],
        [formation(1, [1, 2], 0, unsure), formation(2, [3], 0, [0.8, 0.1, 0.1])],
        [formation(1, [1, 2], 1, sure), formation(2, [3], 1, [0.8, 0.1, 0.1])],
        [formation(1, [1, 2], 2, sure), formation(2, [3], 1, [0.8, 0.1, 0.1])],
    ]
    found = [told(one, formations) for one, formations in zip(truth, scans, strict=True)]
    score = score_formations(found, [tracks_of(one) for one in truth], truth, 50.0, BOUNDS)
    assert score.decided.tolist() == [False, False, False, False, False, True, True, True]
    assert score.probable.tolist() == [False, False, False, True, True, True, True, True]
    assert sorted(score.delay_s) == [2.0, 3.0]
    assert score.of_truth.tolist() == [0.3, 0.8, 0.9, 0.8, 0.9, 0.8]
    values = formation_values([score])
    assert values["formation_number_decided_right"] == pytest.approx(3.0 / 8.0)
    assert values["formation_delay_s"] == 2.5
    assert values["formations_never_right"] == 0.0
    # Stated .6: wrong; .8 three times, .9 twice: right.
    off = (0.6 + 3 * 0.2 + 2 * 0.1) / 6.0
    assert values["formation_calibration_error"] == pytest.approx(off)
    bins = calibration_bins([score])
    assert [entry["samples"] for entry in bins] == [1, 3, 2]
    assert bins[0] == {"samples": 1, "stated": 0.6, "right": 0.0}


def test_more_objects_than_the_largest_number_are_right_as_that():
    truth = [truth_of([0.0, 500.0, 1000.0, 1500.0])]
    found = [told(truth[0], [formation(1, [1, 2, 3, 4], 3, [0.0, 0.0, 1.0])])]
    score = score_formations(found, [tracks_of(truth[0])], truth, 50.0, BOUNDS)
    assert score.decided.tolist() == [True]
    assert np.isfinite(score.delay_s).all()
    other = score_formations([told(truth[0], [])], [tracks_of(truth[0])], truth, 50.0, BOUNDS)
    assert np.isnan(other.delay_s).all()


def _event(kind, number_id, others=(), tracks=()):
    return FormationEvent(kind, number_id, 0, 0, tuple(tracks), tuple(others))


def test_splits_and_mergers_by_hand():
    together, apart = [0.0, 500.0, 20000.0], [0.0, 5000.0, 20000.0]
    truth = [
        truth_of(place, k) for k, place in enumerate([together, together, apart, apart, together])
    ]
    one = formation(1, [1, 2], 2, [0, 1, 0])
    alone, third = formation(1, [1], 1, [1, 0, 0]), formation(3, [3], 1, [1, 0, 0])
    new = formation(2, [2], 1, [1, 0, 0])
    found = [
        told(truth[0], [one, third]),
        # Told as split off: the third, which never was with the first.
        told(truth[1], [one, third], [_event(SPLIT, 1, [3])]),
        told(truth[2], [one, third]),
        told(truth[3], [alone, new, third], [_event(SPLIT, 1, [2])]),
        told(truth[4], [one, third], [_event(MERGED, 1, [2])]),
    ]
    score = score_formations(found, [tracks_of(t) for t in truth], truth, 50.0, BOUNDS)
    assert (score.splits.true, score.splits.told, score.splits.false) == (1, 1, 1)
    assert score.splits.delay_s.tolist() == [1.0]
    assert (score.mergers.true, score.mergers.told, score.mergers.false) == (1, 1, 0)
    assert score.mergers.delay_s.tolist() == [0.0]


def test_scans_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="1 scans with formations, 0 with tracks, 0 with truth"):
        score_formations([told(truth_of([0.0]), [])], [], [], 50.0, BOUNDS)


def test_numbers_are_those_of_another_count():
    """The page's script finds formations by their places, and knows who flies with whom."""
    scenario = measure_formations.straight(load_scenario("formations"))
    scenario = replace(scenario, time=replace(scenario.time, n_scans=28))
    recording = simulate(scenario, 2)
    parameters = FormationParameters()
    preset = tracker_preset(scenario, "automatic")
    preset["track_manager"].update(measure_formations.METHOD)
    ring = Ring(preset)
    results = [ring.process(scan) for scan in recording.detections]
    found = follow_formations(results, parameters)
    score = score_formations(
        found, [result.tracks for result in results], recording.truth, 300.0, parameters
    )
    expected = measure_formations.right_numbers(found, recording.truth)
    for name in ("decided", "probable"):
        own = getattr(score, name).reshape(28, 5)
        assert own[-8:].all() == expected[name][-8:].all()
        assert own.sum(axis=0) == pytest.approx(expected[name].sum(axis=0), abs=2)
    assert score.splits.true == score.mergers.true == 0


def test_the_command_tells_of_formations(tmp_path):
    scenario = load_scenario("formations")
    scenario = replace(scenario, time=replace(scenario.time, n_scans=16))
    (result,) = monte_carlo(
        [scenario],
        ["map/none/cv"],
        runs=1,
        initiation="automatic",
        workers=1,
        formations=FormationParameters(),
    )
    text = format_result(result)
    assert "decided right" in text
    assert "splits" in text
    assert max(map(len, text.splitlines()[2:])) <= 100
    write_json(tmp_path / "out.json", [result])
    entry = json.loads((tmp_path / "out.json").read_text())["methods"][0]
    assert 0.0 < entry["formation_number_probable_right"] < 1.0
    assert sum(b["samples"] for b in entry["formation_calibration"]) > 20
    bins = {"map/none/cv": entry["formation_calibration"]}
    assert png(stated_numbers(bins)).startswith(b"\x89PNG")
    # A method that never had a track has no bins.
    for some in ({"none": [], **bins}, {"none": []}):
        assert png(stated_numbers(some)).startswith(b"\x89PNG")
    with pytest.raises(ParameterError, match="allowed is automatic"):
        monte_carlo([scenario], ["map/none/cv"], runs=1, formations=FormationParameters())
