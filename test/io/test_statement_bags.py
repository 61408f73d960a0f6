"""Statements in a bag are said again when it is replayed."""

from __future__ import annotations

from dataclasses import replace

from gda_tracker.cli import main
from gda_tracker.commands.say import EXAMPLES
from gda_tracker.io.adapters.bag import write_recording
from gda_tracker.io.statement_files import read_statements
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.simulation.simulate import simulate


def test_replay_says_what_a_bag_holds(tmp_path, capsys):
    recording = simulate(load_scenario("crossing_targets"), 1, initiation="automatic")
    stamp_ns = recording.detections[9].stamp_ns
    for position, kind in ((10, "fuzzy"), (11, "region")):
        (draft,) = read_statements(EXAMPLES[kind], "x")
        statement = replace(draft.complete(position, stamp_ns, "map"), track_id=10**6)
        recording.statements.append((position, statement))
    write_recording(tmp_path / "bag", recording)
    assert main(["replay", str(tmp_path / "bag"), "--offline"]) == 0
    assert "statements: 1 admitted, 1 unknown_track" in capsys.readouterr().out
