#!/usr/bin/env python3
"""Measure what a model of the Doppler blind zone is worth; write docs/blind-zone.md.

    python scripts/measure_blind_zone.py [--runs 16] [--seed 1]

The scenario stop_and_go, tracked with the model and without on the same detections. Numbers also go
to docs/blind-zone.json.
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

from gda_tracker.evaluation.figures.canvas import COLOURS, PALE, canvas, png  # noqa: E402
from gda_tracker.evaluation.statistics import mean_and_stderr  # noqa: E402
from gda_tracker.simulation.playback import with_method  # noqa: E402
from gda_tracker.simulation.preset import tracker_preset  # noqa: E402
from gda_tracker.simulation.scenarios import Scenario, load_scenario  # noqa: E402
from gda_tracker.simulation.simulate import simulate  # noqa: E402
from gda_tracker.tracking.ring import Ring  # noqa: E402
from gda_tracker.vocabulary.tracks import CONFIRMED  # noqa: E402
from scripts.doc_tables import markdown, signed, with_error, write_section  # noqa: E402

AWARE, UNAWARE = "stop_and_go", "stop_and_go_unaware"
METHODS = ("gda/none/imm", "map/none/imm", "jpda/none/imm", "mht/none/imm", "map/none/cv")
RULES = {
    **{(method, "m_of_n"): method for method in METHODS},
    **{
        (method, "sequential"): f"{method}, sequential"
        for method in ("map/none/imm", "mht/none/imm")
    },
}
DRAWN = ("mht/none/imm", "sequential")
NEAR_M = 60.0
# Scans before a vehicle brakes, and after it has set off, at which it must be under the same track.
BEFORE, AFTER = 2, 10


def follow(scenario: Scenario, rule: tuple[str, str], recording: Any) -> dict[str, Any]:
    """Track a run: who is under which track, what was false, how long it took."""
    method, extraction = rule
    parameters = with_method(tracker_preset(scenario, "automatic"), method)
    parameters["track_manager"]["extraction"] = extraction
    ring, ids, places = Ring(parameters), [], []
    matched: set[int] = set()
    confirmed: set[int] = set()
    began = time.process_time()
    told = [ring.process(scan).tracks for scan in recording.detections]
    spent = time.process_time() - began
    for tracks, truth in zip(told, recording.truth, strict=True):
        assert tracks is not None
        live = tracks.status == CONFIRMED
        track_id, at = tracks.track_id[live], tracks.mean[live, :2]
        gap = np.linalg.norm(at[:, None] - truth.target_state[:, :2], axis=2)
        confirmed.update(track_id.tolist())
        matched.update(track_id[(gap < NEAR_M).any(axis=1)].tolist())
        best = gap.argmin(axis=0) if len(at) else np.zeros(len(truth.target_id), int)
        near = [len(at) > 0 and gap[b, t] < NEAR_M for t, b in enumerate(best)]
        ids.append([int(track_id[b]) if n else -1 for b, n in zip(best, near, strict=True)])
        places.append((track_id, at))
    held = np.array(ids)
    kept = []
    for place, target in enumerate(scenario.targets):
        (stop,) = target.stops
        before, after = round(stop.start_scan) - 1 - BEFORE, round(stop.end_scan) - 1 + AFTER
        kept.append(held[before, place] >= 0 and held[before, place] == held[after, place])
    return {
        "kept": float(np.mean(kept)),
        "complete": float((held >= 0).mean()),
        "false": float(len(confirmed - matched)),
        "ms": 1000.0 * spent / len(told),
        "places": places,
    }


def measure(runs: int, seed: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Numbers by method, and the first run to draw."""
    scenarios = {name: load_scenario(name) for name in (AWARE, UNAWARE)}
    found: dict[Any, list[dict[str, Any]]] = {}
    first: dict[str, Any] = {}
    for run in range(runs):
        recording = simulate(scenarios[AWARE], seed, run, initiation="automatic")
        for rule in RULES:
            for name, scenario in scenarios.items():
                one = follow(scenario, rule, recording)
                places = one.pop("places")
                found.setdefault((rule, name), []).append(one)
                if run == 0 and rule == DRAWN:
                    first[name] = places
        if run == 0:
            first["recording"], first["scenario"] = recording, scenarios[AWARE]
    numbers: dict[str, Any] = {"runs": runs, "seed": seed, "methods": {}}
    for rule, label in RULES.items():
        both = {name: found[rule, name] for name in scenarios}
        entry: dict[str, Any] = {
            name: {
                key: [round(value, 4) for value in mean_and_stderr(_of(several, key))]
                for key in ("kept", "complete", "false", "ms")
            }
            for name, several in both.items()
        }
        gain = _of(both[AWARE], "kept") - _of(both[UNAWARE], "kept")
        entry["gain"] = [round(value, 4) for value in mean_and_stderr(gain)]
        numbers["methods"][label] = entry
    return numbers, first


def _of(several: list[dict[str, Any]], key: str) -> np.ndarray:
    return np.array([one[key] for one in several])


def table(numbers: dict[str, Any]) -> str:
    """The table of the page."""
    rows = []
    for label, entry in numbers["methods"].items():
        for name, title in ((UNAWARE, "without"), (AWARE, "with")):
            one = entry[name]
            rows.append(
                (
                    f"`{label}`",
                    title,
                    with_error(*one["kept"]),
                    signed(*entry["gain"]) if name == AWARE else "",
                    with_error(*one["complete"]),
                    f"{one['false'][0]:.2f} +- {one['false'][1]:.2f}",
                    f"{one['ms'][0]:.1f}",
                )
            )
    head = ("method", "zone", "stops survived", "gain", "complete", "false tracks", "CPU [ms]")
    return f"{numbers['runs']} runs of seed {numbers['seed']}:\n\n" + markdown(head, rows)


def draw(first: dict[str, Any]) -> Any:
    """Distance from the radar over time, a colour for each track."""
    recording, scenario = first["recording"], first["scenario"]
    period = scenario.time.scan_period_s
    times = period * np.arange(len(recording.truth))
    states = np.array([truth.target_state for truth in recording.truth])
    with canvas(12.0, 4.5) as figure:
        panels = figure.subplots(1, 2, sharex=True, sharey=True)
        for axes, name, title in zip(
            panels, (UNAWARE, AWARE), ("without the blind zone", "with it"), strict=True
        ):
            for at, scan in zip(times, recording.detections, strict=True):
                axes.plot(np.full(len(scan.range_m), at), scan.range_m, ".", color=PALE, ms=3)
            for place in range(states.shape[1]):
                axes.plot(times, np.hypot(*states[:, place, :2].T), color="black", lw=0.8)
            for track in sorted({i for ids, _ in first[name] for i in ids.tolist()}):
                line = [
                    (at, float(np.hypot(*mean[ids == track][0])))
                    for at, (ids, mean) in zip(times, first[name], strict=True)
                    if (ids == track).any()
                ]
                axes.plot(*zip(*line, strict=True), color=COLOURS[track % len(COLOURS)], lw=2.2)
            axes.set(title=title, xlabel="time [s]", ylim=(800.0, 3200.0))
        panels[0].set_ylabel("distance from the radar [m]")
    return figure


def main() -> int:
    """Measure, and write table and picture."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=16)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    numbers, first = measure(args.runs, args.seed)
    text = json.dumps(numbers, indent=1) + "\n"
    print(text)
    (ROOT / "docs" / "blind-zone.json").write_text(text, encoding="utf-8")
    write_section(ROOT / "docs" / "blind-zone.md", "blind zone", table(numbers))
    (ROOT / "docs" / "images" / "blind_zone.png").write_bytes(png(draw(first)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
