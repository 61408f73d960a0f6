#!/usr/bin/env python3
"""Draw the README's picture: one run of the crossing targets, RCS off beside RCS on.

    python scripts/make_readme_picture.py [--output docs/images/crossing.png] [--runs 20] [--seed 1]

It tracks with the offline ring, whose tracks are exactly those of the nodes, and so draws the same
run as ``gda-tracker demo`` with the same runs and seed: the one in which the RCS helps most.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from gda_tracker.evaluation.figures import association_maps, png  # noqa: E402
from gda_tracker.evaluation.summary import Run, run_purity  # noqa: E402
from gda_tracker.simulation.playback import Playback, of_scenario, with_method  # noqa: E402
from gda_tracker.simulation.preset import tracker_preset  # noqa: E402
from gda_tracker.simulation.scenarios import load_scenario  # noqa: E402
from gda_tracker.tracking.ring import Ring  # noqa: E402

METHODS = {"RCS off": "gda/none/cv", "RCS on": "gda/dsm_classic/cv"}
DPI = 110


def track(method: str, runs: int, seed: int) -> tuple[list[Playback], list[Run]]:
    """Simulate the runs and track them offline."""
    scenario = load_scenario("crossing_targets")
    plays = of_scenario(scenario, runs, seed, method)
    ring = Ring(with_method(tracker_preset(scenario), method))
    found = []
    for play in plays:
        ring.initialise(play.initial)
        tracks = [ring.process(detections).tracks for detections in play.detections]
        found.append(Run(tracks, play.truth))
    return plays, found


def main(arguments: list[str] | None = None) -> int:
    """Draw the picture; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=ROOT / "docs/images/crossing.png")
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args(arguments)
    results = {name: track(method, args.runs, args.seed) for name, method in METHODS.items()}
    purity = {name: [run_purity(run) for run in runs] for name, (_, runs) in results.items()}
    shown = int(np.argmax(np.subtract(purity["RCS on"], purity["RCS off"])))
    play = results["RCS on"][0][shown]
    panels = {
        f"{name}: purity {purity[name][shown]:.2f}": runs[shown].tracks
        for name, (_, runs) in results.items()
    }
    figure = association_maps(panels, play.detections, play.truth, axis_names=("East", "North"))
    args.output.parent.mkdir(parents=True, exist_ok=True)
    args.output.write_bytes(png(figure, DPI))
    print(f"{args.output}: run {shown} of {args.runs}, {args.output.stat().st_size / 1000:.0f} kB")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
