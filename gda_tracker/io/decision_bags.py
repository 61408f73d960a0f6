"""The decisions in a bag of the ring's topics, as entries of the association log."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from gda_tracker.errors import UserError
from gda_tracker.evaluation.association_log import decision_entry
from gda_tracker.io.bags import Bag
from gda_tracker.io.messages import (
    associations_from_message,
    attribute_scores_from_message,
    predictions_from_message,
    scan_from_message,
    scan_report_from_message,
    tracks_from_message,
)
from gda_tracker.vocabulary.scans import ScanKey

READERS: dict[str, Callable[[Any], Any]] = {
    "scans": scan_from_message,
    "predictions": predictions_from_message,
    "attribute_scores": attribute_scores_from_message,
    "associations": associations_from_message,
    "tracks": tracks_from_message,
    "scan_reports": scan_report_from_message,
}
NEEDED = ("scans", "predictions", "associations")

Parts = dict[str, Any]


def bag_entries(path: str | Path, namespace: str = "") -> list[dict[str, Any]]:
    """Return an entry per scan of a bag of all topics, in the order in which they were answered.

    Parameters
    ----------
    path
        Bag.
    namespace
        Of the topics; by default the only one in which the ring is recorded.

    Raises
    ------
    UserError
        If there are no decisions in it.
    """
    bag = Bag(path)
    topics = _topics(bag, namespace)
    parts: dict[ScanKey, Parts] = {}
    answered: list[Any] = []
    for record in bag.records(list(topics)):
        name = topics[record.topic]
        value = READERS[name](record.message())
        if name != "scan_reports":
            parts.setdefault(value.key, {})[name] = value
        elif not value.repeated and value.outcome != "initialised":
            answered.append(value)
    entries = []
    for report in answered:
        head = {
            "sensor_id": report.key.sensor_id,
            "stamp_ns": int(report.key.stamp_ns),
            "outcome": report.outcome,
            "reason": report.reason,
        }
        entries.append(head | entry_of_parts(parts.pop(report.key, {})))
    # What was decided without an answer in the bag, as where recording began or ended in between.
    entries += [
        {"sensor_id": key.sensor_id, "stamp_ns": int(key.stamp_ns), "outcome": "tracked"}
        | {"reason": ""}
        | entry_of_parts(found)
        for key, found in parts.items()
        if set(NEEDED) <= set(found)
    ]
    return entries


def entry_of_parts(parts: Parts) -> dict[str, Any]:
    """Return what the messages of one scan say of the decision, nothing if some are missing."""
    if not set(NEEDED) <= set(parts):
        return {}
    return decision_entry(
        parts["scans"],
        parts["predictions"],
        parts.get("attribute_scores"),
        parts["associations"],
        parts.get("tracks"),
    )


def _topics(bag: Bag, namespace: str) -> dict[str, str]:
    """Topics that are read, with their names in the ring."""
    space = "/" + namespace.strip("/") if namespace.strip("/") else ""
    found = [
        name.removesuffix("/associations") for name in bag.topics if name.endswith("/associations")
    ]
    if not namespace:
        if len(found) > 1:
            places = ", ".join(sorted(place or "/" for place in found))
            raise UserError(f"{bag.path}: several rings: {places}; name one with --namespace")
        space = found[0] if found else ""
    topics = {
        f"{space}/{name}": name
        for name in READERS
        if f"{space}/{name}" in bag.topics and bag.topics[f"{space}/{name}"].message_count
    }
    missing = [name for name in NEEDED if name not in topics.values()]
    if missing:
        raise UserError(
            f"{bag.path}: no decisions in it ({', '.join(missing)} missing); make them with "
            f"gda-tracker replay {bag.path} --offline --association-log why.jsonl"
        )
    return topics
