"""``gda-tracker run``: the ring, live."""

from __future__ import annotations

import argparse
import sys
import time

from gda_tracker.commands.options import Parameters, add_parameter_options, gather_parameters

RESTART_WINDOW_S = 60.0
RESTARTS_ALLOWED = 5


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
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
    parameters = gather_parameters(args.params, args.method)
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


def _recorder(bag: str | None, **options: object) -> list[object]:
    if not bag:
        return []
    from gda_tracker.nodes.recorder import RecorderNode

    return [RecorderNode({"bag": bag}, **options)]


def _run_nodes(parameters: Parameters, remap: list[str], bag: str | None) -> int:
    from gda_tracker.nodes.runner import Nodes, stage_nodes

    arguments = ["--ros-args", *remap] if remap else None
    with Nodes(
        lambda **options: [*stage_nodes(parameters, **options), *_recorder(bag, **options)],
        arguments=arguments,
    ) as nodes:
        print("gda-tracker run: four nodes in one process, waiting for detections; Ctrl-C ends")
        sys.stdout.flush()
        nodes.spin_until(lambda: not nodes.context.ok())
    return 0


def _run_processes(parameters: Parameters, remap: list[str], bag: str | None) -> int:
    from gda_tracker.nodes.runner import Nodes, RingProcesses

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

    with RingProcesses(parameters, arguments=remap) as ring:
        print("gda-tracker run: four processes, waiting for detections; Ctrl-C ends")
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
