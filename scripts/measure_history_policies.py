#!/usr/bin/env python3
"""Measure what the history policies do to purity: a table and a picture of docs/attribute-terms.md.

    python scripts/measure_history_policies.py [--runs 200] [--seed 1]

The same simulated runs are tracked under every policy by three methods on both scenarios. The
picture shows what becomes of a history of ``dsm_classic`` on the first scenario.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from gda_tracker.evaluation.figures.canvas import canvas, colour, legend_below, png  # noqa: E402
from gda_tracker.evaluation.purity import confusion_counts, purity  # noqa: E402
from gda_tracker.evaluation.statistics import mean_and_stderr  # noqa: E402
from gda_tracker.evidence.frames import total_ignorance, union_of_atoms  # noqa: E402
from gda_tracker.simulation.playback import with_method  # noqa: E402
from gda_tracker.simulation.preset import tracker_preset  # noqa: E402
from gda_tracker.simulation.scenarios import Scenario, load_scenario  # noqa: E402
from gda_tracker.simulation.simulate import simulate  # noqa: E402
from gda_tracker.tracking.labelled import labelled_tracks  # noqa: E402
from gda_tracker.tracking.manager import TrackManager  # noqa: E402
from gda_tracker.tracking.ring import Prepared, Ring  # noqa: E402
from gda_tracker.vocabulary.recordings import Recording  # noqa: E402
from scripts.doc_tables import markdown, signed, with_error, write_section  # noqa: E402

SCENARIOS = ("crossing_targets", "closely_spaced_targets")
METHODS = ("gda/dsm_classic/cv", "map/dsm_classic/cv", "map/bayes/cv")
# Parameters of the track manager by the name in the table; the first is what all differ from.
POLICIES: dict[str, dict[str, Any]] = {
    "none": {"history_policy": "none"},
    **{
        f"forgetting {factor:g}": {"history_policy": "forgetting", "forgetting_factor": factor}
        for factor in (0.9, 0.7, 0.5)
    },
    **{
        f"window {size}": {"history_policy": "window", "history_window": size}
        for size in (12, 6, 3, 1)
    },
}
DRAWN = ("none", "forgetting 0.9", "forgetting 0.7", "window 12", "window 6", "window 3")
DPI = 110


@dataclass
class Outcome:
    """One method under one policy on one scenario.

    ``purity`` (R,) of each run; ``intersection`` and ``distance`` (R, K) per scored scan: the mean
    mass of the tracks' histories on the intersection of all elements, and the mean distance of the
    pairs that were chosen; NaN where there is none.
    """

    purity: np.ndarray
    intersection: np.ndarray
    distance: np.ndarray


Outcomes = dict[tuple[str, str], dict[str, Outcome]]


def measure(scenario: Scenario, method: str, runs: int, seed: int) -> dict[str, Outcome]:
    """Track the same runs under every policy."""
    preset = with_method(tracker_preset(scenario), method)
    rings = {
        name: Ring({**preset, "track_manager": {**preset["track_manager"], **policy}})
        for name, policy in POLICIES.items()
    }
    skip = scenario.time.n_initiation_scans
    found: dict[str, list[tuple[float, list[float], list[float]]]] = {name: [] for name in rings}
    for run in range(runs):
        recording = simulate(scenario, seed, run)
        # The same under every policy.
        prepared = [rings["none"].prepare(detections) for detections in recording.detections]
        for name, ring in rings.items():
            # All but the track manager keep nothing from run to run.
            ring.manager = TrackManager(ring.manager.parameters)
            ring.initialise(labelled_tracks(recording, skip, ring, prepared))
            found[name].append(track(ring, recording, skip, prepared))
    return {
        name: Outcome(*(np.array(values) for values in zip(*results, strict=True)))
        for name, results in found.items()
    }


def track(
    ring: Ring, recording: Recording, skip: int, prepared: Sequence[Prepared]
) -> tuple[float, list[float], list[float]]:
    """Purity of one run, and per scan the mass on the total intersection and the mean distance.

    The first ``skip`` scans are those of the initial tracks.
    """
    tracks, intersection, distance = [], [], []
    for detections, known in zip(recording.detections[skip:], prepared[skip:], strict=True):
        result = ring.process(detections, known)
        assert result.tracks is not None
        assert result.scores is not None
        assert result.associations is not None
        tracks.append(result.tracks)
        total = total_intersection(len(result.tracks.frame))
        shares = result.tracks.masses[:, result.tracks.focal == total].sum(axis=1)
        intersection.append(float(shares.mean()))
        chosen = result.scores.distance[result.associations.chosen]
        distance.append(float(chosen.mean()) if len(chosen) else np.nan)
    assert recording.truth is not None
    truth = recording.truth[skip:]
    targets = np.sort(truth[0].target_id)
    ids = np.arange(1, len(targets) + 1)
    counts = confusion_counts(tracks, truth, ids, targets)
    return float(purity(counts).mean()), intersection, distance


def total_intersection(size: int) -> int:
    """Mask of the intersection of all elements: the Venn part inside each of them."""
    mask = 1 << ((1 << size) - 2)
    assert union_of_atoms(size, mask) == total_ignorance(size)
    return mask


def policies_table(outcomes: Outcomes) -> str:
    """Markdown: purity by policy and its paired difference to ``none``."""
    head = ["method", "policy"]
    for scenario in SCENARIOS:
        head += [scenario, "difference to none"]
    rows = []
    for method in METHODS:
        for name in POLICIES:
            cells = [f"`{method}`", name]
            for scenario in SCENARIOS:
                found = outcomes[scenario, method]
                difference = found[name].purity - found["none"].purity
                cells.append(with_error(*mean_and_stderr(found[name].purity)))
                cells.append("-" if name == "none" else signed(*mean_and_stderr(difference)))
            rows.append(cells)
    return markdown(head, rows)


def drift_table(outcomes: Outcomes) -> str:
    """Markdown: where the histories of ``gda/dsm_classic/cv`` stand on some scans."""
    drift = outcomes[SCENARIOS[0], METHODS[0]]
    scans = [0, 4, 9, drift["none"].intersection.shape[1] - 1]
    head = ["policy"]
    head += [f"mass, scan {scan + 1}" for scan in scans]
    head += [f"distance, scan {scan + 1}" for scan in scans]
    rows = []
    for name, outcome in drift.items():
        values = [outcome.intersection.mean(axis=0), np.nanmean(outcome.distance, axis=0)]
        rows.append([name, *[f"{value[scan]:.3f}" for value in values for scan in scans]])
    return markdown(head, rows)


def picture(outcomes: Outcomes) -> Any:
    """Draw the drift of ``gda/dsm_classic/cv`` on the first scenario and all purities."""
    drift = outcomes[SCENARIOS[0], METHODS[0]]
    with canvas(11.5, 4.0) as figure:
        mass, distance, score = figure.subplots(1, 3, width_ratios=[1.0, 1.0, 1.25])
        for index, name in enumerate(DRAWN):
            outcome = drift[name]
            scans = 1 + np.arange(outcome.intersection.shape[1])
            style = {
                "color": colour(index),
                "linestyle": "--" if name.startswith("window") else "-",
                "label": name,
            }
            mass.plot(scans, outcome.intersection.mean(axis=0), **style)
            distance.plot(scans, np.nanmean(outcome.distance, axis=0), **style)
        mass.set_title("Mass on the total intersection")
        distance.set_title("Distance of the chosen pairs")
        for axes in (mass, distance):
            axes.set_xlabel("scored scan")
            axes.set_ylim(bottom=0.0)
        draw_purities(score, outcomes)
        legend_below(figure, mass, len(DRAWN))
    return figure


def draw_purities(axes: Any, outcomes: Outcomes) -> None:
    """Draw the purity of every method under every policy, side by side."""
    for index, method in enumerate(METHODS):
        for scenario in SCENARIOS:
            second = scenario != SCENARIOS[0]
            points = [mean_and_stderr(o.purity) for o in outcomes[scenario, method].values()]
            mean, error = np.array(points).T
            axes.errorbar(
                np.arange(len(POLICIES)) + 0.12 * (index - 1),
                mean,
                error,
                fmt="s" if second else "o",
                mfc="white" if second else None,
                color=colour(index),
                capsize=2,
                ms=4.5,
                label=None if second else method.removesuffix("/cv"),
            )
    axes.set_title("Purity (open squares: closely spaced)")
    axes.set_xticks(np.arange(len(POLICIES)), POLICIES, rotation=45, ha="right")
    axes.set_ylim(0.4, 1.0)
    axes.legend(loc="lower left", fontsize=8, ncols=1)


def main(arguments: list[str] | None = None) -> int:
    """Measure and write; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--document", type=Path, default=ROOT / "docs/attribute-terms.md")
    parser.add_argument("--picture", type=Path, default=ROOT / "docs/images/history_policies.png")
    args = parser.parse_args(arguments)
    outcomes: Outcomes = {}
    for method in METHODS:
        for name in SCENARIOS:
            outcomes[name, method] = measure(load_scenario(name), method, args.runs, args.seed)
            print(f"measured: {method} on {name}", file=sys.stderr, flush=True)
    write_section(args.document, "history policies", policies_table(outcomes))
    write_section(args.document, "history drift", drift_table(outcomes))
    args.picture.parent.mkdir(parents=True, exist_ok=True)
    args.picture.write_bytes(png(picture(outcomes), DPI))
    size = args.picture.stat().st_size
    print(f"written: tables of {args.document}, {args.picture} ({size / 1000:.0f} kB)")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
