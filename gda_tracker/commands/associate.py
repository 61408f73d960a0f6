"""``gda-tracker associate``: which measurements of several sensors belong together, how surely."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from gda_tracker.association.xmap.answer import answer, answer_json
from gda_tracker.association.xmap.json_values import ProblemError
from gda_tracker.association.xmap.problem import EXAMPLES, example, read_problem
from gda_tracker.association.xmap.solution import AUTO, METHODS, Sampling, solve

STANDARD_INPUT = "-"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    default = Sampling()
    parser.add_argument(
        "problem",
        nargs="?",
        metavar="PROBLEM.json",
        help=f"the problem; {STANDARD_INPUT} reads standard input",
    )
    parser.add_argument(
        "--example",
        nargs="?",
        const=EXAMPLES[0],
        choices=EXAMPLES,
        metavar="NAME",
        help=f"print a problem that can be solved, and end; NAME is {', '.join(EXAMPLES)}, the "
        "example of section 6.1 of the paper",
    )
    parser.add_argument(
        "--top",
        type=int,
        default=20,
        metavar="N",
        help="how many associations to print, the most probable ones (default 20)",
    )
    parser.add_argument(
        "--method",
        choices=METHODS,
        default=AUTO,
        help="enumeration: all associations, up to 1,000,000; gibbs: samples, each association "
        "that was visited scored exactly; auto: enumeration where possible (default)",
    )
    parser.add_argument(
        "--sweeps",
        type=int,
        default=default.sweeps,
        metavar="N",
        help=f"gibbs: sweeps of each of {default.chains} chains (default {default.sweeps})",
    )
    parser.add_argument(
        "--seed",
        type=int,
        default=default.seed,
        metavar="N",
        help=f"gibbs: seed of the random numbers (default {default.seed})",
    )


def run(args: argparse.Namespace) -> int:
    """Solve the problem and print the answer.

    Raises
    ------
    ProblemError
        If the problem cannot be read or solved.
    """
    if (args.problem is None) == (args.example is None):
        raise ProblemError("allowed is either PROBLEM.json or --example; --help explains both")
    for option, least in (("top", 0), ("sweeps", 1), ("seed", 0)):
        if getattr(args, option) < least:
            raise ProblemError(
                f"--{option} {getattr(args, option)}: allowed is an integer >= {least}"
            )
    if args.example is not None:
        print(example(args.example), end="")
        return 0
    problem = read_problem(_content(args.problem))
    sampling = Sampling(sweeps=args.sweeps, seed=args.seed)
    solution = solve(problem.model, problem.data, args.method, sampling)
    print(answer_json(answer(problem, solution, args.top)))
    return 0


def _content(path: str) -> bytes:
    try:
        if path == STANDARD_INPUT:
            return sys.stdin.buffer.read()
        return Path(path).read_bytes()
    except OSError as error:
        raise ProblemError(f"{path}: cannot be read: {error.strerror}") from None
