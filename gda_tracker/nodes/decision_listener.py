"""Hearing the newest decision of a running ring: its topics keep it for who comes late."""

from __future__ import annotations

from typing import Any

from gda_tracker_msgs import msg

from gda_tracker.errors import UserError
from gda_tracker.io.decision_bags import NEEDED, READERS, entry_of_parts
from gda_tracker.nodes.inquirer import Inquirer
from gda_tracker.nodes.qualities import latched, stream
from gda_tracker.vocabulary.scans import ScanKey

LATCHED = {
    "scans": msg.Scan,
    "predictions": msg.Predictions,
    "attribute_scores": msg.AttributeScores,
    "associations": msg.Associations,
}
MHT = "mht"


def last_decision(namespace: str, domain: int | None, wait_s: float) -> dict[str, Any]:
    """Return the entry of the newest scan that the ring has decided.

    Under ``mht`` the tracks say which hypothesis leads, and they are not kept for who comes late:
    it is that of the next scan.

    Raises
    ------
    UserError
        If no decision is heard within ``wait_s``.
    """
    heard: dict[ScanKey, dict[str, Any]] = {}

    def take(name: str, message: Any) -> None:
        value = READERS[name](message)
        heard.setdefault(value.key, {})[name] = value

    def complete() -> list[dict[str, Any]]:
        return [parts for parts in heard.values() if _complete(parts)]

    with Inquirer("gda_tracker_why", domain) as inquirer:
        space = namespace.strip("/")
        prefix = f"/{space}/" if space else "/"
        for name, kind in LATCHED.items():
            inquirer.node.create_subscription(
                kind, prefix + name, lambda m, n=name: take(n, m), latched()
            )
        inquirer.node.create_subscription(
            msg.TrackArray, f"{prefix}tracks", lambda m: take("tracks", m), stream()
        )
        if not inquirer.spin_until(lambda: bool(complete()), wait_s):
            there = inquirer.node.count_publishers(f"{prefix}associations")
            raise UserError(_nothing(prefix, bool(there), bool(heard), inquirer.domain, wait_s))
    parts = complete()[-1]
    key = parts["associations"].key
    head = {"sensor_id": key.sensor_id, "stamp_ns": int(key.stamp_ns), "outcome": "tracked"}
    return head | {"reason": ""} | entry_of_parts(parts)


def _complete(parts: dict[str, Any]) -> bool:
    if not set(NEEDED) <= set(parts):
        return False
    decided = parts["associations"]
    if not decided.degraded and "attribute_scores" not in parts:
        return False
    return decided.decision != MHT or "tracks" in parts


def _nothing(prefix: str, there: bool, heard: bool, domain: int, wait_s: float) -> str:
    if not there:
        return (
            f"no tracker publishes {prefix}associations in ROS domain {domain}; gda-tracker doctor "
            "looks for the reason"
        )
    if heard:
        return (
            f"no scan was decided within {wait_s:g} s (with decision mht a new one is needed); is "
            "the radar still sending?"
        )
    return f"the tracker has decided no scan yet within {wait_s:g} s"
