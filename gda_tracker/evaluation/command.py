"""The command ``gda-tracker evaluate``."""

from __future__ import annotations

import argparse
import json
import math
import shlex
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from gda_tracker.evaluation.evaluation_report import evaluation_report
from gda_tracker.evaluation.monte_carlo import DEFAULT_METHODS, Progress, monte_carlo
from gda_tracker.evaluation.results import ScenarioResult
from gda_tracker.evaluation.runs import INITIATIONS, LABELLED
from gda_tracker.evaluation.table import format_result
from gda_tracker.formations.parameters import FormationParameters
from gda_tracker.parameters import ParameterError
from gda_tracker.simulation.scenarios import load_scenario, shipped_scenarios

HELP = "how well do methods associate? Monte Carlo on simulated scenarios"

DESCRIPTION = """\
Simulates a scenario many times, tracks every run with every method on the same
scans, and prints how often each track got the detection of its own target.

A method is decision/attribute/filter:
  decision   gda  the 2004 chapter: 1 - P_k P_a and Munkres
             map  the most probable joint hypothesis
             mht  over several scans: hypothesis trees, revised for 8 scans
                  (docs/mht.md)
             jpda all detections in the gate, each as far as it is probable;
                  scored by the most probable joint hypothesis
  attribute  none         kinematics alone
             dsm_classic, dsm_hybrid, dempster, yager, dubois_prade, pcr5, pcr6
                          masses on the radar cross section (RCS), by that rule
             bayes        class likelihoods of the RCS
             (docs/attribute-terms.md has all of them measured)
  filter     cv   constant velocity
             imm  two models of it with different process noise, interacting
or clairvoyant: the own detection whenever it is there and in the gate, the bound
for all of them.

Reading the table
  purity      share of scans on which a track got its own target's detection,
              mean over tracks and runs, +- its standard error. One run's purity
              scatters by about 0.27: compare methods by the paired difference,
              not by two purities from different calls.
  delayed     the same with the past as it is seen N scans later, for methods
              that revise it (mht)
  missed, FA  share of scans on which a track got no detection, or a false alarm
  CPU         processor time of the whole ring per scan, one core

With --initiation automatic there are four tables instead (docs/measures.md): continuity
(completeness, identity switches, false tracks), GOSPA with its parts and OSPA, extraction
delay and life of false tracks, and consistency (NEES, NIS); with --formations two more.

With --adapter ais or uav the argument is a file of real trajectories, seen by a simulated
radar (docs/simulated-radar.md); the whole tracker runs, and completeness, switches, false
tracks and GOSPA are printed. Methods: default, map/none/cv and mht/none/imm, unless named.
"""

EXAMPLES = """\
examples:
  gda-tracker evaluate crossing_targets --runs 50
  gda-tracker evaluate crossing_targets closely_spaced_targets --runs 200 --seed 1 \\
      --method gda/none/cv --method map/bayes/cv --method clairvoyant --json out.json
  gda-tracker evaluate my_scenario.yaml --initiation automatic --report report.html
  gda-tracker evaluate data/trajectories/uav.csv --adapter uav --runs 3
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add description, arguments and examples of ``evaluate`` to its parser."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description = DESCRIPTION
    parser.epilog = f"shipped scenarios: {', '.join(shipped_scenarios())}\n\n{EXAMPLES}"
    parser.add_argument(
        "scenarios",
        nargs="+",
        metavar="SCENARIO",
        help="name of a shipped scenario, or a YAML file; with --adapter a file of trajectories",
    )
    parser.add_argument(
        "--runs", type=int, metavar="N", help="runs (default 100, with --adapter 1)"
    )
    parser.add_argument(
        "--seed",
        type=int,
        default=0,
        metavar="S",
        help="the results depend on this alone, not on the number of workers (default 0)",
    )
    parser.add_argument(
        "--method",
        action="append",
        dest="methods",
        metavar="M",
        help="may be repeated; differences are to the first (default: "
        + ", ".join(DEFAULT_METHODS)
        + ")",
    )
    parser.add_argument(
        "--initiation",
        choices=INITIATIONS,
        default=LABELLED,
        help="labelled: tracks start from the labelled detections of the first scans, as in the "
        "chapter (default). automatic: the whole tracker, which reports continuity, GOSPA, false "
        "tracks and consistency",
    )
    parser.add_argument(
        "--match-distance",
        type=float,
        metavar="M",
        help="automatic: how far a track may be from its target, and the cut-off of GOSPA and "
        "OSPA, in m (default: three standard deviations of a measured position)",
    )
    parser.add_argument(
        "--formations",
        action="store_true",
        help="automatic: follow formations too, and score their numbers, splits and mergers "
        "(docs/formations.md)",
    )
    parser.add_argument(
        "--confusion", action="store_true", help="print whose detections each track got"
    )
    parser.add_argument(
        "--json",
        metavar="FILE",
        help="write the results to FILE; one scenario gives an object, several a list",
    )
    parser.add_argument(
        "--report", metavar="FILE", help="write tables and pictures to FILE, one HTML page"
    )
    parser.add_argument(
        "--workers", type=int, metavar="N", help="processes (default: one per core)"
    )


def run(args: argparse.Namespace) -> int:
    """Run ``evaluate``; return the exit code: 0, 2 for a wrong argument, 130 after Ctrl-C."""
    try:
        args.runs = 100 if args.runs is None else args.runs
        scenarios = [load_scenario(name) for name in args.scenarios]
        check_writable("--json", args.json)
        check_writable("--report", args.report)
        with progress_on_stderr() as progress:
            results = monte_carlo(
                scenarios,
                args.methods or DEFAULT_METHODS,
                args.runs,
                args.seed,
                initiation=args.initiation,
                match_distance_m=args.match_distance,
                workers=args.workers,
                progress=progress,
                formations=FormationParameters() if args.formations else None,
            )
        for result in results:
            print(format_result(result, args.confusion))
        if args.json:
            write_json(Path(args.json), results)
        if args.report:
            page = evaluation_report(results, command_line(args))
            Path(args.report).write_text(page, encoding="utf-8")
    except (ParameterError, OSError) as error:
        print(f"gda-tracker evaluate: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("gda-tracker evaluate: interrupted", file=sys.stderr)
        return 130
    return 0


def command_line(args: argparse.Namespace) -> str:
    """The command that makes the same results again."""
    words = ["gda-tracker", "evaluate", *args.scenarios, "--runs", str(args.runs)]
    words += ["--seed", str(args.seed), "--initiation", args.initiation]
    if args.match_distance is not None:
        words += ["--match-distance", str(args.match_distance)]
    if args.formations:
        words.append("--formations")
    for method in args.methods or DEFAULT_METHODS:
        words += ["--method", method]
    return shlex.join(words)


def write_json(path: Path, results: list[ScenarioResult]) -> None:
    """Write one result as an object, several as a list."""
    content: Any = [result.to_dict() for result in results]
    if len(content) == 1:
        content = content[0]
    path.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")


@contextmanager
def progress_on_stderr() -> Iterator[Progress]:
    """Show progress on stderr: a bar on a terminal with tqdm installed, else lines."""
    if sys.stderr.isatty():
        try:
            from tqdm import tqdm
        except ImportError:
            pass
        else:
            with tqdm(unit="run", file=sys.stderr, leave=False) as bar:

                def advance(done: int, total: int) -> None:
                    bar.total = total
                    bar.update(done - bar.n)

                yield advance
            return
    yield _Lines()


class _Lines:
    """A line at the first progress, every few seconds, and when done."""

    PERIOD_S = 5.0

    def __init__(self) -> None:
        self._last = -math.inf

    def __call__(self, done: int, total: int) -> None:
        now = time.monotonic()
        if done == total or now - self._last >= self.PERIOD_S:
            print(f"{done}/{total} runs", file=sys.stderr, flush=True)
            self._last = now


def check_writable(option: str, path: str | None) -> None:
    """Find out before the runs, not after them, that the file cannot be written."""
    if path is None:
        return
    folder = Path(path).resolve().parent
    if not folder.is_dir():
        raise ParameterError(f"{option} {path}: the folder {folder} does not exist")
    if Path(path).is_dir():
        raise ParameterError(f"{option} {path}: is a folder, allowed is a file")
