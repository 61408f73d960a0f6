"""``gda-tracker play``: the messages of a bag on their topics, at the pace of their times."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from gda_tracker.commands.progress import progress_bar
from gda_tracker.errors import UserError
from gda_tracker.io.bags import Bag, BagError, BagRecord

if TYPE_CHECKING:
    from gda_tracker.nodes.bag_player import BagPlayerNode
    from gda_tracker.nodes.runner import Nodes


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument("bag", metavar="BAG", help="folder of a bag, or an .mcap or .db3 file")
    parser.add_argument(
        "--rate",
        type=float,
        default=1.0,
        metavar="R",
        help="R times the recorded speed (default 1)",
    )
    parser.add_argument("--loop", action="store_true", help="begin again at the end, until Ctrl-C")
    parser.add_argument(
        "--topic",
        action="extend",
        nargs="+",
        default=[],
        metavar="NAME",
        help="play these topics alone; without it all",
    )
    parser.add_argument(
        "--clock",
        action="store_true",
        help="publish the time of the bag on /clock, for gda-tracker run --use-sim-time",
    )
    parser.add_argument(
        "--restamp",
        action="store_true",
        help="move the stamps in headers (and in transforms) as if the bag were recorded from now "
        "on; with --loop they go on from turn to turn",
    )


def run(args: argparse.Namespace) -> int:
    """Play to the end, or until Ctrl-C."""
    if not 0.0 < args.rate < float("inf"):
        raise UserError(f"--rate {args.rate}: allowed is a number > 0")
    bag = Bag(args.bag)
    topics = _chosen(bag, args.topic)
    from rclpy.executors import ExternalShutdownException

    from gda_tracker.nodes.bag_player import SETTLE_S, BagPlayerNode
    from gda_tracker.nodes.runner import Nodes, transport_environment, use_environment

    use_environment(transport_environment())
    played = [0]
    with Nodes(lambda **o: [BagPlayerNode(bag, topics, args.clock, **o)]) as nodes:
        player: BagPlayerNode = nodes.nodes[0]
        _say_what(args, bag, player, nodes.context.get_domain_id())
        try:
            # Whoever listens already shall get the first message too.
            nodes.spin_until(player.heard, SETTLE_S)
            _play(args, bag, nodes, played)
        except (KeyboardInterrupt, ExternalShutdownException):
            pass
    for topic, number in player.malformed.items():
        print(f"warning: {topic}: {number} messages are cut off, left out", file=sys.stderr)
    print(f"gda-tracker play: {played[0]} messages played")
    return 0


def _chosen(bag: Bag, names: list[str]) -> list[str]:
    """The topics of the bag that are meant.

    Raises
    ------
    UserError
        If one is not in the bag.
    """
    found = []
    for name in names:
        known = next((topic for topic in (name, f"/{name}") if topic in bag.topics), None)
        if known is None:
            raise UserError(
                f"--topic {name}: not in {bag.path}, whose topics are {', '.join(bag.topics)}"
            )
        found.append(known)
    return found


def _say_what(args: argparse.Namespace, bag: Bag, player: BagPlayerNode, domain: int) -> None:
    if bag.damage:
        print(f"warning: {bag.path} is damaged: {bag.damage}", file=sys.stderr)
    for name, reason in player.skipped.items():
        print(f"warning: {name} is left out: {reason}", file=sys.stderr)
    topics = [bag.topics[name] for name in player.played_topics]
    if not topics:
        raise UserError(f"{bag.path}: no message that can be played")
    if args.loop and not args.restamp:
        print(
            "warning: --loop without --restamp: stamps go back at every turn; a tracker rejects "
            "scans that are late by less than time_jump_s, and starts anew for more",
            file=sys.stderr,
        )
    total = sum(topic.message_count for topic in topics)
    print(f"gda-tracker play: {total} messages of {bag.path}, ROS domain {domain}; Ctrl-C ends")
    for topic in topics:
        print(f"  {topic.name}: {topic.message_count} {topic.type}")
    sys.stdout.flush()


def _play(args: argparse.Namespace, bag: Bag, nodes: Nodes, played: list[int]) -> None:
    """Play once, or again and again; ``played`` counts the messages of all turns."""
    player: BagPlayerNode = nodes.nodes[0]

    def wait(seconds: float) -> None:
        nodes.executor.spin_once(timeout_sec=seconds)

    total = sum(bag.topics[name].message_count for name in player.played_topics)
    begun, start_ns = time.monotonic(), time.time_ns()
    while True:
        with progress_bar(total, "messages") as bar:
            records = _counted(_records(bag, player.played_topics), played, bar)
            moved_to = start_ns if args.restamp else None
            turn = player.play(records, wait, args.rate, begun, moved_to)
        if not args.loop:
            return
        begun = max(begun + turn.period_ns * 1e-9 / args.rate, time.monotonic())
        start_ns += turn.period_ns


def _counted(
    records: Iterator[BagRecord], played: list[int], bar: Callable[[int], None]
) -> Iterator[BagRecord]:
    """Hand records on; one is counted when the next is asked for, so after it was played."""
    for number, record in enumerate(records, 1):
        yield record
        played[0] += 1
        bar(number)


def _records(bag: Bag, topics: tuple[str, ...]) -> Iterator[BagRecord]:
    """The messages of a bag as far as it can be read."""
    count = 0
    try:
        for record in bag.records(topics):
            count += 1
            yield record
    except BagError as error:
        if not count:
            raise
        print(f"warning: {error}", file=sys.stderr)
