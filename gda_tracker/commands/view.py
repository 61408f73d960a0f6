"""``gda-tracker view``: see in a browser what the tracker does, and tune it."""

from __future__ import annotations

import argparse
import asyncio
import signal
import sys
from contextlib import ExitStack
from typing import Any

from gda_tracker.commands.options import add_parameter_options, add_preset_option
from gda_tracker.commands.replay import add_recording_options, load_playback
from gda_tracker.commands.replay_formations import formation_tracker
from gda_tracker.errors import UserError

DEFAULT_HOST, DEFAULT_PORT = "127.0.0.1", 8765
LARGEST_PORT = 65535
MOST_SCANS = 100_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument(
        "recording",
        metavar="RECORDING",
        nargs="?",
        help="bag folder, file, or scenario name to replay; without it topics of a running ring",
    )
    add_recording_options(parser)
    add_preset_option(parser)
    add_parameter_options(parser)
    parser.add_argument(
        "--formations",
        action="store_true",
        help="follow formations and show them; of a running ring they are shown if its node "
        "track_formations is there",
    )
    parser.add_argument(
        "--rate",
        type=float,
        default=1.0,
        metavar="R",
        help="replay at R times the recorded speed, 0: as fast as it goes (default 1)",
    )
    parser.add_argument(
        "--paused", action="store_true", help="stand before the first scan until told to play"
    )
    parser.add_argument(
        "--namespace", default="", metavar="NS", help="namespace of the running ring's topics"
    )
    parser.add_argument(
        "--port",
        type=int,
        default=DEFAULT_PORT,
        help=f"port of the page, 0: any that is free (default {DEFAULT_PORT})",
    )
    parser.add_argument(
        "--host",
        default=DEFAULT_HOST,
        metavar="ADDRESS",
        help="address to serve at; 0.0.0.0 opens the page, read only, to the whole network "
        f"(default {DEFAULT_HOST}, this machine alone)",
    )
    parser.add_argument(
        "--allow-changes",
        action="store_true",
        help="with --host: those who look may change parameters and steer the replay too",
    )
    parser.add_argument(
        "--history",
        type=int,
        default=1000,
        metavar="N",
        help="scans to keep for looking back (default 1000, fewer if they are large)",
    )


def run(args: argparse.Namespace) -> int:
    """Serve until Ctrl-C."""
    _check(args)
    try:
        from gda_tracker.view.history import History
        from gda_tracker.view.server import plot_library

        plot_library()
    except ModuleNotFoundError as error:
        raise ImportError(f"{error}; the page needs: pip install 'gda_tracker[view]'") from error
    history = History(args.history)
    with ExitStack() as stack:
        source = _replay(args, history) if args.recording else _live(args, history)
        stack.callback(source.close)
        return asyncio.run(_serve(args, history, source))


def _check(args: argparse.Namespace) -> None:
    if not 0 <= args.port <= LARGEST_PORT:
        raise UserError(f"--port {args.port}: allowed is an integer >= 0 and <= {LARGEST_PORT}")
    if not 1 <= args.history <= MOST_SCANS:
        raise UserError(f"--history {args.history}: allowed is an integer >= 1 and <= {MOST_SCANS}")
    if not 0.0 <= args.rate < float("inf"):
        raise UserError(f"--rate {args.rate}: allowed is a number >= 0")
    if args.recording and args.namespace:
        raise UserError("--namespace: allowed without a RECORDING only")
    if not args.recording and args.formations:
        raise UserError(
            "--formations: allowed with a RECORDING; a running ring shows those of its node "
            "track_formations"
        )
    if not args.recording and (args.params or args.method or args.preset or args.topic):
        raise UserError(
            "--params, --method, --preset, --topic: allowed with a RECORDING; a running ring has "
            "its parameters, change them on the page"
        )


def _replay(args: argparse.Namespace, history: Any) -> Any:
    from gda_tracker.view.player import Player

    play, preset_name, parameters = load_playback(args)
    if not play.detections:
        raise UserError(f"{args.recording}: no scans")
    print(f"{play.name}: {len(play.detections)} scans, parameters: {preset_name}")
    tracker = formation_tracker(args)
    player = Player(
        play,
        parameters,
        history,
        args.rate,
        playing=not args.paused,
        formations=None if tracker is None else tracker.parameters,
    )
    player.start()
    return player


def _live(args: argparse.Namespace, history: Any) -> Any:
    from gda_tracker.nodes.view_bridge import ViewBridge

    return ViewBridge(history, args.namespace)


async def _serve(args: argparse.Namespace, history: Any, source: Any) -> int:
    from gda_tracker.view.guard import LOCAL
    from gda_tracker.view.server import Server

    opened = args.host not in LOCAL
    allow_changes = not opened or args.allow_changes
    server = Server(
        history,
        source,
        source.status,
        player=source if args.recording else None,
        host=args.host,
        port=args.port,
        allow_changes=allow_changes,
    )
    if opened:
        rights = "look and change parameters" if allow_changes else "look"
        print(
            f"gda-tracker view: warning: --host {args.host}: everybody on the network may {rights};"
            " there is no password and no encryption",
            file=sys.stderr,
        )

    stopped = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stopped.set)

    def ready(address: str) -> None:
        print(f"gda-tracker view: {address}  (Ctrl-C ends)")
        sys.stdout.flush()

    await server.run(ready, stopped.is_set)
    return 0
