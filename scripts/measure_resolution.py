#!/usr/bin/env python3
"""Measure what a model of the sensor's resolution is worth; write docs/unresolved.md.

    python scripts/measure_resolution.py [--runs 200] [--seed 1]

Two targets pass inside the resolution cell; the same detections are tracked with the model and
without. Numbers also go to docs/unresolved.json.
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

from gda_tracker.association.unresolved import (  # noqa: E402
    ResolutionSensor,
    resolution_covariance,
    unresolved_probability,
)
from gda_tracker.association.unresolved_tracker import UnresolvedTracker  # noqa: E402
from gda_tracker.evaluation.figures.canvas import COLOURS, canvas, png  # noqa: E402
from gda_tracker.evaluation.statistics import mean_and_stderr  # noqa: E402
from gda_tracker.kinematics.motion_models import white_noise_acceleration  # noqa: E402
from scripts.doc_tables import markdown, write_section  # noqa: E402

STEP_S, SCANS, DENSITY = 5.0, 36, 0.05
NOISE = np.diag([20.0, 50.0]) ** 2
SEEN, CLUTTER, WIDE = 0.9, 2e-9, 12_000.0
ACROSS_M, RANGE_CELL_M = 700.0, 150.0
# Resolution across: P_u = 1/2 at this distance [m].
SCENES = {"a cell of 500 m": 500.0, "a cell of 800 m": 800.0}
# What the tracker believes: whether there is a limit, and P_D.
BELIEFS = {
    "with": (True, SEEN),
    "without": (False, SEEN),
    "without, P_D = 0.6": (False, 0.6),
}
MODELS = tuple(BELIEFS)
KEPT_WITHIN_M = 300.0


def sensor(scene: str, model: str) -> ResolutionSensor:
    """The sensor as a tracker believes it to be."""
    limited, seen = BELIEFS[model]
    return ResolutionSensor(
        np.eye(2, 4), NOISE, NOISE, seen, SEEN, CLUTTER, resolution(scene) if limited else None
    )


def resolution(scene: str) -> np.ndarray:
    """R_u of a scene."""
    return resolution_covariance(np.array([RANGE_CELL_M, SCENES[scene]]))


def paths() -> np.ndarray:
    """True states (SCANS, 2, 4): 200 m/s ahead, and across from side to side."""
    t = np.linspace(-1.0, 1.0, SCANS)
    duration = STEP_S * (SCANS - 1)
    along = 100.0 * duration * (t + 1.0)
    states = np.empty((SCANS, 2, 4))
    for i, sign in enumerate((1.0, -1.0)):
        # 30 m apart in range, so that they never are at one place.
        rate = np.full(SCANS, -sign * 2.0 * ACROSS_M / duration)
        states[:, i] = np.stack(
            [along + 15.0 * sign, -sign * ACROSS_M * t, np.full(SCANS, 200.0), rate], axis=1
        )
    return states


def scan(rng: np.random.Generator, states: np.ndarray, scene: str) -> np.ndarray:
    """Detections (m, 2) of one scan."""
    chance = unresolved_probability(states[0, :2] - states[1, :2], resolution(scene))
    at = states[:, :2]
    if rng.uniform() < chance:
        at = at.mean(axis=0, keepdims=True)
    at = at[rng.uniform(size=len(at)) < SEEN]
    at = at + rng.multivariate_normal([0.0, 0.0], NOISE, len(at))
    false = rng.poisson(CLUTTER * WIDE**2)
    middle = states[:, :2].mean(axis=0)
    return np.vstack([at, middle + rng.uniform(-WIDE / 2, WIDE / 2, (false, 2))])


def run(scene: str, seed: int, number: int) -> dict[str, Any]:
    """Both trackers on the same detections."""
    rng = np.random.default_rng([seed, number, list(SCENES).index(scene)])
    truth = paths()
    step, noise = white_noise_acceleration(STEP_S, DENSITY)
    start = np.diag([50.0, 50.0, 5.0, 5.0]) ** 2
    mean = truth[0] + rng.multivariate_normal(np.zeros(4), start, 2)
    trackers = {
        name: UnresolvedTracker(mean, np.tile(start, (2, 1, 1)), sensor(scene, name))
        for name in MODELS
    }
    found: dict[str, Any] = {"detections": [], **{name: [] for name in MODELS}}
    seconds = dict.fromkeys(MODELS, 0.0)
    for k in range(SCANS):
        detections = scan(rng, truth[k], scene)
        found["detections"].append(detections)
        for name, tracker in trackers.items():
            began = time.process_time()
            if k:
                tracker.predict(step, noise)
            tracker.update(detections)
            seconds[name] += time.process_time() - began
            found[name].append(tracker.estimate()[0])
    for name, tracker in trackers.items():
        gap = np.linalg.norm(tracker.most_probable()[:, :2] - truth[-1, :, :2], axis=1)
        found[name, "kept"] = bool((gap < KEPT_WITHIN_M).all())
        other = np.linalg.norm(tracker.most_probable()[::-1, :2] - truth[-1, :, :2], axis=1)
        found[name, "swapped"] = bool((other < KEPT_WITHIN_M).all())
        at = np.array(found[name])[:, :, :2] - truth[:, :, :2]
        found[name, "error_m"] = float(np.sqrt(np.mean(np.sum(at**2, axis=2))))
        found[name, "ms"] = 1000.0 * seconds[name] / SCANS
    return found


def measure(runs: int, seed: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Numbers by scene, and the first run of each to draw."""
    numbers: dict[str, Any] = {"runs": runs, "seed": seed, "scenes": {}}
    first = {}
    for scene in SCENES:
        found = [run(scene, seed, number) for number in range(runs)]
        first[scene] = found[0]
        kept = {name: np.array([one[name, "kept"] for one in found], float) for name in MODELS}
        numbers["scenes"][scene] = {
            **{
                name: {
                    "kept": round(float(kept[name].mean()), 3),
                    "swapped": round(float(np.mean([one[name, "swapped"] for one in found])), 3),
                    "error_m": round(float(np.median([one[name, "error_m"] for one in found])), 1),
                    "ms_per_scan": round(float(np.mean([one[name, "ms"] for one in found])), 1),
                }
                for name in MODELS
            },
            "gain": {
                name: [
                    round(value, 3)
                    for value in (
                        *mean_and_stderr(kept["with"] - kept[name]),
                        float(kept["with"].mean() / kept[name].mean() - 1.0),
                    )
                ]
                for name in MODELS[1:]
            },
        }
    return numbers, first


def gain_of(entry: dict[str, Any], name: str) -> str:
    """How much more often the model keeps both, paired."""
    if name not in entry["gain"]:
        return ""
    mean, error, more = entry["gain"][name]
    return f"{mean:+.3f} +- {error:.3f} ({more:+.0%})"


def table(numbers: dict[str, Any]) -> str:
    """The table of the page."""
    rows = []
    for scene, entry in numbers["scenes"].items():
        for name in MODELS:
            one = entry[name]
            rows.append(
                (
                    scene,
                    name,
                    f"{one['kept']:.3f}",
                    gain_of(entry, name),
                    f"{one['swapped']:.3f}",
                    f"{one['error_m']:.0f}",
                    f"{one['ms_per_scan']:.1f}",
                )
            )
    head = (
        "scene",
        "model",
        "both kept",
        "with the model more often",
        "swapped",
        "error [m]",
        "CPU [ms]",
    )
    return f"{numbers['runs']} runs of seed {numbers['seed']}:\n\n" + markdown(head, rows)


def draw(first: dict[str, Any]) -> Any:
    """One run of each scene."""
    with canvas(12.0, 6.0) as figure:
        panels = figure.subplots(len(first), 2, sharex=True, squeeze=False)
        for row, (scene, found) in zip(panels, first.items(), strict=True):
            truth = paths()
            for axes, name in zip(row, MODELS[:2], strict=True):
                points = np.concatenate(found["detections"])
                axes.plot(*(points.T / 1000), ".", color="0.7", ms=4)
                at = np.array(found[name])
                for i in range(2):
                    axes.plot(*(truth[:, i, :2].T / 1000), color="black", lw=0.8)
                    axes.plot(*(at[:, i, :2].T / 1000), color=COLOURS[i], lw=1.6)
                axes.set(ylim=(-1.2, 1.2), ylabel="y [km]", title=f"{scene}, {name} the model")
        for axes in panels[-1]:
            axes.set_xlabel("x [km]")
    return figure


def main() -> int:
    """Measure, and write table and picture."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    numbers, first = measure(args.runs, args.seed)
    text = json.dumps(numbers, indent=1) + "\n"
    print(text)
    (ROOT / "docs" / "unresolved.json").write_text(text, encoding="utf-8")
    write_section(ROOT / "docs" / "unresolved.md", "resolution", table(numbers))
    (ROOT / "docs" / "images" / "unresolved.png").write_bytes(png(draw(first)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
