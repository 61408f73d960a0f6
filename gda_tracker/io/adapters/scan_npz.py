"""Seeded surveillance-radar scenarios as numpy files of arrays (``.npz``, no pickles).

=============  ==========  =========================================================================
times          (K,)        scan times [s]
scan_ptr       (K + 1,)    detections of scan k are rows scan_ptr[k] to scan_ptr[k + 1]
azimuth        (D,)        [rad] from North, clockwise
range          (D,)        [m]
rcs            (D,)        [m2], linear; optional
truth_id       (D,)        target index, -1 for clutter; this and the next two are optional
truth_state    (K, N, 4)   x East, vx, y North, vy [m, m/s]
truth_type     (N,)        0 fighter, 1 cargo
meta           ()          JSON text; optional
=============  ==========  =========================================================================

Azimuths are turned to REP-103 (counter-clockwise from East). ``sigma_range`` and ``sigma_azimuth``
of ``meta`` are the sensor's data sheet and go with the detections; ``p_detect`` and
``clutter_density`` go into the preset.
"""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gda_tracker.io.adapters.adapter import (
    NO_OPTIONS,
    Adapter,
    InputOptions,
    RecordingError,
    first_bytes,
)
from gda_tracker.io.parameter_files import (
    ParameterFileError,
    check_parameters,
    read_preset,
    stage_tables,
)
from gda_tracker.vocabulary.arrays import FloatArray, IntArray
from gda_tracker.vocabulary.recordings import Recording
from gda_tracker.vocabulary.scans import Detections, ScanTruth

SENSOR_ID = "radar"
SENSOR_FRAME = "radar"
TRACKING_FRAME = "map"
TYPES = ("fighter", "cargo")
TRUTH = ("truth_id", "truth_state", "truth_type")
# name in the data sheet -> parameter of the track manager
DATA_SHEET = {
    "p_detect": "detection_probability",
    "clutter_density": "clutter_density_per_m_rad",
}


def recognises(path: Path) -> bool:
    """Tell whether this is a zip archive with a member ``scan_ptr.npy``."""
    if not first_bytes(path, 4).startswith(b"PK\x03\x04"):
        return False
    try:
        with zipfile.ZipFile(path) as archive:
            return "scan_ptr.npy" in archive.namelist()
    except (zipfile.BadZipFile, OSError):
        return False


def load(path: Path, options: InputOptions = NO_OPTIONS) -> Recording:
    """Read a scenario file.

    Raises
    ------
    RecordingError
        If it is not of this kind; the message names the array.
    """
    arrays = _read(path)
    start, stamps = _scans(arrays, path)
    count = int(start[-1])
    columns = {name: _column(arrays, name, count, path) for name in ("azimuth", "range")}
    rcs = _column(arrays, "rcs", count, path) if "rcs" in arrays else None
    meta = _meta(arrays, path)
    noise = {
        field: np.array([_positive(meta[name], name, path)])
        for name, field in (("sigma_range", "range_std_m"), ("sigma_azimuth", "azimuth_std_rad"))
        if name in meta
    }
    azimuth = _counter_clockwise_from_east(columns["azimuth"])
    detections = [
        Detections(
            sensor_id=SENSOR_ID,
            stamp_ns=stamps[k],
            range_m=columns["range"][a:b],
            azimuth_rad=azimuth[a:b],
            rcs_m2=None if rcs is None else rcs[a:b],
            frame_id=SENSOR_FRAME,
            sequence=k + 1,
            **noise,
        )
        for k, (a, b) in enumerate(zip(start[:-1], start[1:], strict=True))
    ]
    return Recording(
        name=path.stem,
        detections=detections,
        truth=_truth(arrays, start, stamps, path),
        preset_name="scan_npz with the data sheet of the file",
        preset=_preset(meta, path),
        origin=f"simulated surveillance radar, seed {meta['seed']}" if "seed" in meta else "",
    )


def _read(path: Path) -> dict[str, NDArray[Any]]:
    try:
        data = np.load(path, allow_pickle=False)
        if isinstance(data, np.ndarray):
            raise RecordingError(f"{path}: one array, not an archive of named arrays")
        with data:
            return {name: data[name] for name in data.files}
    except RecordingError:
        raise
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror or error}") from error
    except (ValueError, EOFError, zipfile.BadZipFile) as error:
        reason = " ".join(str(error).split())
        raise RecordingError(f"{path}: not an archive of arrays ({reason})") from error


def _array(arrays: dict[str, NDArray[Any]], name: str, shape: str, path: Path) -> NDArray[Any]:
    if name not in arrays:
        raise RecordingError(f"{path}: array {name} {shape} is missing")
    array = arrays[name]
    if array.dtype.kind not in "iuf":
        raise RecordingError(f"{path}: array {name} holds {array.dtype}, not numbers")
    return array


def _scans(arrays: dict[str, NDArray[Any]], path: Path) -> tuple[IntArray, list[int]]:
    """Return the first row of each scan, and the end, and the stamps."""
    start = _array(arrays, "scan_ptr", "(K + 1,)", path)
    times = _array(arrays, "times", "(K,)", path)
    rows = _array(arrays, "range", "(D,)", path).size
    if (
        start.ndim != 1
        or start.dtype.kind == "f"
        or len(start) < 2
        or start[0] != 0
        or np.any(start[1:] < start[:-1])
        or start[-1] != rows
    ):
        raise RecordingError(f"{path}: array scan_ptr does not rise from 0 to {rows}")
    if times.shape != (len(start) - 1,) or not np.isfinite(times).all():
        raise RecordingError(f"{path}: array times is not {len(start) - 1} numbers")
    return start.astype(np.int64), [round(float(time) * 1e9) for time in times]


def _column(arrays: dict[str, NDArray[Any]], name: str, count: int, path: Path) -> FloatArray:
    array = _array(arrays, name, "(D,)", path)
    if array.shape != (count,):
        raise RecordingError(f"{path}: array {name} has the shape {array.shape}, not ({count},)")
    return array.astype(np.float64)


def _counter_clockwise_from_east(azimuth: FloatArray) -> FloatArray:
    turned = np.pi / 2.0 - azimuth
    return np.where(turned > np.pi, turned - 2.0 * np.pi, turned)


def _meta(arrays: dict[str, NDArray[Any]], path: Path) -> dict[str, Any]:
    if "meta" not in arrays:
        return {}
    try:
        meta = json.loads(str(arrays["meta"]))
    except json.JSONDecodeError as error:
        raise RecordingError(f"{path}: meta is not JSON: {error.msg}") from error
    if not isinstance(meta, dict):
        raise RecordingError(f"{path}: meta is not an object with named fields")
    return meta


def _positive(value: Any, name: str, path: Path) -> float:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not np.isfinite(value) or value <= 0.0:
        raise RecordingError(f"{path}: meta: {name} = {value!r}: allowed is a number > 0")
    return float(value)


def _preset(meta: dict[str, Any], path: Path) -> dict[str, dict[str, Any]]:
    preset = read_preset("scan_npz")
    told = {parameter: meta[name] for name, parameter in DATA_SHEET.items() if name in meta}
    content = {"track_manager": {"ros__parameters": {**preset["track_manager"], **told}}}
    try:
        return preset | check_parameters(content, stage_tables(), f"{path}: meta")
    except ParameterFileError as error:
        raise RecordingError(str(error)) from error


def _truth(
    arrays: dict[str, NDArray[Any]], start: IntArray, stamps: list[int], path: Path
) -> list[ScanTruth] | None:
    if not any(name in arrays for name in TRUTH):
        return None
    scans = len(stamps)
    state = _array(arrays, "truth_state", "(K, N, 4)", path)
    if state.ndim != 3 or state.shape[0] != scans or state.shape[2] != 4:
        shape = f"({scans}, N, 4)"
        raise RecordingError(f"{path}: array truth_state has the shape {state.shape}, not {shape}")
    targets = state.shape[1]
    source = _array(arrays, "truth_id", "(D,)", path)
    if source.shape != (start[-1],) or np.any((source < -1) | (source >= targets)):
        raise RecordingError(f"{path}: array truth_id is not one of -1 to {targets - 1} per row")
    kinds = _array(arrays, "truth_type", "(N,)", path)
    if kinds.shape != (targets,) or np.any((kinds < 0) | (kinds >= len(TYPES))):
        raise RecordingError(f"{path}: array truth_type is not one of 0, 1 per target")
    x, vx, y, vy = np.moveaxis(state.astype(np.float64), 2, 0)
    ordered = np.stack([x, y, vx, vy], axis=2)
    classes = tuple(TYPES[int(kind)] for kind in kinds)
    identifiers = np.arange(targets, dtype=np.int32)
    return [
        ScanTruth(
            sensor_id=SENSOR_ID,
            stamp_ns=stamps[k],
            target_id=identifiers,
            target_state=ordered[k],
            source_id=source[start[k] : start[k + 1]].astype(np.int32),
            target_class=classes,
            frame_id=TRACKING_FRAME,
        )
        for k in range(scans)
    ]


ADAPTER = Adapter(
    name="scan_npz",
    description="simulated scenario as a numpy archive with scan_ptr, azimuth, range, rcs",
    recognises=recognises,
    load=load,
)
