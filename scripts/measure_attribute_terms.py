#!/usr/bin/env python3
"""Measure what the attribute terms do to purity: the tables and the picture of docs.

    gda-tracker evaluate crossing_targets closely_spaced_targets --method ... --json terms.json
    python scripts/measure_attribute_terms.py table terms.json
    python scripts/measure_attribute_terms.py forgetting [--runs 200] [--seed 1]
    python scripts/measure_attribute_terms.py swaps [--runs 20000] [--seed 1]

``table`` writes the results of an evaluation as Markdown. ``forgetting`` tracks the same simulated
runs with several forgetting factors, writes a table, and draws what becomes of a history of
``dsm_classic``. ``swaps`` asks the terms alone, without kinematics, which of two detections belongs
to a fighter and which to a cargo.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from gda_tracker.attributes.fusion import fuse_pairs  # noqa: E402
from gda_tracker.attributes.fuzzification import RcsFuzzifier, RcsFuzzifierParameters  # noqa: E402
from gda_tracker.attributes.rcs import sample  # noqa: E402
from gda_tracker.attributes.terms import ATTRIBUTE_TERMS, DISTANCE_TERMS  # noqa: E402
from gda_tracker.evaluation.figures.canvas import canvas, colour, legend_below, png  # noqa: E402
from gda_tracker.evaluation.purity import confusion_counts, purity  # noqa: E402
from gda_tracker.evaluation.statistics import mean_and_stderr  # noqa: E402
from gda_tracker.evidence.frames import union_of_atoms  # noqa: E402
from gda_tracker.parameters import from_mapping  # noqa: E402
from gda_tracker.simulation.playback import Playback, with_method  # noqa: E402
from gda_tracker.simulation.preset import tracker_preset  # noqa: E402
from gda_tracker.simulation.scenarios import Scenario, load_scenario  # noqa: E402
from gda_tracker.simulation.simulate import simulate  # noqa: E402
from gda_tracker.tracking.labelled import labelled_tracks  # noqa: E402
from gda_tracker.tracking.manager import TrackManager  # noqa: E402
from gda_tracker.tracking.ring import Ring  # noqa: E402
from gda_tracker.vocabulary.scans import Scan, ScanKey  # noqa: E402

SCENARIOS = ("crossing_targets", "closely_spaced_targets")
METHODS = ("gda/dsm_classic/cv", "map/dsm_classic/cv", "map/bayes/cv")
FACTORS = (1.0, 0.9, 0.7, 0.5)
SWAP_SCANS, SWAP_SHOWN = 24, (5, 25)
DPI = 110


# --- forgetting ---------------------------------------------------------------------------------


@dataclass
class Outcome:
    """One method with one factor on one scenario.

    ``purity`` (R,) of each run; ``intersection`` and ``distance`` (R, K) per scored scan: the mean
    mass of the tracks' histories on the intersection of all elements, and the mean distance of the
    pairs that were chosen; NaN where there is none.
    """

    purity: np.ndarray
    intersection: np.ndarray
    distance: np.ndarray


def measure(scenario: Scenario, method: str, runs: int, seed: int) -> list[Outcome]:
    """Track the same runs with every factor."""
    preset = with_method(tracker_preset(scenario), method)
    rings = [Ring({**preset, "attribute_fusion": {"forgetting_factor": f}}) for f in FACTORS]
    skip = scenario.time.n_initiation_scans
    found: list[list[tuple[float, list[float], list[float]]]] = [[] for _ in FACTORS]
    for run in range(runs):
        recording = simulate(scenario, seed, run)
        assert recording.truth is not None
        for ring, results in zip(rings, found, strict=True):
            # All but the track manager keep nothing from run to run.
            ring.manager = TrackManager(ring.manager.parameters)
            play = Playback(
                recording.name,
                recording.detections[skip:],
                recording.truth[skip:],
                labelled_tracks(recording, skip, ring),
            )
            results.append(track(ring, play))
    return [
        Outcome(*(np.array(values) for values in zip(*results, strict=True))) for results in found
    ]


def track(ring: Ring, play: Playback) -> tuple[float, list[float], list[float]]:
    """Purity of one run, and per scan the mass on the total intersection and the mean distance."""
    assert play.initial is not None
    assert play.truth is not None
    ring.initialise(play.initial)
    tracks, intersection, distance = [], [], []
    for detections in play.detections:
        result = ring.process(detections)
        assert result.tracks is not None
        assert result.scores is not None
        assert result.associations is not None
        tracks.append(result.tracks)
        total = total_intersection(len(result.tracks.frame))
        shares = result.tracks.masses[:, result.tracks.focal == total].sum(axis=1)
        intersection.append(float(shares.mean()))
        chosen = result.scores.distance[result.associations.chosen]
        distance.append(float(chosen.mean()) if len(chosen) else np.nan)
    targets = np.sort(play.truth[0].target_id)
    ids = np.arange(1, len(targets) + 1)
    counts = confusion_counts(tracks, play.truth, ids, targets)
    return float(purity(counts).mean()), intersection, distance


def total_intersection(size: int) -> int:
    """Mask of the intersection of all elements: the Venn part inside each of them."""
    mask = 1 << ((1 << size) - 2)
    assert union_of_atoms(size, mask) == (1 << ((1 << size) - 1)) - 1
    return mask


def forgetting_table(outcomes: dict[tuple[str, str], list[Outcome]]) -> str:
    """Markdown: purity by factor and its paired difference to a factor of 1."""
    head = ["method", "factor"]
    for scenario in SCENARIOS:
        head += [scenario, "difference to 1"]
    rows = []
    for method in METHODS:
        for index, factor in enumerate(FACTORS):
            cells = [f"`{method}`", f"{factor:g}"]
            for scenario in SCENARIOS:
                values = [o.purity for o in outcomes[scenario, method]]
                cells.append(with_error(*mean_and_stderr(values[index])))
                cells.append(signed(*mean_and_stderr(values[index] - values[0])) if index else "-")
            rows.append(cells)
    return markdown(head, rows)


def picture(outcomes: dict[tuple[str, str], list[Outcome]]) -> Any:
    """Draw the drift of ``gda/dsm_classic/cv`` on the first scenario and all purities."""
    drift = outcomes[SCENARIOS[0], "gda/dsm_classic/cv"]
    with canvas(10.5, 3.7) as figure:
        mass, distance, score = figure.subplots(1, 3)
        for index, (factor, outcome) in enumerate(zip(FACTORS, drift, strict=True)):
            scans = 1 + np.arange(outcome.intersection.shape[1])
            style = {"color": colour(index), "label": f"forgetting_factor {factor:g}"}
            mass.plot(scans, outcome.intersection.mean(axis=0), **style)
            distance.plot(scans, np.nanmean(outcome.distance, axis=0), **style)
        mass.set_title("Mass on the total intersection")
        distance.set_title("Distance of the chosen pairs")
        for axes in (mass, distance):
            axes.set_xlabel("scored scan")
            axes.set_ylim(bottom=0.0)
        markers = {SCENARIOS[0]: "o-", SCENARIOS[1]: "s--"}
        for index, method in enumerate(METHODS):
            for scenario in SCENARIOS:
                points = [mean_and_stderr(o.purity) for o in outcomes[scenario, method]]
                mean, error = np.array(points).T
                score.errorbar(
                    FACTORS,
                    mean,
                    error,
                    fmt=markers[scenario],
                    color=colour(3 + index),
                    capsize=3,
                    ms=5,
                    label=method.removesuffix("/cv") if scenario == SCENARIOS[0] else None,
                )
        score.set_title("Purity (dashed: closely spaced)")
        score.set_xlabel("forgetting_factor")
        score.set_ylim(0.4, 1.0)
        score.invert_xaxis()
        score.legend(loc="lower left", fontsize=8)
        legend_below(figure, mass, len(FACTORS))
    return figure


# --- swaps --------------------------------------------------------------------------------------


@dataclass
class Swaps:
    """How a term tells a fighter and a cargo apart, (K,) per scan.

    Two tracks have taken their own detections so far; now there are one of each. The distance is
    right if that product of distances is smaller in which each takes its own, the likelihood if
    that product is larger; equal products are right in half of the runs. The log ratios are the
    medians of the size of the log of one product over the other.
    """

    distance: np.ndarray
    likelihood: np.ndarray
    distance_log_ratio: np.ndarray
    likelihood_log_ratio: np.ndarray


def measure_swaps(term: str, runs: int, seed: int) -> Swaps:
    """Track fighters and cargos without error for ``SWAP_SCANS`` scans, as many of each as runs."""
    tracker = tracker_preset(load_scenario(SCENARIOS[0]))
    table = from_mapping(RcsFuzzifierParameters, tracker["rcs_fuzzifier"])
    fuzzify = RcsFuzzifier(table)
    classes = [table.class_names.index(name) for name in ("fighter", "cargo")]
    mean = np.array(table.class_rcs_mean_m2)[classes, None]
    swerling = np.array(table.class_rcs_swerling)[classes, None]
    random = np.random.default_rng(seed)
    # Rows: the fighters of all runs, then their cargos.
    own = np.arange(2 * runs, dtype=np.int32)
    other = np.roll(own, runs)
    evidence = fuzzify(scan_of(sample(random, mean, swerling, (2, runs)).ravel()))
    focal, masses, classes_now = evidence.focal, evidence.masses, evidence.class_probability
    found = []
    for _ in range(SWAP_SCANS):
        evidence = fuzzify(scan_of(sample(random, mean, swerling, (2, runs)).ravel()))
        history = (term, evidence.frame, focal, masses, classes_now, evidence)
        kept, swapped = fuse_pairs(*history, own), fuse_pairs(*history, other)
        with np.errstate(divide="ignore"):
            distance = compare(np.log(kept.distance), np.log(swapped.distance))
        likelihood = compare(-kept.log_likelihood, -swapped.log_likelihood)
        found.append((distance[0], likelihood[0], distance[1], likelihood[1]))
        classes_now = kept.class_probability
        if kept.masses.shape[1]:
            focal, masses = kept.focal, kept.masses
    return Swaps(*np.array(found).T)


def compare(kept: np.ndarray, swapped: np.ndarray) -> tuple[float, float]:
    """Share of runs in which the sum over both tracks is smaller if they keep their own.

    Also the median size of the difference of the sums; -inf - (-inf) is no difference.
    """
    one, two = (values.reshape(2, -1).sum(axis=0) for values in (kept, swapped))
    equal = one == two
    difference = np.abs(np.subtract(one, two, out=np.zeros_like(one), where=~equal))
    return float(np.mean((one < two) + 0.5 * equal)), float(np.median(difference))


def scan_of(rcs_m2: np.ndarray) -> Scan:
    """Detections of which only the RCS matters."""
    n = len(rcs_m2)
    return Scan(
        key=ScanKey(0, "radar", 0),
        frame_id="map",
        sensor_position_m=np.zeros(3),
        sensor_orientation_xyzw=np.array([0.0, 0.0, 0.0, 1.0]),
        source_index=np.arange(n, dtype=np.int32),
        range_m=np.ones(n),
        azimuth_rad=np.zeros(n),
        noise_covariance=np.tile(np.eye(2), (n, 1, 1)),
        rcs_m2=rcs_m2,
        rcs_valid=np.ones(n, dtype=np.bool_),
    )


def swaps_table(runs: int, seed: int) -> str:
    """Markdown: shares of right swaps, and log ratios, on an early and a late scan."""
    names = ("distance", "likelihood", "distance_log_ratio", "likelihood_log_ratio")
    head = ["term"]
    head += [f"{name.replace('_', ' ')}, scan {scan}" for name in names for scan in SWAP_SHOWN]
    rows = []
    for term in ATTRIBUTE_TERMS[1:]:
        swaps = measure_swaps(term, runs, seed)
        cells = [f"`{term}`"]
        for name in names:
            silent = name.startswith("distance") and term not in DISTANCE_TERMS
            values = getattr(swaps, name)[[scan - 2 for scan in SWAP_SHOWN]]
            cells += ["-" if silent else f"{value:.2f}" for value in values]
        rows.append(cells)
    return markdown(head, rows)


# --- tables -------------------------------------------------------------------------------------


def terms_table(results: Sequence[dict[str, Any]]) -> str:
    """Markdown: purity of all methods of an evaluation and paired differences to the first."""
    head = ["method"]
    for result in results:
        head += [result["scenario"], f"difference to {result['difference_to']}"]
    rows = []
    for index, method in enumerate(results[0]["methods"]):
        cells = [f"`{method['method']}`"]
        for result in results:
            entry = result["methods"][index]
            cells.append(with_error(entry["purity_mean"], entry["purity_stderr"]))
            cells.append(
                signed(entry["difference_mean"], entry["difference_stderr"]) if index else "-"
            )
        rows.append(cells)
    return markdown(head, rows)


def with_error(mean: float, stderr: float) -> str:
    """Mean +- standard error."""
    return f"{mean:.3f} +- {stderr:.3f}"


def signed(mean: float, stderr: float) -> str:
    """Difference +- standard error."""
    return f"{mean:+.3f} +- {stderr:.3f}"


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def main(arguments: list[str] | None = None) -> int:
    """Measure or write; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    table = commands.add_parser("table", help="results of an evaluation as Markdown")
    table.add_argument("json", type=Path, help="file written by gda-tracker evaluate --json")
    forgetting = commands.add_parser("forgetting", help="purity by forgetting factor")
    forgetting.add_argument("--runs", type=int, default=200)
    forgetting.add_argument("--seed", type=int, default=1)
    forgetting.add_argument("--output", type=Path, default=ROOT / "docs/images/forgetting.png")
    swaps = commands.add_parser("swaps", help="what the terms tell apart without kinematics")
    swaps.add_argument("--runs", type=int, default=20_000)
    swaps.add_argument("--seed", type=int, default=1)
    args = parser.parse_args(arguments)
    if args.command == "table":
        content = json.loads(args.json.read_text())
        print(terms_table(content if isinstance(content, list) else [content]))
        return 0
    if args.command == "swaps":
        print(swaps_table(args.runs, args.seed))
        return 0
    outcomes = {
        (name, method): measure(load_scenario(name), method, args.runs, args.seed)
        for name in SCENARIOS
        for method in METHODS
    }
    print(forgetting_table(outcomes))
    args.output.parent.mkdir(parents=True, exist_ok=True)
    args.output.write_bytes(png(picture(outcomes), DPI))
    print(f"{args.output}: {args.output.stat().st_size / 1000:.0f} kB", file=sys.stderr)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
