"""True positions of targets from elsewhere, such as a GNSS log, for recordings without them.

A CSV table has one row per target and time, in the tracking frame::

    time_s,target_id,x_m,y_m
    1620205606.25,1,102.5,-33.0

``stamp_ns`` or ``time_ms`` may stand in place of ``time_s``; ``vx_mps`` and ``vy_mps`` are
optional. Between two rows of a target its position is interpolated to the time of the scan.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gda_tracker.io.adapters import RecordingError, is_recording, load_recording
from gda_tracker.vocabulary.arrays import FloatArray, IntArray
from gda_tracker.vocabulary.scans import Detections, ScanTruth

# Rows of a target farther apart in time tell nothing of what is between them.
LONGEST_GAP_S = 10.0
TIMES = {"stamp_ns": 1, "time_ms": 1_000_000, "time_s": 1_000_000_000}
STATE = ("x_m", "y_m", "vx_mps", "vy_mps")


@dataclass(frozen=True)
class TruthTable:
    """Known states: ``stamp_ns`` (N,), ``target_id`` (N,), ``state`` (N, 4) with NaN if unknown."""

    stamp_ns: IntArray
    target_id: IntArray
    state: FloatArray


def read_truth(path: Path) -> TruthTable:
    """Read a CSV table, or the truth that a recording brings.

    Raises
    ------
    RecordingError
        If it cannot be read; the message names the line.
    """
    if not path.exists():
        raise RecordingError(f"{path} does not exist")
    if path.is_dir() or (path.suffix != ".csv" and is_recording(path)):
        truth = load_recording(path).truth
        if truth is None:
            raise RecordingError(f"{path}: the recording brings no true positions")
        counts = [len(scan.target_id) for scan in truth]
        return TruthTable(
            np.repeat(np.array([scan.stamp_ns for scan in truth], dtype=np.int64), counts),
            np.concatenate([scan.target_id for scan in truth]).astype(np.int64),
            np.vstack([scan.target_state for scan in truth]),
        )
    try:
        with path.open(newline="", encoding="utf-8") as file:
            return _read_csv(file, path)
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"{path}: cannot be read: {error}") from error


def truth_of_scans(
    tables: Sequence[TruthTable], detections: Sequence[Detections]
) -> list[ScanTruth]:
    """Return the truth at the time of each scan, unknown (NaN) outside the rows of a target.

    Raises
    ------
    RecordingError
        If no target is known at any scan.
    """
    stamp = np.concatenate([table.stamp_ns for table in tables])
    identity = np.concatenate([table.target_id for table in tables])
    state = np.vstack([table.state for table in tables])
    targets = np.unique(identity)
    scans = np.array([scan.stamp_ns for scan in detections], dtype=np.int64)
    found = np.full((len(scans), len(targets), 4), np.nan)
    for column, target in enumerate(targets):
        mine = np.flatnonzero(identity == target)
        order = mine[np.argsort(stamp[mine], kind="stable")]
        found[:, column] = _interpolate(scans, stamp[order], state[order])
    if not np.isfinite(found[..., :2]).all(axis=2).any():
        raise RecordingError("truth: no target is known at the time of any scan; are clocks equal?")
    return [
        ScanTruth(scan.sensor_id, scan.stamp_ns, targets.astype(np.int32), found[row])
        for row, scan in enumerate(detections)
    ]


def _interpolate(scans: IntArray, stamp: IntArray, state: FloatArray) -> FloatArray:
    after = np.searchsorted(stamp, scans, side="left")
    right = np.minimum(after, len(stamp) - 1)
    left = np.maximum(np.where(stamp[right] == scans, right, after - 1), 0)
    gap = (stamp[right] - stamp[left]).astype(np.float64)
    inside = (stamp[left] <= scans) & (scans <= stamp[right]) & (gap <= LONGEST_GAP_S * 1e9)
    share = np.divide(scans - stamp[left], gap, out=np.zeros(len(scans)), where=gap > 0)[:, None]
    result = (1.0 - share) * state[left] + share * state[right]
    result[~inside] = np.nan
    return result


def _read_csv(file: object, path: Path) -> TruthTable:
    rows = csv.DictReader(line for line in file if not line.startswith("#"))
    names = [name.strip() for name in rows.fieldnames or []]
    rows.fieldnames = names
    time = next((name for name in TIMES if name in names), None)
    missing = [name for name in ("target_id", "x_m", "y_m") if name not in names]
    if time is None or missing:
        wanted = [] if time else [f"one of {', '.join(TIMES)}"]
        raise RecordingError(f"{path}: columns {', '.join(wanted + missing)}: missing in {names}")
    stamps, targets, states = [], [], []
    for number, row in enumerate(rows, 2):
        try:
            stamps.append(_stamp(row[time], TIMES[time]))
            targets.append(int(row["target_id"]))
            states.append([_number(row.get(name)) for name in STATE])
        except (TypeError, ValueError) as error:
            raise RecordingError(f"{path}: row {number}: {error}") from error
    if not stamps:
        raise RecordingError(f"{path}: no row")
    return TruthTable(
        np.array(stamps, dtype=np.int64), np.array(targets, dtype=np.int64), np.array(states)
    )


def _stamp(text: str, unit_ns: int) -> int:
    """Exact to the nanosecond: a float of seconds since 1970 is not."""
    if unit_ns == 1:
        return int(text)
    from decimal import Decimal, InvalidOperation

    try:
        return int((Decimal(text.strip()) * unit_ns).to_integral_value())
    except InvalidOperation as error:
        raise ValueError(f"{text!r} is not a time") from error


def _number(text: str | None) -> float:
    if text is None or not text.strip():
        return math.nan
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text} is not finite; an empty cell is unknown")
    return value
