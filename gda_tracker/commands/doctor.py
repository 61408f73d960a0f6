"""``gda-tracker doctor``: what is wrong with a live system, why it matters, what mends it."""

from __future__ import annotations

import argparse
import json
import shutil
import textwrap
from typing import TYPE_CHECKING, Any

from gda_tracker.errors import UserError
from gda_tracker.nodes.diagnosis.environment import environment_findings, unusable
from gda_tracker.nodes.diagnosis.findings import ERROR, NOTE, WARNING, Finding, by_level

if TYPE_CHECKING:
    from gda_tracker.nodes.diagnosis.observation import Observation

FOUND_EXIT_CODE = 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument("--input", metavar="TOPIC", help="topic of the radar's driver")
    parser.add_argument("--domain", type=int, metavar="N", help="ROS domain to look in")
    parser.add_argument("--namespace", metavar="NS", help="namespace of the tracker")
    parser.add_argument(
        "--seconds",
        type=float,
        default=5.0,
        metavar="S",
        help="how long to listen to the topics (default: 5)",
    )
    parser.add_argument(
        "--wait",
        type=float,
        default=5.0,
        metavar="S",
        help="how long to look for the nodes (default: 5)",
    )
    parser.add_argument("--json", action="store_true", help="print JSON")


def run(args: argparse.Namespace) -> int:
    """Look, judge, print; return 1 if anything needs attention."""
    for name in ("seconds", "wait"):
        if not 0.0 < getattr(args, name) <= 3600.0:
            raise UserError(f"--{name} {getattr(args, name)}: allowed is a number > 0 and <= 3600")
    findings = environment_findings(domain=args.domain)
    seen = None
    if not unusable(findings):
        seen, more = _look(args)
        findings += more
    findings = by_level(findings)
    if args.json:
        print(json.dumps(_record(seen, findings), indent=2))
    else:
        _print(seen, findings)
    return FOUND_EXIT_CODE if any(f.level != NOTE for f in findings) else 0


def _look(args: argparse.Namespace) -> tuple[Observation | None, list[Finding]]:
    from gda_tracker.nodes.diagnosis.diagnostics_checks import diagnostics_findings
    from gda_tracker.nodes.diagnosis.graph_checks import graph_findings
    from gda_tracker.nodes.diagnosis.look import observe
    from gda_tracker.nodes.diagnosis.traffic_checks import traffic_findings

    try:
        seen = observe(args.input, args.domain, args.namespace, args.seconds, args.wait)
    except RuntimeError as error:
        # What rclpy raises where the middleware cannot be loaded or has no socket.
        return None, [
            Finding(
                ERROR,
                "rclpy_fails",
                "rclpy",
                f"does not start: {str(error).splitlines()[0]}",
                "no node can be started with these variables",
                "unset RMW_IMPLEMENTATION FASTDDS_DEFAULT_PROFILES_FILE ROS_DOMAIN_ID",
            )
        ]
    return seen, [
        *graph_findings(seen),
        *traffic_findings(seen),
        *diagnostics_findings(seen),
    ]


def _record(seen: Observation | None, findings: list[Finding]) -> dict[str, Any]:
    record: dict[str, Any] = {
        "errors": sum(f.level == ERROR for f in findings),
        "warnings": sum(f.level == WARNING for f in findings),
        "findings": [f.record() for f in findings],
    }
    if seen is not None:
        record |= {
            "domain": seen.domain,
            "namespace": seen.namespace,
            "seconds": seen.seconds,
            "nodes": {seen.node(name): state for name, state in seen.states.items()},
            "inputs": {topic: _rate(seen, topic) for topic in seen.inputs},
            "scans_answered": len(seen.reports),
            "diagnostics": {node: status.values for node, status in seen.last.items()},
        }
    return record


def _rate(seen: Observation, topic: str) -> dict[str, Any]:
    rate = seen.rate_hz(topic)
    return {
        "publishers": [endpoint.node for endpoint in seen.publishers(topic)],
        "messages": len(seen.heard.get(topic, [])),
        "rate_hz": None if rate is None else round(rate, 2),
    }


def _print(seen: Observation | None, findings: list[Finding]) -> None:
    if seen is not None:
        print(f"ROS domain {seen.domain}, namespace {seen.namespace}, {seen.seconds:g} s")
        for name, state in seen.states.items():
            print(f"  {seen.node(name)}: {state or 'does not answer'}")
        for topic in seen.inputs:
            about = _rate(seen, topic)
            rate = "" if about["rate_hz"] is None else f", {about['rate_hz']:.1f} Hz"
            by = ", ".join(about["publishers"]) or "nobody"
            print(f"  {topic}: {about['messages']} messages{rate}, by {by}")
        print(f"  {seen.topic('scan_reports')}: {len(seen.reports)} scans answered")
    width = max(shutil.get_terminal_size((110, 24)).columns - 1, 60)
    for found in findings:
        print()
        head = f"{found.level} {found.subject}: {found.what}"
        for start, text in (("", head), ("  why: ", found.why), ("  fix: ", found.fix)):
            print(
                textwrap.fill(
                    start + text,
                    width,
                    subsequent_indent=" " * (len(start) or 2),
                    break_on_hyphens=False,
                    break_long_words=False,
                )
            )
    counts = {level: sum(f.level == level for f in findings) for level in (ERROR, WARNING, NOTE)}
    told = ", ".join(f"{n} {level}{'s' if n > 1 else ''}" for level, n in counts.items() if n)
    print(f"\n{told}" if told else "\nnothing wrong found")
