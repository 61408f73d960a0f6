#!/usr/bin/env python3
"""Measure the fusion of the tracks of two radars: tables and picture of docs/track-fusion.md.

    python -m scripts.measure_track_fusion [--runs 30] [--ideal-runs 60] [--seed 0]

Runs through two rings against nearest neighbours with the biases ignored; one of them over real
topics; and radars that are Kalman filters, where what the fusion says of its own errors can be
checked, for every fusion rule.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from gda_tracker.evaluation.consistency import chi_square_bounds
from gda_tracker.evaluation.set_distances import set_distance
from gda_tracker.evaluation.statistics import mean_and_stderr
from gda_tracker.fusion.fuser import TrackFuser
from gda_tracker.fusion.parameters import FUSION_RULES, TrackFusionParameters
from gda_tracker.simulation.kalman_radars import KalmanRadars
from gda_tracker.vocabulary.arrays import FloatArray
from scripts.doc_tables import markdown, write_section
from scripts.track_fusion_case import (
    MATCH_M,
    RADARS,
    RELATIVE_BIAS_M,
    Fused,
    RingCase,
    fused_once,
    fused_targets,
    nearest_neighbours,
    ring_case,
    targets_of,
)
from scripts.track_fusion_figure import picture

ROOT = Path(__file__).resolve().parent.parent
FUSION_NAME = "`track_fusion`"
NEAREST = {
    "nearest neighbour, gate of the covariances": False,
    "nearest neighbour within 3 km": True,
}
SKIPPED_SCANS = 8  # until both radars have confirmed their tracks
CUTOFF_M = 500.0
IDEAL_BIAS_M = ((0.0, 0.0), (-800.0, 600.0))
IDEAL_TARGETS, IDEAL_SCANS = 4, 30
EARLY, LATE = slice(1, 6), slice(15, IDEAL_SCANS)
TWO_SIGMA = 2.0

Figures = dict[str, Any]


def score(case: RingCase, scan: int, fused: Fused) -> dict[str, float]:
    """Score one scan of a method, in the coordinates of the first radar."""
    live = case.tracks[scan]
    once = fused_once(case, fused, live, scan)
    about = fused_targets(fused, targets_of(case, scan, live))
    truth = case.truth(scan)[:, :2] - np.array(RADARS[0].bias_m)
    right = [(row, *one) for row, one in enumerate(about) if len(one) == 1 and -1 not in one]
    square = [float(np.square(fused.mean[row, :2] - truth[k]).sum()) for row, k in right]
    distance = set_distance(fused.mean[:, :2], truth, CUTOFF_M)
    return {
        "once": float(once.mean()) if len(once) else np.nan,
        "wrong": float(np.mean([len(one) > 1 for one in about])),
        "number": len(about) / len(truth),
        "square_m2": float(np.mean(square)) if square else np.nan,
        "gospa_m": distance.gospa_m,
    }


def measure_rings(runs: int, seed: int) -> Figures:
    """Runs through two rings: scores of each method, and the biases."""
    scores: dict[str, list[dict[str, float]]] = {name: [] for name in (FUSION_NAME, *NEAREST)}
    bias_error, bias_sigma, bias_square = [], [], []
    for run in range(runs):
        case = ring_case(seed, run)
        fusions = case.offline()
        kept: dict[str, list[dict[str, float]]] = {name: [] for name in scores}
        for scan in range(SKIPPED_SCANS, len(fusions)):
            kept[FUSION_NAME].append(score(case, scan, fusions[scan][0]))
            for name, wide in NEAREST.items():
                pairs = nearest_neighbours(case.tracks[scan], wide)
                kept[name].append(score(case, scan, pairs))
        for name, rows in kept.items():
            scores[name].append(
                {key: float(np.nanmean([row[key] for row in rows])) for key in rows[0]}
            )
        error, covariance = _bias(fusions[-1][1])
        bias_error.append(error.tolist())
        bias_sigma.append(np.sqrt(np.diag(covariance)).tolist())
        bias_square.append(float(error @ np.linalg.solve(covariance, error)))
        print(f"run {run + 1} of {runs}", file=sys.stderr, flush=True)
    return {
        "runs": runs,
        "scores": scores,
        "bias": {"error_m": bias_error, "sigma_m": bias_sigma, "nees": bias_square},
    }


def _bias(found: Any) -> tuple[FloatArray, FloatArray]:
    """Error of the relative bias, and its covariance."""
    return found.bias[1] - RELATIVE_BIAS_M, found.bias_covariance[1]


def measure_ideal(runs: int, seed: int) -> Figures:
    """Radars that are Kalman filters: errors of states and biases against what is said of them."""
    found: Figures = {"runs": runs, "rules": {}}
    for rule in FUSION_RULES:
        nees, square, bias, naive = [], [], [], []
        for run in range(runs):
            one = _ideal_run(seed * 100_000 + run, rule)
            for values, part in zip((nees, square, bias, naive), one, strict=True):
                values.append(part)
        found["rules"][rule] = {
            "nees": np.mean(nees, axis=0).tolist(),
            "rms_m": np.sqrt(np.mean(square, axis=0)).tolist(),
        }
        # On the first scan nothing is known of the bias.
        found["bias_nees"] = np.mean(bias, axis=0)[1:].tolist()
        found["naive_bias_nees"] = np.mean(naive, axis=0)[1:].tolist()
        print(f"measured: {rule}", file=sys.stderr, flush=True)
    return found


def _ideal_run(seed: int, rule: str) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """NEES and squared error per scan, and NEES of the bias: ours, and with all fusions summed."""
    radars = KalmanRadars(seed, IDEAL_BIAS_M, IDEAL_TARGETS)
    fuser = TrackFuser(
        TrackFusionParameters(
            bias_std_m=[0.0, -1.0],
            fusion_rule=rule,
            # What a fusion says of the bias from its tracks alone, and nothing learnt before.
            track_memory_s=1e6,
        )
    )
    nees, square, bias, naive = np.zeros((4, IDEAL_SCANS))
    information, vector = np.zeros((2, 2)), np.zeros(2)
    for scan in range(IDEAL_SCANS):
        radars.step()
        for radar, name in enumerate(("radar_1", "radar_2")):
            for fused, told in fuser.take(name, radars.message(radar)):
                last = fused, told
        fused, told = last
        target = np.where(fused.member[:, 0], fused.member_track_id[:, 0], -1)
        own = target >= 0
        error = fused.mean[own] - radars.states[target[own]]
        solved = np.linalg.solve(fused.covariance[own], error[..., None])[..., 0]
        nees[scan] = (error * solved).sum(axis=1).mean()
        square[scan] = np.square(error[:, :2]).sum(axis=1).mean()
        if not scan:
            continue
        gap = told.bias[1] - radars.bias_m[1]
        bias[scan] = gap @ np.linalg.solve(told.bias_covariance[1], gap)
        inverse = np.linalg.inv(told.association_bias_covariance[1])
        information += inverse
        vector += inverse @ told.association_bias[1]
        gap = np.linalg.solve(information, vector) - radars.bias_m[1]
        naive[scan] = gap @ information @ gap
    return nees, square, bias, naive


def measure_topics(seed: int) -> Figures:
    """One run over real topics, two rings and the node in one process."""
    from gda_tracker.nodes.runner import private_environment, release_domain, use_environment

    environment = private_environment()
    use_environment(environment)
    domain = int(environment["ROS_DOMAIN_ID"])
    try:
        case = ring_case(seed, 0)
        client, _ = case.over_topics(domain)
    finally:
        release_domain(domain)
    by_stamp = {fused.stamp_ns: fused for fused in client.fused}
    scans = next(iter(case.recordings.values())).detections
    rows = [
        score(case, scan, by_stamp[scans[scan].stamp_ns])
        for scan in range(SKIPPED_SCANS, len(scans))
    ]
    error, covariance = _bias(client.associations[-1])
    return {
        "scores": {key: float(np.nanmean([row[key] for row in rows])) for key in rows[0]},
        "fused_tracks": len(client.fused[-1]),
        "bias_m": client.associations[-1].bias[1].tolist(),
        "error_m": error.tolist(),
        "sigma_m": np.sqrt(np.diag(covariance)).tolist(),
    }


# --- tables -------------------------------------------------------------------------------------


def ring_table(figures: Figures) -> str:
    """Markdown: the methods on the same tracks, and the run over topics."""
    head = ["method", "targets fused once", "fused tracks of different targets",
            "fused tracks per target", "position error [m]", "GOSPA [m]"]  # fmt: skip

    def cells(rows: list[dict[str, float]]) -> list[str]:
        table = {key: np.array([row[key] for row in rows]) for key in rows[0]}
        gospa, stderr = mean_and_stderr(table["gospa_m"])
        error = f" +- {stderr:.0f}" if np.isfinite(stderr) else ""
        return [
            f"{100 * table['once'].mean():.1f} %",
            f"{100 * table['wrong'].mean():.1f} %",
            f"{table['number'].mean():.2f}",
            f"{np.sqrt(np.nanmean(table['square_m2'])):.0f}",
            f"{gospa:.0f}{error}",
        ]

    rows = [[name, *cells(scores)] for name, scores in figures["rings"]["scores"].items()]
    rows.append([f"{FUSION_NAME}, one run over topics", *cells([figures["topics"]["scores"]])])
    return f"{figures['rings']['runs']} runs:\n\n{markdown(head, rows)}"


def bias_table(figures: Figures) -> str:
    """Markdown: the relative bias at the end of the runs."""
    bias, topics = figures["rings"]["bias"], figures["topics"]
    error, sigma = np.array(bias["error_m"]), np.array(bias["sigma_m"])
    low, high = (float(b) for b in chi_square_bounds(2, len(error)))
    inside = (np.abs(error) <= TWO_SIGMA * sigma).mean()
    own = ", ".join(
        f"{e:+.1f} ({abs(e) / s:.1f} sigma)"
        for e, s in zip(topics["error_m"], topics["sigma_m"], strict=True)
    )
    return markdown(
        ["relative bias of radar_2", ""],
        [
            ["true, East and North [m]", ", ".join(f"{b:.0f}" for b in RELATIVE_BIAS_M)],
            ["error per coordinate, root mean square [m]", f"{_rms(error):.1f}"],
            ["standard deviation said, mean [m]", f"{sigma.mean():.1f}"],
            ["coordinates within 2 sigma (95.4 % expected)", f"{100 * inside:.1f} %"],
            [f"NEES (2 expected; 95 %: {low:.2f} to {high:.2f})", f"{np.mean(bias['nees']):.2f}"],
            ["error of the run over topics [m]", own],
        ],
    )  # fmt: skip


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.square(values).mean()))


def ideal_table(figures: Figures) -> str:
    """Markdown: the fusion rules where their assumptions can be checked."""
    ideal = figures["ideal"]
    head = ["fusion rule", "NEES, scans 2-6", "NEES, scans 16-30", "position error [m]"]
    rows = []
    for rule, values in ideal["rules"].items():
        nees, rms = np.array(values["nees"]), np.array(values["rms_m"])
        rows.append(
            [f"`{rule}`", f"{nees[EARLY].mean():.2f}", f"{nees[LATE].mean():.2f}",
             f"{_rms(rms[LATE]):.1f}"]
        )  # fmt: skip
    return f"{ideal['runs']} runs:\n\n{markdown(head, rows)}"


def accumulation_table(figures: Figures) -> str:
    """Markdown: the bias learnt over time, by equivalent measurements and by summed fusions."""
    ideal = figures["ideal"]
    scans = (2, 5, 10, 20, 30)
    rows = [
        [name, *(f"{ideal[key][scan - 2]:.1f}" for scan in scans)]
        for name, key in (
            ("equivalent measurements", "bias_nees"),
            ("every fusion's estimate taken as new", "naive_bias_nees"),
        )
    ]
    return markdown(["NEES of the bias (2 expected) after scan", *map(str, scans)], rows)


TABLES = {
    "fusion methods": ring_table,
    "fusion bias": bias_table,
    "fusion rules": ideal_table,
    "fusion accumulation": accumulation_table,
}


def main(arguments: list[str] | None = None) -> int:
    """Measure and write; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=30, help="runs through two rings")
    parser.add_argument("--ideal-runs", type=int, default=60, help="runs with Kalman filters")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--from", type=Path, dest="figures", help="write from measured figures")
    parser.add_argument("--document", type=Path, default=ROOT / "docs/track-fusion.md")
    parser.add_argument("--json", type=Path, default=ROOT / "docs/track-fusion.json")
    parser.add_argument("--picture", type=Path, default=ROOT / "docs/images/track_fusion.png")
    args = parser.parse_args(arguments)
    if args.figures:
        figures = json.loads(args.figures.read_text(encoding="utf-8"))
    else:
        figures = {
            "match_m": MATCH_M,
            "topics": measure_topics(args.seed),
            "rings": measure_rings(args.runs, args.seed),
            "ideal": measure_ideal(args.ideal_runs, args.seed),
        }
    # Five digits say all: the file is for people who compare.
    figures = json.loads(json.dumps(figures), parse_float=lambda text: float(f"{float(text):.5g}"))
    args.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    for name, table in TABLES.items():
        write_section(args.document, name, table(figures))
    args.picture.write_bytes(picture(ring_case(args.seed, 0)))
    print(f"written: {args.json}, {args.picture} and tables of {args.document}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
