"""``gda-tracker say``: files are read with every key checked, faults are one line."""

from __future__ import annotations

import io
import sys

import pytest
import yaml

from gda_tracker.cli import main
from gda_tracker.commands.say import EXAMPLES
from gda_tracker.io.statement_files import read_statements
from gda_tracker.vocabulary.statements import KINDS

GOOD = yaml.safe_load(EXAMPLES["fuzzy"])


@pytest.fixture
def check(tmp_path, capsys):
    """Check a file: exit status, stdout, stderr."""

    def run(content, *options):
        path = tmp_path / "statement.yaml"
        path.write_text(content if isinstance(content, str) else yaml.safe_dump(content))
        status = main(["say", str(path), "--check", *options])
        shown = capsys.readouterr()
        return status, shown.out, shown.err

    return run


@pytest.mark.parametrize("kind", KINDS)
def test_there_is_a_good_example_of_each_kind(kind, check, capsys):
    assert main(["say", "--example", kind]) == 0
    text = capsys.readouterr().out
    assert yaml.safe_load(text)["kind"] == kind
    status, out, err = check(text)
    assert (status, err) == (0, "")
    assert "1 well-formed statement" in out


def test_all_examples_are_one_file(check, capsys, monkeypatch):
    assert main(["say", "--example"]) == 0
    text = capsys.readouterr().out
    assert f"{len(EXAMPLES)} well-formed statements" in check(text)[1]
    monkeypatch.setattr(sys, "stdin", io.StringIO(text))
    assert main(["say", "-", "--check"]) == 0
    assert "standard input" in capsys.readouterr().out


def test_a_draft_takes_what_is_missing_and_keeps_what_is_there():
    text = EXAMPLES["fuzzy"]
    (draft,) = read_statements(text, "x")
    statement = draft.complete(7, 5, "map")
    assert (statement.sequence, statement.stamp_ns, statement.frame_id) == (7, 5, "map")
    assert statement.pieces[0].class_grades == (1.0, 0.2)
    (draft,) = read_statements(text + "sequence: 3\nstamp_s: 2.5\nframe_id: map\n", "x")
    statement = draft.complete(7, 5, "map")
    assert (statement.sequence, statement.stamp_ns) == (3, 2_500_000_000)


def changed(**fields):
    return {**GOOD, **fields}


def without(name):
    return {key: value for key, value in GOOD.items() if key != name}


WRONG = {
    "no YAML": "a: [",
    "no statement": "# nothing\n",
    "allowed are keys": "just a text",
    "unknown key 'sorce', did you mean source?": changed(sorce="x"),
    "the key source is missing": without("source"),
    "pieces = None: allowed is a list": without("pieces"),
    "source = 3: allowed is a text": changed(source=3),
    "track_id = 1.5: allowed is an integer": changed(track_id=1.5),
    "reliability = 'high': allowed is a number": changed(reliability="high"),
    "classes = 'fighter': allowed are names with grades": changed(pieces=[{"classes": "fighter"}]),
    "classes, fighter = True: allowed is a number": changed(
        pieces=[{"classes": {"fighter": True}}]
    ),
    "centre_m = 5: allowed is a list of numbers": changed(
        pieces=[{"region": {"shape": "gaussian", "centre_m": 5}}]
    ),
    "region: unknown key 'center_m', did you mean centre_m?": changed(
        pieces=[{"region": {"shape": "gaussian", "center_m": [1, 2]}}]
    ),
    "statement 1: bad_gaussian: centre_m is x, y": changed(
        pieces=[{"region": {"shape": "gaussian"}, "classes": {"fighter": 1}}]
    ),
    "unknown_kind: kind is one of region, fuzzy, fds, rule": changed(kind="rumour"),
    "place_without_classes": changed(pieces=[{"region": GOOD["pieces"][0]["region"]}]),
    "unknown_frame": changed(frame_id="odom"),
    "stamp_out_of_range": changed(stamp_s=-1.0),
}


@pytest.mark.parametrize("words", WRONG)
def test_a_wrong_file_is_one_line(words, check):
    status, out, err = check(WRONG[words])
    assert (status, out) == (2, "")
    assert len(err.strip().splitlines()) == 1, err
    assert words in err


def test_the_frame_may_be_another(check):
    assert check(changed(frame_id="odom"), "--frame", "odom")[0] == 0


def test_a_file_that_is_not_there(capsys):
    assert main(["say", "nowhere.yaml"]) == 2
    assert "nowhere.yaml: cannot be read" in capsys.readouterr().err
    assert main(["say"]) == 2
    assert "either FILE.yaml or --example" in capsys.readouterr().err
