"""``replay --offline --formations``: the table, the line, the section of the report."""

from __future__ import annotations

import csv

import pytest
import yaml
from formation_examples import STEP_S, live, states_of

from gda_tracker.cli import main
from gda_tracker.commands.replay_formations import formation_line, formation_section
from gda_tracker.evaluation import figures
from gda_tracker.evaluation.figures.formations import (
    formation_histories,
    formation_lanes,
    formation_numbers,
)
from gda_tracker.formations.tracker import FormationTracker
from gda_tracker.io.formation_csv import COLUMNS, write_formations
from gda_tracker.simulation.playback import of_scenario
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario, shipped_scenarios
from gda_tracker.tracking.ring import Ring

METHOD = "map/none/cv"


@pytest.fixture
def scenario(tmp_path):
    content = yaml.safe_load(shipped_scenarios()["formations"].read_text())
    content["time"]["n_scans"] = 24
    content["targets"] = content["targets"][:3]
    path = tmp_path / "one_and_two.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


@pytest.fixture
def drawn(monkeypatch):
    """Figures that were drawn; rendering takes most of the time."""
    found = []
    monkeypatch.setattr(figures, "png", lambda figure: found.append(figure) or b"")
    return found


def test_table_and_section_are_those_of_the_core(scenario, drawn, tmp_path, capsys):
    table = tmp_path / "formations.csv"
    arguments = ["replay", str(scenario), "--offline", "--method", METHOD]
    assert main([*arguments, "--formations", str(table)]) == 0
    out = capsys.readouterr().out
    assert "formations: 2 formed, 2 number changed; in the end, with their objects" in out
    read = load_scenario(scenario)
    (play,) = of_scenario(read, 1, 1, METHOD)
    preset = tracker_preset(read)
    preset["track_manager"].update(decision="map", attribute_term="none", filter="cv")
    ring, core = Ring(preset), FormationTracker()
    ring.initialise(play.initial)
    expected = []
    for detections in play.detections:
        result = ring.process(detections)
        expected.append(core.take(result.tracks, result.scan, result.predictions))
    with table.open() as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS
    wanted = [(k, one) for k, found in enumerate(expected) for one in found.formations]
    assert len(rows) == len(wanted)
    for row, (k, one) in zip(rows, wanted, strict=True):
        assert (int(row["scan"]), int(row["formation_id"])) == (k, one.formation_id)
        assert [int(i) for i in row["track_ids"].split()] == one.track_ids.tolist()
        assert float(row["x_m"]) == one.position[0]
        assert int(row["number"]) == one.number
        assert float(row["expected_number"]) == one.expected_number
    assert sorted(int(row["number"]) for row in rows[-2:]) == [1, 2]
    assert {row["events"] for row in rows} == {"", "formed", "number_changed"}
    section = formation_section(expected)
    assert [picture.title for picture in section.pictures] == ["Lineage", "Number of objects"]
    assert {row[5] for row in section.table[1:]} == {"", "0 -> 1", "0 -> 2"}
    lanes, numbers = drawn
    assert [label.get_text() for label in lanes.axes[0].get_yticklabels()] == ["1", "2"]
    assert [axes.get_title("left") for axes in numbers.axes[:2]] == ["formation 1", "formation 2"]


def test_parameters_of_the_file_are_used_and_the_nodes_refused(scenario, tmp_path, capsys):
    params = tmp_path / "params.yaml"
    params.write_text("track_formations:\n  ros__parameters:\n    largest_number: 2\n")
    table = tmp_path / "formations.csv"
    arguments = ["replay", str(scenario), "--method", METHOD, "--formations", str(table)]
    assert main([*arguments, "--offline", "--params", str(params)]) == 0
    with table.open() as file:
        told = [row["number_probabilities"].split() for row in csv.DictReader(file)]
    assert {len(probabilities) for probabilities in told} <= {0, 2}
    assert ["0.500000", "0.500000"] in told
    assert main(arguments) == 2
    assert "--formations: allowed with --offline alone" in capsys.readouterr().err


def test_ends_have_rows_of_their_own_and_links_are_drawn(tmp_path):
    # Two formations of which one is taken in by the other, and then no track is left.
    tracker = FormationTracker()
    found = []
    for k in range(40):
        gap = 5000.0 if k < 12 else 300.0
        now = states_of([[0.0, 20_000.0], [gap, 20_000.0]])[: 2 if k < 39 else 0]
        found.append(tracker.take(live(STEP_S * k, [1, 2][: len(now)], now)))
    assert [e.kind for one in found for e in one.events] == ["formed", "formed", "merged", "ended"]
    write_formations(tmp_path / "formations.csv", found)
    with (tmp_path / "formations.csv").open() as file:
        (*_, last) = csv.DictReader(file)
    assert (last["formation_id"], last["events"], last["x_m"]) == ("1", "ended", "")
    assert [h.formation_id for h in formation_histories(found)] == [1, 2]
    (axes,) = formation_lanes(found).axes
    assert sum(text.arrow_patch is not None for text in axes.texts if not text.get_text()) == 1
    assert formation_line(found).startswith("formations: 2 formed, 1 merged, 1 ended; ")
    for draw in (formation_lanes, formation_numbers):
        with pytest.raises(ValueError, match="no formation to draw"):
            draw([])
