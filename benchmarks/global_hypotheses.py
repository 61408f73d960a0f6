"""Time of the global-hypothesis engine: best, k best and probabilities of leaves.

``python -m benchmarks.global_hypotheses``: leaves with the detections of the last 8 scans, as an
N-scan tracker has them, of single tracks and groups, and of one dense cluster.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.measuring import RESULTS, table, write_results
from gda_tracker.association.global_hypotheses import (
    best_global_hypothesis,
    k_best_global_hypotheses,
)
from gda_tracker.association.leaf_probabilities import leaf_probabilities

WINDOW = 8
"""Scans of a leaf's history that can be contested."""

MISS, CLUTTER = -3.0, -4.5
"""Log likelihood of a missed detection and of a false alarm, that of the own detection being 0."""

Leaves = tuple[np.ndarray, np.ndarray, np.ndarray]


def group_sizes(tracks: int, random: np.random.Generator) -> list[int]:
    """Half of the tracks alone, the others in groups of two to four."""
    sizes = [1] * (tracks // 2)
    while (left := tracks - sum(sizes)) > 0:
        sizes.append(min(left, int(random.integers(2, 5))))
    return sizes


def make_leaves(
    sizes: list[int], leaves: int, ambiguity: float, random: np.random.Generator, own: bool = True
) -> Leaves:
    """The most likely association histories of each track (log_score, track, used).

    Every track may take the detection of any other one of its group, a false alarm, or none, in
    each scan. One leaf of each track has its own detections only, unless ``own`` is False: then
    nothing guarantees a hypothesis with a leaf of each track.

    Parameters
    ----------
    sizes : list of int
        Tracks of each group.
    leaves : int
        Leaves of each track.
    ambiguity : float
        Standard deviation of the log likelihood of another track's detection; the mean is minus
        that, times the distance of the two in the group.
    random : Generator
    own : bool
        Whether to keep the history of own detections.
    """
    scores, tracks, used = [], [], []
    track = detection = 0
    for size in sizes:
        # Per scan: each member's detection, then one false alarm near the group, then nothing.
        numbers = detection + np.arange(WINDOW * (size + 1)).reshape(WINDOW, size + 1)
        numbers = np.column_stack([numbers, np.full(WINDOW, -1)])
        detection += WINDOW * (size + 1)
        for member in range(size):
            log_likelihood = random.normal(0.0, ambiguity, (WINDOW, size + 2))
            log_likelihood[:, :size] -= ambiguity * np.abs(np.arange(size) - member)
            log_likelihood[:, member] = random.normal(0.0, 1.0, WINDOW)
            log_likelihood[:, size] = random.normal(CLUTTER, 1.0, WINDOW)
            log_likelihood[:, size + 1] = MISS
            histories = np.zeros((1, 0), dtype=np.int64)
            total = np.zeros(1)
            for scan in range(WINDOW):
                total = (total[:, None] + log_likelihood[scan]).ravel()
                histories = np.column_stack(
                    [
                        histories.repeat(size + 2, axis=0),
                        np.tile(numbers[scan], len(histories)),
                    ]
                )
                best = (-total).argsort(kind="stable")[:leaves]
                total, histories = total[best], histories[best]
            right = numbers[:, member]
            if own and not (histories == right).all(axis=1).any():
                total[-1], histories[-1] = log_likelihood[:, member].sum(), right
            scores.append(total)
            tracks.append(np.full(len(total), track))
            used.append(histories)
            track += 1
    return np.concatenate(scores), np.concatenate(tracks), np.concatenate(used)


@dataclass(frozen=True)
class Case:
    """Scenes: ``tracks`` in groups or in one cluster; the rest as in :func:`make_leaves`."""

    grouped: bool
    tracks: int
    leaves: int
    ambiguity: float
    own: bool = True

    def scene(self, seed: int) -> Leaves:
        """One scene."""
        random = np.random.default_rng(seed)
        sizes = group_sizes(self.tracks, random) if self.grouped else [self.tracks]
        return make_leaves(sizes, self.leaves, self.ambiguity, random, self.own)


CASES = {
    "100 x 20, groups of 1-4": Case(True, 100, 20, 2.0),
    "100 x 20, groups of 1-4, ambiguous": Case(True, 100, 20, 0.7),
    "10 x 50, one cluster": Case(False, 10, 50, 2.0),
    "10 x 50, one cluster, ambiguous": Case(False, 10, 50, 0.7),
    "10 x 50, one cluster, tracks to drop": Case(False, 10, 50, 0.7, own=False),
}
"""Name: tracks x leaves."""


def measure(case: str, seeds: int, repeats: int, k: int) -> dict[str, Any]:
    """CPU times [s] of the three functions on several scenes, and what answered."""
    calls: dict[str, Callable[[Leaves], Any]] = {
        "best": lambda scene: best_global_hypothesis(*scene),
        "k_best": lambda scene: k_best_global_hypotheses(*scene, k),
        "probabilities": lambda scene: leaf_probabilities(*scene),
    }
    times: dict[str, list[float]] = {name: [] for name in calls}
    engines: Counter[str] = Counter()
    unproven: Counter[str] = Counter(dict.fromkeys(calls, 0))
    shares = []
    for seed in range(seeds):
        scene = CASES[case].scene(seed)
        for name, call in calls.items():
            for _ in range(repeats):
                begin = time.process_time()
                answer = call(scene)
                times[name].append(time.process_time() - begin)
            if name == "best":
                engines.update(answer.engine)
                unproven[name] += int((~answer.optimal).sum())
            elif name == "k_best":
                unproven[name] += sum(not cluster.optimal for cluster in answer)
            else:
                unproven[name] += int((~answer.exact).sum())
                shares.append(float(answer.share.min()))
    return {
        "median_s": {name: float(np.median(values)) for name, values in times.items()},
        "worst_s": {name: max(values) for name, values in times.items()},
        "engines_of_best": dict(engines),
        "unproven_clusters": dict(unproven),
        "least_share": min(shares),
    }


def main(arguments: list[str] | None = None) -> None:
    """Measure and print all cases."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20, help="scenes of each case")
    parser.add_argument("--repeats", type=int, default=5, help="calls on each scene")
    parser.add_argument("-k", type=int, default=60, help="hypotheses of each cluster")
    parser.add_argument("--out", type=Path, default=RESULTS / "global_hypotheses.json")
    options = parser.parse_args(arguments)
    for name in ("seeds", "repeats", "k"):
        if getattr(options, name) < 1:
            parser.error(f"{name} = {getattr(options, name)}: allowed are integers >= 1")
    measure(next(iter(CASES)), 1, 1, 1)  # first calls load scipy
    results = {case: measure(case, options.seeds, options.repeats, options.k) for case in CASES}
    rows = [
        [
            case,
            *(1e3 * found[kind][name] for name in found["median_s"] for kind in KINDS),
            sum(found["unproven_clusters"].values()),
            found["least_share"],
        ]
        for case, found in results.items()
    ]
    heads = [
        f"{name} {kind}"
        for name in ("best", f"{options.k} best", "prob.")
        for kind in ("ms", "worst")
    ]
    print(table(["scenes", *heads, "unproven", "least share"], rows))
    for case, found in results.items():
        print(f"{case}: {found['engines_of_best']}; unproven {found['unproven_clusters']}")
    print(write_results(options.out, {"k": options.k, "cases": results}))


KINDS = ("median_s", "worst_s")

if __name__ == "__main__":
    main()
