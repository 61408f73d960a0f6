"""Formations as a table: one row per formation and scan."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gda_tracker.formations.found import Formations
from gda_tracker.io.track_csv import decimal_seconds

COLUMNS = (
    "scan",
    "stamp_s",
    "formation_id",
    "since_s",
    "track_ids",
    "parent_track_ids",
    "x_m",
    "y_m",
    "vx_mps",
    "vy_mps",
    "x_std_m",
    "y_std_m",
    "extent_x_m",
    "extent_y_m",
    "number",
    "number_since_s",
    "expected_number",
    "number_probabilities",
    "parent_ids",
    "child_ids",
    "events",
)


def write_formations(path: str | Path, by_scan: Sequence[Formations]) -> None:
    """Write all formations; several ids, probabilities or events in one cell have spaces between.

    ``scan`` counts from 0; ``extent_x_m``, ``extent_y_m`` are standard deviations of the tracks
    about the centroid. The last row of a formation that was taken in, or has ended, has the event
    in the scan after it: in a row of its own, without places.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    with Path(path).open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for scan, found in enumerate(by_scan):
            told: dict[int, list[str]] = {}
            for event in found.events:
                told.setdefault(event.formation_id, []).append(event.kind)
            stamp = decimal_seconds(found.key.stamp_ns)
            for one in found.formations:
                std = np.sqrt(np.diagonal(one.position_covariance)).tolist()
                extent = np.sqrt(np.diagonal(one.extent)).tolist()
                since = decimal_seconds(one.number_since_ns) if one.number else ""
                probabilities = (f"{p:.6f}" for p in one.number_probabilities.tolist())
                writer.writerow(
                    (
                        scan,
                        stamp,
                        one.formation_id,
                        decimal_seconds(one.since_ns),
                        _cell(one.track_ids.tolist()),
                        _cell(one.parent_track_ids.tolist()),
                        *one.position.tolist(),
                        *one.velocity.tolist(),
                        *std,
                        *extent,
                        one.number,
                        since,
                        one.expected_number,
                        " ".join(probabilities),
                        _cell(one.parent_ids),
                        _cell(one.child_ids),
                        " ".join(told.pop(one.formation_id, [])),
                    )
                )
            for formation_id, kinds in told.items():
                blank = [""] * (len(COLUMNS) - 4)
                writer.writerow((scan, stamp, formation_id, *blank, " ".join(kinds)))


def _cell(ids: Sequence[int]) -> str:
    return " ".join(str(one) for one in ids)
