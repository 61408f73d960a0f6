#!/usr/bin/env python3
"""Measure decisions, attribute terms and filters: tables of docs/decisions.md and the README.

    python scripts/measure_decisions.py [--runs 200] [--seed 1] [--workers 2]
    python scripts/measure_decisions.py --from docs/decisions.json     # write the tables again

One command measures all of it: every decision with every attribute term and filter on both
shipped scenarios; the best of them on variants of these (all targets of one class; the mean radar
cross sections told to the tracker 1.5 times too high or too low); every decision and filter on the
real recordings that are shipped. The figures go to ``docs/decisions.json``, the tables made of
them into the documents.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from gda_tracker.commands.progress import progress_bar  # noqa: E402
from gda_tracker.evaluation.continuity import score_continuity  # noqa: E402
from gda_tracker.evaluation.monte_carlo import monte_carlo  # noqa: E402
from gda_tracker.io.adapters import load_recording  # noqa: E402
from gda_tracker.simulation.scenarios import Scenario, load_scenario  # noqa: E402
from gda_tracker.tracking.methods import default_method, parse_method  # noqa: E402
from gda_tracker.tracking.ring import Ring  # noqa: E402
from gda_tracker.vocabulary.recordings import Recording  # noqa: E402
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks  # noqa: E402
from scripts.doc_tables import markdown, with_error, write_section  # noqa: E402

SCENARIOS = ("crossing_targets", "closely_spaced_targets")
DECISIONS = ("gda", "map", "jpda", "mht")
TERMS = ("none", "dsm_classic", "bayes")
FILTERS = ("cv", "imm")
METHODS = tuple(f"{d}/{t}/{f}" for d in DECISIONS for t in TERMS for f in FILTERS)
VARIANT_METHODS = (default_method(), "mht/none/imm", "map/bayes/imm")
README_METHODS = ("gda/none/cv", "gda/dsm_classic/cv", "map/bayes/cv", default_method())
MISSTATED = 1.5
# Without a radar cross section there is nothing for the attribute to say.
RECORDED_METHODS = tuple(f"{d}/none/{f}" for d in DECISIONS for f in FILTERS)
RECORDINGS = {
    "Autoferry 13": ROOT / "data/autoferry/scenario13",
    "Autoferry 16": ROOT / "data/autoferry/scenario16",
    "walk": ROOT / "data/mmwave_walk/SOT.tar.xz",
}
MATCH_DISTANCE_M = 25.0
NEAR = 2.0
"""Differences of less than so many standard errors are not told apart."""

Results = dict[str, Any]
Progress = Callable[[int, int], None]


# --- variants of the scenarios ------------------------------------------------------------------


def same_class(scenario: Scenario) -> Scenario:
    """All targets of the first one's class and radar cross section; the tracker knows both."""
    first = scenario.targets[0]
    one = {
        "class_name": first.class_name,
        "rcs_mean_m2": first.rcs_mean_m2,
        "rcs_swerling": first.rcs_swerling,
    }
    targets = tuple(replace(target, **one) for target in scenario.targets)
    return replace(scenario, name=f"{scenario.name}, one class", targets=targets)


def misstated(scenario: Scenario, factor: float) -> Scenario:
    """The tracker is told mean radar cross sections ``factor`` times those of the targets."""
    told = tuple(
        replace(known, rcs_mean_m2=known.rcs_mean_m2 * factor)
        for known in scenario.attribute.classes
    )
    return replace(
        scenario,
        name=f"{scenario.name}, means x {factor:.3g}",
        attribute=replace(scenario.attribute, classes=told),
    )


def variants() -> list[tuple[str, str, Scenario]]:
    """Name of the variant, of the shipped scenario, and the scenario to simulate."""
    made = []
    for name in SCENARIOS:
        scenario = load_scenario(name)
        made += [
            ("one class", name, same_class(scenario)),
            (f"means told x {MISSTATED}", name, misstated(scenario, MISSTATED)),
            (f"means told / {MISSTATED}", name, misstated(scenario, 1.0 / MISSTATED)),
        ]
    return made


# --- measurements -------------------------------------------------------------------------------


def measure_scenarios(
    scenarios: Sequence[Scenario],
    methods: Sequence[str],
    runs: int,
    seed: int,
    workers: int | None,
    progress: Progress | None = None,
) -> list[Results]:
    """Purity at once and delayed of all methods on the same runs of each scenario."""
    results = monte_carlo(scenarios, list(methods), runs, seed, workers=workers, progress=progress)
    return [
        {entry["method"]: _kept(entry) for entry in (m.to_dict() for m in result.methods)}
        for result in results
    ]


def _kept(entry: Results) -> Results:
    names = ("purity_mean", "purity_stderr", "difference_mean", "difference_stderr")
    delayed = ("purity_delayed_mean", "purity_delayed_stderr")
    kept = {name: round(entry[name], 5) for name in (*names, *delayed) if name in entry}
    return {**kept, "cpu_ms_per_scan": round(entry["cpu_ms_per_scan"], 2)}


def measure_recording(recording: Recording, method: str) -> Results:
    """Play a recording through the ring with its preset and another method."""
    manager = {**recording.preset.get("track_manager", {}), **parse_method(method)}
    ring = Ring({**recording.preset, "track_manager": manager})
    tracks: list[Tracks] = []
    cpu_s = []
    for detections in recording.detections:
        begin = time.process_time()
        found = ring.process(detections).tracks
        cpu_s.append(time.process_time() - begin)
        if found is None:
            raise RuntimeError(f"{recording.name}: a scan was rejected")
        tracks.append(found)
    confirmed = [t.track_id[t.status == CONFIRMED] for t in tracks]
    ids, scans = np.unique(np.concatenate(confirmed), return_counts=True)
    result: Results = {
        "confirmed_tracks": len(ids),
        "longest_share": round(float(scans.max(initial=0)) / len(tracks), 3),
        "cpu_ms_per_scan": round(1e3 * float(np.mean(cpu_s)), 2),
        "slowest_scan_ms": round(1e3 * max(cpu_s), 1),
    }
    if recording.truth is not None:
        score = score_continuity(tracks, recording.truth, match_distance_m=MATCH_DISTANCE_M)
        result |= {
            "completeness": [round(float(s), 3) for s in score.matched / score.samples],
            "switches": int(score.switches.sum()),
            "flips": int(score.flips.sum()),
            "position_rmse_m": round(score.position_rmse_m, 2),
        }
    return result


def measure(runs: int, seed: int, workers: int | None) -> Results:
    """All of it, with progress on standard error."""
    scenarios = [load_scenario(name) for name in SCENARIOS]
    made = variants()
    results: Results = {"runs": runs, "seed": seed}
    total = runs * (len(scenarios) + len(made)) + len(RECORDINGS) * len(RECORDED_METHODS)
    with progress_bar(total, "runs", "decisions") as show:
        options = (runs, seed, workers)
        measured = measure_scenarios(scenarios, METHODS, *options, lambda done, _: show(done))
        results["scenarios"] = dict(zip(SCENARIOS, measured, strict=True))
        before = runs * len(scenarios)
        measured = measure_scenarios(
            [scenario for *_, scenario in made],
            VARIANT_METHODS,
            *options,
            lambda done, _: show(before + done),
        )
        results["variants"] = {
            f"{variant}: {name}": found
            for (variant, name, _), found in zip(made, measured, strict=True)
        }
        before += runs * len(made)
        results["recordings"] = {}
        for name, path in RECORDINGS.items():
            recording = load_recording(str(path))
            results["recordings"][name] = {}
            for method in RECORDED_METHODS:
                results["recordings"][name][method] = measure_recording(recording, method)
                before += 1
                show(before)
    return results


# --- tables -------------------------------------------------------------------------------------


def purity_cells(entry: Results) -> list[str]:
    """Purity at once and delayed; a dash where the past is not revised."""
    delayed = "-"
    if "purity_delayed_mean" in entry:
        delayed = with_error(entry["purity_delayed_mean"], entry["purity_delayed_stderr"])
    return [with_error(entry["purity_mean"], entry["purity_stderr"]), delayed]


def scenarios_table(results: Results) -> str:
    """Markdown: every method on both scenarios; the best of a column, and what is near it, bold."""
    head, rows = ["decision", "attribute", "filter"], []
    for name in SCENARIOS:
        head += [f"{name}: at once", "delayed"]
    head.append("CPU ms per scan")
    for method in METHODS:
        entries = [results["scenarios"][name][method] for name in SCENARIOS]
        cells = [f"`{part}`" for part in method.split("/")]
        for name, entry in zip(SCENARIOS, entries, strict=True):
            first, *rest = purity_cells(entry)
            best = max(results["scenarios"][name].values(), key=lambda e: e["purity_mean"])
            error = np.hypot(best["purity_stderr"], entry["purity_stderr"])
            near = best["purity_mean"] - entry["purity_mean"] <= NEAR * error
            cells += [f"**{first}**" if near else first, *rest]
        cells.append(" / ".join(f"{entry['cpu_ms_per_scan']:.1f}" for entry in entries))
        rows.append(cells)
    return markdown(head, rows)


def variants_table(results: Results) -> str:
    """Markdown: the methods that matter on the variants of the scenarios."""
    head = ["what differs", "method"]
    for name in SCENARIOS:
        head += [f"{name}: at once", "delayed"]
    rows = []
    for variant in dict.fromkeys(key.split(": ")[0] for key in results["variants"]):
        for method in VARIANT_METHODS:
            cells = [variant, f"`{method}`"]
            for name in SCENARIOS:
                cells += purity_cells(results["variants"][f"{variant}: {name}"][method])
            rows.append(cells)
    return markdown(head, rows)


def recordings_table(results: Results) -> str:
    """Markdown: every decision and filter on the real recordings."""
    head = ["recording", "method", "completeness of the boats", "switches", "flips", "error m"]
    head += ["confirmed tracks", "longest", "CPU ms per scan", "slowest"]
    rows = []
    for name, methods in results["recordings"].items():
        for method, found in methods.items():
            cells = [name, f"`{method}`"]
            if "completeness" in found:
                cells += [
                    ", ".join(f"{share:.3f}" for share in found["completeness"]),
                    str(found["switches"]),
                    str(found["flips"]),
                    f"{found['position_rmse_m']:.1f}",
                ]
            else:
                cells += ["no truth", "-", "-", "-"]
            rows.append(
                [
                    *cells,
                    str(found["confirmed_tracks"]),
                    f"{found['longest_share']:.2f}",
                    f"{found['cpu_ms_per_scan']:.1f}",
                    f"{found['slowest_scan_ms']:.0f}",
                ]
            )
    return markdown(head, rows)


def readme_table(results: Results) -> str:
    """Markdown: purity, and the paired gain over the first method."""
    command = "gda-tracker evaluate crossing_targets closely_spaced_targets"
    methods = " ".join(f"--method {m}" for m in (*README_METHODS[:-1], "default"))
    rows = []
    for method in README_METHODS:
        cells = [f"`{method}`" + (", the default" if method == default_method() else "")]
        for name in SCENARIOS:
            entry = results["scenarios"][name][method]
            cell = f"{entry['purity_mean']:.3f} +- {entry['purity_stderr']:.3f}"
            if method != METHODS[0]:
                cell += f" ({entry['difference_mean']:+.3f})"
            if "purity_delayed_mean" in entry:
                cell += f", delayed {entry['purity_delayed_mean']:.3f}"
            cells.append(cell)
        rows.append(cells)
    return (
        f"```sh\n{command} \\\n    --runs {results['runs']} --seed {results['seed']} \\\n"
        f"    {methods}\n```\n\n"
        "Track purity with its standard error, and the paired gain over kinematics alone:\n\n"
        + markdown(["method", *SCENARIOS], rows)
    )


PAGE_TABLES = {
    "scenarios": scenarios_table,
    "variants": variants_table,
    "recordings": recordings_table,
}


def write_tables(results: Results, page: Path, readme: Path) -> None:
    """Put all tables into the documents."""
    for section, make in PAGE_TABLES.items():
        write_section(page, section, make(results))
    write_section(
        page, "origin", f"Seed {results['seed']}, {results['runs']} runs of each scenario."
    )
    write_section(readme, "measured", readme_table(results))


def main(arguments: list[str] | None = None) -> int:
    """Measure and write; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, help="processes (default: one per core)")
    parser.add_argument("--json", type=Path, default=ROOT / "docs/decisions.json")
    parser.add_argument("--document", type=Path, default=ROOT / "docs/decisions.md")
    parser.add_argument("--readme", type=Path, default=ROOT / "README.md")
    parser.add_argument("--from", type=Path, dest="given", help="figures measured before")
    args = parser.parse_args(arguments)
    if args.runs < 2:
        parser.error(f"--runs = {args.runs}: allowed is an integer >= 2")
    if args.given is None:
        results = measure(args.runs, args.seed, args.workers)
        args.json.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
        print(f"written: {args.json}")
    else:
        results = json.loads(args.given.read_text(encoding="utf-8"))
    write_tables(results, args.document, args.readme)
    print(f"written: tables of {args.document} and {args.readme}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
