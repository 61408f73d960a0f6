"""Speed of the rules of combination: 100 x 100 pairs of a history and a measurement.

Histories have mass on all elements of the hyper-power set (18 for three elements, 166 for four),
measurements on the elements of the frame and on total ignorance, as the fuzzifier makes them. All
pairs of 100 histories and 100 measurements are fused by each rule, on one core; the index tables
are in place, as they are from the second scan on, and their own time is shown. "rows" is the time
of the same pairs given one by one, of which nothing is known to be shared. evidencelib, a
library of Python dictionaries, fuses some pairs of the same masses, and its time is scaled to all;
the largest difference of a mass is shown.

    python -m benchmarks.evidence
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.measuring import RESULTS, table, write_results
from gda_tracker.evidence import rule_tables
from gda_tracker.evidence.batches import combine_grid, combine_rows, rule_table
from gda_tracker.evidence.frames import (
    Model,
    element_name,
    free_element,
    free_model,
    hyper_power_set,
    shafer_model,
    singletons,
    total_ignorance,
)

ROWS = 100
REPEATS = 60
ROW_REPEATS = 5
# (elements, rule, model, goal in ms): histories that are dead on the model have no place in the
# rules of Shafer's model, so these run over its own elements.
CASES = (
    (3, "dsmc", "free", 0.5),
    (3, "dsmh", "shafer", 0.5),
    (3, "pcr5", "shafer", 3.0),
    (3, "dempster", "shafer", None),
    (3, "yager", "shafer", None),
    (3, "dubois_prade", "shafer", None),
    (3, "disjunctive", "shafer", None),
    (4, "dsmc", "free", 15.0),
    (4, "dsmh", "shafer", None),
    (4, "pcr5", "shafer", None),
)
FREE_HISTORIES = ("dsmc", "dsmh")


def problem(size: int, rule: str, model: Model) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Columns and masses of histories and measurements."""
    random = np.random.default_rng(size)
    focal = hyper_power_set(size)
    if rule not in FREE_HISTORIES:
        # One element of the free model for each element of Shafer's.
        own = np.unique(focal & np.uint32(model.alive))
        focal = np.array([free_element(model, mask) for mask in own[own > 0].tolist()], np.uint32)
    measured = np.array([*singletons(size), total_ignorance(size)], dtype=np.uint32)
    columns = [focal, measured]
    return columns, [random.dirichlet(np.ones(len(column)), ROWS) for column in columns]


def fastest(call: Callable[[], Any], repeats: int) -> tuple[float, float]:
    """Least and median time of a call [s]."""
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        call()
        times.append(time.perf_counter() - begin)
    return min(times), float(np.median(times))


def measure(size: int, rule: str, model: Model) -> dict[str, float]:
    """Time of the table, and of all pairs with it, as a grid and one by one [s]."""
    columns, (histories, measurements) = problem(size, rule, model)
    rule_tables.clear()
    begin = time.perf_counter()
    prepared = rule_table(rule, model, columns)
    table_s = time.perf_counter() - begin
    least, median = fastest(lambda: combine_grid(prepared, histories, measurements), REPEATS)
    left, right = np.divmod(np.arange(ROWS * ROWS), ROWS)
    sources = histories[left], measurements[right]
    _, rows = fastest(lambda: combine_rows(prepared, sources), ROW_REPEATS)
    return {"table_s": table_s, "least_s": least, "median_s": median, "rows_s": rows}


def measure_evidencelib(
    size: int, rule: str, model_name: str, model: Model, pairs: int
) -> dict[str, float] | None:
    """Time of evidencelib for all pairs, from that of the first ones [s], and the difference.

    ``None`` where it is not installed.
    """
    try:
        import evidencelib
    except ImportError:
        return None
    columns, masses = problem(size, rule, model)
    names = model.names
    free = evidencelib.Frame.dsmt(names)
    target = free if model_name == "free" else evidencelib.Frame.dst(names)
    frame = free if rule in FREE_HISTORIES else target
    bodies = [
        [
            frame.mass(
                {element_name(names, m): v for m, v in zip(column.tolist(), row, strict=True)}
            )
            for row in rows
        ]
        for column, rows in zip(columns, masses, strict=True)
    ]
    options = {"model": target} if rule == "dsmh" else {}
    chosen = [(k * 37 % ROWS, k * 61 % ROWS) for k in range(pairs)]
    begin = time.perf_counter()
    fused = [getattr(bodies[0][i], rule)(bodies[1][j], **options) for i, j in chosen]
    taken = (time.perf_counter() - begin) / pairs * ROWS * ROWS
    prepared = rule_table(rule, model, columns)
    grid, _ = combine_grid(prepared, *masses)
    reading = free_model(names) if rule == "dsmc" else model
    difference = max(
        abs(theirs.mass(element_name(names, mask, reading)) - ours)
        for (i, j), theirs in zip(chosen, fused, strict=True)
        for mask, ours in zip(prepared.focal.tolist(), grid[i, j].tolist(), strict=True)
    )
    return {"all_pairs_s": taken, "largest_difference": difference}


def main() -> None:
    """Measure and print all cases."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=40, help="pairs that evidencelib fuses")
    parser.add_argument("--out", type=Path, default=RESULTS / "evidence.json")
    arguments = parser.parse_args()
    if not 1 <= arguments.pairs <= ROWS:
        parser.error(f"--pairs = {arguments.pairs}: allowed is 1 to {ROWS}")
    rows, results = [], []
    for size, rule, model_name, goal_ms in CASES:
        names = tuple("ABCD"[:size])
        model = free_model(names) if model_name == "free" else shafer_model(names)
        ours = measure(size, rule, model)
        theirs = measure_evidencelib(size, rule, model_name, model, arguments.pairs)
        ms = 1e3 * ours["median_s"]
        rows.append(
            [
                f"{rule}, {size} elements, {model_name}",
                goal_ms,
                1e3 * ours["least_s"],
                ms,
                1e3 * ours["rows_s"],
                1e3 * ours["table_s"],
                1e3 * theirs["all_pairs_s"] if theirs else None,
                theirs["all_pairs_s"] / ours["median_s"] if theirs else None,
                theirs["largest_difference"] if theirs else None,
            ]
        )
        results.append(
            {"elements": size, "rule": rule, "model": model_name, "goal_ms": goal_ms, **ours}
            | {"evidencelib": theirs}
        )
    heads = ("100 x 100 pairs", "goal ms", "least ms", "median ms", "rows ms", "table ms")
    print(table([*heads, "evidencelib ms", "times", "difference"], rows))
    print(f"\nevidencelib: {arguments.pairs} pairs, scaled to 10000")
    print(write_results(arguments.out, {"evidencelib_pairs": arguments.pairs, "cases": results}))


if __name__ == "__main__":
    main()
