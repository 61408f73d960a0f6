"""Entries of the association log about detections that two tracks may have between them."""

from __future__ import annotations

from typing import Any

import numpy as np

from gda_tracker.vocabulary.hypotheses import Associations, Predictions
from gda_tracker.vocabulary.scans import Scan


def group_entries(
    scan: Scan, predictions: Predictions, associations: Associations
) -> dict[str, list[dict[str, Any]]]:
    """Return ``{"groups": [...]}``, or nothing where no tracks were near each other.

    An entry for every two tracks and detection (``None``: the group gave nothing), of the leaves
    that are least resolved. ``chosen``: both tracks have the detection.
    """
    decided = associations
    if not len(decided.group_first):
        return {}
    first, second = decided.group_first, decided.group_second
    tracks = np.stack([predictions.track_id[first], predictions.track_id[second]], axis=1)
    tracks.sort(axis=1)
    key = np.column_stack([tracks, decided.group_detection])
    order = np.lexsort((-decided.group_unresolved, *key.T[::-1]))
    new = np.ones(len(order), dtype=np.bool_)
    new[1:] = (np.diff(key[order], axis=0) != 0).any(axis=1)
    best = order[new]
    source = np.append(scan.source_index, -1)
    assigned, found = decided.assigned_detection, []
    for event in best.tolist():
        detection = int(decided.group_detection[event])
        of_both = [
            (assigned[predictions.track_id == track] == detection).any() for track in tracks[event]
        ]
        found.append(
            {
                "tracks": tracks[event].tolist(),
                "detection": None if detection < 0 else int(source[detection]),
                "unresolved_probability": float(decided.group_unresolved[event]),
                "joint_marginal": float(decided.group_marginal[event]),
                "chosen": bool(detection >= 0 and all(of_both)),
            }
        )
    return {"groups": found}


def group_lines(found: dict[str, Any]) -> list[str]:
    """What an explanation says of the detections that its track may share."""
    lines = []
    for group in found.get("groups", ()):
        if found["track_id"] not in group["tracks"] or group["detection"] is None:
            continue
        other = next(track for track in group["tracks"] if track != found["track_id"])
        text = (
            f"  detection {group['detection']} of both, it and track {other}: not resolved with "
            f"probability {group['unresolved_probability']:.3g}"
        )
        if found["decision"] != "mht":
            text += f", with all that is known {group['joint_marginal']:.3g}"
        lines.append(text + ("; CHOSEN, they share it" if group["chosen"] else ""))
    return lines
