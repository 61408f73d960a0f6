"""``gda-tracker demo --set-valued``: figure 1 of Stirling & Thompson 1991, tracked and drawn."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gda_tracker.evaluation.figures import png
from gda_tracker.evaluation.figures.track_sets import crossing_tracks_figure
from gda_tracker.evaluation.report import Facts, Picture, Section, render
from gda_tracker.evaluation.track_sets import covering, undecided
from gda_tracker.parameters import from_mapping
from gda_tracker.simulation.crossing_tracks import (
    CrossingTracks,
    set_valued_preset,
    simulate_crossing_tracks,
)
from gda_tracker.tracking.set_valued.parameters import SetValuedParameters
from gda_tracker.tracking.set_valued.tracker import SetValuedTracker
from gda_tracker.vocabulary.scans import Detections, ScanTruth
from gda_tracker.vocabulary.track_sets import TrackSetArray

REPORT, PICTURE, NUMBERS = "set_valued.html", "set_valued.png", "set_valued.json"
CROSSING_SAMPLE = 11


@dataclass(frozen=True)
class Tracked:
    """What was simulated, and the sets after each sample."""

    detections: list[Detections]
    truth: list[ScanTruth]
    sets: list[TrackSetArray]
    parameters: dict[str, Any]


def track_crossing(seed: int) -> Tracked:
    """Simulate the three crossing tracks and follow them with sets."""
    model = CrossingTracks()
    detections, truth = simulate_crossing_tracks(model, seed)
    parameters = set_valued_preset(model)
    tracker = SetValuedTracker(from_mapping(SetValuedParameters, parameters))
    sets = []
    for scan in detections:
        found, report = tracker.process(scan)
        if found is None:
            raise RuntimeError(f"scan rejected: {report.reason}")
        sets.append(found)
    return Tracked(detections, truth, sets, dict(parameters))


def table_of(tracked: Tracked) -> list[list[str]]:
    """Heading and one row per sample."""
    rows = [["sample", "tracks", "sets", "of an open association", "radius [m]", "covered"]]
    for k, (sets, truth) in enumerate(zip(tracked.sets, tracked.truth, strict=True), 1):
        covered = covering(sets, truth.target_state[:, :2]).any(axis=1)
        rows.append(
            [
                str(k),
                str(len(np.unique(sets.track_id))),
                str(len(sets)),
                str(int(np.count_nonzero(undecided(sets)))),
                " ".join(f"{r:.0f}" for r in sets.position_radius_m[sets.best]),
                f"{np.count_nonzero(covered)} of {len(covered)}",
            ]
        )
    return rows


def run(out: Path, seed: int) -> int:
    """Track, print, draw; write PNG, HTML and JSON into ``out``."""
    began = time.monotonic()
    tracked = track_crossing(seed)
    table = table_of(tracked)
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    for row in table:
        print("  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)))
    picture = png(
        crossing_tracks_figure(
            tracked.detections, tracked.truth, tracked.sets, around=CROSSING_SAMPLE
        )
    )
    out.mkdir(parents=True, exist_ok=True)
    (out / PICTURE).write_bytes(picture)
    (out / REPORT).write_text(_report(tracked, table, picture, seed), encoding="utf-8")
    numbers = {"seed": seed, "columns": table[0], "samples": table[1:]}
    (out / NUMBERS).write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")
    print(f"report:  {out / REPORT}")
    print(f"picture: {out / PICTURE}")
    print(f"done in {time.monotonic() - began:.0f} s")
    return 0


def _report(tracked: Tracked, table: list[list[str]], picture: bytes, seed: int) -> str:
    sections = [
        Section(
            "Three crossing tracks",
            (
                "Every ellipse is a set of estimates with equal claim: all of them may be the mean "
                "of the target's state. Observations that a set may own are not decided on: the "
                "set branches, one branch for each.",
            ),
            pictures=[
                Picture(
                    "Truth, sets, crossing, and what is open",
                    "(a) The lines are true, the crosses measured. (b) The sets after each "
                    "sample, large at first and soon hardly larger than a dot. (c) At the crossing "
                    "tracks 1 and 2 may own each other's observations: each has several sets, the "
                    "best scored with a dot, the others with a cross. (d) A few samples later "
                    "there is one set per track again.",
                    picture,
                )
            ],
        ),
        Section("Sample by sample", table=table),
        Section(
            "Make it again",
            code=f"gda-tracker demo --set-valued --seed {seed}",
            facts=[Facts("Parameters of the tracker", tracked.parameters)],
        ),
    ]
    return render(
        "Set-valued tracking",
        "After figure 1 of Stirling & Thompson, Set-Valued Multiple-Target Tracking, 1991.",
        sections,
    )
