"""``gda-tracker demo --set-valued``: what it writes and what the picture is made of."""

from __future__ import annotations

import argparse
import json

import numpy as np

from gda_tracker.commands import demo, demo_set_valued
from gda_tracker.evaluation.figures.track_sets import crossing_tracks_figure, set_outlines


def test_it_writes_picture_report_and_numbers(tmp_path, capsys):
    parser = argparse.ArgumentParser()
    demo.add_arguments(parser)
    out = tmp_path / "new" / "folder"
    assert demo.run(parser.parse_args(["--set-valued", "--out", str(out), "--seed", "1"])) == 0
    said = capsys.readouterr().out
    assert (out / demo_set_valued.PICTURE).read_bytes().startswith(b"\x89PNG")
    report = (out / demo_set_valued.REPORT).read_text()
    assert "data:image/png;base64," in report
    assert "Stirling" in report
    numbers = json.loads((out / demo_set_valued.NUMBERS).read_text())
    rows = numbers["samples"]
    assert len(rows) == 25
    sets = [int(row[2]) for row in rows]
    undecided = [int(row[3]) for row in rows]
    # Open at first and at the crossing, decided between and after.
    assert undecided[1] > 0
    assert max(undecided[8:13]) >= 4
    assert undecided[5:8] == [0, 0, 0]
    assert undecided[14:] == [0] * 11
    assert sets[-1] == 3
    assert {row[5] for row in rows} == {"3 of 3"}
    assert all(row[0] in said for row in rows)
    assert str(out / demo_set_valued.REPORT) in said


def test_the_picture_draws_every_set():
    tracked = demo_set_valued.track_crossing(2)
    figure = crossing_tracks_figure(tracked.detections, tracked.truth, tracked.sets, around=11)
    measured, filtered, crossing, counts, radius = figure.axes
    total = sum(len(s) for s in tracked.sets)
    assert len(filtered.patches) == total
    assert len(crossing.patches) == sum(len(s) for s in tracked.sets[7:14])
    assert [len(line.get_xdata()) for line in measured.lines[:3]] == [25, 25, 25]
    assert list(radius.lines[0].get_ydata()) == [s.position_radius_m.max() for s in tracked.sets]
    assert counts.get_xlabel() == "sample"


def test_an_outline_is_the_edge_of_the_set():
    sets = demo_set_valued.track_crossing(2).sets[0]
    outlines = set_outlines(sets)
    distance = np.linalg.norm(outlines - sets.centroid[:, None, :2], axis=2)
    np.testing.assert_allclose(distance.max(axis=1), sets.position_radius_m, rtol=1e-2)
    # Every point of it is c + K u for a u of length one, the shortest there is.
    part = sets.matrix[:, :2]
    gap = outlines - sets.centroid[:, None, :2]
    inverse = np.linalg.pinv(part)
    u = gap @ inverse.transpose(0, 2, 1)
    np.testing.assert_allclose(np.linalg.norm(u, axis=2), 1.0, rtol=1e-9)
