#!/usr/bin/env python3
"""Measure what is told of stops that a radar does not see; write docs/track-events.md.

    python scripts/measure_stops.py [--runs 16] [--seed 1]

The scenario stop_and_go: three vehicles in each run that brake, wait unseen and drive on. Numbers
also go to docs/track-stops.json.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from gda_tracker.events.detector import TrackEventDetector  # noqa: E402
from gda_tracker.events.found import MOVES, STOPPED  # noqa: E402
from gda_tracker.events.parameters import EventParameters  # noqa: E402
from gda_tracker.events.sequential import H1, OPEN  # noqa: E402
from gda_tracker.simulation.playback import with_method  # noqa: E402
from gda_tracker.simulation.preset import tracker_preset  # noqa: E402
from gda_tracker.simulation.scenarios import Scenario, load_scenario  # noqa: E402
from gda_tracker.simulation.simulate import simulate  # noqa: E402
from gda_tracker.tracking.ring import Ring  # noqa: E402
from gda_tracker.vocabulary.tracks import CONFIRMED  # noqa: E402
from scripts.doc_tables import markdown, write_section  # noqa: E402

PAGE, FIGURES = ROOT / "docs" / "track-events.md", ROOT / "docs" / "track-stops.json"
SCENARIO = "stop_and_go"
METHODS = ("gda/none/imm", "map/none/imm", "jpda/none/imm", "mht/none/imm")
STOPS: dict[str, Any] = {"tests": ["stops"], "stopped_speed_mps": 1.0, "moving_speed_mps": 6.0}
TESTS: dict[str, dict[str, Any]] = {
    "states alone": {},
    "and missed detections": {"blind_speed_mps": 2.0},
}
NEAR_M = 60.0
# Vehicles that drive at the bound of h0 all the time, and tests that are designed to err as often.
DESIGN = 0.05
AT_BOUND = ("map/none/imm", "mht/none/imm")


def standing(scenario: Scenario) -> list[tuple[float, float]]:
    """Time from which each vehicle is as slow as a stop, and until when [s]."""
    spans = []
    for target in scenario.targets:
        (stop,) = target.stops
        begin, end = (
            (k - 1.0) * scenario.time.scan_period_s for k in (stop.start_scan, stop.end_scan)
        )
        slow = STOPS["stopped_speed_mps"]
        spans.append(
            (begin + (target.speed_mps - slow) / stop.braking_mps2, end + slow / stop.braking_mps2)
        )
    return spans


def follow(scenario: Scenario, method: str, recording: Any) -> dict[str, dict[str, Any]]:
    """What each of the tests tells in one run."""
    parameters = with_method(tracker_preset(scenario, "automatic"), method)
    parameters["track_manager"]["extraction"] = "sequential"
    ring = Ring(parameters)
    detectors = {
        name: TrackEventDetector(EventParameters(**{**STOPS, **more}))
        for name, more in TESTS.items()
    }
    spans, period = standing(scenario), scenario.time.scan_period_s
    found: dict[str, dict[str, Any]] = {
        name: {"delay": {}, "resumed": {}, "early": 0, "false": 0, "no target": 0, "moving_s": 0.0}
        for name in TESTS
    }
    for scan, truth in zip(recording.detections, recording.truth, strict=True):
        tracks = ring.process(scan).tracks
        assert tracks is not None
        now = (scan.stamp_ns - recording.detections[0].stamp_ns) / 1e9
        gap = np.linalg.norm(tracks.mean[:, None, :2] - truth.target_state[None, :, :2], axis=2)
        speed = np.hypot(*truth.target_state[:, 2:4].T)
        for name, detector in detectors.items():
            one = found[name]
            if len(tracks):
                own = gap.argmin(axis=1)
                drives = (gap.min(axis=1) < NEAR_M) & (speed[own] >= STOPS["moving_speed_mps"])
                one["moving_s"] += period * float((drives & (tracks.status == CONFIRMED)).sum())
            for event in detector.take(tracks).events:
                row = int(np.flatnonzero(tracks.track_id == event.track_id)[0])
                target = int(gap[row].argmin())
                begin, end = spans[target]
                if gap[row, target] >= NEAR_M:
                    one["no target"] += event.kind == STOPPED
                elif event.kind == STOPPED and begin <= now <= end:
                    one["delay"].setdefault(target, now - begin)
                elif event.kind == STOPPED:
                    one["false" if speed[target] >= STOPS["moving_speed_mps"] else "early"] += 1
                elif event.kind == MOVES and now > end and target in one["delay"]:
                    one["resumed"].setdefault(target, now - end)
    return found


def wrong_decisions(method: str, runs: int, seed: int) -> dict[str, Any]:
    """Finished tests of vehicles that drive at the bound of h0, and how many say they stand."""
    scenario = load_scenario(SCENARIO)
    driving = tuple(
        replace(target, stops=(), speed_mps=STOPS["moving_speed_mps"])
        for target in scenario.targets
    )
    scenario = replace(scenario, targets=driving)
    parameters = with_method(tracker_preset(scenario, "automatic"), method)
    parameters["track_manager"]["extraction"] = "sequential"
    errors = {"false_alarm_probability": DESIGN, "miss_probability": DESIGN}
    settings = {**STOPS, **TESTS["and missed detections"], **errors}
    finished = wrong = 0
    for run in range(runs):
        ring = Ring(parameters)
        detector = TrackEventDetector(EventParameters(**settings))
        for scan in simulate(scenario, seed, run, initiation="automatic").detections:
            tracks = ring.process(scan).tracks
            assert tracks is not None
            # The test itself: events tell changes alone, not every decision.
            states, confirmed = detector._states(tracks)
            tested = detector._with_due(states.select(confirmed))
            _, decisions = detector._tests[0].step(tested)
            finished += int(np.count_nonzero(decisions.verdict != OPEN))
            wrong += int(np.count_nonzero(decisions.verdict == H1))
    return {"finished": finished, "wrong": wrong, "design": DESIGN}


def measure(runs: int, seed: int) -> dict[str, Any]:
    """Numbers by method and test."""
    scenario = load_scenario(SCENARIO)
    several: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for run in range(runs):
        recording = simulate(scenario, seed, run, initiation="automatic")
        for method in METHODS:
            for name, one in follow(scenario, method, recording).items():
                several.setdefault((method, name), []).append(one)
    numbers: dict[str, Any] = {"runs": runs, "seed": seed, "methods": {}}
    numbers["at the bound"] = {name: wrong_decisions(name, runs, seed) for name in AT_BOUND}
    stops = runs * len(scenario.targets)
    for (method, name), each in several.items():
        delays = [delay for one in each for delay in one["delay"].values()]
        share = len(delays) / stops
        by_target = [
            round(float(np.mean([target in one["delay"] for one in each])), 3)
            for target in range(len(scenario.targets))
        ]
        numbers["methods"].setdefault(method, {})[name] = {
            "stops": stops,
            "told": [round(share, 4), round(float(np.sqrt(share * (1.0 - share) / stops)), 4)],
            "by vehicle": by_target,
            "median delay_s": round(float(np.median(delays)), 1) if delays else None,
            "end told": sum(len(one["resumed"]) for one in each),
            "early": sum(one["early"] for one in each),
            "false": sum(one["false"] for one in each),
            "no target": sum(one["no target"] for one in each),
            "moving_h": round(sum(one["moving_s"] for one in each) / 3600.0, 3),
        }
    return numbers


def table(numbers: dict[str, Any]) -> str:
    """The table of the page."""
    rows = []
    for method, tests in numbers["methods"].items():
        for name, one in tests.items():
            delay = one["median delay_s"]
            rows.append(
                (
                    f"`{method}`",
                    name,
                    f"{100.0 * one['told'][0]:.0f} +- {100.0 * one['told'][1]:.0f} %",
                    ", ".join(f"{100.0 * share:.0f}" for share in one["by vehicle"]),
                    "" if delay is None else f"{delay:.0f} s",
                    str(one["end told"]),
                    str(one["early"]),
                    f"{one['false']} in {one['moving_h']:.1f} h",
                    str(one["no target"]),
                )
            )
    head = (
        "method",
        "test",
        "stops told",
        "by vehicle [%]",
        "median delay",
        "ends told",
        "told while braking",
        "told of what drives",
        "of no vehicle",
    )
    stops = next(iter(numbers["methods"].values()))["states alone"]["stops"]
    told = f"{stops} stops in {numbers['runs']} runs of seed {numbers['seed']}:\n\n"
    bound = [
        (
            f"`{method}`",
            f"{one['wrong']} of {one['finished']}",
            f"{one['design'] * one['finished']:.0f}",
        )
        for method, one in numbers["at the bound"].items()
    ]
    return (
        told
        + markdown(head, rows)
        + "\n\nThe same vehicles when they never stop and drive at 6 m/s, the bound of h0:\n\n"
        + markdown(
            ("method", "finished tests that say it stands", "by a design of 5 % at most"), bound
        )
    )


def main() -> int:
    """Measure, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=16)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    numbers = measure(args.runs, args.seed)
    text = json.dumps(numbers, indent=1) + "\n"
    print(text)
    FIGURES.write_text(text, encoding="utf-8")
    write_section(PAGE, "stops", table(numbers))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
