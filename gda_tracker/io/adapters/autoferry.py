"""The marine radar of the Autoferry sensor fusion dataset (CC0-1.0).

A scenario is ``scenarioN_detections.json``, with ``scenarioN_groundTruth.json`` beside it or not.
Entry k of the truth belongs to entry k of the detections. Only the radar (``sensorID`` 2) is read.

Positions in the files are [north, east]; here x is East and y is North, so the azimuth is
counter-clockwise from East. Detections are relative to the own ship without rotation, hence the
sensor stands at the own ship's position with the axes of the local frame. There is no range rate
and no radar cross section. The truth is where the boats' GNSS antennas were at a time that differs
from the scan's by up to 0.75 s; their velocities are not given.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from gda_tracker.io.adapters.adapter import (
    NO_OPTIONS,
    Adapter,
    InputOptions,
    RecordingError,
    first_bytes,
)
from gda_tracker.io.parameter_files import read_preset
from gda_tracker.vocabulary.arrays import FloatArray
from gda_tracker.vocabulary.recordings import Recording
from gda_tracker.vocabulary.scans import Detections, ScanTruth

RADAR = 2
SENSOR_ID = "radar"
SENSOR_FRAME = "radar"
TRACKING_FRAME = "map"
DETECTIONS_SUFFIX = "_detections"
TRUTH_SUFFIX = "_groundTruth"
ORIGIN = (
    "Autoferry sensor fusion dataset, CC0-1.0, github.com/Autoferry/sensor_fusion_dataset; "
    'cite "Heterogeneous multi-sensor tracking for an autonomous surface vehicle in a littoral '
    'environment", sciencedirect.com/science/article/pii/S0029801822005753'
)


def recognises(path: Path) -> bool:
    """Tell whether this is a JSON list of entries with a ``sensorID``."""
    start = first_bytes(path, 4096).lstrip()
    return start.startswith(b"[") and b'"sensorID"' in start


def load(path: Path, options: InputOptions = NO_OPTIONS) -> Recording:
    """Read the radar scans of a scenario, with the truth if its file lies beside.

    Raises
    ------
    RecordingError
        If a file is not of this kind; the message names the entry.
    """
    entries = _read_list(path)
    truth_path = _truth_path(path)
    truth_entries = _read_list(truth_path) if truth_path is not None else None
    if truth_entries is not None and len(truth_entries) != len(entries):
        raise RecordingError(
            f"{truth_path}: {len(truth_entries)} entries, {len(entries)} in {path.name}"
        )
    name = path.stem.removesuffix(DETECTIONS_SUFFIX)
    recording = Recording(
        name=name,
        detections=[],
        truth=None if truth_entries is None else [],
        preset_name="autoferry",
        preset=read_preset("autoferry"),
        origin=f"{ORIGIN}, {name}",
    )
    for index, entry in enumerate(entries):
        where = f"{path}: entry {index}"
        if _field(entry, "sensorID", where) != RADAR:
            continue
        detections = _detections(entry, len(recording.detections) + 1, where)
        recording.detections.append(detections)
        if recording.truth is not None and truth_entries is not None:
            where = f"{truth_path}: entry {index}"
            recording.truth.append(_truth(truth_entries[index], detections.stamp_ns, where))
    if not recording.detections:
        raise RecordingError(f"{path}: no radar scan (sensorID {RADAR}) in {len(entries)} entries")
    return recording


def _truth_path(path: Path) -> Path | None:
    if not path.stem.endswith(DETECTIONS_SUFFIX):
        return None
    stem = path.stem.removesuffix(DETECTIONS_SUFFIX)
    truth = path.with_name(f"{stem}{TRUTH_SUFFIX}{path.suffix}")
    return truth if truth.exists() else None


def _read_list(path: Path) -> list[Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise RecordingError(f"{path}: not a text file") from error
    except json.JSONDecodeError as error:
        raise RecordingError(f"{path}: not JSON in line {error.lineno}: {error.msg}") from error
    if not isinstance(content, list):
        raise RecordingError(f"{path}: not a list of entries")
    return content


def _field(entry: Any, name: str, where: str) -> Any:
    if not isinstance(entry, dict):
        raise RecordingError(f"{where}: not an object with named fields")
    if name not in entry:
        raise RecordingError(f"{where}: {name} is missing")
    return entry[name]


def _numbers(value: Any, shape: str, where: str) -> FloatArray:
    """Return lists of numbers as an array; lists of different lengths and texts are errors."""
    try:
        return np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise RecordingError(f"{where}: expected {shape}") from error


def _stamp_ns(entry: Any, where: str) -> int:
    time = _field(entry, "time", where)
    if isinstance(time, bool) or not isinstance(time, int | float) or not np.isfinite(time):
        raise RecordingError(f"{where}: time = {time!r} is not a number of seconds")
    return round(time * 1e9)


def _detections(entry: Any, sequence: int, where: str) -> Detections:
    own = _numbers(_field(entry, "ownshipPosition", where), "[north, east]", f"{where}: ownship")
    if own.shape != (2,) or not np.isfinite(own).all():
        raise RecordingError(f"{where}: ownshipPosition is not [north, east]")
    north, east = _points(_field(entry, "measurement", where), f"{where}: measurement")
    return Detections(
        sensor_id=SENSOR_ID,
        stamp_ns=_stamp_ns(entry, where),
        range_m=np.hypot(north, east),
        azimuth_rad=np.arctan2(north, east),
        sensor_position_m=np.array([own[1], own[0], 0.0]),
        frame_id=SENSOR_FRAME,
        sequence=sequence,
    )


def _points(measurement: Any, where: str) -> FloatArray:
    """Return (2, M): north, east. An empty scan is ``[]``, one point may stand as [north, east]."""
    shape = "[[north ...], [east ...]]"
    points = _numbers(measurement, shape, where)
    if points.size == 0:
        return np.zeros((2, 0))
    if points.shape == (2,):
        return points.reshape(2, 1)
    if points.ndim != 2 or len(points) != 2:
        raise RecordingError(f"{where}: expected {shape}, found the shape {points.shape}")
    return points


def _truth(targets: Any, stamp_ns: int, where: str) -> ScanTruth:
    if not isinstance(targets, list):
        raise RecordingError(f"{where}: not a list of targets")
    state = np.full((len(targets), 4), np.nan)
    for row, target in enumerate(targets):
        position = _numbers(_field(target, "position", where), "[north, east, down]", where)
        if position.shape != (3,):
            raise RecordingError(f"{where}: position is not [north, east, down]")
        state[row, :2] = position[1], position[0]
    identifiers = [_field(target, "targetID", where) for target in targets]
    if not all(isinstance(number, int) for number in identifiers):
        raise RecordingError(f"{where}: targetID is not an integer")
    return ScanTruth(
        sensor_id=SENSOR_ID,
        stamp_ns=stamp_ns,
        target_id=np.array(identifiers, dtype=np.int32),
        target_state=state,
        frame_id=TRACKING_FRAME,
    )


ADAPTER = Adapter(
    name="autoferry",
    description="scenarioN_detections.json of the Autoferry sensor fusion dataset",
    recognises=recognises,
    load=load,
)
