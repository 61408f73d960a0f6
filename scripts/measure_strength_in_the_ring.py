#!/usr/bin/env python3
"""Measure signal strength in the ring: docs/signal-strength.md, docs/strength_in_the_ring.json.

    python scripts/measure_strength_in_the_ring.py [--runs 100] [--seed 1]

The scenario weak_targets without its first two scans, on which every target is detected. The same
recordings go through the whole tracker with four kinds of knowledge. A track is declared at the
first scan on which its odds of a target exceed a limit; where it is then says whether that is true
or false. The limit of each is set so that all have the same number of false tracks.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import logit
from scipy.stats import invgamma

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from gda_tracker.evaluation.figures.canvas import COLOURS, canvas, png  # noqa: E402
from gda_tracker.evaluation.statistics import mean_and_stderr  # noqa: E402
from gda_tracker.kinematics.signal_strength import threshold  # noqa: E402
from gda_tracker.simulation.playback import with_method  # noqa: E402
from gda_tracker.simulation.preset import tracker_preset  # noqa: E402
from gda_tracker.simulation.scenarios import Scenario, load_scenario  # noqa: E402
from gda_tracker.simulation.simulate import simulate  # noqa: E402
from gda_tracker.tracking.labelled import labelled_tracks  # noqa: E402
from gda_tracker.tracking.ring import Ring  # noqa: E402
from gda_tracker.vocabulary.recordings import Recording  # noqa: E402
from scripts.doc_tables import markdown, write_section  # noqa: E402

KNOWLEDGE = ("position alone", "RCS as measured", "RCS, true classes", "signal strength")
ALONE, MEASURED, CLASSES, STRENGTH = KNOWLEDGE
MAIN, OTHERS = "map", ("gda", "jpda", "mht")
NEAR_M, WITHIN, FALSE_TRACKS = 90.0, 20, (0.1, 0.5)
# So that the sequential test ends tracks but decides nothing above the limits that are compared.
NEVER = 1e-6
PRIOR_SHAPE, PRIOR_MEAN = 3.0, 8.0
CHECKED = (5, 10, 20, 30)


def recordings(scenario: Scenario, runs: int, seed: int) -> list[Recording]:
    """Runs without the scans on which every target is detected."""
    found = [simulate(scenario, seed, run) for run in range(runs)]
    first = scenario.time.n_initiation_scans
    return [replace(r, detections=r.detections[first:], truth=r.truth[first:]) for r in found]


def parameters_of(scenario: Scenario, decision: str, knowledge: str) -> dict[str, Any]:
    """What the ring is told; all classes and the mean detection probability are the true ones."""
    term = "bayes" if knowledge in (MEASURED, CLASSES) else "none"
    told = with_method(tracker_preset(scenario, "automatic"), f"{decision}/{term}/cv")
    told["track_manager"]["signal_strength"] = "swerling_1" if knowledge == STRENGTH else "none"
    told["track_manager"]["false_track_probability"] = NEVER
    if knowledge == CLASSES:
        means = [1.0 + target.rcs_mean_m2 for target in scenario.targets]
        told["rcs_fuzzifier"]["class_rcs_mean_m2"] = [1.0, *means]
    return told


def courses(
    recording: Recording, told: dict[str, Any], knowledge: str, lambda_: float
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Scans, log odds and target (row, -1 for none) of every track of a run."""
    ring, seen = Ring(told), {}
    assert recording.truth is not None
    for k, (scan, truth) in enumerate(zip(recording.detections, recording.truth, strict=True)):
        if knowledge == CLASSES:
            # The excess is exponential, of a target with 1 + x and of noise with 1: exact classes.
            scan = replace(scan, rcs_m2=scan.attribute_values[0] - lambda_)
        tracks = ring.process(scan).tracks
        assert tracks is not None
        if not len(tracks):
            continue
        gap = tracks.mean[:, None, :2] - truth.target_state[None, :, :2]
        distance = np.hypot(gap[..., 0], gap[..., 1])
        nearest = distance.argmin(axis=1)
        target = np.where(distance.min(axis=1) <= NEAR_M, nearest, -1)
        odds = logit(tracks.existence_probability)
        for row, track in enumerate(tracks.track_id.tolist()):
            seen.setdefault(track, []).append((k, odds[row], target[row]))
    return [tuple(np.array(c) for c in zip(*course, strict=True)) for course in seen.values()]


def declared(
    runs: list[list[tuple[np.ndarray, ...]]], limit: float, targets: int
) -> tuple[np.ndarray, float]:
    """First scan (runs, targets) on which each target is declared, inf for never; false tracks."""
    first, false = np.full((len(runs), targets), np.inf), 0
    for run, tracks in enumerate(runs):
        for scans, odds, target in tracks:
            above = np.flatnonzero(odds >= limit)
            if not len(above):
                continue
            at = above[0]
            if target[at] < 0:
                false += 1
            else:
                first[run, target[at]] = min(first[run, target[at]], scans[at])
    return first, false / len(runs)


def limit_for(runs: list[list[tuple[np.ndarray, ...]]], targets: int, rate: float) -> float:
    """Least limit with at most so many false tracks per run."""
    low, high = -10.0, 40.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        if declared(runs, middle, targets)[1] > rate:
            low = middle
        else:
            high = middle
    return high


def gains(scenario: Scenario, decision: str, runs: int, seed: int) -> dict[str, Any]:
    """Detection of each target within so many scans, at equal numbers of false tracks."""
    lambda_ = threshold(scenario.sensor.false_alarm_probability)
    count, found = len(scenario.targets), {}
    made = recordings(scenario, runs, seed)
    for knowledge in KNOWLEDGE:
        told = parameters_of(scenario, decision, knowledge)
        found[knowledge] = [courses(r, told, knowledge, lambda_) for r in made]
    entry: dict[str, Any] = {"runs": runs}
    for rate in FALSE_TRACKS:
        hits, at = {}, entry.setdefault(f"{rate:g}", {})
        for knowledge in KNOWLEDGE:
            limit = limit_for(found[knowledge], count, rate)
            first, false = declared(found[knowledge], limit, count)
            hits[knowledge] = (first < WITHIN).astype(float)
            at[knowledge] = {
                "false_tracks": round(false, 4),
                "detected": [round(float(v), 4) for v in hits[knowledge].mean(axis=0)],
                "share": [
                    round(float(np.mean(first <= k)), 4) for k in range(len(made[0].detections))
                ],
                "weak_share": [
                    round(float(np.mean(first[:, 0] <= k)), 4)
                    for k in range(len(made[0].detections))
                ],
            }
        for knowledge in KNOWLEDGE[:-1]:
            better = hits[STRENGTH] - hits[knowledge]
            at[knowledge]["gain_of_strength"] = [
                [round(v, 4) for v in mean_and_stderr(better[:, row])] for row in range(count)
            ]
    return entry


def consistency(scenario: Scenario, runs: int, seed: int) -> dict[str, Any]:
    """Errors over what the ring says of them: one target each, its strength drawn from the prior.

    Tracks start from labelled detections and never end, so that no target is lost to the sample.
    """
    errors: dict[str, list[list[float]]] = {"strength": [], "position": [], "position without": []}
    rng = np.random.default_rng([seed, 7])
    thetas = invgamma.rvs(
        PRIOR_SHAPE, scale=PRIOR_SHAPE * (1.0 + PRIOR_MEAN), size=runs, random_state=rng
    )
    for run, theta in enumerate(thetas.tolist()):
        target = replace(scenario.targets[1], rcs_mean_m2=max(theta - 1.0, 1e-6))
        one = replace(scenario, targets=(target,))
        recording = simulate(one, seed, run)
        assert recording.truth is not None
        for name, kind in (("position", "swerling_1"), ("position without", "none")):
            told = with_method(tracker_preset(one), "jpda/none/cv")
            told["track_manager"].update(
                extraction="m_of_n",
                signal_strength=kind,
                initial_signal_strength=PRIOR_MEAN,
                initial_signal_strength_shape=PRIOR_SHAPE,
                signal_strength_memory_s=1e9,
            )
            ring = Ring(told)
            start = scenario.time.n_initiation_scans
            assert ring.initialise(labelled_tracks(recording, start, ring)).outcome == "initialised"
            squares, strengths = [], []
            for k in range(start, len(recording.detections)):
                tracks = ring.process(recording.detections[k]).tracks
                assert tracks is not None
                gap = tracks.mean[0] - recording.truth[k].target_state[0]
                squares.append(float(gap @ np.linalg.solve(tracks.covariance[0], gap)))
                if kind != "none":
                    a, b = ring.manager.state.table.strength[
                        np.flatnonzero(ring.manager.state.table.track_id == 1)[0]
                    ]
                    strengths.append(float(invgamma.cdf(theta, a, scale=b)))
            errors[name].append([squares[k - 1] for k in CHECKED])
            if strengths:
                errors["strength"].append([strengths[k - 1] for k in CHECKED])
    entry: dict[str, Any] = {"runs": runs, "scans": list(CHECKED)}
    for name in ("position", "position without"):
        values = np.array(errors[name])
        entry[name] = [[round(v, 3) for v in mean_and_stderr(values[:, k])] for k in range(4)]
    quantile = np.array(errors["strength"])
    entry["strength inside 90 %"] = [
        round(float(np.mean((quantile[:, k] > 0.05) & (quantile[:, k] < 0.95))), 3)
        for k in range(4)
    ]
    entry["strength below median"] = [
        round(float(np.mean(quantile[:, k] < 0.5)), 3) for k in range(4)
    ]
    return entry


def measure(runs: int, seed: int) -> dict[str, Any]:
    """All numbers of the page."""
    scenario = load_scenario("weak_targets")
    decisions = {MAIN: gains(scenario, MAIN, runs, seed)}
    for decision in OTHERS:
        decisions[decision] = gains(scenario, decision, max(runs // 4, 2), seed)
    return {
        "seed": seed,
        "targets": [target.rcs_mean_m2 for target in scenario.targets],
        "decisions": decisions,
        "consistency": consistency(scenario, 2 * runs, seed),
    }


def gain_table(numbers: dict[str, Any]) -> str:
    """Detected targets by decision and knowledge."""
    rows = []
    for decision, entry in numbers["decisions"].items():
        for rate in FALSE_TRACKS:
            for knowledge in KNOWLEDGE:
                one = entry[f"{rate:g}"][knowledge]
                gain = one.get("gain_of_strength")
                weak = f"{gain[0][0]:+.2f} +- {gain[0][1]:.2f}" if gain else ""
                shares = (f"{value:.2f}" for value in one["detected"])
                rows.append((decision, str(entry["runs"]), f"{rate:g}", knowledge, *shares, weak))
    names = (f"x = {strength:g}" for strength in numbers["targets"])
    head = ("decision", "runs", "false tracks a run", "knowledge", *names, "gain, weakest target")
    return markdown(head, rows)


def consistency_table(numbers: dict[str, Any]) -> str:
    """Errors over what the ring says of them."""
    entry = numbers["consistency"]
    rows = [
        ("NEES of the kinematics (4)", *(f"{m:.2f} +- {e:.2f}" for m, e in entry["position"])),
        (
            "the same without signal strength",
            *(f"{m:.2f} +- {e:.2f}" for m, e in entry["position without"]),
        ),
        (
            "strength inside its 90 % interval",
            *(f"{value:.2f}" for value in entry["strength inside 90 %"]),
        ),
        (
            "strength below its median (0.5)",
            *(f"{value:.2f}" for value in entry["strength below median"]),
        ),
    ]
    return (
        f"{entry['runs']} targets, strengths drawn from the prior, jpda, labelled start:\n\n"
        + markdown(("after scan", *(str(k) for k in entry["scans"])), rows)
    )


def draw(numbers: dict[str, Any]) -> Any:
    """Declared targets over time at equal numbers of false tracks."""
    entry = numbers["decisions"][MAIN]
    with canvas(12.0, 4.2) as figure:
        panels = figure.subplots(1, 2, sharey=True)
        for axes, name, title in (
            (panels[0], "weak_share", f"weakest target, x = {numbers['targets'][0]:g}"),
            (panels[1], "share", "all three targets"),
        ):
            for knowledge, colour in zip(KNOWLEDGE, COLOURS, strict=False):
                axes.plot(entry["0.1"][knowledge][name], color=colour, label=knowledge)
            axes.set(xlabel="scan", ylim=(0.0, 1.0), title=title)
        panels[0].set_ylabel("share declared, 0.1 false tracks a run")
        panels[1].legend(loc="lower right")
    return figure


def main() -> int:
    """Measure, and write tables and picture."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    numbers = measure(args.runs, args.seed)
    text = json.dumps(numbers, indent=1) + "\n"
    print(gain_table(numbers))
    print(consistency_table(numbers))
    (ROOT / "docs" / "strength_in_the_ring.json").write_text(text, encoding="utf-8")
    page = ROOT / "docs" / "signal-strength.md"
    write_section(page, "ring gain", gain_table(numbers))
    write_section(page, "ring consistency", consistency_table(numbers))
    (ROOT / "docs" / "images" / "strength_in_the_ring.png").write_bytes(png(draw(numbers)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
