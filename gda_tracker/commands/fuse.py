"""``gda-tracker fuse``: combine bodies of evidence by any rule, JSON in, JSON out."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

from gda_tracker.evidence.calculator import solve
from gda_tracker.evidence.problem import RULES, Problem, ProblemError, read_problem
from gda_tracker.evidence.rules import TotalConflictError

STANDARD_INPUT = "-"
UNDEFINED_EXIT_CODE = 3

# Without exclusive elements these rules meet no conflict.
_NEEDS_CONSTRAINTS = ("dsmh", "dempster", "yager", "dubois_prade", "pcr5", "pcr6")

_CONSTRAINED: dict[str, Any] = {
    "frame": ["A", "B", "C"],
    "model": {"empty": ["A&B"]},
    "sources": [{"A": 0.3, "A|B": 0.7}, {"B": 0.6, "A&C": 0.1, "A|B|C": 0.3}],
}
_ONE_SOURCE = {**_CONSTRAINED, "sources": _CONSTRAINED["sources"][1:]}


def example(rule: str) -> dict[str, Any]:
    """Return a problem that can be solved, for a rule of ``RULES``."""
    if rule == "discount":
        return {**_ONE_SOURCE, "rule": rule, "reliability": 0.85}
    if rule == "pignistic":
        return {**_ONE_SOURCE, "rule": rule}
    return {**_CONSTRAINED, "rule": rule}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "problem",
        nargs="?",
        metavar="PROBLEM.json",
        help=f"the problem; {STANDARD_INPUT} reads standard input",
    )
    parser.add_argument(
        "--example",
        nargs="?",
        const="dsmh",
        choices=RULES,
        metavar="RULE",
        help=f"print a problem that can be solved, and end; RULE is one of {', '.join(RULES)} "
        "(default dsmh)",
    )


def run(args: argparse.Namespace) -> int:
    """Solve the problem; return 0, or 3 where the rule has no answer.

    Raises
    ------
    ProblemError
        If the problem cannot be read.
    """
    if (args.problem is None) == (args.example is None):
        raise ProblemError("allowed is either PROBLEM.json or --example; --help explains both")
    if args.example is not None:
        print(json.dumps(example(args.example)))
        return 0
    problem = read_problem(_content(args.problem))
    for note in notes(problem):
        print(f"gda-tracker fuse: note: {note}", file=sys.stderr)
    try:
        solutions = [asdict(solution) for solution in solve(problem)]
    except TotalConflictError:
        print(json.dumps({"undefined": "total conflict"}))
        return UNDEFINED_EXIT_CODE
    answer = solutions[0] if len(solutions) == 1 else solutions
    # json writes the shortest digits that read back as the same number.
    print(json.dumps(answer, indent=2, allow_nan=False))
    return 0


def notes(problem: Problem) -> list[str]:
    """What in a valid problem may not mean what its author thinks, a line each."""
    found = []
    if problem.reliability is not None and problem.rule != "discount":
        found.append(f"reliability is for rule discount; {problem.rule} makes no use of it")
    if not problem.model_given and problem.rule in _NEEDS_CONSTRAINTS:
        found.append(
            f"no model: on the free model nothing is in conflict, so {problem.rule} is dsmc; "
            '"model": "shafer" makes the elements exclusive'
        )
    return found


def _content(path: str) -> bytes:
    try:
        if path == STANDARD_INPUT:
            return sys.stdin.buffer.read()
        return Path(path).read_bytes()
    except OSError as error:
        raise ProblemError(f"{path}: cannot be read: {error.strerror}") from None
