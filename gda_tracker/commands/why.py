"""``gda-tracker why``: why a detection went to a track, from a log, a bag or a running tracker."""

from __future__ import annotations

import argparse
import json
import shutil
import textwrap
from pathlib import Path
from typing import Any

from gda_tracker.errors import UserError
from gda_tracker.evaluation.explanation import (
    LAST,
    check_associated,
    explain,
    explanation_lines,
    overview_lines,
    pick_scan,
    tracks_of,
)

Entry = dict[str, Any]

LONGEST_LINE = 120


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument("scan", metavar="SCAN", help=f"number, stamp or {LAST}")
    parser.add_argument("track", metavar="TRACK", nargs="?", help="track id; without it all tracks")
    parser.add_argument(
        "source",
        metavar="SOURCE",
        nargs="?",
        type=Path,
        help="association log or bag of all topics; without it the tracker that runs",
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--namespace", default="", metavar="NS", help="namespace of the tracker")
    parser.add_argument("--domain", type=int, metavar="N", help="ROS domain to listen in")
    parser.add_argument(
        "--wait",
        type=float,
        default=10.0,
        metavar="S",
        help="of a running tracker: wait at most this long for a decision (default: 10)",
    )


def run(args: argparse.Namespace) -> int:
    """Print the explanation."""
    track, source = _track_and_source(args)
    if source is None:
        if args.scan != LAST:
            raise UserError(
                f"scan {args.scan}: of a running tracker only the {LAST} one is known; name a log "
                "or a bag for others"
            )
        entries = [_live(args)]
    else:
        entries = _entries_of(source, args.namespace)
    number = pick_scan(entries, args.scan)
    if track is None:
        check_associated(entries[number], number)
        lines = overview_lines(entries[number], number)
        record: Any = {
            "scan": number,
            "stamp_ns": entries[number]["stamp_ns"],
            "tracks": tracks_of(entries[number]),
        }
    else:
        record = explain(entries, number, track)
        lines = explanation_lines(record)
    if args.json:
        print(json.dumps(record, indent=2, allow_nan=False))
        return 0
    width = min(max(shutil.get_terminal_size((110, 24)).columns - 1, 60), LONGEST_LINE)
    for line in lines:
        indent = len(line) - len(line.lstrip())
        further = 16 if indent == 4 else indent + 2
        print(textwrap.fill(line, width, subsequent_indent=" " * further, break_on_hyphens=False))
    return 0


def _track_and_source(args: argparse.Namespace) -> tuple[int | None, Path | None]:
    """TRACK may be left out before SOURCE too."""
    track, source = args.track, args.source
    if track is not None and not track.isdigit():
        if source is not None:
            raise UserError(f"track {track}: allowed is a track id, a whole number")
        track, source = None, Path(track)
        if not source.exists():
            raise UserError(f"{source}: no track id, and no such file")
    return None if track is None else int(track), source


# --- where entries come from ----------------------------------------------------------------------


def _entries_of(path: Path, namespace: str) -> list[Entry]:
    """Entries of a log or a bag.

    Raises
    ------
    UserError
        If it is neither, or a bag without decisions.
    """
    if path.is_file() and path.suffix not in (".mcap", ".db3"):
        return _of_log(path)
    return _of_bag(path, namespace)


def _of_log(path: Path) -> list[Entry]:
    entries = []
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError:
        raise UserError(f"{path}: no association log, not a text in UTF-8") from None
    for number, line in enumerate(lines, 1):
        try:
            entry = json.loads(line)
        except json.JSONDecodeError as error:
            raise UserError(f"{path}, line {number}: no JSON: {error.msg}") from None
        if not isinstance(entry, dict) or not {"sensor_id", "stamp_ns", "outcome"} <= set(entry):
            raise UserError(
                f"{path}, line {number}: no entry of an association log; gda-tracker replay "
                "RECORDING --offline --association-log FILE writes one"
            )
        entries.append(entry)
    if not entries:
        raise UserError(f"{path}: no association log, it is empty")
    return entries


def _of_bag(path: Path, namespace: str) -> list[Entry]:
    from gda_tracker.io.decision_bags import bag_entries

    return bag_entries(path, namespace)


def _live(args: argparse.Namespace) -> Entry:
    if not 0.0 < args.wait < float("inf"):
        raise UserError(f"--wait {args.wait}: allowed is a number > 0")
    from gda_tracker.nodes.decision_listener import last_decision

    return last_decision(args.namespace, args.domain, args.wait)
