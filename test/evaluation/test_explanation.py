"""Explanations: the numbers of the log in words, worked by hand; which scan and track are meant."""

from __future__ import annotations

import copy
import json
import math

import pytest

from gda_tracker.evaluation.association_log import log_entry
from gda_tracker.evaluation.explanation import (
    NoSuchScan,
    explain,
    explanation_lines,
    overview_lines,
    pick_scan,
    tracks_of,
)
from gda_tracker.simulation.playback import of_scenario, with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.tracking.ring import Ring


def term(name, value, threshold=None, passed=None):
    return {"term": name, "value": value, "threshold": threshold, "passed": passed}


def pair_of(track, detection, ratio, chosen, reason, rival=None):
    return {
        "track_id": track,
        "hypothesis_id": 10 * track,
        "detection": detection,
        "cluster": 0,
        "engine": "subsets",
        "converged": True,
        "chosen": chosen,
        "reason": reason,
        "terms": [
            term("mahalanobis_squared", 4.0, 9.21034, True),
            term("kinematic_log_likelihood", -3.0, -3.0 - math.log(20.0), True),
            term("attribute_log_likelihood", -2.0, -2.0 + math.log(5.0), False),
            term("log_likelihood_ratio", ratio, 0.0, ratio >= 0.0),
            term("p_kinematic", 0.8),
            term("p_attribute", 1.0),
            term("p_generalised", 0.8),
            term("joint_marginal", 0.75),
        ],
        "rival": rival,
    }


ENTRY = {
    "sensor_id": "front",
    "stamp_ns": 1_716_000_000_250_000_000,
    "outcome": "tracked",
    "reason": "",
    "decision": "map",
    "decided_by": "log_likelihood_ratio",
    "attribute_term": "bayes",
    "degraded": False,
    "gate_probability": 0.99,
    "clutter_density_per_m_rad": 1e-6,
    "missed_track_hypotheses": "zero",
    "detections": 7,
    "tracks": [
        {"track_id": 3, "hypothesis_id": 30, "detection": 5, "log_miss_probability": math.log(0.1)},
        {"track_id": 4, "hypothesis_id": 40, "detection": 6, "log_miss_probability": math.log(0.1)},
        {"track_id": 8, "hypothesis_id": 80, "detection": None, "log_miss_probability": None},
    ],
    "pairs": [
        pair_of(
            3,
            6,
            math.log(8.0),
            False,
            "track_and_detection_are_elsewhere",
            {"track_id": 4, "hypothesis_id": 40, "detection": 6, "value": 3.0},
        ),
        pair_of(
            3,
            5,
            math.log(4.0),
            True,
            "chosen",
            {"track_id": 3, "hypothesis_id": 30, "detection": 6, "value": math.log(8.0)},
        ),
        pair_of(4, 6, 3.0, True, "chosen"),
    ],
}
REJECTED = {"sensor_id": "front", "stamp_ns": 1, "outcome": "rejected", "reason": "late"}


def text_of(entry, track, number=0):
    entries = [REJECTED] * number + [entry]
    return "\n".join(explanation_lines(explain(entries, number, track)))


def test_the_numbers_of_a_pair_in_words():
    text = text_of(ENTRY, 3, 2)
    lines = text.splitlines()
    assert lines[0] == (
        "scan 2 of front, stamp 1716000000.250000000 s: decision map, attribute term bayes, "
        "7 detections, clutter density 1e-06 1/(m rad)"
    )
    assert "track 3: got detection 5; 2 of 7 detections in its gate" in text
    assert "log(1 - P_d) = -2.303, a chance of 10 % to be missed" in text
    assert "Mahalanobis distance 2.00 sigma (squared 4.00, gate 9.21 for 99 % of" in text
    kinematics = "log likelihood -3.00 [log 1/(m rad)], a miss and a false alarm are as likely at "
    assert f"{kinematics}-6.00: speaks for the pair, 20 times" in text
    attribute = "log likelihood -2.00 [log 1/m2], from a false alarm -0.39: "
    assert f"{attribute}speaks against the pair, 5 times" in text
    assert "log likelihood ratio +1.39, from 0 on" in text
    assert "speaks for the pair, 4 times" in text
    assert "0.750 with all that is known; P_k 0.800 by the kinematics" in text
    assert text.index("detection 5: CHOSEN") < text.index(
        "detection 6: not chosen, it went to track 4, and the track has detection 5"
    )
    assert "detection 6 for the same track, log likelihood ratio 2.079, more by 0.693" in text
    assert "track 4 for the same detection, log likelihood ratio 3, more by 0.921" in text


def test_a_track_without_a_detection_and_special_numbers():
    text = text_of(ENTRY, 8)
    assert "track 8: got no detection; 0 of 7 detections in its gate" in text
    assert "no detection lay in its gate" in text
    assert "log(1 - P_d) = infinite, a chance of 0 % to be missed" in text
    entry = copy.deepcopy(ENTRY)
    pair = entry["pairs"][2]
    pair["converged"], pair["engine"] = False, "belief_propagation"
    for item in pair["terms"]:
        if item["term"] == "attribute_log_likelihood":
            item["value"] = item["threshold"] = 0.0
        if item["term"] == "log_likelihood_ratio":
            item["value"] = None
    entry["degraded"] = True
    text = text_of(entry, 4)
    assert "unknown for this detection: says nothing" in text
    assert "beyond comparison (P_d = 1 or no clutter)" in text
    assert "belief_propagation has not converged" in text
    assert "degraded: the attributes were given up" in text


def test_which_scan_is_meant():
    stamps = (1_000_000_000, 1_500_000_000, 1_716_000_000_250_000_001)
    entries = [{**ENTRY, "stamp_ns": stamp} for stamp in stamps]
    words = {"0": 0, "2": 2, "last": 2, "1.5": 1, "1.5004": 1, "1.0": 0, "1500000000": 1}
    words |= {"1716000000.25": 2, "1716000000250000001": 2}
    for word, number in words.items():
        assert pick_scan(entries, word) == number, word
    wrong = {
        "3": "scan 3: there are 3, numbers 0 to 2, stamps 1.000000000 to",
        "1.4": "nearest is scan 1 at 1.500000000",
        "first": "allowed is a number, a stamp in seconds with a point, or last",
        "-1": "allowed is a number",
    }
    for word, reason in wrong.items():
        with pytest.raises(NoSuchScan) as error:
            pick_scan(entries, word)
        assert reason in str(error.value)
        assert "\n" not in str(error.value)
    with pytest.raises(NoSuchScan, match="no scans"):
        pick_scan([], "0")


def test_a_track_that_is_not_there_is_answered_with_those_that_are():
    entries = [REJECTED, ENTRY, {**ENTRY, "tracks": ENTRY["tracks"][:1], "pairs": []}]
    wrong = {
        (2, 4): "track 4 was not predicted for scan 2; tracks there: 3; track 4 is in scans 1 to 1",
        (1, 7): "tracks there: 3, 4, 8; tracks of all scans: 3, 4, 8",
        (0, 3): "scan 0 was rejected: late; nothing was decided on it",
    }
    for (number, track), reason in wrong.items():
        with pytest.raises(NoSuchScan) as error:
            explain(entries, number, track)
        assert reason in str(error.value)
    assert overview_lines(ENTRY, 1)[1:] == [
        "track 3: detection 5; in its gate: 5, 6",
        "track 4: detection 6; in its gate: 6",
        "track 8: no detection; in its gate: none",
    ]


@pytest.mark.parametrize("method", ["map/bayes/cv", "gda/pcr5/cv", "jpda/none/cv", "mht/bayes/imm"])
def test_every_track_of_a_run_is_explained(method):
    """Every scan and track gives JSON and words, and they tell of the detection the track got."""
    scenario = load_scenario("closely_spaced_targets")
    (play,) = of_scenario(scenario, 1, 2, method)
    ring = Ring(with_method(tracker_preset(scenario), method))
    ring.initialise(play.initial)
    results = [ring.process(scan) for scan in play.detections]
    entries = [json.loads(json.dumps(log_entry(result))) for result in results]
    explained = 0
    for number, (entry, result) in enumerate(zip(entries, results, strict=True)):
        for track in tracks_of(entry):
            found = explain(entries, number, track)
            text = "\n".join(explanation_lines(found))
            json.dumps(found, allow_nan=False)
            row = list(result.tracks.track_id).index(track)
            index = int(result.tracks.detection_index[row])
            assert found["detection"] == (index if index >= 0 else None)
            if index >= 0:
                assert f"got detection {index};" in text
                assert f"detection {index}" in text.split("CHOSEN")[0].rsplit("\n", 1)[1]
            count = len({pair["detection"] for pair in found["pairs"]})
            assert text.count("    gate  ") == count
            assert ("attribute   log" in text) <= (entry["attribute_term"] != "none")
            explained += 1
    assert explained > 20
