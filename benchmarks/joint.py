"""Time of exact joint probabilities at scale, and the error of loopy belief propagation.

Scenes of gated pairs with radar-like weights (P_d = 0.9, gate of 9.2, likelihoods and clutter as in
the scenarios) are clustered and answered as in the association stage, by whatever engine it
chooses. Then loopy belief propagation answers all of them, and is compared with the exact marginals
of the gated pairs. One core; median and least wall clock, and median CPU time, of the repetitions.

    python -m benchmarks.joint
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.measuring import RESULTS, table, write_results
from gda_tracker.association.choices import ENGINES
from gda_tracker.association.cluster_marginals import (
    ClusterMarginals,
    EngineLimits,
    cluster_marginals,
)
from gda_tracker.association.clustering import find_clusters
from gda_tracker.association.generalised import kinematic_weights

REPEATS = 20
GATE = 9.2


class Case(NamedTuple):
    """A gate (n, m), the goal and the spread of further log weights added to tracks and pairs."""

    name: str
    gate: np.ndarray
    goal_ms: float | None
    log_spread: float = 0.0


def chain(tracks: int, reach: int) -> np.ndarray:
    """Tracks in a row, each with the next ``reach`` of tracks + reach - 1 detections."""
    step = np.arange(tracks + reach - 1) - np.arange(tracks)[:, None]
    return (step >= 0) & (step < reach)


def clumps(tracks: int, linked: bool, seed: int = 1) -> np.ndarray:
    """Dense clumps of 4 to 8 tracks; linked ones share a detection with their neighbours."""
    random = np.random.default_rng(seed)
    gate = np.zeros((tracks, tracks), dtype=bool)
    first = 0
    while first < tracks:
        end = min(first + int(random.integers(4, 9)), tracks)
        gate[first:end, first:end] = True
        if linked and first:
            gate[first, first - 1] = gate[first - 1, first] = True
        first = end
    return gate


CASES = (
    Case("dense, 12 x 12", np.ones((12, 12), dtype=bool), 20.0),
    Case("dense, 14 x 14", np.ones((14, 14), dtype=bool), 100.0),
    Case("chain of 50 tracks, 4 detections each", chain(50, 4), 60.0),
    Case("the same, log weights spread over 2000", chain(50, 4), 60.0, 2000.0),
    Case("200 tracks in clumps of 4 to 8", clumps(200, False), 100.0),
    Case("the same, clumps linked in a row", clumps(200, True), 100.0),
    Case("chain of 400 tracks, 4 detections each", chain(400, 4), None),
)


class Problem(NamedTuple):
    """Gated pairs (P,) in random order of tracks and detections, and their log likelihoods."""

    track: np.ndarray
    detection: np.ndarray
    log_likelihood: np.ndarray
    shape: tuple[int, int]


def problem(case: Case, seed: int = 2) -> Problem:
    """Draw the weights of a case and shuffle its tracks and detections."""
    random = np.random.default_rng(seed)
    n, m = case.gate.shape
    shuffled = case.gate[np.ix_(random.permutation(n), random.permutation(m))]
    track, detection = (index.astype(np.int32) for index in np.nonzero(shuffled))
    log_likelihood = np.log(1e-4) - 0.5 * random.uniform(0.0, GATE, len(track))
    if case.log_spread:
        log_likelihood += random.uniform(-0.5, 0.5, len(track)) * case.log_spread
    return Problem(track, detection, log_likelihood, (n, m))


def answer(data: Problem, limits: EngineLimits) -> ClusterMarginals:
    """Cluster the pairs and compute their marginals, as the association stage does."""
    n, m = data.shape
    clusters = find_clusters(data.track, data.detection, n, m)
    weights = kinematic_weights(data.track, data.log_likelihood, np.full(n, 0.9), 1e-6, m)
    return cluster_marginals(clusters, [weights], limits)


def times_ms(data: Problem, limits: EngineLimits, repeats: int) -> np.ndarray:
    """Wall clock and CPU time (repeats, 2) of an answer, after one that makes the index tables."""
    answer(data, limits)
    times = []
    for _ in range(repeats):
        begin = time.perf_counter(), time.process_time()
        answer(data, limits)
        times.append((time.perf_counter() - begin[0], time.process_time() - begin[1]))
    return 1e3 * np.array(times)


def measure(case: Case, repeats: int) -> dict[str, Any]:
    """Engines, times and the error of the approximation, of one case."""
    data = problem(case)
    limits, loopy_limits = EngineLimits(), EngineLimits(max_exact_size=1)
    found, loopy = answer(data, limits), answer(data, loopy_limits)
    engines = {ENGINES[index] for index in found.engine.tolist()}
    exact_ms = times_ms(data, limits, repeats)
    error = np.abs(loopy.marginals - found.marginals)
    return {
        "case": case.name,
        "pairs": len(data.track),
        "clusters": len(found.engine),
        "engines": sorted(engines),
        "goal_ms": case.goal_ms,
        "least_ms": float(exact_ms[:, 0].min()),
        "median_ms": float(np.median(exact_ms[:, 0])),
        "median_cpu_ms": float(np.median(exact_ms[:, 1])),
        "loopy_engines": sorted({ENGINES[index] for index in loopy.engine.tolist()}),
        "loopy_ms": float(np.median(times_ms(data, loopy_limits, repeats)[:, 0])),
        "loopy_converged": bool(loopy.converged.all()),
        "loopy_mean_error": float(error.mean()),
        "loopy_largest_error": float(error.max()),
    }


def main(arguments: list[str] | None = None) -> None:
    """Measure and print all cases."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=REPEATS)
    parser.add_argument("--out", type=Path, default=RESULTS / "joint.json")
    options = parser.parse_args(arguments)
    if options.repeats < 1:
        parser.error(f"--repeats = {options.repeats}: allowed is >= 1")
    results = [measure(case, options.repeats) for case in CASES]
    heads = ("case", "engine", "goal ms", "median ms", "CPU ms", "least ms")
    heads += ("loopy ms", "mean error", "largest", "converged")
    rows = [
        [
            result["case"],
            " ".join(name.removesuffix("_dynamic_programming") for name in result["engines"]),
            *(result[f"{name}_ms"] for name in ("goal", "median", "median_cpu", "least", "loopy")),
            *(result[name] for name in ("loopy_mean_error", "loopy_largest_error")),
            "yes" if result["loopy_converged"] else "no",
        ]
        for result in results
    ]
    print(table(heads, rows))
    print(f"\n{write_results(options.out, {'repeats': options.repeats, 'cases': results})}")


if __name__ == "__main__":
    main()
