#!/usr/bin/env python3
"""Measure what lanes and plans in the filter are worth, and what they cost; write docs/lanes.md.

    python scripts/measure_lanes.py [--runs 12] [--seed 1]

The scenario road_network, tracked with the map and the plan and without on the same detections.
Numbers also go to docs/lanes.json.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "test" / "tracking")]

import context_examples as roads  # noqa: E402

from gda_tracker.evaluation.figures.canvas import COLOURS, PALE, canvas, png  # noqa: E402
from gda_tracker.evaluation.statistics import mean_and_stderr  # noqa: E402
from gda_tracker.simulation.playback import with_method  # noqa: E402
from gda_tracker.simulation.preset import tracker_preset  # noqa: E402
from gda_tracker.simulation.scenarios import Scenario, load_scenario  # noqa: E402
from gda_tracker.simulation.simulate import simulate  # noqa: E402
from gda_tracker.tracking.context_files import read_context_file  # noqa: E402
from gda_tracker.tracking.labelled import labelled_tracks  # noqa: E402
from gda_tracker.tracking.ring import Ring  # noqa: E402
from scripts.doc_tables import markdown, signed, with_error, write_section  # noqa: E402

TOLD, UNTOLD = "road_network", "road_network_untold"
METHODS = ("gda/none/cv", "map/none/cv", "jpda/none/cv", "mht/none/cv", "jpda/none/imm")
DRAWN, DRAWN_RUN = "jpda/none/cv", 1
NEAR_M = 60.0
KEEPERS, LEAVERS, PLANNED = (1, 2, 4), (3, 5), (6,)
# Scan, from 0, at which each leaver leaves, and how long "during the departure" is.
LEAVES = {3: 20, 5: 31}
DEPARTURE_SCANS = 8
# Scans at which vehicle 1 gives no detections, in its first bend, and when it is looked for.
GAP = range(30, 41)
AFTER_GAP = 45


def without_detections(recording: Any, target: int, scans: range) -> Any:
    """The recording without the detections of a target on some scans."""
    detections = list(recording.detections)
    for k in scans:
        keep = recording.truth[k].source_id != target
        scan = detections[k]
        columns = {
            name: np.asarray(getattr(scan, name))[keep]
            for name in ("range_m", "azimuth_rad", "rcs_m2", "rcs_valid")
            if getattr(scan, name) is not None
        }
        detections[k] = replace(scan, **columns)
    return replace(recording, detections=detections)


def follow(scenario: Scenario, method: str, recording: Any) -> dict[str, Any]:
    """Errors (scans, targets) of the labelled tracks, beliefs of the last two models, time."""
    parameters = with_method(tracker_preset(scenario), method)
    ring = Ring(parameters)
    ring.initialise(labelled_tracks(recording, 2, Ring(parameters)))
    errors, beliefs, places = [], [], []
    began = time.process_time()
    for scan, truth in zip(recording.detections[2:], recording.truth[2:], strict=True):
        tracks = ring.process(scan).tracks
        # Labelled tracks have the ids of their targets, and none ends.
        rows = np.searchsorted(tracks.track_id, truth.target_id)
        places.append(tracks.mean[rows, :2])
        errors.append(np.linalg.norm(places[-1] - truth.target_state[:, :2], axis=1))
        table = ring.manager.state.table
        own = table.model_weight[table.chosen]
        beliefs.append(own[rows, -2:] if own.shape[1] > 2 else np.zeros((len(rows), 2)))
    spent = time.process_time() - began
    blank = np.full((2, len(errors[0])), np.nan)
    return {
        "errors": np.concatenate([blank, errors]),
        "beliefs": np.concatenate([np.zeros((2, *beliefs[0].shape)), beliefs]),
        "places": np.array(places),
        "ms": 1000.0 * spent / len(errors),
    }


def figures(one: dict[str, Any], gapped: dict[str, Any]) -> dict[str, float]:
    """The numbers of one run, and of the same with the gap."""
    errors = one["errors"]
    found = {
        "lost": float((errors[-5:] > NEAR_M).all(axis=0).mean()),
        "ms": one["ms"],
        "gap": float(np.nanmax(gapped["errors"][AFTER_GAP : AFTER_GAP + 3, 0]) < NEAR_M),
        "gap_error": float(np.median(gapped["errors"][GAP.start : GAP.stop, 0])),
    }
    for name, targets in (("keepers", KEEPERS), ("leavers", LEAVERS), ("planned", PLANNED)):
        columns = errors[:, [target - 1 for target in targets]]
        # Of those that are lost the error says nothing: they count as lost. Where all of them are,
        # the run counts in no mean of errors.
        near = columns[columns < NEAR_M]
        found[name] = float(np.sqrt(np.mean(near**2))) if len(near) else float("nan")
    leaving = [errors[scan : scan + DEPARTURE_SCANS, target - 1] for target, scan in LEAVES.items()]
    found["departure"] = float(np.mean(np.minimum(leaving, NEAR_M)))
    belief = [one["beliefs"][scan:, target - 1, 0] for target, scan in LEAVES.items()]
    found["delay"] = float(np.mean([np.argmax(b < 0.5) for b in belief]))
    return found


def matched(n: int = 40, scans: int = 70) -> dict[str, Any]:
    """NEES and error of vehicles that move as the lane model has it, with it and without.

    Each has a road of its own, 300 m from the next; those of the consistency test.
    """
    states = roads.keepers(n, scans, 5)
    aside = np.zeros((n, 4))
    aside[:, 1] = 300.0 * (np.arange(n) - n / 2)
    detections = roads.seen(states + aside, 6, azimuth_std_rad=0.002)
    found: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "roads.yaml"
        path.write_text(roads.parallel(aside[:, 1]), encoding="utf-8")
        for name, told, changes in (
            ("without", "", {}),
            ("with", str(path), {}),
            ("with, all known to keep", str(path), {"lane_keeping_share": 0.9999}),
        ):
            more = {"azimuth_std_rad": 0.002, "lane_keeping_s": 1e4 if changes else 120.0}
            ring = Ring({"track_manager": roads.settings(told, **more, **changes)})
            squared, errors = [], []
            for scan, truth in zip(detections, states + aside, strict=True):
                tracks = ring.process(scan).tracks
                if len(tracks) < n:
                    continue
                gap = np.linalg.norm(truth[:, None, :2] - tracks.mean[:, :2], axis=2)
                row = gap.argmin(axis=1)
                error = tracks.mean[row] - truth
                solved = np.linalg.solve(tracks.covariance[row], error[..., None])[..., 0]
                squared.append(np.sum(error * solved, axis=1))
                errors.append(gap.min(axis=1) ** 2)
            # A mean for each vehicle: scans hang together.
            nees = np.mean(squared[10:], axis=0)
            found[name] = {
                "nees": [round(v, 3) for v in mean_and_stderr(nees)],
                "rms_m": round(float(np.sqrt(np.mean(errors[10:]))), 3),
            }
    return found


def drawn(seed: int) -> dict[str, Any]:
    """A run with the gap, with the map and without, to draw."""
    scenarios = {name: load_scenario(name) for name in (TOLD, UNTOLD)}
    recording = without_detections(simulate(scenarios[TOLD], seed, DRAWN_RUN), 1, GAP)
    told = {name: follow(scenario, DRAWN, recording) for name, scenario in scenarios.items()}
    return {"scenario": scenarios[TOLD], "recording": recording, **told}


def measure(runs: int, seed: int) -> dict[str, Any]:
    """Numbers by method."""
    scenarios = {name: load_scenario(name) for name in (TOLD, UNTOLD)}
    period = scenarios[TOLD].time.scan_period_s
    found: dict[Any, list[dict[str, float]]] = {}
    for run in range(runs):
        recording = simulate(scenarios[TOLD], seed, run)
        gapped = without_detections(recording, 1, GAP)
        for method in METHODS:
            for name, scenario in scenarios.items():
                one, two = (follow(scenario, method, each) for each in (recording, gapped))
                found.setdefault((method, name), []).append(figures(one, two))
    numbers: dict[str, Any] = {
        "matched": matched(),
        "runs": runs,
        "seed": seed,
        "period_s": period,
        "methods": {},
    }
    for method in METHODS:
        both = {name: found[method, name] for name in scenarios}
        entry: dict[str, Any] = {
            name: {key: _mean([one[key] for one in several]) for key in several[0]}
            for name, several in both.items()
        }
        entry["gain"] = {
            key: _mean([a[key] - b[key] for a, b in zip(both[TOLD], both[UNTOLD], strict=True)])
            for key in ("keepers", "planned", "leavers", "departure", "lost", "gap")
        }
        numbers["methods"][method] = entry
    return numbers


def _mean(values: list[float]) -> list[float]:
    """Mean and standard error of those that are there."""
    known = np.array(values)
    return [round(v, 4) for v in mean_and_stderr(known[np.isfinite(known)])]


def tables(numbers: dict[str, Any]) -> str:
    """The tables of the page."""
    errors, rest = [], []
    for method, entry in numbers["methods"].items():
        for name, title in ((UNTOLD, "without"), (TOLD, "with")):
            one, gain = entry[name], entry["gain"]
            told = name == TOLD
            errors.append(
                (
                    f"`{method}`",
                    title,
                    *(
                        _metres(one[key]) + (f" ({_signed(gain[key])})" if told else "")
                        for key in ("keepers", "planned", "leavers", "departure")
                    ),
                )
            )
            rest.append(
                (
                    f"`{method}`",
                    title,
                    with_error(*one["gap"]) + (f" ({signed(*gain['gap'])})" if told else ""),
                    _metres(one["gap_error"]),
                    with_error(*one["lost"]) + (f" ({signed(*gain['lost'])})" if told else ""),
                    f"{numbers['period_s'] * one['delay'][0]:.1f}" if told else "",
                    f"{one['ms'][0]:.1f}",
                )
            )
    head = ("method", "map", "keepers [m]", "plan [m]", "leavers [m]", "while they leave [m]")
    other = (
        "method",
        "map",
        "found after the gap",
        "error in the gap [m]",
        "lost at the end",
        "delay [s]",
        "CPU [ms]",
    )
    consistent = [
        (name, f"{one['nees'][0]:.2f} +- {one['nees'][1]:.2f}", f"{one['rms_m']:.1f}")
        for name, one in numbers["matched"].items()
    ]
    return (
        "Vehicles that move as the lane model has it, 40 of them, a scan each second:\n\n"
        + markdown(("lanes", "NEES (4)", "position error, rms [m]"), consistent)
        + f"\n\n`road_network`, {numbers['runs']} runs of seed {numbers['seed']}; in brackets the "
        + "paired difference:\n\n"
        + markdown(head, errors)
        + "\n\n"
        + markdown(other, rest)
    )


def _metres(value: list[float]) -> str:
    return f"{value[0]:.1f} +- {value[1]:.1f}"


def _signed(value: list[float]) -> str:
    return f"{value[0]:+.1f} +- {value[1]:.1f}"


def draw(first: dict[str, Any]) -> Any:
    """Map with the tracks of both, and beliefs over time."""
    recording, scenario = first["recording"], first["scenario"]
    context = read_context_file(scenario.tracker.context_file)
    states = np.array([truth.target_state for truth in recording.truth])
    with canvas(12.0, 5.0) as figure:
        left, right = figure.subplots(1, 2, width_ratios=(1.5, 1.0))
        for lane in context.lanes:
            left.plot(*lane.points.T, color=PALE, lw=6, solid_capstyle="butt", zorder=0)
        for plan in context.plans:
            left.plot(*plan.points.T, "s", color="black", ms=6, mfc="none", zorder=5)
        left.plot(*states[:, :, :2].reshape(-1, 2).T, ".", color="black", ms=1.5, zorder=3)
        for name, colour, title in (
            (UNTOLD, COLOURS[1], "track without"),
            (TOLD, COLOURS[0], "track with lanes and plan"),
        ):
            places = first[name]["places"]
            for target in range(places.shape[1]):
                left.plot(
                    *places[:, target].T,
                    color=colour,
                    lw=1.2,
                    zorder=2 if name == UNTOLD else 4,
                    label=title if not target else None,
                )
        for target in range(states.shape[1]):
            left.annotate(f"{target + 1}", states[0, target, :2], fontsize=9)
        left.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", xlim=(-1600, 1600))
        left.set_ylim(-1300, 1600)
        left.legend(fontsize=8, loc="lower left")
        times = scenario.time.scan_period_s * np.arange(len(states))
        for target in range(states.shape[1]):
            place = 1 if target + 1 in PLANNED else 0
            right.plot(
                times,
                first[TOLD]["beliefs"][:, target, place],
                color=COLOURS[target % len(COLOURS)],
                ls="--" if target + 1 in LEAVERS else "-",
                label=f"{target + 1}" + (" leaves" if target + 1 in LEAVERS else ""),
            )
        for target, scan in LEAVES.items():
            right.axvline(times[scan], color=COLOURS[target - 1], lw=0.7)
        right.set(xlabel="time [s]", ylabel="belief: keeps to lane or plan", ylim=(0.0, 1.0))
        right.legend(fontsize=8, ncols=2)
    return figure


def main() -> int:
    """Measure, and write tables and picture."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=12)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    numbers = measure(args.runs, args.seed)
    text = json.dumps(numbers, indent=1) + "\n"
    (ROOT / "docs" / "lanes.json").write_text(text, encoding="utf-8")
    (ROOT / "docs" / "images" / "lanes.png").write_bytes(png(draw(drawn(args.seed))))
    write_section(ROOT / "docs" / "lanes.md", "lanes", tables(numbers))
    print(tables(numbers))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
