"""``gda-tracker tune``: search parameters that suit a radar, and say what they are worth."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from gda_tracker.commands.options import add_parameter_options, add_preset_option
from gda_tracker.commands.progress import progress_bar
from gda_tracker.commands.tune_inputs import load_cases, one_base, refuse_seen, search_space
from gda_tracker.commands.tune_outputs import command_line, tell_result, with_radar, write_result
from gda_tracker.errors import UserError
from gda_tracker.evaluation.figures import require_matplotlib
from gda_tracker.evaluation.processes import available_cores
from gda_tracker.io.truth_files import read_truth
from gda_tracker.tuning.comparison import compare
from gda_tracker.tuning.objectives import OBJECTIVES, choose, parse_objectives
from gda_tracker.tuning.report import Result, importances
from gda_tracker.tuning.search import (
    Found,
    Outcome,
    Problem,
    open_study,
    results,
    score_points,
    search,
)
from gda_tracker.tuning.storage import open_storage, require_optuna
from gda_tracker.tuning.workers import Workers

MOST_WORKERS = 8


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument(
        "recordings",
        nargs="+",
        metavar="RECORDING",
        help="bag, file, or scenario name: what the search scores parameters on",
    )
    parser.add_argument(
        "--held-back",
        action="append",
        default=[],
        metavar="RECORDING",
        help="not searched on: default and result are compared on it; may be repeated",
    )
    parser.add_argument(
        "--truth",
        action="append",
        default=[],
        type=Path,
        metavar="FILE",
        help="true positions for recordings that bring none: CSV with time_s, target_id, x_m, y_m, "
        "or a bag with truth; may be repeated, each scan takes what is known at its time",
    )
    parser.add_argument(
        "--complete-truth",
        action="store_true",
        help="the truth knows all that the radar sees, so every other track is false (without it "
        "only for simulations)",
    )
    parser.add_argument(
        "--objective",
        action="append",
        metavar="NAME",
        help=f"one of {', '.join(OBJECTIVES)}; may be repeated for a trade-off (default: gospa)",
    )
    parser.add_argument(
        "--parameter",
        action="append",
        default=[],
        metavar="NAME=LOW:HIGH[:log]",
        help="search this one, in this range, or NAME=ONE|OTHER for choices; may be repeated. "
        "These alone are searched then, with --parameter default also the default ones",
    )
    parser.add_argument(
        "--trials", type=int, default=100, metavar="N", help="of the study in all (default: 100)"
    )
    parser.add_argument(
        "--runs",
        type=int,
        default=10,
        metavar="N",
        help="simulated runs of a scenario (default: 10)",
    )
    parser.add_argument(
        "--seed", type=int, default=0, metavar="S", help="of search and simulation (default: 0)"
    )
    parser.add_argument(
        "--output",
        type=Path,
        default=Path("results/tune"),
        metavar="FOLDER",
        help="report.html, tuned.yaml, result.json, pictures (default: results/tune)",
    )
    parser.add_argument(
        "--storage",
        metavar="URL",
        help="NAME.journal, sqlite:///FILE or a database's URL; several commands may share it "
        "(default: study.journal in the output folder)",
    )
    parser.add_argument(
        "--study",
        default="tune",
        metavar="NAME",
        help="of the study in the storage (default: tune)",
    )
    parser.add_argument(
        "--workers", type=int, metavar="N", help="processes (default: one per core, at most 8)"
    )
    parser.add_argument(
        "--time-limit",
        type=float,
        default=0.0,
        metavar="S",
        help="a trial that takes longer fails (default: no limit)",
    )
    parser.add_argument(
        "--pick", type=int, metavar="TRIAL", help="take this trial in place of the best"
    )
    parser.add_argument(
        "--match-distance",
        type=float,
        metavar="M",
        help="how far a track may be from its target, and the cut-off of GOSPA (default: 25; for "
        "scenarios three standard deviations of a measured position)",
    )
    parser.add_argument(
        "--adapter", default="auto", metavar="NAME", help="how to read recordings (default: auto)"
    )
    parser.add_argument("--topic", metavar="NAME", help="topic of a bag with several radars")
    add_preset_option(parser)
    add_parameter_options(parser)


def run(args: argparse.Namespace) -> int:
    """Search, compare, write."""
    require_optuna()
    require_matplotlib()
    _check(args)
    tables = [read_truth(path) for path in args.truth]
    loaded = [load_cases(name, args, tables, args.seed) for name in args.recordings]
    cases = [case for one, _ in loaded for case in one]
    # Of a scenario that is both searched and held back other runs are taken.
    spare = [load_cases(name, args, tables, args.seed + 1) for name in args.held_back]
    held_back = [case for one, _ in spare for case in one]
    base = one_base(loaded + spare, args.recordings + args.held_back)
    objectives = parse_objectives(args.objective or ["gospa"], cases + held_back)
    space = search_space(args.parameter, base, cases)
    refuse_seen(cases, held_back)
    problem = Problem(base, space, objectives, cases, args.seed)
    args.output.mkdir(parents=True, exist_ok=True)
    url = args.storage or str(args.output / "study.journal")
    study = open_study(problem, open_storage(url), args.study)
    workers = args.workers or min(available_cores(), MOST_WORKERS)
    print(f"search: {', '.join(item.name for item in space)}")
    sys.stdout.flush()
    try:
        with (
            Workers(cases, workers, args.time_limit) as pool,
            progress_bar(args.trials, "trials", "tune") as bar,
        ):
            search(problem, study, pool, args.trials, lambda done, _: bar(done))
    except KeyboardInterrupt:
        print(f"\nstudy {args.study} is kept in {url}; the same command goes on", file=sys.stderr)
        raise
    found = results(problem, study)
    chosen = _chosen(problem, found, args.pick)
    comparison = None
    if held_back:
        winner = chosen or found.baseline
        with Workers(held_back, workers) as pool:
            default, tuned = score_points([base, problem.parameters(winner.point)], pool)
        comparison = compare(objectives, default, tuned, args.seed)
    told = importances(study, problem, found)
    result = Result(problem, found, chosen, comparison, told, command_line(args))
    write_result(result, with_radar(base, args), args.output)
    tell_result(result, args.output)
    return 0


def _check(args: argparse.Namespace) -> None:
    for option, value in (("trials", args.trials), ("runs", args.runs), ("workers", args.workers)):
        if value is not None and value < 1:
            raise UserError(f"--{option} {value}: allowed is an integer >= 1")
    if args.seed < 0:
        raise UserError(f"--seed {args.seed}: allowed is an integer >= 0")
    if not args.time_limit >= 0.0:
        raise UserError(f"--time-limit {args.time_limit}: allowed is a number >= 0 [s]")


def _chosen(problem: Problem, found: Found, pick: int | None) -> Outcome | None:
    if pick is not None:
        for trial in found.trials:
            if trial.number == pick:
                return trial
        raise UserError(f"--pick {pick}: the study has no such trial with a result")
    values = [trial.values for trial in found.trials]
    place = choose(problem.objectives, found.baseline.values, values)
    return None if place is None else found.trials[place]
