#!/usr/bin/env python3
"""Measure extended objects in the ring; write docs/extended_ring.json and docs/extended-objects.md.

    python scripts/measure_extended_ring.py [--runs 5] [--seed 1]

The scenario extended_objects with the option on and off (each detection an object of its own), the
walk before a mmWave radar, and one scan of a car's radar.
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

from gda_tracker.evaluation.figures.canvas import COLOURS, canvas, png  # noqa: E402
from gda_tracker.evaluation.quality import score_quality  # noqa: E402
from gda_tracker.evaluation.statistics import mean_and_stderr  # noqa: E402
from gda_tracker.io.adapters import InputOptions, load_recording  # noqa: E402
from gda_tracker.io.parameter_files import read_parameter_file  # noqa: E402
from gda_tracker.kinematics.extended.ellipses import outline, semi_axes  # noqa: E402
from gda_tracker.simulation.scenarios import load_scenario  # noqa: E402
from gda_tracker.simulation.simulate import simulate  # noqa: E402
from gda_tracker.tracking.ring import Ring, RingResult  # noqa: E402
from gda_tracker.vocabulary.recordings import Recording  # noqa: E402
from gda_tracker.vocabulary.tracks import CONFIRMED  # noqa: E402
from scripts.doc_tables import markdown, write_section  # noqa: E402

METHOD = {"decision": "map", "attribute_term": "none", "filter": "imm"}
WALK = (ROOT / "data/mmwave_walk/SOT.tar.xz", "mmwave", "extended_walk.yaml")
CAR = (
    ROOT / "data/continental/ars548_1708578204_202447652_detection.yaml",
    "continental_yaml",
    "extended_car.yaml",
)
MEASURES = {
    "completeness": 3,
    "confirmed_tracks": 1,
    "position_rmse_m": 1,
    "extent_error_m": 1,
    "nees": 2,
    "ms_per_scan": 1,
}


def scenario_numbers(
    runs: int, seed: int
) -> tuple[dict[str, Any], tuple[Recording, list[RingResult]]]:
    """Measures with the option on and off, over the same runs, and the first run with it."""
    scenario = load_scenario("extended_objects")
    values: dict[str, dict[str, list[float]]] = {}
    for run in range(runs):
        recording = simulate(scenario, seed, run, initiation="automatic")
        assert recording.truth is not None
        assert recording.match_distance_m is not None
        for model in ("random_matrix", "none"):
            preset = recording.preset
            manager = {**preset["track_manager"], **METHOD, "extended_objects": model}
            ring = Ring({**preset, "track_manager": manager})
            start = time.process_time()
            results = [ring.process(scan) for scan in recording.detections]
            spent = 1e3 * (time.process_time() - start) / len(results)
            if run == 0 and model == "random_matrix":
                first = recording, results
            found = score_quality(results, recording.truth, recording.match_distance_m)
            own = values.setdefault(model, {name: [] for name in MEASURES})
            own["completeness"].append(found.continuity.completeness)
            own["confirmed_tracks"].append(found.continuity.confirmed_tracks)
            own["position_rmse_m"].append(found.continuity.position_rmse_m)
            own["extent_error_m"].append(found.extent_error_m)
            own["nees"].append(float(found.nees.squared.mean()))
            own["ms_per_scan"].append(spent)
    told = {
        model: {
            name: [round(v, 4) for v in mean_and_stderr(np.array(own[name]))]
            for name in MEASURES
            if not np.isnan(own[name]).any()
        }
        for model, own in values.items()
    }
    return told, first


def play(name: Path, adapter: str, params: str) -> list[RingResult]:
    """What the ring makes of a recording."""
    told = read_parameter_file(ROOT / "params" / params)
    recording = load_recording(name, adapter, InputOptions(radar_input=told["radar_input"]))
    manager = {**recording.preset.get("track_manager", {}), **told["track_manager"]}
    ring = Ring({"track_manager": manager})
    return [ring.process(scan) for scan in recording.detections]


def walk_numbers(results: list[RingResult]) -> dict[str, Any]:
    """Numbers of the track that lives longest."""
    live = [result.tracks for result in results if result.tracks is not None]
    ids = np.concatenate([one.track_id[one.status == CONFIRMED] for one in live])
    longest = int(np.bincount(ids).argmax())
    rows = [np.flatnonzero((one.track_id == longest) & (one.status == CONFIRMED)) for one in live]
    there = [(one, int(row[0])) for one, row in zip(live, rows, strict=True) if len(row)]
    axes = semi_axes(np.array([one.extent[row] for one, row in there]))[0]
    counts = np.array([one.detection_count[row] for one, row in there])
    reach = [float(np.hypot(*one.mean[row, :2])) for one, row in there]
    return {
        "scans": len(live),
        "scans_with_the_track": len(there),
        "scans_in_which_it_has_points": int((counts > 0).sum()),
        "other_confirmed_tracks": len(np.unique(ids)) - 1,
        "from_m": round(reach[0], 2),
        "to_m": round(reach[-1], 2),
        "median_long_semi_axis_m": round(float(np.median(axes[:, 0])), 2),
        "mean_detections": round(float(counts.mean()), 1),
        "mean_probability_of_the_chosen_partition": round(
            float(np.mean([result.report.partition_probability for result in results])), 3
        ),
    }


def car_numbers(results: list[RingResult]) -> dict[str, Any]:
    """Numbers of the cells: tracks begin with the second scan."""
    scan = results[0].scan
    assert scan is not None
    assert scan.cells is not None
    return {
        "detections": scan.detections,
        "cells": len(scan),
        "detections_in_cells_of_three_and_more": int(scan.cells.count[scan.cells.count >= 3].sum()),
        # A product over all regions of the scan.
        "probability_of_the_chosen_partition": float(f"{scan.cells.probability:.2g}"),
    }


def draw(recording: Recording, results: list[RingResult]) -> Any:
    """One run: detections, true ellipses and those of the tracks."""
    assert recording.truth is not None
    with canvas(10.0, 6.0) as figure:
        axis = figure.subplots()
        for k in range(0, len(results), 8):
            seen, true, tracks = recording.detections[k], recording.truth[k], results[k].tracks
            assert tracks is not None
            assert true.target_extent is not None
            x, y = seen.range_m * np.cos(seen.azimuth_rad), seen.range_m * np.sin(seen.azimuth_rad)
            axis.plot(x, y, ".", color="0.6", ms=3)
            for place, extent in zip(true.target_state[:, :2], true.target_extent, strict=True):
                axis.plot(*outline(place, extent).T, color="black", lw=0.9)
            for row in np.flatnonzero(tracks.status == CONFIRMED):
                line = outline(tracks.mean[row, :2], tracks.extent[row])
                colour = COLOURS[int(tracks.track_id[row]) % len(COLOURS)]
                axis.plot(*line.T, color=colour, lw=1.4)
        axis.set(
            xlabel="East [m]",
            ylabel="North [m]",
            xlim=(-800.0, 900.0),
            ylim=(1700.0, 3150.0),
            aspect="equal",
            title="every 8th scan: detections, true outlines (black), tracks",
        )
    return figure


def tables(numbers: dict[str, Any]) -> dict[str, str]:
    """Sections of the page by name."""
    head = ("", "extended objects", "points")
    rows = []
    for name, digits in MEASURES.items():
        cells = []
        for model in ("random_matrix", "none"):
            entry = numbers["scenario"][model].get(name)
            cells.append(
                "-" if entry is None else f"{entry[0]:.{digits}f} +- {entry[1]:.{digits}f}"
            )
        rows.append((name.replace("_", " "), *cells))
    walk = [(key.replace("_", " "), f"{value:g}") for key, value in numbers["walk"].items()]
    car = [(key.replace("_", " "), f"{value:g}") for key, value in numbers["car"].items()]
    return {
        "ring": f"{numbers['runs']} runs of seed {numbers['seed']}, 3 objects:\n\n"
        + markdown(head, rows),
        "ring-walk": markdown(("the walk, in the ring", ""), walk),
        "ring-car": markdown(("one scan of the ARS548, in the ring", ""), car),
    }


def main() -> int:
    """Measure, and write tables and picture."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    scenario, first = scenario_numbers(args.runs, args.seed)
    numbers = {
        "runs": args.runs,
        "seed": args.seed,
        "scenario": scenario,
        "walk": walk_numbers(play(*WALK)),
        "car": car_numbers(play(*CAR)),
    }
    text = json.dumps(numbers, indent=1) + "\n"
    print(text, end="")
    (ROOT / "docs" / "extended_ring.json").write_text(text, encoding="utf-8")
    for name, content in tables(numbers).items():
        write_section(ROOT / "docs" / "extended-objects.md", name, content)
    (ROOT / "docs" / "images" / "extended_ring.png").write_bytes(png(draw(*first)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
