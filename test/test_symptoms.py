"""The symptoms of docs/tuning.md: measured rows, and a document that has them all."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from gda_tracker.parameters import from_mapping
from gda_tracker.tracking.parameters import TrackManagerParameters
from scripts.measure_symptoms import AIRCRAFT, NO_CURES, ROWS, Laboratory, measure_row

pytestmark = pytest.mark.slow

DOCUMENT = Path(__file__).resolve().parent.parent / "docs" / "tuning.md"


@pytest.fixture(scope="module")
def laboratory():
    return Laboratory(2, 1)


def test_a_measured_cure_and_a_change_that_is_none(laboratory):
    row = next(r for r in ROWS if r.data == AIRCRAFT and "max_speed_mps" in r.change)
    cells = measure_row(laboratory, row)
    assert cells[:3] == ["ghosts", "`max_speed_mps` 1500 -> 300", "aircraft"]
    before = laboratory.measure(AIRCRAFT, row.sick)["false_tracks"]
    after = laboratory.measure(AIRCRAFT, row.change)["false_tracks"]
    assert cells[3] == f"false tracks {before:.3g} -> **{after:.3g}**"
    assert after < before
    backwards = dataclasses.replace(row, sick=row.change, change=row.sick)
    with pytest.raises(RuntimeError, match="which is no cure"):
        measure_row(laboratory, backwards)
    with pytest.raises(RuntimeError, match="which is a cure"):
        measure_row(laboratory, row, cures=False)


def test_the_document_has_every_row():
    lines = [line for line in DOCUMENT.read_text().splitlines() if "->" in line]
    for row in (*ROWS, *NO_CURES):
        from_mapping(TrackManagerParameters, {**row.sick, **row.change})
        names = [f"`{name}`" for name in row.change]
        mine = [line for line in lines if line.startswith(f"| {row.symptom} |")]
        assert any(all(name in line for name in names) for line in mine), row
