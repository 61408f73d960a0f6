"""Checkpoint: the track manager's state in a file, so that a restart goes on bit for bit.

The file holds no code and no pickles::

    text      "gda_tracker checkpoint 6" and a line feed
    8 bytes   length of the header, unsigned, little-endian
    header    JSON in UTF-8: {"rest": {...}, "arrays": [[name, dtype, shape], ...]}
    arrays    their bytes one after the other, row-major
    4 bytes   Adler-32 of all before, unsigned, little-endian

It is written to a neighbour and renamed, so a reader sees the old state or the new one, never half
of one. It is not forced to the disk: it outlives the process, not the machine.
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
import struct
import zlib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gda_tracker.tracking.class_motion import (
    histories_from,
    histories_to_arrays,
    histories_to_plain,
)
from gda_tracker.tracking.clutter import ClutterMap
from gda_tracker.tracking.hypotheses import ROW_FIELDS, HypothesisTable
from gda_tracker.tracking.initiation import StartPoints
from gda_tracker.tracking.looks import DetectionMap
from gda_tracker.tracking.manager import TrackManager
from gda_tracker.tracking.manager_state import ManagerState
from gda_tracker.tracking.measurement_clutter import MeasurementClutter
from gda_tracker.tracking.mht.couplings import Couplings
from gda_tracker.tracking.mht.generations import Generation
from gda_tracker.tracking.statement_desk import desk_from_plain, desk_to_plain
from gda_tracker.vocabulary.scans import ScanKey, ScanReport

MAGIC = b"gda_tracker checkpoint 6\n"
_LENGTH = struct.Struct("<Q")
_CHECKSUM = struct.Struct("<I")
_TABLE_FIELDS = (*ROW_FIELDS, "focal", "window_focal", "cell_members")
_POINT_FIELDS = tuple(f.name for f in dataclasses.fields(StartPoints))
_COUPLING_FIELDS = tuple(f.name for f in dataclasses.fields(Couplings))
_CLUTTER_FIELDS = ("extent_m", "exposure_scans", "count")
_MEASURED_FIELDS = ("extent", "lowest", "highest", "exposure_scans", "count")
_LOOKS_FIELDS = ("extent_m", "hits", "misses")
# Fields of ManagerState that are written as they are.
_PLAIN = (
    "next_track_id",
    "next_hypothesis_id",
    "next_detection_number",
    "last_ns",
    "degraded",
    "scans_closed",
)


class CheckpointError(ValueError):
    """A checkpoint cannot be read or written; the message is one line."""


def save(manager: TrackManager, path: Path) -> None:
    """Write the state of ``manager`` after its last closed scan to ``path`` by atomic rename.

    Raises
    ------
    CheckpointError
        If the file cannot be written; what was there before is untouched.
    """
    state = manager.state
    arrays = _table_arrays("table", state.table)
    arrays |= {f"points_{name}": getattr(state.points, name) for name in _POINT_FIELDS}
    arrays |= {f"clutter_{name}": getattr(state.clutter, name) for name in _CLUTTER_FIELDS}
    measured = state.measurement_clutter
    arrays |= {f"measured_clutter_{name}": getattr(measured, name) for name in _MEASURED_FIELDS}
    arrays |= {f"couplings_{name}": getattr(state.couplings, name) for name in _COUPLING_FIELDS}
    arrays |= {f"looks_{name}": getattr(state.looks, name) for name in _LOOKS_FIELDS}
    arrays |= histories_to_arrays(state.motion)
    arrays["deleted_track_id"] = state.deleted_track_id
    for place, generation in enumerate(state.generations):
        arrays |= _table_arrays(f"generation{place}", generation.table)
        arrays[f"generation{place}_settled"] = generation.settled
        arrays[f"generation{place}_deleted_track_id"] = generation.deleted_track_id
    described = [[name, values.dtype.str, values.shape] for name, values in arrays.items()]
    # Integers of numpy would be refused by JSON.
    header = json.dumps({"rest": _rest(manager), "arrays": described}, default=int).encode()
    parts: list[Any] = [MAGIC + _LENGTH.pack(len(header)) + header]
    parts += [np.ascontiguousarray(values).reshape(-1).view(np.uint8) for values in arrays.values()]
    checksum = 1
    for part in parts:
        checksum = zlib.adler32(part, checksum)
    neighbour = path.with_name(path.name + ".tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with neighbour.open("wb") as file:
            file.writelines([*parts, _CHECKSUM.pack(checksum)])
        os.replace(neighbour, path)
    except OSError as error:
        neighbour.unlink(missing_ok=True)
        raise CheckpointError(f"checkpoint {path}: cannot be written ({error.strerror})") from error


def load(manager: TrackManager, path: Path) -> bool:
    """Give ``manager`` the state in ``path``; return whether there was one.

    Raises
    ------
    CheckpointError
        If the file exists and is not a whole checkpoint of this format; ``manager`` is unchanged.
    """
    found = _read(path, manager.epoch)
    if found is None:
        return False
    manager.state, manager.system_uuid = found.state, found.system_uuid
    manager.counters.clear()
    manager.counters.update(found.counters)
    manager.resume()
    return True


def restore(manager: TrackManager, path: Path, epoch: int) -> list[ScanReport]:
    """Give a running ``manager`` the state in ``path``, and a new epoch.

    Its counters go on. Returns the answers to the scans that were under way, see
    :meth:`~gda_tracker.tracking.manager.TrackManager.reset`.

    Raises
    ------
    CheckpointError
        If there is no such file, or it is not a whole checkpoint of this format; ``manager`` is
        unchanged.
    """
    found = _read(path, epoch)
    if found is None:
        raise CheckpointError(f"checkpoint {path}: there is no such file")
    return manager.restore(found.state, found.system_uuid, epoch)


class _Content(NamedTuple):
    state: ManagerState
    system_uuid: bytes
    counters: dict[str, int]


def _read(path: Path, epoch: int) -> _Content | None:
    """Content of a file, ``None`` if there is none."""
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise CheckpointError(f"checkpoint {path}: cannot be read ({error.strerror})") from error
    try:
        rest, arrays = _parse(content)
        state = _state(rest, arrays, epoch)
        return _Content(state, bytes.fromhex(rest["system_uuid"]), dict(rest["counters"]))
    except (ValueError, KeyError, TypeError, struct.error) as error:
        reason = " ".join(str(error).split())
        raise CheckpointError(f"checkpoint {path}: not readable ({reason})") from error


def _rest(manager: TrackManager) -> dict[str, Any]:
    """All of the state that is not an array, for JSON."""
    state = manager.state
    report, origin = None, None
    if state.last_report is not None:
        report = dataclasses.asdict(state.last_report)
        del report["key"]  # it has the epoch, which a restart changes
    if state.initialised_from is not None:
        origin = [state.initialised_from[0].hex(), state.initialised_from[1]]
    return {
        **{name: getattr(state, name) for name in _PLAIN},
        "system_uuid": manager.system_uuid.hex(),
        "frame": state.table.frame,
        "class_names": state.table.class_names,
        "models": state.table.models,
        "spread": state.table.spread,
        "generations": [
            {
                "key": generation.key[1:],
                "degraded": generation.degraded,
                "frame": generation.table.frame,
                "class_names": generation.table.class_names,
                "models": generation.table.models,
                "spread": generation.table.spread,
            }
            for generation in state.generations
        ],
        "motion": histories_to_plain(state.motion),
        "last_sensors": state.last_sensors,
        "clutter_sensors": state.clutter.sensor_ids,
        "measured_clutter_sensors": state.measurement_clutter.sensor_ids,
        "measured_clutter_models": state.measurement_clutter.models,
        "looks_sensors": state.looks.sensor_ids,
        "last_key": None if state.last_key is None else state.last_key[1:],
        "last_report": report,
        "initialised_from": origin,
        "statements": desk_to_plain(state.desk),
        "counters": manager.counters,
    }


def _parse(content: bytes) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Header and arrays of a file."""
    if not content.startswith(MAGIC):
        raise ValueError("it is not a checkpoint of this version")
    body, checksum = content[: -_CHECKSUM.size], content[-_CHECKSUM.size :]
    if _CHECKSUM.unpack(checksum)[0] != zlib.adler32(body):
        raise ValueError("it is damaged or cut off")
    start = len(MAGIC) + _LENGTH.size
    end = start + _LENGTH.unpack(body[len(MAGIC) : start])[0]
    header = json.loads(body[start:end])
    arrays = {}
    for name, dtype, shape in header["arrays"]:
        values = np.frombuffer(body, dtype=dtype, count=math.prod(shape), offset=end)
        arrays[name] = values.reshape(shape).copy()
        end += values.nbytes
    return header["rest"], arrays


def _state(rest: dict[str, Any], arrays: dict[str, np.ndarray], epoch: int) -> ManagerState:
    """State of the manager from header and arrays."""
    key = None if rest["last_key"] is None else ScanKey(epoch, *rest["last_key"])
    report = None
    if rest["last_report"] is not None and key is not None:
        report = ScanReport(key=key, **rest["last_report"])
    origin = rest["initialised_from"]
    generations = [
        Generation(
            ScanKey(epoch, *known["key"]),
            _table(f"generation{place}", arrays, known),
            arrays[f"generation{place}_settled"],
            arrays[f"generation{place}_deleted_track_id"],
            known["degraded"],
        )
        for place, known in enumerate(rest["generations"])
    ]
    return ManagerState(
        **{name: rest[name] for name in _PLAIN},
        table=_table("table", arrays, rest),
        points=StartPoints(**{name: arrays[f"points_{name}"] for name in _POINT_FIELDS}),
        clutter=ClutterMap(
            tuple(rest["clutter_sensors"]),
            **{name: arrays[f"clutter_{name}"] for name in _CLUTTER_FIELDS},
        ),
        measurement_clutter=MeasurementClutter(
            tuple(rest.get("measured_clutter_sensors", ())),
            tuple(rest.get("measured_clutter_models", ())),
            **{
                name: arrays[f"measured_clutter_{name}"]
                for name in _MEASURED_FIELDS
                if f"measured_clutter_{name}" in arrays
            },
        ),
        couplings=Couplings(
            # Checkpoints of versions without are read too.
            **{
                name: arrays[f"couplings_{name}"]
                for name in _COUPLING_FIELDS
                if f"couplings_{name}" in arrays
            }
        ),
        looks=DetectionMap(
            tuple(rest.get("looks_sensors", ())),
            **{
                name: arrays[f"looks_{name}"] for name in _LOOKS_FIELDS if f"looks_{name}" in arrays
            },
        ),
        last_sensors=tuple(rest["last_sensors"]),
        last_key=key,
        last_report=report,
        deleted_track_id=arrays["deleted_track_id"],
        initialised_from=None if origin is None else (bytes.fromhex(origin[0]), origin[1]),
        generations=generations,
        motion=histories_from(rest.get("motion", []), arrays),
        desk=desk_from_plain(rest["statements"]),
    )


def _table_arrays(prefix: str, table: HypothesisTable) -> dict[str, np.ndarray]:
    """Arrays of a table by their names in the file."""
    return {f"{prefix}_{name}": getattr(table, name) for name in _TABLE_FIELDS}


def _table(prefix: str, arrays: dict[str, np.ndarray], rest: dict[str, Any]) -> HypothesisTable:
    """Table of the arrays with a prefix; ``rest`` has the names of frame, classes, models."""
    columns: dict[str, Any] = {name: arrays[f"{prefix}_{name}"] for name in _TABLE_FIELDS}
    frame, classes = tuple(rest["frame"]), tuple(rest["class_names"])
    models, spread = tuple(rest["models"]), int(rest.get("spread", 1))
    return HypothesisTable(
        **columns, frame=frame, class_names=classes, models=models, spread=spread
    )
