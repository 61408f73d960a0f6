"""``gda-tracker demo``: a real recording and two crossing targets through the four nodes."""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from gda_tracker.commands.demo_play import DemoError, Part, Played, play_part
from gda_tracker.commands.progress import progress_bar
from gda_tracker.evaluation.figures.canvas import MissingPlotLibraryError, require_matplotlib
from gda_tracker.evaluation.runs import default_match_distance_m
from gda_tracker.evaluation.statistics import mean_and_stderr
from gda_tracker.evaluation.summary import (
    Summary,
    format_table,
    paired_difference,
    summarise,
    summary_table,
)
from gda_tracker.parameters import ParameterError
from gda_tracker.resources import resource
from gda_tracker.simulation.playback import of_recording, of_scenario, with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.tracking.ring import stage_parameters
from gda_tracker.vocabulary.recordings import Recording

DEFAULT_OUT = Path("results", "demo")
DEFAULT_RUNS = 20
DEFAULT_SEED = 1
MOST_RUNS = 1000
# A boat is 5 to 15 m long, and the truth is its antenna.
BOAT_MATCH_DISTANCE_M = 25.0
SCENARIO = "crossing_targets"
RCS_OFF, RCS_ON = "gda/none/cv", "gda/dsm_classic/cv"

REPORT, SCORES = "report.html", "scores.json"
FOLDERS = AUTOFERRY, OFF, ON = "autoferry_16", "crossing_rcs_off", "crossing_rcs_on"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument(
        "--out",
        type=Path,
        default=DEFAULT_OUT,
        metavar="DIR",
        help=f"folder for report and bags; an earlier demo in it is replaced ({DEFAULT_OUT})",
    )
    parser.add_argument(
        "--runs",
        type=int,
        default=DEFAULT_RUNS,
        metavar="N",
        help=f"runs of the crossing targets per method ({DEFAULT_RUNS})",
    )
    parser.add_argument(
        "--seed",
        type=int,
        default=DEFAULT_SEED,
        metavar="S",
        help=f"seed of the crossing targets ({DEFAULT_SEED})",
    )
    parser.add_argument(
        "--set-valued",
        action="store_true",
        help="instead: three crossing tracks by sets (Stirling & Thompson 1991), some seconds",
    )


def run(args: argparse.Namespace) -> int:
    """Run the demo; return 0, or 1 after one line on what is wrong."""
    began = time.monotonic()
    if not 1 <= args.runs <= MOST_RUNS:
        raise ParameterError(f"--runs {args.runs}: allowed is an integer >= 1 and <= {MOST_RUNS}")
    if args.seed < 0:
        raise ParameterError(f"--seed {args.seed}: allowed is an integer >= 0")
    try:
        require_matplotlib()
        if args.set_valued:
            from gda_tracker.commands import demo_set_valued

            return demo_set_valued.run(args.out, args.seed)
        from gda_tracker.io.bag_types import require_rosbags

        require_rosbags()
        recording, parts = make_parts(args.runs, args.seed)
        prepare_folder(args.out)
        played = play(parts, args.out)
        columns = {name: _summarise(result) for name, result in played.items()}
        titles = {result.part.title: columns[name] for name, result in played.items()}
        table = summary_table(titles, played[OFF].part.title)
        print(format_table(table))
        print(reading_of(columns))
        scores = json.dumps(scores_of(columns, args.seed), indent=1, allow_nan=False)
        (args.out / SCORES).write_text(scores + "\n", encoding="utf-8")
        from gda_tracker.commands.demo_report import write_report

        write_report(args.out / REPORT, recording, played, columns, table, args)
    except (DemoError, MissingPlotLibraryError, OSError) as error:
        return _failed(str(error))
    except ImportError as error:
        return _failed(_remedy(error))
    print(f"report: {args.out / REPORT}")
    print(f"bags:   {', '.join(str(args.out / name) for name in played)}")
    print(f"done in {time.monotonic() - began:.0f} s")
    lost = sum(summary.lost_scans for summary in columns.values())
    return _failed(f"{lost} scans were lost") if lost else 0


def make_parts(runs: int, seed: int) -> tuple[Recording, dict[str, Part]]:
    """Load the recording and simulate the scenario: the parts by the name of their folder."""
    from gda_tracker.io.adapters import RecordingError, load_recording

    try:
        recording = load_recording(resource("data", "autoferry", "scenario16"), "bag")
    except (RecordingError, FileNotFoundError) as error:
        raise DemoError(str(error)) from error
    preset = {node: dict(values) for node, values in recording.preset.items()}
    scenario = load_scenario(SCENARIO)
    parts = {
        AUTOFERRY: Part(
            title="Autoferry 16",
            method=_method_name(preset),
            plays=[of_recording(recording)],
            parameters=preset,
            match_distance_m=BOAT_MATCH_DISTANCE_M,
            truth_is_partial=True,
        )
    }
    for name, title, method in (
        (OFF, "crossing, RCS off", RCS_OFF),
        (ON, "crossing, RCS on", RCS_ON),
    ):
        parts[name] = Part(
            title=title,
            method=method,
            plays=of_scenario(scenario, runs, seed, method),
            parameters=with_method(tracker_preset(scenario), method),
            match_distance_m=default_match_distance_m(scenario),
            truth_is_partial=False,
        )
    return recording, parts


def play(parts: Mapping[str, Part], out: Path) -> dict[str, Played]:
    """Play all parts, one after the other, each through four processes of its own."""
    from gda_tracker.nodes.runner import private_environment, use_environment

    environment = private_environment()
    use_environment(environment)
    played: dict[str, Played] = {}
    total = sum(part.scans for part in parts.values())
    before = 0
    with progress_bar(total, "scans", "four processes") as bar:
        for name, part in parts.items():
            show = partial(_show, bar, before)
            played[name] = play_part(part, out / name, environment, show)
            before += part.scans
    for result in played.values():
        print(
            f"{result.part.title}: {result.part.scans} scans through four processes in "
            f"{result.seconds:.1f} s, start-up included"
        )
    return played


def _show(bar: Callable[[int], None], before: int, done: int) -> None:
    bar(before + done)


def prepare_folder(out: Path) -> None:
    """Make the folder and take away what an earlier demo has written there, and nothing else.

    Raises
    ------
    DemoError
        If it is a file, or a bag's folder in it has files that are not of a bag.
    """
    if out.exists() and not out.is_dir():
        raise DemoError(f"--out {out}: is a file, allowed is a folder")
    out.mkdir(parents=True, exist_ok=True)
    bags = [out / name for name in FOLDERS]
    for bag in bags:
        if not bag.exists():
            continue
        foreign = not bag.is_dir() or [p.name for p in bag.iterdir() if not _is_bag_file(p)]
        if foreign:
            raise DemoError(f"--out {out}: {bag} holds more than a bag of an earlier demo")
    for bag in bags:
        if bag.exists():
            for path in bag.iterdir():
                path.unlink()
            bag.rmdir()
    for name in (REPORT, SCORES):
        (out / name).unlink(missing_ok=True)


def scores_of(columns: Mapping[str, Summary], seed: int) -> dict[str, Any]:
    """The figures of the table for programs; what does not apply is ``None``."""
    parts = {}
    for name, summary in columns.items():
        purity = summary.purity
        mean, stderr = (math.nan, math.nan) if purity is None else mean_and_stderr(purity)
        median, most = np.percentile(summary.latency_ms, (50.0, 99.0))
        values = {
            "purity_mean": mean,
            "purity_stderr": stderr,
            "completeness": summary.completeness,
            "identity_switches_per_run": summary.switches,
            "position_rmse_m": summary.position_rmse_m,
            "match_distance_m": summary.match_distance_m,
            "latency_ms_median": float(median),
            "latency_ms_p99": float(most),
        }
        parts[name] = {
            "method": summary.method,
            "runs": summary.runs,
            "scans": summary.scans,
            "lost_scans": summary.lost_scans,
            "purity_per_run": None if purity is None else purity.tolist(),
            **{key: value if math.isfinite(value) else None for key, value in values.items()},
        }
    return {"seed": seed, "parts": parts}


def reading_of(columns: Mapping[str, Summary]) -> str:
    """One sentence on what the radar cross section brought."""
    on, off = columns[ON].purity, columns[OFF].purity
    if on is None or off is None:
        return ""
    mean, stderr = paired_difference(on, off)
    error = f" +- {stderr:.3f}" if math.isfinite(stderr) else ""
    return (
        f"The radar cross section changes track purity by {mean:+.3f}{error} (mean and standard "
        f"error over {len(on)} runs, same random numbers)."
    )


def _summarise(result: Played) -> Summary:
    part = result.part
    if not result.runs or not result.latency_ms:
        raise DemoError(f"{part.title}: no scan came back with tracks")
    return summarise(
        part.method,
        result.runs,
        result.latency_ms,
        result.lost_scans,
        labelled=part.plays[0].initial is not None,
        match_distance_m=part.match_distance_m,
    )


def _method_name(parameters: Mapping[str, Mapping[str, Any]]) -> str:
    manager = stage_parameters(parameters)["track_manager"]
    return f"{manager.decision}/{manager.attribute_term}/{manager.filter}"


def _is_bag_file(path: Path) -> bool:
    return path.name == "metadata.yaml" or (path.suffix == ".mcap" and path.is_file())


def _failed(message: str) -> int:
    print(f"gda-tracker demo: {message}", file=sys.stderr)
    return 1


def _remedy(error: ImportError) -> str:
    """Say what to do about something that is not installed; a defect of ours is raised again."""
    if (error.name or "").partition(".")[0] in ("rclpy", "gda_tracker_msgs"):
        return f"the nodes need ROS 2 ({error}): run `make setup`, or source a ROS 2 workspace"
    if error.name is None:
        return str(error)
    raise error
