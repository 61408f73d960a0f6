"""``gda-tracker record``: all topics into a bag."""

from __future__ import annotations

import argparse
import sys


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument("bag", metavar="FOLDER", help="folder of the new bag; must not exist")
    parser.add_argument("--namespace", default="", metavar="NS", help="namespace of the topics")
    parser.add_argument(
        "--markers",
        action="store_true",
        help="record the layers below markers/ too (node markers, docs/layers.md)",
    )


def run(args: argparse.Namespace) -> int:
    """Record until Ctrl-C."""
    from rclpy.executors import ExternalShutdownException

    from gda_tracker.io.markers.parameters import marker_topics
    from gda_tracker.nodes.recorder import RecorderNode
    from gda_tracker.nodes.runner import Nodes, transport_environment, use_environment

    use_environment(transport_environment())
    remap = ["--ros-args", "-r", f"__ns:=/{args.namespace.strip('/')}"] if args.namespace else None
    settings = {"bag": args.bag, "also": marker_topics() if args.markers else []}
    with Nodes(lambda **o: [RecorderNode(settings, **o)], arguments=remap) as nodes:
        print(f"gda-tracker record: recording into {args.bag}; Ctrl-C ends")
        sys.stdout.flush()
        try:
            nodes.spin_until(lambda: not nodes.context.ok())
        except (KeyboardInterrupt, ExternalShutdownException):
            pass
        counts = nodes.nodes[0].counters
    print(f"gda-tracker record: {sum(counts.values())} messages in {args.bag}")
    return 0
