#!/usr/bin/env python3
"""Measure the ring with and without a model of the sensor's resolution; write docs/unresolved.md.

    python scripts/measure_unresolved.py [--runs 200] [--seed 1] [--scenario unresolved_three]

The shipped scenarios unresolved_pair and unresolved_three: the same detections, tracked offline
with the resolution told and not. Numbers also go to docs/unresolved_ring.json.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from gda_tracker.evaluation.figures.canvas import COLOURS, canvas, png  # noqa: E402
from gda_tracker.evaluation.statistics import mean_and_stderr  # noqa: E402
from gda_tracker.simulation.playback import Playback, of_scenario, with_method  # noqa: E402
from gda_tracker.simulation.preset import tracker_preset  # noqa: E402
from gda_tracker.simulation.scenarios import Scenario, load_scenario  # noqa: E402
from gda_tracker.tracking.ring import Ring  # noqa: E402
from scripts.doc_tables import markdown, write_section  # noqa: E402

FIGURES = ROOT / "docs" / "unresolved_ring.json"
OFF = {"resolution_range_m": 0.0, "resolution_azimuth_rad": 0.0}
# What the tracker is told: the resolution; nothing; that targets fly straighter, which they do, so
# that a track is moved less by what is not its own. (A smaller P_D changes nothing.)
SETTINGS: dict[str, dict[str, Any]] = {
    "with": {},
    "without": OFF,
    "without, 0.05 m/s2": {**OFF, "process_noise_std_mps2": 0.05},
}
CASES = {
    ("unresolved_pair", "jpda/none/cv"): 1.0,
    ("unresolved_pair", "mht/none/cv"): 1.0,
    ("unresolved_pair", "map/none/cv"): 0.25,
    ("unresolved_three", "jpda/none/cv"): 0.5,
    ("unresolved_three", "mht/none/cv"): 0.5,
}
"""Scenario and method, and the share of the runs that is played."""
KEPT_WITHIN_M = 300.0


def track(
    scenario: Scenario, play: Playback, method: str, change: dict[str, Any]
) -> dict[str, Any]:
    """One run: whether all targets end within KEPT_WITHIN_M of their own tracks, NEES, CPU."""
    parameters = with_method(tracker_preset(scenario), method)
    parameters["track_manager"] |= change
    ring = Ring(parameters)
    assert play.initial is not None
    assert play.truth is not None
    ring.initialise(play.initial)
    path, nees, began = [], [], time.process_time()
    for scan, truth in zip(play.detections, play.truth, strict=True):
        tracks = ring.process(scan).tracks
        assert tracks is not None
        order = np.argsort(tracks.track_id)
        error = tracks.mean[order] - truth.target_state
        solved = np.linalg.solve(tracks.covariance[order], error[:, :, None])[:, :, 0]
        nees.append(float(np.mean(np.sum(error * solved, axis=1))) / 4.0)
        path.append(tracks.mean[order][:, :2])
    seconds = time.process_time() - began
    gap = np.linalg.norm(path[-1][:, None] - play.truth[-1].target_state[:, :2], axis=2)
    near = gap < KEPT_WITHIN_M
    return {
        "kept": bool(near.diagonal().all()),
        # Each track on a target, but not all on their own.
        "swapped": bool(not near.diagonal().all() and (near.sum(axis=0) == 1).all()),
        "nees": float(np.mean(nees)),
        "ms": 1000.0 * seconds / len(play.detections),
        "path": np.array(path),
    }


def measure(runs: int, seed: int, known: dict[str, Any], only: str = "") -> dict[str, Any]:
    """Numbers by scenario and method, in paired runs; of ``only`` one, the others as ``known``."""
    numbers: dict[str, Any] = {"seed": seed, "cases": []}
    for (name, method), share in CASES.items():
        if only not in ("", name):
            numbers["cases"] += [
                case
                for case in known["cases"]
                if (case["scenario"], case["method"]) == (name, method)
            ]
            continue
        scenario, count = load_scenario(name), max(1, round(share * runs))
        found: dict[str, list[dict[str, Any]]] = {setting: [] for setting in SETTINGS}
        for run in range(count):
            play = of_scenario(scenario, 1, seed, method, run)[0]
            for setting, change in SETTINGS.items():
                found[setting].append(track(scenario, play, method, change))
        kept = {
            key: np.array([one["kept"] for one in runs_], float) for key, runs_ in found.items()
        }
        case: dict[str, Any] = {"scenario": name, "method": method, "runs": count, "settings": {}}
        for setting, each in found.items():
            difference = mean_and_stderr(kept["with"] - kept[setting])
            base = float(kept[setting].mean())
            case["settings"][setting] = {
                "kept": round(base, 3),
                "gain": [round(value, 3) for value in difference],
                "more": round(float(kept["with"].mean()) / base - 1.0, 3) if base else None,
                "swapped": round(float(np.mean([one["swapped"] for one in each])), 3),
                "nees": round(float(np.mean([one["nees"] for one in each])), 2),
                "ms_per_scan": round(float(np.mean([one["ms"] for one in each])), 1),
            }
        numbers["cases"].append(case)
        print(json.dumps(case), flush=True)
    return numbers


def table(numbers: dict[str, Any]) -> str:
    """The table of the page."""
    rows = []
    for case in numbers["cases"]:
        for setting, one in case["settings"].items():
            gain = ""
            if setting != "with":
                more = "" if one["more"] is None else f" ({one['more']:+.0%})"
                gain = f"{one['gain'][0]:+.3f} +- {one['gain'][1]:.3f}{more}"
            rows.append(
                (
                    f"{case['scenario']}, {case['runs']} runs",
                    case["method"],
                    setting,
                    f"{one['kept']:.3f}",
                    gain,
                    f"{one['swapped']:.3f}",
                    f"{one['nees']:.2f}",
                    f"{one['ms_per_scan']:.1f}",
                )
            )
    head = ("scenario", "method", "resolution", "all kept", "with it more often")
    return f"Paired runs of seed {numbers['seed']}:\n\n" + markdown(
        (*head, "swapped", "NEES / 4", "CPU [ms]"), rows
    )


def draw(seed: int) -> Any:
    """One run of the pair, with and without, for two decisions."""
    scenario = load_scenario("unresolved_pair")
    with canvas(12.0, 6.0) as figure:
        panels = figure.subplots(2, 2, sharex=True, sharey=True)
        for row, method in zip(panels, ("jpda/none/cv", "mht/none/cv"), strict=True):
            play = of_scenario(scenario, 1, seed, method)[0]
            assert play.truth is not None
            truth = np.array([one.target_state[:, :2] for one in play.truth])
            for axes, setting in zip(row, ("with", "without"), strict=True):
                for scan in play.detections:
                    at = scan.range_m * [np.cos(scan.azimuth_rad), np.sin(scan.azimuth_rad)]
                    axes.plot(at[1] / 1000, at[0] / 1000, ".", color="0.7", ms=4)
                path = track(scenario, play, method, SETTINGS[setting])["path"]
                for i in range(2):
                    axes.plot(truth[:, i, 1] / 1000, truth[:, i, 0] / 1000, color="0.2", lw=0.8)
                    axes.plot(path[:, i, 1] / 1000, path[:, i, 0] / 1000, color=COLOURS[i], lw=1.8)
                axes.set(ylim=(-1.5, 1.5), xlim=(24.0, 62.0))
                axes.set(title=f"{method}, {setting} the resolution", ylabel="x [km]")
        for axes in panels[-1]:
            axes.set_xlabel("y [km], away from the radar")
    return figure


def main() -> int:
    """Measure, and write table and picture."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--scenario", default="", help="only this one, the others as measured")
    args = parser.parse_args()
    known = json.loads(FIGURES.read_text(encoding="utf-8"))
    numbers = measure(args.runs, args.seed, known, args.scenario)
    FIGURES.write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")
    write_section(ROOT / "docs" / "unresolved.md", "ring", table(numbers))
    (ROOT / "docs" / "images" / "unresolved-ring.png").write_bytes(png(draw(args.seed)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
