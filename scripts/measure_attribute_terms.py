#!/usr/bin/env python3
"""Measure what the attribute terms do to purity: the tables of docs/attribute-terms.md.

    gda-tracker evaluate crossing_targets closely_spaced_targets --method ... --json terms.json
    python scripts/measure_attribute_terms.py table terms.json
    python scripts/measure_attribute_terms.py paired [--runs 200] [--seed 1]
    python scripts/measure_attribute_terms.py swaps [--runs 20000] [--seed 1]

Each command writes its own table into the document. ``table`` takes the results of an evaluation,
``paired`` compares the terms with the best of their decision on the same simulated runs, ``swaps``
asks the terms alone, without kinematics, which of two detections belongs to a fighter and which to
a cargo. The history policies have a script of their own, ``measure_history_policies.py``.
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
from gda_tracker.evaluation.monte_carlo import monte_carlo  # noqa: E402
from gda_tracker.parameters import from_mapping  # noqa: E402
from gda_tracker.simulation.preset import tracker_preset  # noqa: E402
from gda_tracker.simulation.scenarios import load_scenario  # noqa: E402
from gda_tracker.vocabulary.scans import Scan, ScanKey  # noqa: E402
from scripts.doc_tables import markdown, signed, with_error, write_section  # noqa: E402

SCENARIOS = ("crossing_targets", "closely_spaced_targets")
# The best of each decision, and what is compared with it.
PAIRED = {
    "gda/dsm_classic/cv": ("gda/dsm_hybrid/cv", "gda/yager/cv", "gda/pcr5/cv"),
    "map/bayes/cv": ("map/dempster/cv", "map/pcr5/cv", "map/dsm_hybrid/cv", "map/dsm_classic/cv"),
}
SECTIONS = {"table": "terms", "paired": "paired differences", "swaps": "swaps"}
SWAP_SCANS, SWAP_SHOWN = 24, (5, 25)


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


def paired_table(runs: int, seed: int) -> str:
    """Markdown: purity of some methods minus that of the best of their decision, run by run."""
    rows = []
    for best, others in PAIRED.items():
        results = monte_carlo(
            [load_scenario(name) for name in SCENARIOS], [best, *others], runs, seed, workers=1
        )
        for index, method in enumerate(others, 1):
            found = [result.methods[index] for result in results]
            cells = [signed(f.difference_mean, f.difference_stderr) for f in found]
            rows.append([f"`{method}`", f"`{best}`", *cells])
    return markdown(["method", "compared with", *SCENARIOS], rows)


def main(arguments: list[str] | None = None) -> int:
    """Measure or write; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    table = commands.add_parser("table", help="results of an evaluation as Markdown")
    table.add_argument("json", type=Path, help="file written by gda-tracker evaluate --json")
    paired = commands.add_parser("paired", help="differences to the best of each decision")
    paired.add_argument("--runs", type=int, default=200)
    paired.add_argument("--seed", type=int, default=1)
    swaps = commands.add_parser("swaps", help="what the terms tell apart without kinematics")
    swaps.add_argument("--runs", type=int, default=20_000)
    swaps.add_argument("--seed", type=int, default=1)
    for command in (table, paired, swaps):
        command.add_argument("--document", type=Path, default=ROOT / "docs/attribute-terms.md")
    args = parser.parse_args(arguments)
    if args.command == "table":
        content = json.loads(args.json.read_text())
        written = terms_table(content if isinstance(content, list) else [content])
    else:
        make = {"paired": paired_table, "swaps": swaps_table}[args.command]
        written = make(args.runs, args.seed)
    write_section(args.document, SECTIONS[args.command], written)
    print(f"written: table of {args.document}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
