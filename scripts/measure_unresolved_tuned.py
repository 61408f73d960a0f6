#!/usr/bin/env python3
"""Compare the ring with and without the resolution model, each at its own best settings.

    python scripts/measure_unresolved_tuned.py [--runs 200] [--tuning 20] [--seed 1]

With and without the model are tuned with the same effort: every process noise of a grid is tried on
the same runs of another seed, and the one that keeps all targets most often is taken (of equal ones
that whose NEES is nearest to its expectation). Then both play the same new runs. Numbers also go to
docs/unresolved_tuned.json.
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

from gda_tracker.evaluation.statistics import mean_and_stderr  # noqa: E402
from gda_tracker.simulation.playback import of_scenario  # noqa: E402
from gda_tracker.simulation.scenarios import load_scenario  # noqa: E402
from scripts.doc_tables import markdown, write_section  # noqa: E402
from scripts.measure_unresolved import OFF, track  # noqa: E402

FIGURES = ROOT / "docs" / "unresolved_tuned.json"
CASES = (("unresolved_pair", "mht/none/cv"), ("unresolved_turning", "mht/none/cv"))
GRID_MPS2 = (0.01, 0.02, 0.05, 0.2, 0.4, 0.8)
SIDES: dict[str, dict[str, Any]] = {"with": {}, "without": OFF}


def setting(side: str, process_noise: float) -> dict[str, Any]:
    """Parameters of the track manager of one side."""
    return {**SIDES[side], "process_noise_std_mps2": process_noise}


def played(
    name: str, method: str, runs: int, seed: int, settings: dict[str, dict[str, Any]]
) -> dict[str, dict[str, Any]]:
    """Whether all were kept (runs,) and the mean NEES / 4 of each setting, in paired runs."""
    scenario = load_scenario(name)
    found: dict[str, list[dict[str, Any]]] = {key: [] for key in settings}
    for run in range(runs):
        play = of_scenario(scenario, 1, seed, method, run)[0]
        for key, change in settings.items():
            found[key].append(track(scenario, play, method, change))
    return {
        key: {
            "kept": np.array([one["kept"] for one in each], float),
            "swapped": float(np.mean([one["swapped"] for one in each])),
            "nees": float(np.mean([one["nees"] for one in each])),
        }
        for key, each in found.items()
    }


def best(tried: dict[str, dict[str, Any]]) -> str:
    """The setting that keeps all most often, then the most consistent one."""
    return max(tried, key=lambda key: (tried[key]["kept"].mean(), -abs(np.log(tried[key]["nees"]))))


def measure(runs: int, tuning: int, seed: int) -> dict[str, Any]:
    """Tune both sides of each case on the seed after, and compare them."""
    numbers: dict[str, Any] = {"seed": seed, "runs": runs, "tuning": tuning, "cases": []}
    for name, method in CASES:
        case: dict[str, Any] = {"scenario": name, "method": method, "sides": {}}
        chosen = {}
        for side in SIDES:
            settings = {f"{q:g}": setting(side, q) for q in GRID_MPS2}
            tried = played(name, method, tuning, seed + 1, settings)
            chosen[side] = float(best(tried))
            case["sides"][side] = {
                "tried": {key: round(float(one["kept"].mean()), 3) for key, one in tried.items()},
                "process_noise_std_mps2": chosen[side],
            }
        found = played(
            name, method, runs, seed, {side: setting(side, q) for side, q in chosen.items()}
        )
        for side, one in found.items():
            case["sides"][side] |= {
                "kept": round(float(one["kept"].mean()), 3),
                "swapped": round(one["swapped"], 3),
                "nees": round(one["nees"], 2),
            }
        difference = mean_and_stderr(found["with"]["kept"] - found["without"]["kept"])
        case["gain"] = [round(value, 3) for value in difference]
        base = float(found["without"]["kept"].mean())
        case["more"] = round(float(found["with"]["kept"].mean()) / base - 1.0, 3) if base else None
        numbers["cases"].append(case)
        print(case, file=sys.stderr, flush=True)
    return numbers


def table(numbers: dict[str, Any]) -> str:
    """Both sides of each case, and what was tried."""
    rows = []
    for case in numbers["cases"]:
        for side, one in case["sides"].items():
            gain = ""
            if side == "without":
                more = "" if case["more"] is None else f" ({case['more']:+.0%})"
                gain = f"{case['gain'][0]:+.3f} +- {case['gain'][1]:.3f}{more}"
            tried = ", ".join(f"{key}: {kept:.2f}" for key, kept in one["tried"].items())
            rows.append(
                (
                    case["scenario"],
                    case["method"],
                    side,
                    f"{one['process_noise_std_mps2']:g}",
                    f"{one['kept']:.3f}",
                    gain,
                    f"{one['swapped']:.3f}",
                    f"{one['nees']:.2f}",
                    tried,
                )
            )
    head = ("scenario", "method", "resolution", "best process noise [m/s2]", "all kept")
    more = ("with it more often", "swapped", "NEES / 4", "kept in tuning")
    text = f"{numbers['runs']} paired runs of seed {numbers['seed']}, tuned on {numbers['tuning']}"
    return f"{text} of seed {numbers['seed'] + 1}:\n\n" + markdown((*head, *more), rows)


def main() -> int:
    """Measure, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--tuning", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    numbers = measure(args.runs, args.tuning, args.seed)
    FIGURES.write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")
    write_section(ROOT / "docs" / "unresolved.md", "tuned", table(numbers))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
