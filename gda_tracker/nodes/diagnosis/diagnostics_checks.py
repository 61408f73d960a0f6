"""What the nodes say of themselves, explained."""

from __future__ import annotations

from collections.abc import Iterator

from gda_tracker.nodes.diagnosis.explanations import explanation
from gda_tracker.nodes.diagnosis.findings import ERROR, LEVELS, NOTE, WARNING, Finding
from gda_tracker.nodes.diagnosis.observation import Observation, Status

# Levels of diagnostic_msgs/DiagnosticStatus.
OF_LEVEL = {1: WARNING, 2: ERROR, 3: WARNING}


def diagnostics_findings(seen: Observation) -> list[Finding]:
    """Judge what the nodes of the ring's namespace report."""
    prefix = seen.node("")
    return [
        found
        for node, last in sorted(seen.last.items())
        if node.startswith(prefix)
        for found in (*_health(node, last), *_counters(node, seen.first[node], last))
    ]


def _health(node: str, status: Status) -> Iterator[Finding]:
    level = OF_LEVEL.get(status.level)
    if level is not None and status.text != "inactive":
        yield Finding(
            level,
            "diagnostics",
            node,
            f"says: {status.text}",
            "the node's own judgement of its input and its figures (docs/live.md)",
            "gda-tracker doctor --json, or ros2 topic echo /diagnostics, for all of its figures",
        )


def _counters(node: str, first: Status, last: Status) -> Iterator[Finding]:
    """Explain the counters that rise; those that stand are told as a note."""
    for name in last.values:
        count = last.count(name)
        meant = explanation(name)
        if not count or meant is None or not meant.level:
            continue
        rise = count - first.count(name)
        level = meant.level if rise > 0 else NOTE
        since = f", {rise} of them just now" if rise > 0 else ", none of them just now"
        yield Finding(
            LEVELS[max(LEVELS.index(level), LEVELS.index(meant.level))],
            name,
            node,
            f"{name} {count}{since}",
            meant.meaning,
            meant.fix or "nothing",
        )
