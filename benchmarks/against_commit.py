"""CPU time per scan of the offline ring, against that of an earlier commit of this repository.

Two processes live side by side, one for each tree, and take turns with the same simulated scans,
many times: what the machine does beside it befalls both alike. The figure is the median over the
turns of the ratio of their CPU times, with its quartiles and a 95 % interval of the median.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binom
from tqdm import tqdm

from benchmarks.measuring import RESULTS, table, write_results

ROOT = Path(__file__).parents[1]
METHODS = ("gda/none/cv", "gda/dsm_classic/cv", "map/none/cv", "jpda/bayes/imm", "mht/bayes/imm")
WORKER = """
import gc, os, sys, time
# Both on one core: others may be slower at the moment.
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
sys.path.insert(0, sys.argv[1])
import gda_tracker
assert gda_tracker.__file__.startswith(sys.argv[1]), gda_tracker.__file__
from gda_tracker.simulation.playback import of_scenario, with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.tracking.ring import Ring
gc.disable()
for line in sys.stdin:
    name, method, runs = line.split()
    scenario = load_scenario(name)
    parameters = with_method(tracker_preset(scenario), method)
    parameters["track_manager"]["initiation"] = "automatic"
    plays = of_scenario(scenario, int(runs), 3, method)
    rings = [Ring(parameters) for _ in plays]
    gc.collect()
    begin, scans = time.process_time(), 0
    for ring, play in zip(rings, plays):
        for detections in play.detections:
            ring.process(detections)
            scans += 1
    print((time.process_time() - begin) / scans, flush=True)
"""


class Worker:
    """A process that times the ring of one tree; to be used in a ``with`` statement."""

    def __init__(self, tree: Path) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", WORKER, str(tree)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        )

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        with suppress(BrokenPipeError):
            self._process.communicate()

    def scan_s(self, scenario: str, method: str, runs: int) -> float:
        """CPU time per scan [s] of so many runs of a scenario.

        Raises
        ------
        RuntimeError
            If the tree cannot do it.
        """
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with suppress(BrokenPipeError):  # it has ended; so it gives no answer
            self._process.stdin.write(f"{scenario} {method} {runs}\n")
            self._process.stdin.flush()
        answer = self._process.stdout.readline()
        if not answer:
            raise RuntimeError(f"{scenario} {method}: the process has ended, see above")
        return float(answer)


def summary(before: Sequence[float], now: Sequence[float]) -> dict[str, float]:
    """Medians [ms] of paired CPU times [s], and of their ratio, with an interval of 95 %.

    The interval of the ratio's median is that of the sign test: order statistics.
    """
    ratios = np.sort(np.asarray(now) / np.asarray(before))
    outside = int(binom.ppf(0.025, len(ratios), 0.5))
    outside = max(outside - 1, 0)
    return {
        "before_ms": 1e3 * float(np.median(before)),
        "now_ms": 1e3 * float(np.median(now)),
        "ratio": float(np.median(ratios)),
        "ratio_lowest": float(ratios[outside]),
        "ratio_highest": float(ratios[-1 - outside]),
        "turns": len(ratios),
    }


def compare(
    trees: tuple[Path, Path], cases: Sequence[tuple[str, str]], turns: int, runs: int
) -> list[dict[str, Any]]:
    """Time cases (scenario, method) in two trees, the earlier one first, turn by turn.

    Returns
    -------
    list of dict
        :func:`summary` of each case, with ``scenario`` and ``method``.
    """
    times: dict[tuple[str, str], tuple[list[float], list[float]]] = {c: ([], []) for c in cases}
    with ExitStack() as stack:
        workers = [stack.enter_context(Worker(tree)) for tree in trees]
        for turn in tqdm(range(turns + 1), desc="turns", disable=None):
            for case in cases:
                # Who begins changes from turn to turn.
                for place in (0, 1) if turn % 2 else (1, 0):
                    found = workers[place].scan_s(*case, runs)
                    if turn:  # the first one warms up
                        times[case][place].append(found)
    return [
        {"scenario": scenario, "method": method, **summary(*times[scenario, method])}
        for scenario, method in cases
    ]


def _git(*words: str) -> str:
    return subprocess.run(
        ["git", "-C", str(ROOT), *words], check=True, capture_output=True, text=True
    ).stdout.strip()


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare, print and write."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.against_commit", description=__doc__.splitlines()[0]
    )
    parser.add_argument("commit", help="the earlier commit, as git names it")
    parser.add_argument("--turns", type=int, default=40, help="default: 40")
    parser.add_argument("--runs", type=int, default=3, help="runs of a turn, default: 3")
    parser.add_argument("--scenario", action="append", metavar="NAME", help="may be repeated")
    parser.add_argument("--method", action="append", metavar="METHOD", help="may be repeated")
    parser.add_argument("--json", type=Path, default=RESULTS / "against_commit.json")
    words = parser.parse_args(arguments)
    if words.turns < 1 or words.runs < 1:
        parser.error(f"--turns {words.turns} --runs {words.runs}: allowed are integers >= 1")
    scenarios = words.scenario or ["crossing_targets"]
    cases = [(name, method) for name in scenarios for method in words.method or METHODS]
    try:
        commit = _git("rev-parse", "--verify", "--short", f"{words.commit}^{{commit}}")
    except subprocess.CalledProcessError:
        parser.error(f"commit {words.commit}: git does not know it")
    with tempfile.TemporaryDirectory(prefix="gda_tracker_") as folder:
        tree = Path(folder) / "tree"
        _git("worktree", "add", "--detach", "--force", str(tree), commit)
        try:
            rows = compare((tree, ROOT), cases, words.turns, words.runs)
        finally:
            _git("worktree", "remove", "--force", str(tree))
    print(f"CPU time per scan, against {commit}; the median of {words.turns} paired ratios\n")
    columns = ("case", "before ms", "now ms", "ratio", "lowest", "highest")
    print(
        table(
            columns,
            [
                [f"{row['scenario']} {row['method']}"]
                + [row[name] for name in ("before_ms", "now_ms")]
                + [f"{row[name]:.3f}" for name in ("ratio", "ratio_lowest", "ratio_highest")]
                for row in rows
            ],
        )
    )
    print(f"\n{write_results(words.json, {'commit': commit, 'cases': rows})}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
