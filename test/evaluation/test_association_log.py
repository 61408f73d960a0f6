"""The association log: worked by hand, enough to make every decision again, valid JSON."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from gda_tracker.association.choices import DECISIONS
from gda_tracker.evaluation.association_log import (
    DECIDED_BY,
    AssociationLogWriter,
    decision_entry,
    log_entry,
    strongest_rivals,
)
from gda_tracker.simulation.playback import with_method
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.simulation.simulate import simulate
from gda_tracker.tracking.ring import Ring, RingResult
from gda_tracker.vocabulary import Detections
from gda_tracker.vocabulary.scans import ScanKey, ScanReport


def results_of(method, run=0, **manager):
    """Results of a run with automatic initiation, where every cluster may hold several tracks."""
    recording = simulate(load_scenario("closely_spaced_targets"), 2, run, initiation="automatic")
    parameters = with_method(recording.preset, method)
    parameters["track_manager"].update(gate_probability=0.999, **manager)
    ring = Ring(parameters)
    return [ring.process(scan) for scan in recording.detections]


def terms_of(pair):
    return {item["term"]: item for item in pair["terms"]}


def clusters_of(entry):
    """Pairs by cluster, with the tracks and detections of each."""
    for cluster in sorted({pair["cluster"] for pair in entry["pairs"]}):
        pairs = [pair for pair in entry["pairs"] if pair["cluster"] == cluster]
        tracks = sorted({pair["hypothesis_id"] for pair in pairs})
        detections = sorted({pair["detection"] for pair in pairs})
        yield pairs, tracks, detections


def decide_again(entry):
    """Chosen (hypothesis_id, detection) from the log alone, by assignment per cluster."""
    chosen = set()
    for pairs, tracks, detections in clusters_of(entry):
        n, m = len(tracks), len(detections)
        by_ratio = entry["decision"] in ("map", "jpda")
        if by_ratio:
            # Ratios against a miss and a false alarm add up; a track may stay alone for nothing.
            value = np.hstack([np.full((n, m), -1e9), np.zeros((n, n))])
        else:
            # As many pairs as possible, of these the largest sum of probabilities.
            value = np.hstack([np.full((n, m), -1e9), np.full((n, n), -2.0 * n)])
        for pair in pairs:
            row, column = tracks.index(pair["hypothesis_id"]), detections.index(pair["detection"])
            term = "log_likelihood_ratio" if by_ratio else "p_generalised"
            value[row, column] = terms_of(pair)[term]["value"]
        for row, column in zip(*linear_sum_assignment(value, maximize=True), strict=True):
            if column < m:
                chosen.add((tracks[row], detections[column]))
    return chosen


@pytest.mark.parametrize(
    "method", ["map/none/cv", "map/bayes/cv", "gda/dsm_classic/cv", "jpda/bayes/cv"]
)
def test_the_decision_can_be_made_again_from_the_log(method):
    together = 0
    for run in range(3):
        for result in results_of(method, run):
            entry = json.loads(json.dumps(log_entry(result), allow_nan=False))
            logged = {(p["hypothesis_id"], p["detection"]) for p in entry["pairs"] if p["chosen"]}
            assert logged == decide_again(entry)
            assigned = {
                (track["hypothesis_id"], track["detection"])
                for track in entry["tracks"]
                if track["detection"] is not None
            }
            assert assigned == logged
            together += sum(len(tracks) > 1 for _, tracks, _ in clusters_of(entry))
    assert together > 20  # clusters in which tracks compete


def test_detections_are_those_of_the_source_and_of_the_tracks():
    for result in results_of("map/bayes/cv"):
        entry, tracks = log_entry(result), result.tracks
        row_of = {int(i): row for row, i in enumerate(tracks.track_id)}
        for track in entry["tracks"]:
            if track["track_id"] in row_of:
                index = int(tracks.detection_index[row_of[track["track_id"]]])
                assert (track["detection"] is None) == (index < 0)
                assert index < 0 or index == track["detection"]


def test_hypothesis_trees_tell_what_leads_after_the_scan():
    leading = 0
    for result in results_of("mht/bayes/cv"):
        entry, tracks = log_entry(result), result.tracks
        index = dict(zip(tracks.track_id.tolist(), tracks.detection_index.tolist(), strict=True))
        for pair in entry["pairs"]:
            led = index.get(pair["track_id"], -1) == pair["detection"]
            assert pair["chosen"] is led
            assert pair["reason"] == ("chosen" if led else "another_hypothesis_leads")
            leading += led
        for track in entry["tracks"]:
            assert track["detection"] in (None, index.get(track["track_id"]))
        without = decision_entry(
            result.scan, result.predictions, result.scores, result.associations
        )
        assert not any(pair["chosen"] for pair in without["pairs"])
    assert leading > 20


def test_every_decision_names_what_it_goes_by():
    assert set(DECISIONS) <= set(DECIDED_BY)


def one_track(**manager):
    """One confirmed track and the result of a third scan at its predicted place and beside it."""
    ring = Ring(
        {
            "track_manager": {
                "range_std_m": 10.0,
                "azimuth_std_rad": 0.001,
                "decision": "map",
                "attribute_term": "none",
                "clutter_density_per_m_rad": 1e-4,
                "detection_probability": 0.8,
                **manager,
            }
        }
    )
    for k in range(3):
        ring.process(Detections("radar", k * 10**9, np.array([1000.0]), np.zeros(1)))
    detections = Detections("radar", 3 * 10**9, np.array([1015.0, 5e5, 1000.0]), np.zeros(3))
    return ring.process(detections)


def test_one_track_by_hand():
    result = one_track()
    entry = log_entry(result)
    assert (entry["decision"], entry["decided_by"]) == ("map", "log_likelihood_ratio")
    assert (entry["outcome"], entry["detections"], len(entry["tracks"])) == ("tracked", 3, 1)
    assert entry["tracks"][0]["log_miss_probability"] == pytest.approx(math.log(0.2))
    assert [pair["detection"] for pair in entry["pairs"]] == [0, 2]
    threshold = math.log(1e-4 * 0.2 / 0.8)
    for pair, likelihood in zip(
        entry["pairs"], result.associations.kinematic_log_likelihood, strict=True
    ):
        terms = terms_of(pair)
        assert list(terms)[:3] == [
            "mahalanobis_squared",
            "kinematic_log_likelihood",
            "log_likelihood_ratio",
        ]
        assert terms["mahalanobis_squared"]["threshold"] == pytest.approx(-2 * math.log(0.01))
        assert terms["mahalanobis_squared"]["passed"] is True
        assert terms["kinematic_log_likelihood"]["value"] == likelihood
        assert terms["kinematic_log_likelihood"]["threshold"] == pytest.approx(threshold)
        ratio = terms["log_likelihood_ratio"]
        assert ratio["value"] == pytest.approx(likelihood - threshold)
        assert (ratio["threshold"], ratio["passed"]) == (0.0, True)
        assert terms["p_kinematic"]["passed"] is None
    beside, exact = entry["pairs"]
    assert (exact["chosen"], exact["reason"]) == (True, "chosen")
    assert (beside["chosen"], beside["reason"]) == (False, "track_has_another_detection")
    assert beside["rival"]["detection"] == 2
    assert beside["rival"]["value"] == terms_of(exact)["log_likelihood_ratio"]["value"]
    assert exact["rival"]["detection"] == 0


def test_a_pair_that_is_not_worth_it_says_so():
    entry = log_entry(one_track(clutter_density_per_m_rad=1e3))
    for pair in entry["pairs"]:
        assert (pair["chosen"], pair["reason"]) == (False, "miss_and_false_alarm_preferred")
        ratio = terms_of(pair)["log_likelihood_ratio"]
        assert ratio["value"] < 0.0
        assert ratio["passed"] is False
    assert entry["tracks"][0]["detection"] is None


def test_infinite_numbers_are_null():
    entry = log_entry(one_track(clutter_density_per_m_rad=0.0, detection_probability=1.0))
    text = json.dumps(entry, allow_nan=False)
    assert "null" in text
    for pair in entry["pairs"]:
        assert terms_of(pair)["log_likelihood_ratio"]["value"] is None
        assert terms_of(pair)["kinematic_log_likelihood"]["passed"] is True
    assert entry["tracks"][0]["log_miss_probability"] is None


@pytest.mark.parametrize("term", ["bayes", "dsm_classic"])
def test_attribute_terms_stand_beside_the_false_alarm(term):
    for result in results_of(f"gda/{term}/cv")[:12]:
        for pair, row in zip(log_entry(result)["pairs"], range(1000), strict=False):
            terms, scores = terms_of(pair), result.scores
            found = terms["attribute_log_likelihood"]
            assert found["value"] == scores.log_likelihood[row]
            clutter = scores.clutter_log_likelihood[result.associations.detection[row]]
            assert found["threshold"] == clutter
            assert found["passed"] is bool(found["value"] >= clutter)
            assert ("attribute_distance" in terms) == (term == "dsm_classic")
            ratio = terms["kinematic_log_likelihood"]
            expected = ratio["value"] - ratio["threshold"] + found["value"] - clutter
            assert terms["log_likelihood_ratio"]["value"] == pytest.approx(expected)


pairs = st.lists(
    st.tuples(st.integers(0, 3), st.integers(0, 4), st.floats(-5.0, 5.0)),
    max_size=14,
    unique_by=lambda pair: pair[:2],
)


@given(pairs)
def test_the_strongest_rival_by_brute_force(listed):
    hypothesis = np.array([p[0] for p in listed], dtype=np.int32)
    detection = np.array([p[1] for p in listed], dtype=np.int32)
    value = np.array([p[2] for p in listed])
    found = strongest_rivals(value, hypothesis, detection)
    for i in range(len(listed)):
        rivals = [
            j
            for j in range(len(listed))
            if j != i and (hypothesis[j] == hypothesis[i] or detection[j] == detection[i])
        ]
        if not rivals:
            assert found[i] == -1
        else:
            assert found[i] in rivals
            assert value[found[i]] == max(value[j] for j in rivals)


def test_one_line_per_scan_also_for_a_rejected_one(tmp_path):
    path = tmp_path / "why.jsonl"
    results = results_of("map/bayes/cv")[:5]
    rejected = RingResult(ScanReport(ScanKey(0, "radar", 7), "rejected", reason="late"))
    with AssociationLogWriter(path) as log:
        for result in [*results, rejected]:
            log.write(result)
    entries = [json.loads(line) for line in path.read_text().splitlines()]
    assert [e["stamp_ns"] for e in entries] == [r.report.key.stamp_ns for r in results] + [7]
    assert entries[-1] == {
        "sensor_id": "radar",
        "stamp_ns": 7,
        "outcome": "rejected",
        "reason": "late",
    }
