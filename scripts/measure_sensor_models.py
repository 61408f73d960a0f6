#!/usr/bin/env python3
"""Measure sensor models: tables and pictures of docs/sensor-models.md.

    python scripts/measure_sensor_models.py [--runs 100] [--model-runs 20] [--seed 0]

It writes docs/sensor-models.json, and the tables and pictures from it. With ``--tables`` it
measures nothing and takes the figures that are there.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from gda_tracker.evaluation.figures.canvas import png  # noqa: E402
from gda_tracker.kinematics.measurement_fusion import (  # noqa: E402
    cumulative_detection_probability,
    mean_update_interval,
)
from gda_tracker.simulation.scenarios import load_scenario  # noqa: E402
from scripts import sensor_models_pictures as pictures  # noqa: E402
from scripts.doc_tables import markdown, write_section  # noqa: E402
from scripts.sensor_models_case import (  # noqa: E402
    Bounded,
    against_the_bound,
    both_found,
    range_rate_errors,
    with_model,
)

MODELS = (
    "bearing",
    "range",
    "range_doppler",
    "doppler",
    "doppler_rotated",
    "bistatic",
    "bistatic_doppler",
    "tdoa",
    "fdoa",
    "tdoa_fdoa",
)
METHOD = "mht/none/cv"
# Scans of moving_emitter by which the sum has become one place.
CONVERGED = slice(25, None)
GHOST_METHODS = ("map/none/cv", "jpda/none/cv", "mht/none/cv")
FOUND_WITHIN_M = 150.0
POSITION_STDS_M = (50.0, 500.0, 1500.0)


def of_bounded(found: Bounded, scans: slice) -> dict[str, Any]:
    """Figures of one comparison with the bound; the curves by scan are rounded."""
    squared, bound = found.squared_m2, found.bound_m2
    return {
        "runs": len(squared),
        "tracked": float(np.isfinite(squared[:, scans]).mean()),
        "error_m": float(np.sqrt(np.nanmean(squared[:, scans]))),
        "bound_m": float(np.sqrt(bound[:, scans].mean())),
        "ratio": found.ratio(scans),
        "nees": float(np.nanmean(found.nees[:, scans])),
        "ms_per_scan": round(found.ms_per_scan, 2),
        "time_s": found.time_s.tolist(),
        "error_by_scan_m": [
            None if np.isnan(column).all() else round(float(np.sqrt(np.nanmean(column))), 2)
            for column in squared.T
        ],
        "bound_by_scan_m": np.sqrt(bound.mean(axis=0)).round(2).tolist(),
        "components_by_scan": found.components.round(1).tolist(),
    }


def measure(runs: int, model_runs: int, seed: int) -> dict[str, Any]:
    """All figures of the page."""
    results: dict[str, Any] = {"seed": seed, "converged_from_scan": CONVERGED.start}
    emitter = against_the_bound(load_scenario("moving_emitter"), METHOD, runs, seed)
    results["moving_emitter"] = of_bounded(emitter, CONVERGED)
    _progress("moving_emitter")
    results["models"] = {}
    for name in MODELS:
        found = against_the_bound(with_model(name), METHOD, model_runs, seed)
        results["models"][name] = of_bounded(found, slice(3 * len(found.time_s) // 4, None))
        results["models"][name]["early_m"] = results["models"][name]["error_by_scan_m"][6]
        _progress(name)
    crossing = load_scenario("crossing_bearings")
    results["ghosts"] = {
        method: both_found(crossing, method, model_runs, seed, FOUND_WITHIN_M).round(3).tolist()
        for method in GHOST_METHODS
    }
    results["ghost_runs"] = model_runs
    _progress("crossing_bearings")
    results["range_rate"] = [
        {
            "position_std_m": deviation,
            **{
                name: {
                    "error_mps": float(np.sqrt(np.mean(found[:, 0] ** 2))),
                    "nees": float(np.mean(found[:, 1])),
                }
                for name, found in range_rate_errors(deviation, 4000, seed).items()
            },
        }
        for deviation in POSITION_STDS_M
    ]
    return results


def _progress(name: str) -> None:
    print(f"measured: {name}", file=sys.stderr, flush=True)


def models_table(results: dict[str, Any]) -> str:
    """Error of each model on two_sensors against its bound."""
    head = [
        "model",
        "unit of the clutter density",
        "error after 14 s [m]",
        "error, last 40 s [m]",
    ]
    head += ["bound [m]", "error / bound", "NEES (4)", "components, start and end", "ms per scan"]
    rows = []
    units = pictures.UNITS
    for name in MODELS:
        found = results["models"][name]
        parts = found["components_by_scan"]
        rows.append(
            [
                f"`{name}`" + (" (beside `tdoa`)" if name == "fdoa" else ""),
                units[name],
                f"{found['early_m']:.0f}",
                f"{found['error_m']:.1f}",
                f"{found['bound_m']:.1f}",
                f"{found['ratio']:.2f}",
                f"{found['nees']:.2f}",
                f"{max(parts[:3]):.0f}, {parts[-1]:.1f}",
                f"{found['ms_per_scan']:.1f}",
            ]
        )
    return markdown(head, rows)


def emitter_table(results: dict[str, Any]) -> str:
    """Error of moving_emitter over time against the bound."""
    found = results["moving_emitter"]
    head = ["after [s]", "error [m RMS]", "Cramer-Rao bound [m]", "components"]
    rows = [
        [
            f"{found['time_s'][k]:.0f}",
            f"{found['error_by_scan_m'][k]:.0f}",
            f"{found['bound_by_scan_m'][k]:.0f}",
            f"{found['components_by_scan'][k]:.0f}",
        ]
        for k in (5, 10, 20, 30, 40, 50, 59)
    ]
    from_s = found["time_s"][results["converged_from_scan"]]
    verdict = (
        f"From {from_s:.0f} s on, over {found['runs']} runs: error {found['error_m']:.1f} m, bound "
        f"{found['bound_m']:.1f} m, **ratio {found['ratio']:.2f}**; NEES {found['nees']:.2f} of 4; "
        f"tracked in {100 * found['tracked']:.1f} % of scans."
    )
    return markdown(head, rows) + "\n\n" + verdict


def ghosts_table(results: dict[str, Any]) -> str:
    """Share of runs in which both boats are found, over time."""
    head = ["decision", "after 30 s", "60 s", "120 s", "180 s", "238 s"]
    rows = [
        [f"`{method}`", *(f"{100 * shares[k]:.0f} %" for k in (15, 30, 60, 90, 119))]
        for method, shares in results["ghosts"].items()
    ]
    return markdown(head, rows)


def range_rate_table(results: dict[str, Any]) -> str:
    """Errors of the two linearisations of the range rate."""
    head = ["predicted position off by [m]", "`doppler` [m/s]", "NEES (4)"]
    head += ["`doppler_rotated` [m/s]", "NEES (4)"]
    rows = [
        [f"{each['position_std_m']:.0f}"]
        + [
            f"{each[name][what]:.{digits}f}"
            for name in ("doppler", "doppler_rotated")
            for what, digits in (("error_mps", 1), ("nees", 2))
        ]
        for each in results["range_rate"]
    ]
    return markdown(head, rows)


def cumulative_table(results: dict[str, Any]) -> str:
    """Koch's (2.29) and (2.30) for the three sensors of mixed_sensors."""
    del results  # computed, not measured
    scenario = load_scenario("mixed_sensors")
    rows = []
    for count in (1, 2, 3):
        sensors = scenario.sensors[:count]
        intervals = [scenario.time.scan_period_s] * count
        probabilities = [sensor.detection_probability for sensor in sensors]
        rows.append(
            [
                ", ".join(f"`{sensor.id}`" for sensor in sensors),
                f"{mean_update_interval(intervals):.2f}",
                f"{cumulative_detection_probability(probabilities, intervals):.3f}",
                f"{cumulative_detection_probability(probabilities):.3f}",
            ]
        )
    head = ["sensors", "T_c [s], (2.29)", "P_D within T_c, (2.30)", "P_D if each looks once"]
    return markdown(head, rows)


TABLES = {
    "sensor models": models_table,
    "moving emitter": emitter_table,
    "ghosts": ghosts_table,
    "range rate": range_rate_table,
    "cumulative detection": cumulative_table,
}


def main(arguments: list[str] | None = None) -> int:
    """Measure and write; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=100, help="of moving_emitter")
    parser.add_argument("--model-runs", type=int, default=20, help="of everything else")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tables", action="store_true", help="measure nothing")
    parser.add_argument("--document", type=Path, default=ROOT / "docs/sensor-models.md")
    parser.add_argument("--images", type=Path, default=ROOT / "docs/images")
    parser.add_argument("--figures", type=Path, default=ROOT / "docs/sensor-models.json")
    args = parser.parse_args(arguments)
    if args.tables:
        results = json.loads(args.figures.read_text(encoding="utf-8"))
    else:
        results = measure(args.runs, args.model_runs, args.seed)
        args.figures.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    for name, figure in pictures.all_pictures(results, args.seed).items():
        (args.images / name).write_bytes(png(figure, 100))
    for name, table in TABLES.items():
        write_section(args.document, name, table(results))
    print(f"written: tables of {args.document}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
