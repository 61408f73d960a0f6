"""Decisions in a bag of the ring's topics are those of the association log."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from gda_tracker.cli import main
from gda_tracker.errors import UserError
from gda_tracker.evaluation.association_log import log_entry
from gda_tracker.io.bags import BagTopic, BagWriter
from gda_tracker.io.decision_bags import bag_entries
from gda_tracker.io.messages import (
    associations_to_message,
    attribute_scores_to_message,
    predictions_to_message,
    scan_report_to_message,
    scan_to_message,
    tracks_to_message,
)
from gda_tracker.simulation.playback import of_scenario, with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.tracking.ring import Ring

TOPICS = {
    "scans": ("Scan", scan_to_message, lambda result: result.scan),
    "predictions": ("Predictions", predictions_to_message, lambda result: result.predictions),
    "attribute_scores": (
        "AttributeScores",
        attribute_scores_to_message,
        lambda result: result.scores,
    ),
    "associations": ("Associations", associations_to_message, lambda result: result.associations),
    "tracks": ("TrackArray", tracks_to_message, lambda result: result.tracks),
    "scan_reports": ("ScanReport", scan_report_to_message, lambda result: result.report),
}


def results_of(method):
    """Results of a run, the fourth a scan that is rejected."""
    scenario = load_scenario("crossing_targets")
    (play,) = of_scenario(scenario, 1, 2, method)
    ring = Ring(with_method(tracker_preset(scenario), method))
    ring.initialise(play.initial)
    scans = [*play.detections[:3], replace(play.detections[0], sensor_id=""), play.detections[3]]
    return [result for scan in scans for result in ring.feed(scan)]


def record(path, results, space="", leave_out=()):
    kept = {name: value for name, value in TOPICS.items() if name not in leave_out}
    topics = [
        BagTopic(f"{space}/{name}", f"gda_tracker_msgs/msg/{kind}")
        for name, (kind, _, _) in kept.items()
    ]
    with BagWriter(path, topics) as bag:
        for place, result in enumerate(results):
            for name, (_, write, part) in kept.items():
                if part(result) is not None:
                    bag.write(f"{space}/{name}", write(part(result)), place)
    return path


@pytest.mark.parametrize("method", ["map/bayes/cv", "gda/dsm_classic/cv", "mht/bayes/imm"])
def test_entries_of_a_bag_are_those_of_the_log(method, tmp_path, capsys):
    results = results_of(method)
    expected = [log_entry(result) for result in results]
    path = record(tmp_path / "bag", results)
    assert bag_entries(path) == expected
    assert [entry["outcome"] for entry in expected] == [*["tracked"] * 3, "rejected", "tracked"]
    assert main(["why", "4", "1", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["pairs"]
    assert main(["why", "3", "1", str(path)]) == 2
    assert "scan 3 was rejected: missing_sensor_id" in capsys.readouterr().err
    without = record(tmp_path / "cut", results, "/front", ("scan_reports",))
    assert bag_entries(without) == [entry for entry in expected if "pairs" in entry]
    assert bag_entries(without, "front") == bag_entries(without)


def test_a_bag_without_decisions_says_how_to_make_them(tmp_path):
    path = record(tmp_path / "bag", results_of("map/bayes/cv"), leave_out=("associations",))
    with pytest.raises(UserError) as error:
        bag_entries(path)
    assert "associations missing" in str(error.value)
    assert f"gda-tracker replay {path} --offline --association-log" in str(error.value)
