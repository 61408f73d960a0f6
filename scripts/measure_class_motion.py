#!/usr/bin/env python3
"""Measure what the motion of a track tells of its class; write docs/class-motion.md.

    python scripts/measure_class_motion.py [--runs 12] [--seed 1]

The scenario class_by_motion, by the radar cross section alone, by motion alone and by both, on the
same detections. Numbers also go to docs/class-motion.json.
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

from gda_tracker.evaluation.figures.canvas import COLOURS, INK, canvas, png  # noqa: E402
from gda_tracker.evaluation.statistics import mean_and_stderr  # noqa: E402
from gda_tracker.simulation.playback import with_method  # noqa: E402
from gda_tracker.simulation.preset import FALSE_ALARM, tracker_preset  # noqa: E402
from gda_tracker.simulation.scenarios import Scenario, load_scenario  # noqa: E402
from gda_tracker.simulation.simulate import simulate  # noqa: E402
from gda_tracker.tracking.ring import Ring  # noqa: E402
from gda_tracker.vocabulary.tracks import CONFIRMED  # noqa: E402
from scripts.doc_tables import markdown, with_error, write_section  # noqa: E402

SCENARIO = "class_by_motion"
METHODS = (
    "map/bayes/imm",
    "map/dempster/imm",
    "map/pcr5/imm",
    "gda/dsm_classic/imm",
    "jpda/bayes/imm",
    "mht/bayes/imm",
)
DRAWN = "map/bayes/imm"
NO_RCS = {"rcs_fuzzifier": {"rcs_reliability": 0.0}}
SOURCES: dict[str, dict[str, dict[str, Any]]] = {
    "RCS": {"track_manager": {"class_motion": "off"}},
    "motion": NO_RCS,
    "both": {},
    "both, densities": {"track_manager": {"class_motion": "densities"}},
}
NEAR_M = 300.0
# Scans at which the classes are looked at, the first one being number 1.
LOOKS = (10, 20, 30, 40, 60)


def believed(
    scenario: Scenario, method: str, source: str, recording: Any
) -> tuple[np.ndarray, float]:
    """Class probabilities (scans, targets, classes) of the nearest tracks, and CPU a scan [ms].

    NaN where no confirmed track is near.
    """
    parameters = with_method(tracker_preset(scenario, "automatic"), method)
    for node, changes in SOURCES[source].items():
        parameters[node].update(changes)
    ring = Ring(parameters)
    began = time.process_time()
    told = [ring.process(scan).tracks for scan in recording.detections]
    spent = time.process_time() - began
    count = len(scenario.attribute.classes) + 1
    found = np.full((len(told), len(scenario.targets), count), np.nan)
    for scan, (tracks, truth) in enumerate(zip(told, recording.truth, strict=True)):
        assert tracks is not None
        live = np.flatnonzero(tracks.status == CONFIRMED)
        if not len(live):
            continue
        gap = np.linalg.norm(
            tracks.mean[live][:, None, :2] - truth.target_state[None, :, :2], axis=2
        )
        best = gap.argmin(axis=0)
        near = gap[best, np.arange(gap.shape[1])] < NEAR_M
        found[scan, near] = tracks.class_probability[live[best[near]]]
    # A confirmed track is no false alarm: the share among the classes of targets.
    found[..., 0] = 0.0
    with np.errstate(invalid="ignore"):
        found /= found.sum(axis=-1, keepdims=True)
    return found, 1000.0 * spent / len(told)


def true_classes(scenario: Scenario) -> np.ndarray:
    """Place of each target's class among the classes."""
    names = [FALSE_ALARM, *(known.name for known in scenario.attribute.classes)]
    return np.array([names.index(target.class_name) for target in scenario.targets])


def right_share(probability: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Share (...) to which the true class is the most probable; of k that are level 1/k counts."""
    best = probability.max(axis=-1, keepdims=True)
    level = probability >= best - 1e-6
    own = np.take_along_axis(level, np.broadcast_to(true, level.shape[:-1])[..., None], axis=-1)
    share = own[..., 0] / np.maximum(level.sum(axis=-1), 1)
    # Without a track the class is not known.
    return np.where(np.isnan(best[..., 0]), 0.0, share)


def measure(runs: int, seed: int) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Numbers by method and source, and the shares over time to draw."""
    scenario = load_scenario(SCENARIO)
    true = true_classes(scenario)
    found: dict[tuple[str, str], list[np.ndarray]] = {}
    spent: dict[tuple[str, str], list[float]] = {}
    for run in range(runs):
        recording = simulate(scenario, seed, run, initiation="automatic")
        for method in METHODS:
            for source in SOURCES:
                one, ms = believed(scenario, method, source, recording)
                found.setdefault((method, source), []).append(one)
                spent.setdefault((method, source), []).append(ms)
    numbers: dict[str, Any] = {"runs": runs, "seed": seed, "methods": {}}
    for (method, source), several in found.items():
        probability = np.array(several)
        right = right_share(probability, true)
        own = np.take_along_axis(
            probability, np.broadcast_to(true, probability.shape[:-1])[..., None], axis=-1
        )[..., 0]
        # Mean over the scans with a track, of the class held for the most probable one.
        some = ~np.isnan(own)
        says = np.nanmax(np.where(some[..., None], probability, np.nan)[some], axis=-1)
        entry = {
            "right": {
                str(k): _rounded(mean_and_stderr(right[:, k - 1].mean(axis=1))) for k in LOOKS
            },
            "by target": [round(float(v), 4) for v in right[:, -1].mean(axis=0)],
            "says": round(float(says.mean()), 4),
            "is": round(float(right[some].mean()), 4),
            "ms": round(float(np.mean(spent[method, source])), 2),
        }
        numbers["methods"].setdefault(method, {})[source] = entry
    drawn = {source: np.array(found[DRAWN, source]) for source in SOURCES}
    return numbers, {
        source: _mean_of_known(
            np.take_along_axis(p, np.broadcast_to(true, p.shape[:-1])[..., None], axis=-1)[..., 0]
        )
        for source, p in drawn.items()
    }


def _mean_of_known(values: np.ndarray) -> np.ndarray:
    """Mean over the first axis of what is not NaN; NaN where nothing is."""
    known = ~np.isnan(values)
    total = np.where(known, values, 0.0).sum(axis=0)
    count = known.sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _rounded(pair: tuple[float, float]) -> list[float]:
    return [round(float(value), 4) for value in pair]


def table(numbers: dict[str, Any]) -> str:
    """The table of the page."""
    rows = []
    for method, sources in numbers["methods"].items():
        for source, one in sources.items():
            rows.append(
                (
                    f"`{method}`",
                    source,
                    *(with_error(*one["right"][str(k)]) for k in (10, 30, 60)),
                    ", ".join(f"{share:.2f}" for share in one["by target"]),
                    f"{one['says']:.2f} / {one['is']:.2f}",
                    f"{one['ms']:.1f}",
                )
            )
    head = (
        "method",
        "class by",
        "right at scan 10",
        "30",
        "60",
        "at the end, by target",
        "said / right",
        "CPU [ms]",
    )
    return f"{numbers['runs']} runs of seed {numbers['seed']}:\n\n" + markdown(head, rows)


def draw(probability: dict[str, np.ndarray]) -> Any:
    """Probability of the true class over time, a panel for each source."""
    scenario = load_scenario(SCENARIO)
    times = scenario.time.scan_period_s * np.arange(scenario.time.n_scans)
    notes = {1: ", stops", 3: ", turns", 4: ", flies straight"}
    with canvas(12.0, 3.8) as figure:
        panels = figure.subplots(1, 3, sharex=True, sharey=True)
        titles = ("radar cross section alone", "motion alone", "both")
        for axes, source, title in zip(panels, ("RCS", "motion", "both"), titles, strict=True):
            for place, target in enumerate(scenario.targets):
                axes.plot(
                    times,
                    probability[source][:, place],
                    color=COLOURS[place],
                    lw=1.8,
                    label=f"{target.class_name}{notes.get(target.id, '')}",
                )
            axes.set(title=title, xlabel="time [s]", ylim=(0.0, 1.02))
            axes.axhline(1.0 / 3.0, color=INK, lw=0.6, ls=":")
        panels[0].set_ylabel("probability of the true class")
        panels[0].legend(loc="lower right")
    return figure


def main() -> int:
    """Measure, and write table and picture."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=12)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    numbers, drawn = measure(args.runs, args.seed)
    text = json.dumps(numbers, indent=1) + "\n"
    print(text)
    (ROOT / "docs" / "class-motion.json").write_text(text, encoding="utf-8")
    write_section(ROOT / "docs" / "class-motion.md", "class motion", table(numbers))
    (ROOT / "docs" / "images" / "class_motion.png").write_bytes(png(draw(drawn)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
