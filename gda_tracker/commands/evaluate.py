"""``gda-tracker evaluate``: methods on simulated scenarios, or on real trajectories."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from gda_tracker.errors import UserError
from gda_tracker.evaluation import command
from gda_tracker.evaluation.command import HELP, check_writable, progress_on_stderr
from gda_tracker.evaluation.recordings import DEFAULT_METHODS, format_scores, score_method
from gda_tracker.io.adapters import InputOptions, load_recording
from gda_tracker.parameters import ParameterError
from gda_tracker.tracking.methods import parse_method

__all__ = ["HELP", "add_arguments", "run"]

# Adapters whose recordings are trajectories; the radar is simulated and the truth complete.
TRAJECTORY_ADAPTERS = ("ais", "uav")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add description, arguments and examples."""
    command.add_arguments(parser)
    parser.add_argument(
        "--adapter",
        choices=TRAJECTORY_ADAPTERS,
        help="the argument is a file of trajectories, seen by a simulated radar",
    )


def run(args: argparse.Namespace) -> int:
    """Run ``evaluate``; return the exit code: 0, 2 for a wrong argument, 130 after Ctrl-C."""
    if not args.adapter:
        return command.run(args)
    try:
        return _on_trajectories(args)
    except (UserError, OSError) as error:
        print(f"gda-tracker evaluate: {error}", file=sys.stderr)
        return 2


def _on_trajectories(args: argparse.Namespace) -> int:
    """Methods on real trajectories that a simulated radar sees."""
    for option in ("report", "workers"):
        if getattr(args, option) is not None:
            raise ParameterError(f"--{option}: allowed with scenarios only")
    for option in ("confusion", "formations"):
        if getattr(args, option):
            raise ParameterError(f"--{option}: allowed with scenarios only")
    runs = 1 if args.runs is None else args.runs
    if runs < 1:
        raise ParameterError(f"--runs {runs}: allowed is an integer >= 1")
    check_writable("--json", args.json)
    methods = list(dict.fromkeys(args.methods or DEFAULT_METHODS))
    for method in methods:
        parse_method(method)
    content = []
    for name in args.scenarios:
        recordings = [
            load_recording(name, args.adapter, InputOptions(seed=args.seed, run=run))
            for run in range(runs)
        ]
        with progress_on_stderr() as progress:
            scores = []
            for number, method in enumerate(methods, 1):
                scores.append(score_method(recordings, method, args.match_distance))
                progress(runs * number, runs * len(methods))
        print(format_scores(recordings[0].name, scores))
        content.append({"recording": Path(name).name, "methods": [s.to_dict() for s in scores]})
    if args.json:
        text = json.dumps(content, indent=2, allow_nan=False)
        Path(args.json).write_text(text + "\n", encoding="utf-8")
    return 0
