"""``gda-tracker calibrate``: associations with a probability of 23 % shall be true in 23 %."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from gda_tracker.commands.progress import progress_bar
from gda_tracker.evaluation.calibration import EXACT, VARIANTS, calibrate_ferry
from gda_tracker.evaluation.calibration_report import format_tables, rows_of, verdict
from gda_tracker.evaluation.figures import png, reliability, require_matplotlib
from gda_tracker.evaluation.monte_carlo import available_cores
from gda_tracker.parameters import ParameterError

SUBJECTS = ("ferry",)
FAILED_EXIT_CODE = 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("subject", choices=SUBJECTS, help="whose probabilities: ferry")
    parser.add_argument(
        "--runs", type=int, default=10_000, metavar="N", help="scenes (default 10000)"
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="default 0")
    parser.add_argument(
        "--variant",
        choices=VARIANTS,
        default=EXACT,
        help=f"what the computation ignores, though it is simulated (default {EXACT}: nothing)",
    )
    parser.add_argument(
        "--plot", metavar="FILE.png", help="draw the reliability: computed against true shares"
    )
    parser.add_argument("--json", metavar="FILE", help="write the rows of both tables, all digits")
    parser.add_argument(
        "--workers", type=int, metavar="N", help="processes (default: one per core)"
    )


def run(args: argparse.Namespace) -> int:
    """Calibrate; return 0, or 1 if the probabilities are not true.

    Raises
    ------
    ParameterError
        If an argument is not allowed, before anything is simulated.
    """
    for option in ("plot", "json"):
        _check_writable(f"--{option}", getattr(args, option))
    if args.plot is not None:
        require_matplotlib()
    workers = available_cores() if args.workers is None else args.workers
    with progress_bar(args.runs, "runs") as progress:
        tally = calibrate_ferry(args.runs, args.seed, args.variant, workers, progress)
    passed, words = verdict(tally)
    print(format_tables(tally))
    print(words)
    if args.json is not None:
        content = {
            "subject": args.subject,
            "runs": args.runs,
            "seed": args.seed,
            "variant": args.variant,
            "calibrated": passed,
            "table_v": rows_of(tally)[:-1],
            "table_vi": rows_of(tally)[-1],
        }
        text = json.dumps(content, indent=2, allow_nan=False)
        Path(args.json).write_text(text + "\n", encoding="utf-8")
    if args.plot is not None:
        title = f"Ferry 2010, section 6.2: {args.runs} runs, {args.variant.replace('_', ' ')}"
        Path(args.plot).write_bytes(png(reliability(tally, title)))
    return 0 if passed else FAILED_EXIT_CODE


def _check_writable(option: str, path: str | None) -> None:
    if path is None:
        return
    if Path(path).is_dir():
        raise ParameterError(f"{option} {path}: is a folder, allowed is a file")
    folder = Path(path).resolve().parent
    if not folder.is_dir():
        raise ParameterError(f"{option} {path}: the folder {folder} does not exist")
