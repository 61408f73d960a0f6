"""The demo without its nodes: arguments, folder, parts, scores."""

from __future__ import annotations

import argparse
import json

import numpy as np
import pytest

from gda_tracker.commands import demo
from gda_tracker.commands.demo_play import PER_SCAN_TOPICS, silent_stage
from gda_tracker.evaluation.summary import Summary
from gda_tracker.parameters import ParameterError


def arguments(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    demo.add_arguments(parser)
    return parser.parse_args(words)


def make_summary(purity) -> Summary:
    return Summary("m", 3, 69, 0, purity, 0.9, 0.5, 12.0, 25.0, np.array([1.0, 2.0, 3.0]))


def make_bag(folder):
    folder.mkdir(parents=True)
    (folder / "metadata.yaml").write_text("old")
    (folder / f"{folder.name}.mcap").write_bytes(b"old")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--runs", "0"), "--runs 0: allowed is an integer >= 1"),
        (("--runs", "100000"), "allowed is an integer >= 1 and <= 1000"),
        (("--seed", "-1"), "--seed -1: allowed is an integer >= 0"),
    ],
)
def test_wrong_arguments_are_named(words, told):
    with pytest.raises(ParameterError, match=told):
        demo.run(arguments(*words))


def test_an_earlier_demo_is_replaced_and_nothing_else(tmp_path):
    make_bag(tmp_path / demo.AUTOFERRY)
    make_bag(tmp_path / "my_bag")
    (tmp_path / demo.REPORT).write_text("old")
    (tmp_path / "notes.txt").write_text("mine")
    demo.prepare_folder(tmp_path)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["my_bag", "notes.txt"]


@pytest.mark.parametrize("kind", ["file", "folder"])
def test_foreign_files_in_a_bags_place_are_not_touched(tmp_path, kind):
    make_bag(tmp_path / demo.AUTOFERRY)
    place = tmp_path / demo.ON
    if kind == "file":
        place.write_text("mine")
    else:
        make_bag(place)
        (place / "thesis.txt").write_text("mine")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(demo.DemoError, match=f"{demo.ON} holds more than a bag"):
        demo.prepare_folder(tmp_path)
    assert sorted(tmp_path.rglob("*")) == before


def test_a_file_is_no_folder(tmp_path):
    path = tmp_path / "out"
    path.write_text("mine")
    with pytest.raises(demo.DemoError, match="is a file, allowed is a folder"):
        demo.prepare_folder(path)


def test_scores_are_plain_numbers():
    columns = {
        demo.AUTOFERRY: make_summary(None),
        demo.OFF: make_summary(np.array([0.5, 0.6, 0.7])),
        demo.ON: make_summary(np.array([0.6, 0.7, 0.8])),
    }
    found = json.loads(json.dumps(demo.scores_of(columns, 4), allow_nan=False))
    assert found["seed"] == 4
    assert found["parts"][demo.AUTOFERRY]["purity_mean"] is None
    assert found["parts"][demo.ON]["purity_mean"] == pytest.approx(0.7)
    assert found["parts"][demo.ON]["latency_ms_median"] == 2.0
    assert "by +0.100 +- 0.000" in demo.reading_of(columns)


@pytest.mark.parametrize(
    ("behind", "node"),
    [
        (["evidence", "attribute_scores", "associations", "tracks"], "rcs_fuzzifier"),
        (["attribute_scores", "associations", "tracks"], "attribute_fusion"),
        (["associations", "tracks"], "association"),
        (["tracks"], "track_manager"),
        ([], "track_manager"),
    ],
)
def test_the_first_silent_stage_is_named(behind, node):
    counts = {topic: 4 if topic in behind else 5 for topic in PER_SCAN_TOPICS}
    assert silent_stage(counts) == node


def test_no_scan_at_all_is_the_track_managers_silence():
    assert silent_stage(dict.fromkeys(PER_SCAN_TOPICS, 0)) == "track_manager"
