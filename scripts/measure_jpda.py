#!/usr/bin/env python3
"""Measure JPDA with and without a coalescence remedy: the table of docs/jpda.md.

    python scripts/measure_jpda.py [--runs 100] [--seed 0]

The same simulated runs are tracked by every decision, with and without attributes, by both filters.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from gda_tracker.evaluation.purity import confusion_counts, purity  # noqa: E402
from gda_tracker.evaluation.statistics import mean_and_stderr  # noqa: E402
from gda_tracker.simulation.playback import with_method  # noqa: E402
from gda_tracker.simulation.preset import tracker_preset  # noqa: E402
from gda_tracker.simulation.scenarios import Scenario, load_scenario  # noqa: E402
from gda_tracker.simulation.simulate import simulate  # noqa: E402
from gda_tracker.tracking.labelled import labelled_tracks  # noqa: E402
from gda_tracker.tracking.manager import TrackManager  # noqa: E402
from gda_tracker.tracking.ring import Ring  # noqa: E402
from scripts.doc_tables import markdown, signed, with_error, write_section  # noqa: E402

SCENARIOS = ("crossing_targets", "closely_spaced_targets")
TERMS_AND_FILTERS = ("none/cv", "none/imm", "bayes/cv", "bayes/imm")
# Decision and coalescence remedy; the first is what the others differ from.
DECISIONS = (("map", "none"), ("jpda", "none"), ("jpda", "jpda_star"))

Purities = dict[tuple[str, str, tuple[str, str]], np.ndarray]


def ring_of(scenario: Scenario, decision: tuple[str, str], term_and_filter: str) -> Ring:
    """The ring for a scenario with a decision and a remedy."""
    preset: dict[str, Any] = with_method(
        tracker_preset(scenario), f"{decision[0]}/{term_and_filter}"
    )
    return Ring({**preset, "association": {"coalescence_remedy": decision[1]}})


def measure(name: str, runs: int, seed: int) -> Purities:
    """Purity (R,) of every run of a scenario, by all decisions, terms and filters."""
    scenario = load_scenario(name)
    rings = {
        (name, other, decision): ring_of(scenario, decision, other)
        for other in TERMS_AND_FILTERS
        for decision in DECISIONS
    }
    skip = scenario.time.n_initiation_scans
    found: dict[tuple[str, str, tuple[str, str]], list[float]] = {key: [] for key in rings}
    for run in range(runs):
        recording = simulate(scenario, seed, run)
        assert recording.truth is not None
        truth = recording.truth[skip:]
        targets = np.sort(truth[0].target_id)
        # The same for all.
        prepared = [next(iter(rings.values())).prepare(scan) for scan in recording.detections]
        for key, ring in rings.items():
            # All but the track manager keep nothing from run to run.
            ring.manager = TrackManager(ring.manager.parameters)
            ring.initialise(labelled_tracks(recording, skip, ring, prepared))
            tracks = []
            for scan, known in zip(recording.detections[skip:], prepared[skip:], strict=True):
                result = ring.process(scan, known)
                assert result.tracks is not None
                tracks.append(result.tracks)
            counts = confusion_counts(tracks, truth, np.arange(1, len(targets) + 1), targets)
            found[key].append(float(purity(counts).mean()))
    return {key: np.array(values) for key, values in found.items()}


def purity_table(purities: Purities) -> str:
    """Markdown: purity and its paired difference to ``map``."""
    head = ["term/filter", "decision", "remedy"]
    for scenario in SCENARIOS:
        head += [scenario, "difference to map"]
    rows = []
    for other in TERMS_AND_FILTERS:
        for decision in DECISIONS:
            cells = [f"`{other}`", f"`{decision[0]}`", f"`{decision[1]}`"]
            for scenario in SCENARIOS:
                values = purities[scenario, other, decision]
                difference = values - purities[scenario, other, DECISIONS[0]]
                cells.append(with_error(*mean_and_stderr(values)))
                first = decision == DECISIONS[0]
                cells.append("-" if first else signed(*mean_and_stderr(difference)))
            rows.append(cells)
    return markdown(head, rows)


def main(arguments: list[str] | None = None) -> int:
    """Measure and write; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--document", type=Path, default=ROOT / "docs/jpda.md")
    args = parser.parse_args(arguments)
    purities: Purities = {}
    for name in SCENARIOS:
        purities |= measure(name, args.runs, args.seed)
        print(f"measured: {name}", file=sys.stderr, flush=True)
    write_section(args.document, "jpda purity", purity_table(purities))
    print(f"written: table of {args.document}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
