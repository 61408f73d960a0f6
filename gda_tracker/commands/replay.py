"""``gda-tracker replay``: any recording through the tracker."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from gda_tracker.commands.options import (
    Parameters,
    add_parameter_options,
    add_preset_option,
    gather_parameters,
    radar_input_of_file,
)
from gda_tracker.commands.progress import progress_bar
from gda_tracker.commands.replay_formations import formation_line, formation_tracker
from gda_tracker.commands.replay_nodes import through_the_nodes
from gda_tracker.commands.replay_summary import Answers, print_summary
from gda_tracker.errors import UserError
from gda_tracker.formations.found import Formations
from gda_tracker.simulation.playback import Playback, of_recording, of_scenario
from gda_tracker.simulation.scenarios import load_scenario, shipped_scenarios
from gda_tracker.tracking.ring import stage_parameters
from gda_tracker.vocabulary.statements import StatementReport
from gda_tracker.vocabulary.tracks import Tracks

if TYPE_CHECKING:
    from gda_tracker.evaluation.rounds import Heard


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument("recording", metavar="RECORDING", help="bag folder, file, or scenario name")
    add_recording_options(parser)
    add_preset_option(parser)
    add_parameter_options(parser)
    how = parser.add_mutually_exclusive_group()
    how.add_argument(
        "--offline", action="store_true", help="call the stages in a row, without ROS; same tracks"
    )
    how.add_argument(
        "--rate",
        type=float,
        default=0.0,
        metavar="R",
        help="play at R times the recorded speed; default: as fast as the ring completes scans",
    )
    parser.add_argument(
        "--tracks", type=Path, metavar="OUT.csv", help="write one row per track and scan"
    )
    parser.add_argument(
        "--tracks-delayed",
        type=Path,
        metavar="OUT.csv",
        help="with --offline and decision mht: the same with the past as it is seen later "
        "(docs/mht.md)",
    )
    parser.add_argument(
        "--tracks-smoothed",
        type=Path,
        metavar="OUT.csv",
        help="with --offline: the same in the light of the whole recording, by fixed-interval "
        "smoothing (docs/filters.md)",
    )
    parser.add_argument(
        "--association-log",
        type=Path,
        metavar="OUT.jsonl",
        help="with --offline: write why each detection went to its track, one JSON object per scan "
        "(docs/association-log.md)",
    )
    parser.add_argument(
        "--formations",
        type=Path,
        metavar="OUT.csv",
        help="with --offline: write which tracks fly together, how many objects they are, splits "
        "and mergers, one row per formation and scan (docs/formations.md)",
    )
    parser.add_argument(
        "--report",
        type=Path,
        metavar="FILE.html",
        help="write one page with counts, pictures (tracks, beliefs, radar cross sections, "
        "latency, consistency) and, where the truth is known, measures (docs/replay-report.md)",
    )
    parser.add_argument(
        "--bag", type=Path, metavar="FOLDER", help="record all topics (not offline)"
    )
    parser.add_argument(
        "--markers",
        action="store_true",
        help="with --bag: record the layers for RViz and Foxglove too (docs/layers.md)",
    )
    parser.add_argument(
        "--domain", type=int, metavar="N", help="ROS domain to use; default: one of its own"
    )
    parser.add_argument(
        "--match-distance",
        type=float,
        metavar="M",
        help="a target counts as tracked if a confirmed track is within M metres "
        "(default: 25, for simulated targets 1000)",
    )


def add_recording_options(parser: argparse.ArgumentParser) -> None:
    """Add what says how RECORDING is read."""
    parser.add_argument(
        "--adapter",
        default="auto",
        metavar="NAME",
        help="how to read it: auto, bag, autoferry, scan_npz, mmwave, continental_yaml, csv, "
        "asterix; ais and uav are trajectories, seen by a simulated radar (default: auto)",
    )
    parser.add_argument(
        "--topic",
        metavar="NAME",
        help="topic of a bag, or SAC/SIC in ASTERIX, with several radars (gda-tracker inspect)",
    )
    parser.add_argument(
        "--seed",
        type=int,
        default=1,
        help="seed, if RECORDING is a scenario, or a radar is simulated (default: 1)",
    )


def run(args: argparse.Namespace) -> int:
    """Replay and print a summary."""
    if args.offline and args.bag:
        raise UserError("--bag: there are no topics to record with --offline")
    if args.markers and not args.bag:
        raise UserError("--markers: allowed with --bag, into which they are recorded")
    if args.association_log and not args.offline:
        raise UserError(
            "--association-log: allowed with --offline alone, which makes the same tracks"
        )
    if args.tracks_delayed and not args.offline:
        raise UserError("--tracks-delayed: allowed with --offline alone, which makes the same")
    if args.tracks_smoothed and not args.offline:
        raise UserError("--tracks-smoothed: allowed with --offline alone, which makes the same")
    if args.formations and not args.offline:
        raise UserError("--formations: allowed with --offline alone; else the node, see run")
    if args.report:
        from gda_tracker.evaluation.figures import require_matplotlib

        try:
            require_matplotlib()
        except ImportError as error:
            raise UserError(f"--report: {error}") from error
        args.report.parent.mkdir(parents=True, exist_ok=True)
    if not 0.0 <= args.rate < float("inf"):
        raise UserError(f"--rate {args.rate}: allowed is a number >= 0")
    play, preset_name, parameters = load_playback(args)
    print(f"{play.name}: {len(play.detections)} scans, parameters: {preset_name}")
    if not play.detections:
        raise UserError(f"{args.recording}: no scans")
    sys.stdout.flush()
    said: list[StatementReport] = []
    delayed: list[Tracks] = []
    smoothed: list[Tracks] = []
    heard: list[Heard] = []
    formations: list[Formations] = []
    if args.offline:
        answers = _offline(play, parameters, args, said, delayed, smoothed, heard, formations)
    else:
        answers = through_the_nodes(play, parameters, args, said, heard)
    if args.tracks:
        _write_table(args.tracks, [tracks for _, tracks in answers])
        print(f"tracks: {args.tracks}")
    if args.tracks_delayed:
        if not delayed:
            raise UserError("--tracks-delayed: allowed with decision mht, which revises the past")
        _write_table(args.tracks_delayed, delayed)
        print(f"tracks with the revised past: {args.tracks_delayed}")
    if args.tracks_smoothed:
        _write_table(args.tracks_smoothed, smoothed)
        print(f"smoothed tracks: {args.tracks_smoothed}")
    if args.association_log:
        print(f"association log: {args.association_log}")
    if args.formations:
        from gda_tracker.io.formation_csv import write_formations

        write_formations(args.formations, formations)
        print(f"formations: {args.formations}")
        print(formation_line(formations))
    if said:
        count = Counter(report.reason or report.outcome for report in said)
        print("statements: " + ", ".join(f"{number} {name}" for name, number in count.items()))
    print_summary(play, answers, {"delayed": delayed, "smoothed": smoothed}, args.match_distance)
    if args.report:
        from gda_tracker.commands.replay_report import write_report

        write_report(
            args.report,
            play,
            preset_name,
            parameters,
            answers,
            heard[0],
            args.match_distance,
            formations,
        )
        print(f"report: {args.report}")
    return 0


def _write_table(path: Path, tracks_by_scan: Sequence[Tracks | None]) -> None:
    """Write one row per track and scan."""
    from gda_tracker.io.track_csv import TrackCsvWriter

    with TrackCsvWriter(path) as table:
        for scan, tracks in enumerate(tracks_by_scan):
            if tracks is not None:
                table.write(scan, tracks)


def load_playback(args: argparse.Namespace) -> tuple[Playback, str, Parameters]:
    """What to play, the name of its parameters, and the parameters.

    ``args`` has what :func:`add_recording_options`, ``add_preset_option`` and
    ``add_parameter_options`` add.
    """
    name = args.recording
    from gda_tracker.io.adapters import InputOptions, is_recording, load_recording
    from gda_tracker.io.extended_input import fault_of_clusters
    from gda_tracker.io.parameter_files import read_preset, shipped_presets

    scenario_file = Path(name).suffix in (".yaml", ".yml") and args.adapter == "auto"
    if name in shipped_scenarios() or (scenario_file and not is_recording(name)):
        if args.preset or args.topic:
            raise UserError("--preset, --topic: allowed with recordings only, this is a scenario")
        scenario = load_scenario(name)
        from gda_tracker.simulation.preset import tracker_preset

        parameters = gather_parameters(args.params, args.method, tracker_preset(scenario))
        manager = stage_parameters(parameters)["track_manager"]
        method = f"{manager.decision}/{manager.attribute_term}/{manager.filter}"
        return (
            of_scenario(scenario, 1, args.seed, method)[0],
            f"scenario {scenario.name}",
            parameters,
        )
    options = InputOptions(
        args.topic, args.preset, radar_input_of_file(args.params), seed=args.seed
    )
    recording = load_recording(name, args.adapter, options)
    for warning in recording.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    for line in (recording.origin, *recording.notes):
        if line:
            print(line)
    preset, preset_name, on_top = recording.preset, recording.preset_name, recording.preset_is_base
    if args.preset is not None and not on_top:
        preset, preset_name, on_top = read_preset(args.preset), args.preset, True
    sources = [f"preset {preset_name}"] if on_top or args.params is None else []
    sources += [str(args.params)] if args.params else []
    parameters = gather_parameters(args.params, args.method, preset, on_top)
    own = read_preset(preset_name) if preset_name in shipped_presets() else {}
    radar = {**own.get("radar_input", {}), **(radar_input_of_file(args.params) or {})}
    if fault := fault_of_clusters(radar, parameters.get("track_manager", {})):
        raise UserError(fault)
    return of_recording(recording), " and ".join(sources), parameters


def _offline(
    play: Playback,
    parameters: Parameters,
    args: argparse.Namespace,
    said: list[StatementReport],
    delayed: list[Tracks],
    smoothed: list[Tracks],
    heard: list[Heard],
    formations: list[Formations],
) -> Answers:
    from gda_tracker.evaluation.association_log import AssociationLogWriter
    from gda_tracker.evaluation.rounds import OfflineRounds
    from gda_tracker.tracking.ring import Ring
    from gda_tracker.tracking.smoothing import Smoother

    ring = Ring(parameters)
    ring.smoother = Smoother()
    if play.initial is not None:
        ring.initialise(play.initial)
    answers: Answers = []
    rounds = OfflineRounds()
    follow = formation_tracker(args)
    with ExitStack() as stack:
        log = None
        if args.association_log:
            log = stack.enter_context(AssociationLogWriter(args.association_log))
        bar = stack.enter_context(progress_bar(len(play.detections), "scans"))
        for position, detections in enumerate((*play.detections, None)):
            said += [ring.say(statement) for statement in play.said_before(position)]
            for result in ring.finish() if detections is None else ring.feed(detections):
                answers.append((result.report, result.tracks))
                delayed += result.delayed
                if follow is not None and result.tracks is not None:
                    formations.append(follow.take(result.tracks, result.scan, result.predictions))
                if log is not None:
                    log.write(result)
                if args.report:
                    rounds.note(result)
            bar(len(answers))
    delayed += ring.rest_of_delayed()
    smoothed += ring.smoother.tracks()
    heard.append(rounds.heard())
    return answers
