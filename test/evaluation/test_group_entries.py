"""The association log and its explanation where two tracks have a detection between them."""

import json

import pytest

from gda_tracker.evaluation.association_log import log_entry
from gda_tracker.evaluation.explanation import explain, explanation_lines
from gda_tracker.simulation.playback import of_scenario, with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.tracking.answers import check_answers
from gda_tracker.tracking.ring import Ring


@pytest.mark.parametrize("decision", ["map", "mht"])
def test_the_explanation_names_the_other_track(decision):
    scenario = load_scenario("unresolved_pair")
    method = f"{decision}/none/cv"
    play = of_scenario(scenario, 1, 1, method)[0]
    ring = Ring(with_method(tracker_preset(scenario), method))
    ring.initialise(play.initial)
    shared = 0
    for scan in play.detections[:20]:
        result = ring.process(scan)
        found = result.associations
        check_answers(result.scan.key, len(result.predictions), len(result.scan), None, None, found)
        entry = json.loads(json.dumps(log_entry(result), allow_nan=False))
        chosen = [group for group in entry.get("groups", []) if group["chosen"]]
        if not chosen:
            continue
        shared += 1
        detection = chosen[0]["detection"]
        assert result.tracks.detection_index.tolist() == [detection, detection]
        assert chosen[0]["tracks"] == [1, 2]
        for track, other in ((1, 2), (2, 1)):
            text = "\n".join(explanation_lines(explain([entry], 0, track)))
            assert f"detection {detection} of both, it and track {other}" in text
            assert "they share it" in text
    assert shared > 3
