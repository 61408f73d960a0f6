"""``gda-tracker run``: the ring, live."""

from __future__ import annotations

import argparse
import sys
import time

from gda_tracker.commands.options import (
    RADAR_INPUT,
    Parameters,
    add_parameter_options,
    add_preset_option,
    gather_parameters,
    radar_input_of_file,
)
from gda_tracker.errors import UserError

RESTART_WINDOW_S = 60.0
RESTARTS_ALLOWED = 5
# To guess the preset: wait for a first message, then look for so long.
WAIT_S, LOOK_S = 30.0, 1.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument(
        "--input",
        metavar="TOPIC",
        help="topic of a radar's driver: PointCloud2, RadarScan or RadarTracks; without it the "
        "topic detections is read",
    )
    add_preset_option(parser)
    add_parameter_options(parser)
    parser.add_argument(
        "--processes",
        action="store_true",
        help="one process per node, restarted if it ends; default: all nodes in one process",
    )
    parser.add_argument(
        "--namespace", default="", metavar="NS", help="namespace of nodes and topics"
    )
    parser.add_argument(
        "--checkpoint",
        metavar="FILE",
        help="keep the tracker's state in FILE, so that a restart goes on where it stopped",
    )
    parser.add_argument("--bag", metavar="FOLDER", help="record all topics into an MCAP bag")


def run(args: argparse.Namespace) -> int:
    """Run until Ctrl-C."""
    parameters = _parameters(args)
    if args.checkpoint:
        parameters.setdefault("track_manager", {})["checkpoint_path"] = args.checkpoint
    from rclpy.executors import ExternalShutdownException

    from gda_tracker.nodes.runner import transport_environment, use_environment

    use_environment(transport_environment())
    remap = ["-r", f"__ns:=/{args.namespace.strip('/')}"] if args.namespace else []
    try:
        if args.processes:
            return _run_processes(parameters, remap, args.bag)
        return _run_nodes(parameters, remap, args.bag)
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0  # the usual end


def _parameters(args: argparse.Namespace) -> Parameters:
    """Parameters of the nodes; with ``--input`` also those of the radar input.

    Raises
    ------
    UserError
        For parameters that are not allowed, or if no preset fits the topic.
    """
    from gda_tracker.io.parameter_files import read_preset
    from gda_tracker.io.radar.input_parameters import RadarInputParameters
    from gda_tracker.parameters import from_mapping

    of_file = radar_input_of_file(args.params)
    name = args.preset
    if args.input and name is None and of_file is None:
        name = _guessed_preset(args.input)
        print(f"gda-tracker run: preset {name}, guessed from the fields of {args.input}")
    preset = read_preset(name) if name else {}
    parameters = gather_parameters(args.params, args.method, preset, preset_is_base=True)
    if not args.input:
        return parameters
    of_radar = {**preset.get(RADAR_INPUT, {}), **(of_file or {}), "input_topic": args.input}
    from_mapping(RadarInputParameters, of_radar)
    return {**parameters, RADAR_INPUT: of_radar}


def _guessed_preset(topic: str) -> str:
    from gda_tracker.io.radar.presets import best_preset, presets_of
    from gda_tracker.nodes.topic_listener import listen

    print(f"gda-tracker run: no preset given, looking at {topic} ...")
    sys.stdout.flush()
    frames = [frame for frame in listen(topic, WAIT_S, LOOK_S) if frame.types]
    found = best_preset(frames)
    if found is None:
        raise UserError(
            f"--input {topic}: no preset fits the fields {', '.join(frames[0].types)}; name one "
            f"with --preset ({', '.join(presets_of(frames[0].kind))}), or declare the fields: "
            f"gda-tracker inspect {topic} --yaml FILE"
        )
    return found


def _recorder(bag: str | None, **options: object) -> list[object]:
    if not bag:
        return []
    from gda_tracker.nodes.recorder import RecorderNode

    return [RecorderNode({"bag": bag}, **options)]


def _radar_input(parameters: Parameters, **options: object) -> list[object]:
    if RADAR_INPUT not in parameters:
        return []
    from gda_tracker.nodes.radar_input import RadarInputNode

    return [RadarInputNode(parameters[RADAR_INPUT], **options)]


def _what(parameters: Parameters) -> str:
    return "four nodes and the radar input" if RADAR_INPUT in parameters else "four nodes"


def _waits(parameters: Parameters) -> str:
    topic = parameters.get(RADAR_INPUT, {}).get("input_topic", "detections")
    return f"waiting for {topic}; Ctrl-C ends"


def _run_nodes(parameters: Parameters, remap: list[str], bag: str | None) -> int:
    from gda_tracker.nodes.runner import Nodes, stage_nodes

    arguments = ["--ros-args", *remap] if remap else None

    def make(**options: object) -> list[object]:
        return [
            *stage_nodes(parameters, **options),
            *_radar_input(parameters, **options),
            *_recorder(bag, **options),
        ]

    with Nodes(make, arguments=arguments) as nodes:
        print(f"gda-tracker run: {_what(parameters)} in one process, {_waits(parameters)}")
        sys.stdout.flush()
        nodes.spin_until(lambda: not nodes.context.ok())
    return 0


def _run_processes(parameters: Parameters, remap: list[str], bag: str | None) -> int:
    from gda_tracker.nodes.runner import STAGES, Nodes, RingProcesses

    restarts: list[float] = []

    def watch() -> None:
        for stage, process in list(ring.processes.items()):
            code = process.poll()
            if code is None:
                continue
            now = time.monotonic()
            restarts[:] = [t for t in restarts if now - t < RESTART_WINDOW_S] + [now]
            if code == 2 or len(restarts) > RESTARTS_ALLOWED:
                raise _GivenUp(f"node {stage} ended with code {code}")
            print(
                f"gda-tracker run: node {stage} ended with code {code}, restarted", file=sys.stderr
            )
            ring.start(stage)

    stages = (*STAGES, RADAR_INPUT) if RADAR_INPUT in parameters else STAGES
    with RingProcesses(parameters, arguments=remap, stages=stages) as ring:
        print(f"gda-tracker run: {len(stages)} processes, {_waits(parameters)}")
        sys.stdout.flush()
        try:
            if bag:
                arguments = ["--ros-args", *remap] if remap else None
                with Nodes(
                    lambda **options: _recorder(bag, **options), arguments=arguments
                ) as nodes:
                    nodes.spin_until(lambda: not nodes.context.ok(), watch=watch)
            else:
                while True:
                    watch()
                    time.sleep(0.2)
        except _GivenUp as error:
            print(f"gda-tracker run: {error}", file=sys.stderr)
            return 1
    return 0


class _GivenUp(RuntimeError):
    """A node does not stay up."""
