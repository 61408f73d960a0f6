"""``gda-tracker why last`` on a ring that runs."""

from __future__ import annotations

import json

from graph_helpers import scenario_plays
from live_helpers import call, spinning, spinning_on
from test_doctor import Driver

from gda_tracker.evaluation.association_log import log_entry
from gda_tracker.evaluation.explanation import explain
from gda_tracker.nodes.runner import Nodes, stage_nodes
from gda_tracker.nodes.scan_source import ScanSourceNode
from gda_tracker.tracking.ring import Ring


def test_the_last_decision_is_kept_for_who_comes_late(domain, capsys):
    method = "map/bayes/cv"
    (play,), parameters = scenario_plays("crossing_targets", method)
    ring = Ring(parameters)
    ring.initialise(play.initial)
    entry = [log_entry(ring.process(scan)) for scan in play.detections][-1]

    def make(**o):
        return [ScanSourceNode({}, plays=[play], **o), *stage_nodes(parameters, **o)]

    with Nodes(make, domain) as nodes:
        assert nodes.spin_until(lambda: nodes.nodes[0].finished, 60.0)
        with spinning_on(nodes):
            assert call("why", "last", "1", "--json") == 0
            found = json.loads(capsys.readouterr().out)
            assert call("why", "last", "77") == 2
            assert "tracks there: 1, 2" in capsys.readouterr().err
    assert found == json.loads(json.dumps(explain([entry], 0, 1)))


def test_under_mht_it_is_the_next_decision(domain, capsys):
    with spinning(lambda **o: [*stage_nodes({}, **o), Driver(**o)], domain):
        assert call("why", "last", "--wait", "30") == 0
        assert "decision mht" in capsys.readouterr().out


def test_without_a_tracker(domain, capsys):
    assert call("why", "last", "1", "--wait", "0.3") == 2
    err = capsys.readouterr().err
    assert f"no tracker publishes /associations in ROS domain {domain}" in err
