#!/usr/bin/env python3
"""Measure estimated maps of clutter and detection: tables and picture of docs/clutter-maps.md.

    python scripts/measure_clutter_maps.py [--runs 10] [--bias-runs 4] [--seed 0] [--from-json]

It writes docs/clutter-maps.json and the picture, and the tables of the page from them.
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

from gda_tracker.simulation.scenarios import load_scenario  # noqa: E402
from scripts.clutter_maps_case import estimated_map, tracked  # noqa: E402
from scripts.doc_tables import markdown, write_section  # noqa: E402
from scripts.map_bias_case import (  # noqa: E402
    BUSY_SECTORS,
    FIELD,
    MEASURED_METHODS,
    field_estimates,
    measured_estimates,
)
from scripts.sensor_models_case import with_model  # noqa: E402

PAGE = ROOT / "docs" / "clutter-maps.md"
FIGURES = ROOT / "docs" / "clutter-maps.json"
PICTURE = ROOT / "docs" / "images" / "clutter_maps.png"
SCENARIO = "busy_coast"
# Name in the table, source of the density, factor of the density told.
VARIANTS = (
    ("told the mean", "given", 1.0),
    ("told a tenth of the mean", "given", 0.1),
    ("estimated, begins with the mean", "estimated", 1.0),
    ("estimated, begins with a tenth", "estimated", 0.1),
    ("the true densities", "truth", 1.0),
)
FACTORS = (0.1, 1.0, 10.0)
FIELD_SCANS = 250
MEMORIES = (50.0, 200.0)


def with_differences() -> Any:
    """A pair of receivers with false time differences over a part of what it could measure."""
    scenario = with_model("tdoa")
    sensors = tuple(
        replace(sensor, false_alarms_per_scan=3.0, range_extent_m=(-8000.0, 8000.0))
        for sensor in scenario.sensors
    )
    return replace(scenario, sensors=sensors)


def _over_runs(values: list[float]) -> dict[str, float]:
    """Mean of runs and its standard error."""
    spread = np.std(values, ddof=1) / np.sqrt(len(values)) if len(values) > 1 else np.nan
    return {"mean": float(np.mean(values)), "error": float(spread)}


def gain(runs: int, seed: int) -> list[dict[str, Any]]:
    """Tracks on wrong, estimated and true densities."""
    scenario, found = load_scenario(SCENARIO), []
    for method in MEASURED_METHODS:
        for name, variant, factor in VARIANTS:
            scores = tracked(scenario, method, variant, factor, range(runs), seed)
            entry: dict[str, Any] = {"method": method, "variant": name}
            for key in scores[0]:
                entry[key] = _over_runs([score[key] for score in scores])
            found.append(entry)
        _progress(f"gain, {method}")
    return found


def field_bias(runs: int, seed: int) -> list[dict[str, Any]]:
    """Both maps of a radar against the field that was simulated."""
    found = []
    for method in MEASURED_METHODS:
        for factor in FACTORS if method == MEASURED_METHODS[0] else (1.0,):
            each = [field_estimates(method, factor, FIELD_SCANS, run, seed) for run in range(runs)]
            entry: dict[str, Any] = {"method": method, "factor": factor}
            entry["probability"] = {
                f"{truth:g}": _over_runs(
                    [float(run["probability"][np.array(FIELD) == truth].mean()) for run in each]
                )
                for truth in dict.fromkeys(FIELD)
            }
            busy = np.isin(np.arange(len(FIELD)), BUSY_SECTORS)
            for key in ("at_targets", "elsewhere"):
                for name, rows in (("busy", busy), ("quiet", ~busy)):
                    entry[f"{key}_{name}"] = _over_runs(
                        [float(run[key][rows].mean()) for run in each]
                    )
            found.append(entry)
        _progress(f"bias of a radar, {method}")
    return found


def measured_bias(runs: int, seed: int) -> list[dict[str, Any]]:
    """Clutter maps of bearings and of time differences against the densities simulated."""
    found = []
    for name, scenario in (
        ("bearing", load_scenario(SCENARIO)),
        ("tdoa", with_differences()),
    ):
        for memory in MEMORIES:
            for factor in FACTORS:
                each = [
                    measured_estimates(scenario, "jpda/none/cv", factor, memory, run, seed)
                    for run in range(runs)
                ]
                entry: dict[str, Any] = {"model": name, "memory_scans": memory, "factor": factor}
                for key in each[0]:
                    entry[key] = _over_runs([run[key] for run in each])
                found.append(entry)
        _progress(f"bias of {name}")
    return found


def measure(runs: int, bias_runs: int, seed: int) -> dict[str, Any]:
    """All figures of the page."""
    return {
        "runs": runs,
        "bias_runs": bias_runs,
        "seed": seed,
        "gain": gain(runs, seed),
        "field": field_bias(bias_runs, seed),
        "measured": measured_bias(bias_runs, seed),
        "map": estimated_map(load_scenario(SCENARIO), "jpda/none/cv", seed),
    }


def _progress(name: str) -> None:
    print(f"measured: {name}", file=sys.stderr, flush=True)


def picture(found: dict[str, Any]) -> Any:
    """Density by bearing, true and estimated, and the false tracks that it makes."""
    from gda_tracker.evaluation.figures.canvas import COLOURS, GREY, INK, canvas

    with canvas(11.0, 4.2) as figure:
        density, bars = figure.subplots(1, 2, width_ratios=(3, 2))
        curve = found["map"]
        told = np.full(len(curve["azimuth_deg"]), curve["given"])
        density.plot(curve["azimuth_deg"], curve["truth"], color=INK, lw=1.5, label="true")
        density.plot(curve["azimuth_deg"], told, color=GREY, ls="--", label="told")
        density.plot(curve["azimuth_deg"], curve["estimate"], color=COLOURS[0], label="estimated")
        density.set(
            xlabel="bearing [deg]",
            ylabel="false bearings per scan [1/rad]",
            title="One direction finder after 90 scans",
            yscale="log",
            xlim=(-180.0, 180.0),
        )
        density.legend()
        place = np.arange(len(MEASURED_METHODS))
        shown = [name for name, _, _ in VARIANTS]
        colours = (GREY, "#444444", COLOURS[0], COLOURS[4], COLOURS[2])
        for index, name in enumerate(shown):
            own = [entry for entry in found["gain"] if entry["variant"] == name]
            bars.bar(
                place + (index - 2.0) * 0.16,
                [entry["false_tracks"]["mean"] for entry in own],
                0.15,
                yerr=[entry["false_tracks"]["error"] for entry in own],
                color=colours[index],
                label=name,
            )
        bars.set_xticks(place, [method.split("/")[0] for method in MEASURED_METHODS])
        bars.set(title="False tracks in 6 minutes", ylabel="per run")
        bars.set_ylim(0.0, 60.0)
        bars.legend(fontsize=7, ncols=2, loc="upper right", columnspacing=1.0, handlelength=1.2)
    return figure


def _value(entry: dict[str, float], digits: int = 2) -> str:
    return f"{entry['mean']:.{digits}f} +- {entry['error']:.{digits}f}"


def gain_table(found: dict[str, Any]) -> str:
    """False tracks and targets held."""
    head = ["method", "density", "false tracks [per run]", "their life [s per run]"]
    head += ["targets held [% of scans]", "GOSPA [m RMS]"]
    rows = [
        [
            f"`{entry['method']}`",
            entry["variant"],
            _value(entry["false_tracks"], 1),
            _value(entry["false_life_s"], 0),
            f"{100.0 * entry['completeness']['mean']:.0f} +- "
            f"{100.0 * entry['completeness']['error']:.0f}",
            _value(entry["gospa_m"], 0),
        ]
        for entry in found["gain"]
    ]
    return markdown(head, rows)


def field_table(found: dict[str, Any]) -> str:
    """Bias of the maps of a radar."""
    truths = list(dict.fromkeys(f"{truth:g}" for truth in FIELD))
    head = ["method", "density told / true", *(f"P_D {truth}" for truth in truths)]
    head += ["clutter, busy", "clutter, quiet", "at the targets, busy", "at the targets, quiet"]
    rows = [
        [
            f"`{entry['method']}`",
            f"{entry['factor']:g}",
            *(_value(entry["probability"][truth], 3) for truth in truths),
            _value(entry["elsewhere_busy"]),
            _value(entry["elsewhere_quiet"]),
            _value(entry["at_targets_busy"]),
            _value(entry["at_targets_quiet"]),
        ]
        for entry in found["field"]
    ]
    return markdown(head, rows)


def measured_table(found: dict[str, Any]) -> str:
    """Bias of the maps of bearings and differences."""
    head = ["sensor", "`clutter_memory_scans`", "density told / true", "busy sector", "elsewhere"]
    rows = [
        [
            f"`{entry['model']}`",
            f"{entry['memory_scans']:g}",
            f"{entry['factor']:g}",
            _value(entry["busy"]) if "busy" in entry else "",
            _value(entry["quiet"]),
        ]
        for entry in found["measured"]
    ]
    return markdown(head, rows)


def tables(found: dict[str, Any]) -> dict[str, str]:
    """The tables by the names of their places on the page."""
    return {
        "gain": gain_table(found),
        "radar": field_table(found),
        "measured": measured_table(found),
    }


def main(arguments: list[str] | None = None) -> int:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--bias-runs", type=int, default=4)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--from-json", action="store_true", help="measure nothing")
    args = parser.parse_args(arguments)
    if not args.from_json:
        found = measure(args.runs, args.bias_runs, args.seed)
        FIGURES.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    found = json.loads(FIGURES.read_text(encoding="utf-8"))
    from gda_tracker.evaluation.figures.canvas import png

    PICTURE.write_bytes(png(picture(found)))
    for name, table in tables(found).items():
        write_section(PAGE, name, table)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
