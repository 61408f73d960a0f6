#!/usr/bin/env python3
"""Measure the count of objects in formations, its errors, splits and mergers: docs/formations.md.

    python scripts/measure_formations.py [--runs 30] [--tests 4000] [--seed 0]

Tests on simulated scans that match their model, and the whole tracker on the scenario formations,
also with objects that the radar does not always resolve. Writes docs/formations.json, and from it
the tables and pictures of the page; with --from-json only the tables.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse.csgraph import connected_components

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from gda_tracker.formations.found import MERGED, SPLIT, Formations  # noqa: E402
from gda_tracker.formations.monte_carlo import OPEN, decided_numbers  # noqa: E402
from gda_tracker.formations.parameters import FormationParameters  # noqa: E402
from gda_tracker.formations.tracker import FormationTracker  # noqa: E402
from gda_tracker.simulation.preset import tracker_preset  # noqa: E402
from gda_tracker.simulation.scenarios import Scenario, load_scenario  # noqa: E402
from gda_tracker.simulation.simulate import simulate  # noqa: E402
from gda_tracker.tracking.ring import Ring  # noqa: E402
from gda_tracker.vocabulary.recordings import Recording  # noqa: E402
from gda_tracker.vocabulary.scans import Detections, ScanTruth  # noqa: E402
from scripts.doc_tables import markdown, write_section  # noqa: E402
from scripts.formation_information import information  # noqa: E402

PAGE = ROOT / "docs" / "formations.md"
FIGURES = ROOT / "docs" / "formations.json"
PICTURES = ROOT / "docs" / "images"
# P_D, R_u^-1 X (infinite: resolved): small steps come nearest to the design.
CASES = {
    "P_D 0.9": (0.9, math.inf),
    "P_D 0.6": (0.6, math.inf),
    "P_D 0.9, partly unresolved": (0.9, 3.0),
}
DESIGNS = (0.1, 0.05, 0.01)
NUMBERS = (1, 2, 3, 4, 5)
SCENARIO = "formations"
METHOD = {"decision": "map", "attribute_term": "none"}
# Objects 400 m apart are one detection with the probability 0.29.
HALF_M, CELL_RANGE_M = 300.0, 37_000.0
SCANS = 60
NEAR_M = 2000.0
SHARE = 0.9
# Of objects beside the tracks: without it two objects in one cell are as good as one.
SPREAD_M = 300.0
# The turns begin and end; what happens before is the beginning of tracks.
SPLIT_SCAN, MERGER_SCAN, FIRST_SCAN = 35, 30, 25


def error_rates(tests: int, seed: int) -> list[dict[str, Any]]:
    """Too many and too few, of matched tests."""
    found = []
    for name, (p_d, ratio) in CASES.items():
        for design in DESIGNS:
            for truth in NUMBERS:
                generator = np.random.default_rng([seed, truth, round(1000 * design)])
                decided = decided_numbers(
                    truth,
                    tests,
                    generator,
                    detection_probability=p_d,
                    resolution_ratio=ratio,
                    design=design,
                )
                done = decided.number != OPEN
                found.append(
                    {
                        "case": name,
                        "design": design,
                        "truth": truth,
                        "tests": tests,
                        "too_many": float((decided.number > truth).mean()),
                        "too_few": float((done & (decided.number < truth)).mean()),
                        "open": float((~done).mean()),
                        "median_scans": float(np.median(decided.scans)),
                        "scans_90": float(np.quantile(decided.scans, 0.9)),
                    }
                )
    return found


def straight(scenario: Scenario) -> Scenario:
    """The formations of the scenario, which fly on side by side."""
    targets = tuple(
        replace(target, manoeuvres=(), initial_heading_deg_ccw_from_north=0.0)
        for target in scenario.targets
    )
    return replace(scenario, targets=targets, time=replace(scenario.time, n_scans=SCANS))


def unresolved(recording: Recording, p_d: float, seed: int) -> Recording:
    """Let objects be one detection, with the probability of their distance; then thin by P_D."""
    generator = np.random.default_rng(seed)
    assert recording.truth is not None
    scans, truths = [], []
    for scan, truth in zip(recording.detections, recording.truth, strict=True):
        one, other = _unresolved_scan(scan, truth, p_d, generator)
        scans.append(one)
        truths.append(other)
    return replace(recording, detections=scans, truth=truths)


def _unresolved_scan(
    scan: Detections, truth: ScanTruth, p_d: float, generator: np.random.Generator
) -> tuple[Detections, ScanTruth]:
    assert truth.source_id is not None
    assert scan.rcs_m2 is not None
    own = np.flatnonzero(truth.source_id >= 0)
    row = {target: index for index, target in enumerate(truth.target_id.tolist())}
    place = truth.target_state[[row[source] for source in truth.source_id[own].tolist()], :2]
    range_m = np.hypot(place[:, 0], place[:, 1])
    azimuth = np.arctan2(place[:, 1], place[:, 0])
    apart = ((range_m[:, None] - range_m[None]) / HALF_M) ** 2
    apart += ((azimuth[:, None] - azimuth[None]) / (HALF_M / CELL_RANGE_M)) ** 2
    linked = np.triu(generator.random(apart.shape) < 0.5**apart, 1)
    group = connected_components(linked, directed=False)[1]
    rows = [own[group == g] for g in range(group.max() + 1) if generator.random() < p_d]
    rows += [np.array([index]) for index in np.flatnonzero(truth.source_id < 0)]
    order = generator.permutation(len(rows))
    rows = [rows[index] for index in order]
    return (
        replace(
            scan,
            range_m=np.array([scan.range_m[r].mean() for r in rows]),
            azimuth_rad=np.array([scan.azimuth_rad[r].mean() for r in rows]),
            rcs_m2=np.array([scan.rcs_m2[r].sum() for r in rows]),
            rcs_valid=np.ones(len(rows), dtype=bool),
        ),
        replace(truth, source_id=np.array([truth.source_id[r[0]] for r in rows], dtype=np.int32)),
    )


def followed(
    recording: Recording, scenario: Scenario, variants: dict[str, FormationParameters]
) -> dict[str, list[Formations]]:
    """Formations after each scan, by variant; all variants see the same tracks."""
    preset = tracker_preset(scenario, "automatic")
    preset["track_manager"].update(METHOD)
    ring = Ring(preset)
    trackers = {name: FormationTracker(table) for name, table in variants.items()}
    found: dict[str, list[Formations]] = {name: [] for name in variants}
    for detections in recording.detections:
        for result in ring.feed(detections):
            assert result.tracks is not None
            for name, tracker in trackers.items():
                found[name].append(tracker.take(result.tracks, result.scan, result.predictions))
    return found


def right_numbers(found: list[Formations], truth: list[ScanTruth]) -> dict[str, np.ndarray]:
    """Whether (scans, 5) the number of each formation is right: as decided, as most probable."""
    shape = (len(truth), len(NUMBERS))
    decided, probable = np.zeros(shape, bool), np.zeros(shape, bool)
    by_stamp = {one.key.stamp_ns: one for one in found}
    for k, known in enumerate(truth):
        now = by_stamp.get(known.stamp_ns)
        for place, n in enumerate(NUMBERS):
            centre = known.target_state[known.target_id // 10 == n, :2].mean(axis=0)
            near = [
                one
                for one in (now.formations if now else ())
                if np.hypot(*(one.position - centre)) < NEAR_M
            ]
            if near:
                best = max(near, key=lambda one: len(one.track_ids))
                decided[k, place] = best.number == n
                probable[k, place] = int(best.number_probabilities.argmax()) + 1 == n
    return {"decided": decided, "probable": probable}


def scans_until(share: np.ndarray) -> int | None:
    """Return the scan, from 1, from which on the share stays at 90 % or more."""
    below = np.flatnonzero(share < SHARE)
    first = int(below[-1]) + 1 if len(below) else 0
    return first + 1 if first < len(share) else None


def cardinality(runs: int, seed: int) -> list[dict[str, Any]]:
    """Numbers through the whole tracker, with resolved and with partly unresolved objects."""
    scenario = straight(load_scenario(SCENARIO))
    seeing_all = replace(scenario, sensor=replace(scenario.sensor, detection_probability=1.0))
    plain = FormationParameters()
    cell = FormationParameters(
        resolution_range_m=HALF_M,
        resolution_azimuth_rad=HALF_M / CELL_RANGE_M,
        spread_std_m=SPREAD_M,
    )
    right: dict[str, list[dict[str, np.ndarray]]] = {}
    for run in range(runs):
        clear = simulate(scenario, seed, run)
        merged = unresolved(
            simulate(seeing_all, seed, run), scenario.sensor.detection_probability, run
        )
        for name, recording, variants in (
            ("resolved", clear, {"without the resolution": plain}),
            (
                "partly unresolved",
                merged,
                {"without the resolution": plain, "with the resolution": cell},
            ),
        ):
            assert recording.truth is not None
            for variant, found in followed(recording, scenario, variants).items():
                right.setdefault(f"{name}, {variant}", []).append(
                    right_numbers(found, recording.truth)
                )
    entries = []
    for name, results in right.items():
        for kind in ("decided", "probable"):
            share = np.mean([result[kind] for result in results], axis=0)
            entries.append(
                {
                    "case": name,
                    "kind": kind,
                    "scans_until_90": scans_until(share.mean(axis=1)),
                    "scans_until_90_by_number": [scans_until(column) for column in share.T],
                    "last_by_number": share[-1].tolist(),
                    "last": float(share[-1].mean()),
                    "share": np.round(share.mean(axis=1), 4).tolist(),
                }
            )
    return entries


def lineage(runs: int, seed: int) -> dict[str, Any]:
    """Splits and mergers in the scenario: one of each is true."""
    scenario = load_scenario(SCENARIO)
    splits, mergers, delays = [], [], {SPLIT: [], MERGED: []}
    for run in range(runs):
        recording = simulate(scenario, seed, run)
        (found,) = followed(recording, scenario, {"": FormationParameters()}).values()
        events = [(k + 1, e) for k, one in enumerate(found) for e in one.events]
        own = {
            kind: [k for k, e in events if e.kind == kind and k >= FIRST_SCAN]
            for kind in (SPLIT, MERGED)
        }
        splits.append(len(own[SPLIT]))
        mergers.append(len(own[MERGED]))
        delays[SPLIT] += [k - SPLIT_SCAN for k in own[SPLIT] if k >= SPLIT_SCAN][:1]
        delays[MERGED] += [k - MERGER_SCAN for k in own[MERGED] if k >= MERGER_SCAN][:1]
    return {
        "runs": runs,
        "runs_with_one_split": float(np.mean(np.array(splits) == 1)),
        "runs_with_one_merger": float(np.mean(np.array(mergers) == 1)),
        "splits": int(np.sum(splits)),
        "mergers": int(np.sum(mergers)),
        "median_split_delay_scans": float(np.median(delays[SPLIT])),
        "median_merger_delay_scans": float(np.median(delays[MERGED])),
    }


def what_a_scan_says() -> list[dict[str, float]]:
    """How much one scan says of partly unresolved objects at best, by their number."""
    scenario, found = load_scenario(SCENARIO), []
    for n in NUMBERS[1:]:
        own = [target for target in scenario.targets if target.id // 10 == n]
        places = np.array([target.initial_position_m for target in own])
        found.append(information(places, HALF_M, SPREAD_M))
    return found


def cost(seed: int) -> dict[str, float]:
    """Processor time per scan [ms] of the ring and of the formations, on the scenario."""
    scenario = load_scenario(SCENARIO)
    recording = simulate(scenario, seed)
    spent = []
    for variants in ({}, {"": FormationParameters()}, {}, {"": FormationParameters()}):
        begun = time.process_time()
        followed(recording, scenario, variants)
        spent.append((time.process_time() - begun) * 1e3 / len(recording.detections))
    # The first two runs pay for what is made once.
    return {"ring_ms": spent[2], "formations_ms": max(spent[3] - spent[2], 0.0)}


def measure(runs: int, tests: int, seed: int) -> dict[str, Any]:
    """All that the page shows."""
    return {
        "runs": runs,
        "tests": tests,
        "seed": seed,
        "errors": error_rates(tests, seed),
        "cardinality": cardinality(runs, seed),
        "lineage": lineage(runs, seed),
        "information": what_a_scan_says(),
        "cost": cost(seed),
    }


def pictures(seed: int) -> None:
    """Draw the scenario's lineage and numbers."""
    from gda_tracker.evaluation.figures import png
    from gda_tracker.evaluation.figures.formations import formation_lanes, formation_numbers

    scenario = load_scenario(SCENARIO)
    (found,) = followed(simulate(scenario, seed), scenario, {"": FormationParameters()}).values()
    (PICTURES / "formations_lineage.png").write_bytes(png(formation_lanes(found)))
    (PICTURES / "formations_numbers.png").write_bytes(png(formation_numbers(found)))


def _percent(share: float, digits: int = 1) -> str:
    return f"{100.0 * share:.{digits}f} %"


def _scan(value: int | None) -> str:
    return "never" if value is None else f"{value}"


def tables(found: dict[str, Any]) -> str:
    """Return the tables of the page."""
    rows = [["case", "design", "too many", "too few", "scans, n = 1 / 3 / 5 (median)"]]
    for name in CASES:
        for design in found_designs(found):
            own = [e for e in found["errors"] if (e["case"], e["design"]) == (name, design)]
            scans = " / ".join(f"{own[n - 1]['median_scans']:.0f}" for n in (1, 3, 5))
            most = max(e["too_many"] for e in own), max(e["too_few"] for e in own)
            rows.append([name, _percent(design, 0), *(_percent(m, 2) for m in most), scans])
    text = (
        f"Wrong decisions of {found['tests']} tests each, of the worst of 1 to 5 objects "
        "(0.2 false detections in the gate):\n\n" + markdown(rows[0], rows[1:])
    )
    rows = [["objects", "number", "right in 90 % from scan", "n = 1 / 2 / 3 / 4 / 5", "at the end"]]
    for entry in found["cardinality"]:
        each = " / ".join(_scan(value) for value in entry["scans_until_90_by_number"])
        row = [entry["case"], entry["kind"], _scan(entry["scans_until_90"]), each]
        rows.append([*row, _percent(entry["last"])])
    text += (
        f"\n\nThe whole tracker on {found['runs']} runs of five formations (P_D 0.9, 40 false "
        "alarms a scan), from the first scan on:\n\n" + markdown(rows[0], rows[1:])
    )
    rows = [["objects", "a scan says [nat]", "scans to 1000 : 1", "places known [nat]", "scans"]]
    rows += [
        [
            f"{e['n']:.0f}, not {e['n'] + 1:.0f}",
            *(f"{e['draws_nat']:.2f}", f"{e['draws_scans']:.0f}"),
            *(f"{e['places_nat']:.2f}", f"{e['places_scans']:.0f}"),
        ]
        for e in found["information"]
    ]
    text += (
        "\n\nWhat the number of detections of a scan says of partly unresolved objects (mean log "
        "ratio against one object more), with the model, and at best, if it were known where "
        "each one flies:\n\n" + markdown(rows[0], rows[1:])
    )
    own = found["lineage"]
    text += (
        f"\n\nIn {own['runs']} runs of the scenario with one split and one merger: exactly one "
        f"split in {_percent(own['runs_with_one_split'], 0)}, exactly one merger in "
        f"{_percent(own['runs_with_one_merger'], 0)} ({own['splits']} and {own['mergers']} in "
        f"all, from scan {FIRST_SCAN} on); the split is told "
        f"{own['median_split_delay_scans']:.0f} scans after the turn begins, "
        f"the merger {own['median_merger_delay_scans']:.0f} scans after the turn ends "
        "(medians).\n\n"
        "On this scenario (about 50 detections a scan) it takes "
        f"{found['cost']['formations_ms']:.1f} ms of processor time a scan, the ring "
        f"{found['cost']['ring_ms']:.1f} ms."
    )
    return text


def found_designs(found: dict[str, Any]) -> list[float]:
    """Return the designs that were measured."""
    return list(dict.fromkeys(entry["design"] for entry in found["errors"]))


def main(arguments: list[str] | None = None) -> int:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=30)
    parser.add_argument("--tests", type=int, default=4000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--from-json", action="store_true", help="write the page alone")
    args = parser.parse_args(arguments)
    if not args.from_json:
        found = measure(args.runs, args.tests, args.seed)
        FIGURES.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        pictures(args.seed + 1)
    write_section(PAGE, "measured", tables(json.loads(FIGURES.read_text(encoding="utf-8"))))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
