"""``gda-tracker say``: a statement to a running ring."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from gda_tracker.errors import UserError
from gda_tracker.io.statement_files import Draft, StatementFileError, read_statements
from gda_tracker.tracking.statement_door import EXPLANATIONS
from gda_tracker.vocabulary.statements import Statement

STANDARD_INPUT = "-"
ANSWER_TIMEOUT_S = 5.0
REJECTED_EXIT_CODE = 1

EXAMPLES = {
    "fuzzy": """\
# "The fighter is by the buoy": 300 m around a point, and what is there is a fighter.
source: lookout
kind: fuzzy
about: place
reliability: 0.8
pieces:
  - region: {shape: gaussian, centre_m: [7200, 300], covariance_m2: [90000, 0, 0, 90000]}
    classes: {fighter: 1.0, cargo: 0.2}
""",
    "region": """\
# "Track 1 is in this sector", as a bearing from (0, 0), counter-clockwise from the x axis.
source: esm_1
kind: region
about: track
track_id: 1
reliability: 0.9
pieces:
  - region: {shape: sector, centre_m: [0, 0], first_bearing_rad: 0.02, opening_rad: 0.07}
""",
    "fds": """\
# "Track 1 is a fighter in the harbour, I am 70 % sure, else a cargo aircraft, wherever."
source: pilot
kind: fds
about: track
track_id: 1
pieces:
  - region: {shape: polygon, vertices_m: [0, 0, 9000, 0, 9000, 4000, 0, 4000]}
    classes: {fighter: 1.0}
    mass: 0.7
  - classes: {cargo: 1.0}
    mass: 0.3
""",
    "rule": """\
# "What flies in the corridor is cargo."
source: air_traffic
kind: rule
about: place
rule: region_implies_classes
pieces:
  - region: {shape: box, low_m: [-5000, 2000], high_m: [9000, 2600]}
    classes: {cargo: 1.0}
""",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument(
        "file",
        nargs="?",
        metavar="FILE.yaml",
        help=f"the statement, or more with --- between them; {STANDARD_INPUT} reads standard input",
    )
    parser.add_argument(
        "--check", action="store_true", help="only check the file, without a running ring"
    )
    parser.add_argument(
        "--example",
        nargs="?",
        const="all",
        choices=("all", *EXAMPLES),
        metavar="KIND",
        help=f"print an example and end; KIND is one of {', '.join(EXAMPLES)} (default all)",
    )
    parser.add_argument(
        "--frame", default="map", metavar="NAME", help="tracking frame for --check (default map)"
    )
    parser.add_argument("--namespace", default="", metavar="NS", help="namespace of the topics")
    parser.add_argument(
        "--timeout",
        type=float,
        default=10.0,
        metavar="S",
        help="how long to look for a running ring (default 10 s)",
    )


def run(args: argparse.Namespace) -> int:
    """Say it; return 0, or 1 where the ring refuses a statement."""
    if (args.file is None) == (args.example is None):
        raise UserError("allowed is either FILE.yaml or --example; --help explains both")
    if not 0.0 < args.timeout < float("inf"):
        raise UserError(f"--timeout {args.timeout}: allowed is a number > 0")
    if args.example is not None:
        texts = EXAMPLES.values() if args.example == "all" else [EXAMPLES[args.example]]
        print("---\n".join(texts), end="")
        return 0
    name = "standard input" if args.file == STANDARD_INPUT else args.file
    drafts = read_statements(_content(args.file), name)
    # Whatever the ring knows, the rest must be good: all of the file is checked before any is said.
    _complete(drafts, 0, args.frame, name, own_frame=args.check)
    if args.check:
        print(f"{name}: {len(drafts)} well-formed statement{'s' if len(drafts) > 1 else ''}")
        return 0
    return _say(drafts, name, args.namespace, args.timeout)


def _content(path: str) -> str:
    try:
        if path == STANDARD_INPUT:
            return sys.stdin.read()
        return Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "no text in UTF-8"
        raise StatementFileError(f"{path}: cannot be read: {reason}") from None


def _complete(
    drafts: list[Draft], stamp_ns: int, frame_id: str, name: str, own_frame: bool = True
) -> list[Statement]:
    """The statements with what was left out; ``own_frame``: theirs must be ``frame_id``."""
    found = []
    for number, draft in enumerate(drafts, start=1):
        frame = frame_id if own_frame or draft.frame_id is None else draft.frame_id
        try:
            # The clock gives numbers that rise from call to call.
            found.append(draft.complete(time.time_ns() + number, stamp_ns, frame))
        except StatementFileError as error:
            raise StatementFileError(f"{name}: statement {number}: {error}") from None
    return found


def _say(drafts: list[Draft], name: str, namespace: str, timeout_s: float) -> int:
    from gda_tracker.nodes.runner import Nodes, transport_environment, use_environment
    from gda_tracker.nodes.speaker import SpeakerNode

    use_environment(transport_environment())
    remap = ["--ros-args", "-r", f"__ns:=/{namespace.strip('/')}"] if namespace else None
    refused = 0
    with Nodes(lambda **o: [SpeakerNode(**o)], arguments=remap) as nodes:
        speaker = nodes.nodes[0]
        if not nodes.spin_until(lambda: speaker.heard, timeout_s):
            raise UserError("no track_manager found: is the ring running in this ROS domain?")
        if not nodes.spin_until(lambda: speaker.newest is not None, timeout_s):
            raise UserError("the ring has had no scan yet, so it has no time to speak of")
        newest = speaker.newest
        statements = _complete(drafts, newest.key.stamp_ns, newest.frame_id, name)
        for number, statement in enumerate(statements, start=1):
            identity = (statement.source, statement.sequence)
            speaker.say(statement)
            if not nodes.spin_until(lambda i=identity: i in speaker.reports, ANSWER_TIMEOUT_S):
                raise UserError(f"statement {number}: the track_manager does not answer")
            report = speaker.reports[identity]
            if report.reason:
                refused += 1
                text = f"rejected, {report.reason}: {EXPLANATIONS.get(report.reason, '')}"
            else:
                text = "admitted, waits for the next scan"
            print(f"statement {number} ({statement.kind}, about a {statement.about}): {text}")
    return REJECTED_EXIT_CODE if refused else 0
