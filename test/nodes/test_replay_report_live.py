"""The report of a replay over DDS says of tracks and innovations what the offline one says."""

from __future__ import annotations

from functools import partial

import pytest
from replay_pages import Page

from gda_tracker.cli import main
from gda_tracker.commands import replay_sections
from gda_tracker.evaluation.figures import png
from gda_tracker.evaluation.rounds import ROUND
from gda_tracker.tracking.ring import PARTS_OF_A_ROUND

STAGES = {"rcs_fuzzifier", "attribute_fusion", "association", "admission to tracks"}


@pytest.fixture(autouse=True)
def _coarse_pictures(monkeypatch):
    monkeypatch.setattr(replay_sections, "png", partial(png, dpi=20))


def replay(path, *arguments):
    command = ["replay", "crossing_targets", "--method", "map/dsm_classic/cv"]
    assert main([*command, "--report", str(path), *arguments]) == 0
    return Page(path.read_text(encoding="utf-8"))


@pytest.mark.usefixtures("environment")
def test_report_over_the_nodes(domain, tmp_path):
    live = replay(tmp_path / "live.html", "--domain", str(domain))
    offline = replay(tmp_path / "offline.html", "--offline")
    assert live.pictures == offline.pictures
    assert live.headings == offline.headings
    # Everything but the times is the same: counts, measures, tracks.
    timed = {*PARTS_OF_A_ROUND, ROUND}
    told = [row for row in live.rows if row[0] not in STAGES]
    assert told == [row for row in offline.rows if row[0] not in timed]
    assert {row[0] for row in live.rows} >= STAGES
    # Every scan was heard, from the first on, and its innovations are the same.
    (nis,) = [text for text in live.texts if text.startswith("NIS of")]
    assert nis in offline.texts
    assert "Of 23 of 23 scans the gated pairs are known." in live.texts
