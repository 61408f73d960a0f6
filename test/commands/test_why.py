"""``gda-tracker why`` on a log as ``replay`` writes it."""

from __future__ import annotations

import json

import pytest

from gda_tracker.cli import main


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "why.jsonl"
    arguments = ["replay", "crossing_targets", "--offline", "--method", "map/bayes/cv"]
    assert main([*arguments, "--association-log", str(path)]) == 0
    return path


def why(capsys, *arguments):
    capsys.readouterr()
    code = main(["why", *map(str, arguments)])
    shown = capsys.readouterr()
    return code, shown.out, shown.err


def test_a_pair_by_number_stamp_and_last(log, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    entries = [json.loads(line) for line in log.read_text().splitlines()]
    code, out, _ = why(capsys, 10, 1, log)
    assert code == 0
    assert "CHOSEN" in out
    assert "speaks for the pair" in out
    assert max(map(len, out.splitlines())) < 80
    stamp_ns = entries[10]["stamp_ns"]
    assert why(capsys, f"{stamp_ns / 1e9:.3f}", 1, log)[1] == out
    assert why(capsys, "last", 1, log)[1] == why(capsys, len(entries) - 1, 1, log)[1]
    _, out, _ = why(capsys, 10, 1, log, "--json")
    record = json.loads(out)
    assert (record["scan"], record["track_id"], record["stamp_ns"]) == (10, 1, stamp_ns)
    logged = [p for p in entries[10]["pairs"] if p["track_id"] == 1]
    assert {p["detection"] for p in record["pairs"]} == {p["detection"] for p in logged}
    assert record["pairs"][0]["terms"] in [p["terms"] for p in logged]
    code, out, _ = why(capsys, 10, log)
    assert code == 0
    assert "track 1: detection" in out
    assert "track 2: detection" in out
    assert json.loads(why(capsys, 10, log, "--json")[1])["tracks"] == [1, 2]


def test_errors_are_one_line_and_say_what_there_is(log, tmp_path, capsys):
    empty, other, broken = tmp_path / "empty.jsonl", tmp_path / "other.jsonl", tmp_path / "b.jsonl"
    empty.write_text("")
    other.write_text('{"x": 1}\n')
    broken.write_text("{\n")
    wrong = {
        (99, 1, log): "there are 23, numbers 0 to 22",
        (3, 9, log): "tracks there: 1, 2",
        (3, "x", log): "track x: allowed is a track id",
        (3, "nothing"): "nothing: no track id, and no such file",
        (3, 1, empty): "it is empty",
        (3, 1, other): "line 1: no entry of an association log",
        (3, 1, broken): "line 1: no JSON",
        (3, 1): "of a running tracker only the last one is known",
    }
    for arguments, reason in wrong.items():
        code, out, err = why(capsys, *arguments)
        assert (code, out) == (2, "")
        assert reason in err
        assert err.count("\n") == 1
