"""``gda-tracker params`` on a running ring."""

from __future__ import annotations

import json

import pytest
from live_helpers import call, spinning

from gda_tracker.io.parameter_files import known_tables, read_parameter_file
from gda_tracker.nodes.attribute_fusion import AttributeFusionNode
from gda_tracker.nodes.radar_input import RadarInputNode
from gda_tracker.nodes.runner import stage_nodes
from gda_tracker.parameters import specifications, to_mapping

START = {"track_manager": {"decision": "map", "reorder_sensors": []}}


@pytest.fixture
def ring(domain):
    with spinning(
        lambda **o: [*stage_nodes(START, **o), RadarInputNode({"input_topic": "p"}, **o)], domain
    ) as nodes:
        yield {node.get_name(): node for node in nodes.nodes}


def test_list_get_set_save(ring, tmp_path, capsys):
    assert call("params", "list", "--json") == 0
    rows = json.loads(capsys.readouterr().out)
    running = [table for node, table in known_tables().items() if node in ring]
    assert len(rows) == sum(len(specifications(table)) for table in running)
    by_name = {(row["node"], row["parameter"]): row for row in rows}
    row = by_name["track_manager", "gate_probability"]
    assert (row["value"], row["minimum"], row["maximum"], row["live"]) == (0.99, 0, 0.999999, True)
    assert by_name["track_manager", "decision"]["value"] == "map"
    assert by_name["rcs_fuzzifier", "class_names"]["value"] == ["false_alarm", "fighter", "cargo"]
    assert not by_name["rcs_fuzzifier", "class_names"]["live"]

    assert call("params", "list", "--node", "track_manager", "--changed") == 0
    out = capsys.readouterr().out
    assert "decision = map   (default mht)" in out
    assert "how detections are assigned" in out
    assert "gate_probability" not in out

    changes = ("gate_probability=0.9", "class_transition=[0.5, 0.5, 0.5, 0.5]", "rcs_unit=dbsm")
    assert call("params", "set", *changes, "imm_mean_sojourn_s=[10, 30]") == 0
    out = capsys.readouterr().out
    assert "track_manager: gate_probability 0.99 -> 0.9" in out
    assert "track_manager: imm_mean_sojourn_s [20.0, 20.0] -> [10.0, 30.0]" in out
    assert "acts at the next scan" in out
    assert ring["track_manager"].parameters.gate_probability == 0.9
    assert ring["attribute_fusion"].parameters.class_transition == [0.5] * 4
    assert ring["radar_input"].parameters.rcs_unit == "dbsm"
    assert call("params", "set", "class_transition=[]", "--json") == 0
    (told,) = json.loads(capsys.readouterr().out)
    assert (told["before"], told["value"], told["set"]) == ([0.5] * 4, [], True)

    assert call("params", "get", "gate_probability") == 0
    assert capsys.readouterr().out == "0.9\n"
    assert call("params", "get", "track_manager.decision", "rcs_unit", "--json") == 0
    assert json.loads(capsys.readouterr().out) == {
        "track_manager.decision": "map",
        "radar_input.rcs_unit": "dbsm",
    }

    path = tmp_path / "all.yaml"
    assert call("params", "save", path) == 0
    assert f"gda-tracker run --params {path}" in capsys.readouterr().out
    saved = read_parameter_file(path)
    assert saved == {name: to_mapping(node.parameters) for name, node in ring.items()}
    path = tmp_path / "changed.yaml"
    assert call("params", "save", path, "--changed") == 0
    assert read_parameter_file(path) == {
        "track_manager": {
            "decision": "map",
            "gate_probability": 0.9,
            "imm_mean_sojourn_s": [10.0, 30.0],
        },
        "radar_input": {"input_topic": "p", "rcs_unit": "dbsm"},
    }


REFUSED = {
    ("gate_probability=2",): "gate_probability = 2: allowed is a number > 0 and <= 0.999999",
    ("gate_probabilty=0.9",): "gate_probabilty: unknown, did you mean gate_probability?",
    ("track_manager.tracking_frame=odom",): "tracking_frame of track_manager is fixed at start-up",
    # Each is allowed alone; together with the others' values they are not.
    ("max_speed_mps=50", "confirmation_hits=9"): "at most confirmation_scans = 4",
    ("gate_probability=0.9", "gate_probability=0.8"): "stands there twice",
    ("gate_probability",): "allowed is name=value",
    ("gate_probability=[",): "not YAML",
    ("gate_probability=0.9", "--node", "recorder"): "node recorder: unknown; known are",
}


def test_what_is_refused_changes_nothing(ring, capsys):
    before = {name: node.parameters for name, node in ring.items()}
    for words, reason in REFUSED.items():
        assert call("params", "set", *words, "--wait", 5) == 2
        err = capsys.readouterr().err
        assert reason in err
        assert err.count("\n") == 1
    # What only the node itself can know: a transition of other classes than the fuzzifier's.
    fusion = ring["attribute_fusion"]
    assert isinstance(fusion, AttributeFusionNode)
    fusion._class_names = ("false_alarm", "fighter", "cargo")
    words = ("class_transition=[0.5, 0.5, 0.5, 0.5]", "max_exact_size=9", "range_std_m=9")
    assert call("params", "set", *words) == 1
    out = capsys.readouterr().out
    assert "attribute_fusion: not changed, parameter class_transition = 4 numbers" in out
    assert "association: not changed, since the other node has refused" in out
    assert "acts at the next scan" not in out
    assert {name: node.parameters for name, node in ring.items()} == before


def test_without_a_tracker_and_with_two(domain, capsys):
    assert call("params", "list", "--wait", 0.5) == 2
    assert f"no node of the tracker found in ROS domain {domain}" in capsys.readouterr().err
    with (
        spinning(lambda **o: [AttributeFusionNode({}, **o)], domain),
        spinning(
            lambda **o: [AttributeFusionNode({}, **o)], domain, ["--ros-args", "-r", "__ns:=/b"]
        ),
    ):
        assert call("params", "list", "--wait", 4) == 2
        assert "several namespaces: /, /b" in capsys.readouterr().err
        assert call("params", "get", "class_transition", "--wait", 4, "--namespace", "b") == 0
        assert capsys.readouterr().out == "[]\n"
