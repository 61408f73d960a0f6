"""Innovations of a replay: the same values as other ways to them, scan by scan."""

from __future__ import annotations

import numpy as np
import pytest

from gda_tracker.evaluation.consistency import score_nis
from gda_tracker.evaluation.innovations import gated_scan, innovations
from gda_tracker.evaluation.rounds import ROUND, OfflineRounds, quantiles_ms
from gda_tracker.io.adapters import load_recording
from gda_tracker.nodes.figures import taken_nis
from gda_tracker.resources import resource
from gda_tracker.simulation.playback import with_method
from gda_tracker.tracking.ring import PARTS_OF_A_ROUND, Ring


def rounds_of(method, scans=72):
    recording = load_recording(resource("data", "autoferry", "scenario16"))
    ring = Ring(with_method(recording.preset, method))
    return [ring.process(detections) for detections in recording.detections[:scans]]


@pytest.fixture(scope="module")
def one_hypothesis():
    return rounds_of("map/none/cv")


def kept(results):
    rounds = OfflineRounds()
    for result in results:
        rounds.note(result)
    return rounds.heard()


def test_with_one_hypothesis_a_track_they_are_those_of_the_evaluation(one_hypothesis):
    tracks = [r.tracks for r in one_hypothesis]
    found = innovations(tracks, kept(one_hypothesis).gated)
    expected = score_nis(
        tracks,
        [r.predictions for r in one_hypothesis],
        [r.associations for r in one_hypothesis],
        [r.assigned for r in one_hypothesis],
    )
    assert len(found.squared) > 100
    np.testing.assert_array_equal(found.scan, expected.scan)
    np.testing.assert_array_equal(found.squared, expected.squared)
    assert (found.dimension, found.threshold) == (expected.dimension, expected.threshold)


def test_with_trees_they_are_those_of_the_diagnostics():
    results = rounds_of("mht/none/cv", 30)
    tracks = [r.tracks for r in results]
    found = innovations(tracks, kept(results).gated)
    total = 0
    for scan, result in enumerate(results):
        # What speaks for a track before a scan is what spoke for it after the one before.
        before = results[scan - 1].tracks.hypothesis_id if scan else []
        leads = np.isin(result.predictions.hypothesis_id, before)
        if not len(result.tracks):
            continue
        expected = taken_nis(
            result.scan, result.predictions, leads, result.associations, result.tracks
        )
        np.testing.assert_array_equal(found.squared[found.scan == scan], expected)
        total += len(expected)
    assert total == len(found.squared) > 50


def test_scans_that_were_not_heard_give_no_value(one_hypothesis):
    tracks = [r.tracks for r in one_hypothesis]
    gated = kept(one_hypothesis).gated
    whole = innovations(tracks, gated)
    lost = next(iter(gated))
    place = [(t.key.sensor_id, t.key.stamp_ns) for t in tracks].index(lost)
    busiest = int(np.bincount(whole.scan).argmax())
    key = tracks[busiest].key
    del gated[lost], gated[key.sensor_id, key.stamp_ns]
    rest = innovations(tracks, gated)
    assert not {place, busiest} & set(rest.scan.tolist())
    assert len(rest.squared) == np.count_nonzero(~np.isin(whole.scan, [place, busiest]))
    assert not len(innovations(tracks, {}).squared)
    assert not len(innovations([], {}).squared)


def test_pairs_that_are_kept(one_hypothesis):
    result = max(one_hypothesis, key=lambda r: len(r.associations.hypothesis))
    scan = gated_scan(result.scan, result.predictions, result.associations)
    a = result.associations
    assert len(scan.squared) == len(a.hypothesis) > 3
    assert scan.detections == len(result.scan)
    assert scan.outside == len(set(range(len(result.scan))) - set(a.detection.tolist()))
    for pair in range(len(scan.squared)):
        row = a.hypothesis[pair]
        assert scan.track_id[pair] == result.predictions.track_id[row]
        assert scan.source_row[pair] == result.scan.source_index[a.detection[pair]]


def test_another_gate_on_the_way_is_refused(one_hypothesis):
    gated = kept(one_hypothesis[:3]).gated
    other = Ring({"track_manager": {"gate_probability": 0.9}})
    recording = load_recording(resource("data", "autoferry", "scenario16"))
    other_round = kept([other.process(recording.detections[5])]).gated
    with pytest.raises(ValueError, match=r"gate_probability = \[0\.9, 0\.99\]"):
        innovations([], {**gated, **other_round})


def test_time_of_each_part_of_a_round(one_hypothesis):
    heard = kept(one_hypothesis)
    assert tuple(heard.latency_ms) == (*PARTS_OF_A_ROUND, ROUND)
    for name in PARTS_OF_A_ROUND:
        seconds = [r.stage_s[name] for r in one_hypothesis]
        assert min(seconds) > 0.0
        assert heard.latency_ms[name] == quantiles_ms(seconds)
    # Of a sum the median is no sum of medians, but it is not below any of them.
    assert heard.latency_ms[ROUND][0] >= max(heard.latency_ms[n][0] for n in PARTS_OF_A_ROUND)


def test_quantiles():
    median, most = quantiles_ms([0.001 * k for k in range(101)])
    assert (round(median, 9), round(most, 9)) == (50.0, 95.0)
