"""One track over time: radar cross section of its detections and belief in its classes."""

from __future__ import annotations

from typing import Any

import numpy as np

from gda_tracker.view.encoding import decibels, numbers
from gda_tracker.view.history import History


def track_json(history: History, track_id: int, last: int) -> dict[str, Any] | None:
    """Rows of a track in the scans kept up to number ``last``; ``None`` where it is in none.

    ``rcs_dbsm`` is ``None`` on scans without a detection or without a radar cross section.
    """
    seconds, scans, rcs_m2 = [], [], []
    probability: list[list[float | None]] = []
    class_names: tuple[str, ...] = ()
    for at, picture in history.between(1, last):
        tracks = picture.tracks
        # Tracks come by rising id.
        row = int(np.searchsorted(tracks.track_id, track_id))
        if row == len(tracks) or tracks.track_id[row] != track_id:
            continue
        scans.append(at)
        seconds.append(history.seconds(picture))
        value = np.nan
        if tracks.detection_index[row] >= 0:
            seen = picture.sightings
            found = np.flatnonzero(seen.source_index == tracks.detection_index[row])
            value = seen.rcs_m2[found[0]] if len(found) else np.nan
        rcs_m2.append(value)
        if tracks.class_names != class_names:  # other classes: what was said before is of those
            class_names = tracks.class_names
            probability = [[None] * len(class_names) for _ in probability]
        probability.append(numbers(tracks.class_probability[row], 4))
    if not scans:
        return None
    return {
        "id": track_id,
        "scan": scans,
        "seconds": numbers(np.array(seconds), 3),
        "rcs_dbsm": numbers(decibels(np.array(rcs_m2, dtype=np.float64)), 2),
        "class_names": list(class_names),
        "class_probability": probability,
    }
