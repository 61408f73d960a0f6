"""Checkpoint: the track manager's state in a file, so that a restart goes on bit for bit.

The file is a plain ``.npz`` without pickles: the arrays of the hypothesis table and the start
points as they are, everything else as one JSON text. It is written to a neighbour and renamed, so a
reader sees the old state or the new one, never half of one.
"""

from __future__ import annotations

import dataclasses
import io
import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from gda_tracker.tracking.hypotheses import ROW_FIELDS, HypothesisTable
from gda_tracker.tracking.initiation import StartPoints
from gda_tracker.tracking.manager import ManagerState, TrackManager
from gda_tracker.vocabulary.scans import ScanKey, ScanReport

FORMAT = 1


class CheckpointError(ValueError):
    """A checkpoint file cannot be read; the message is one line."""


def save(manager: TrackManager, path: Path) -> None:
    """Write the state of ``manager`` after its last closed scan to ``path`` by atomic rename."""
    state = manager.state
    rest: dict[str, Any] = {
        "format": FORMAT,
        "system_uuid": manager.system_uuid.hex(),
        "frame": list(state.table.frame),
        "class_names": list(state.table.class_names),
        "next_track_id": state.next_track_id,
        "next_hypothesis_id": state.next_hypothesis_id,
        "last_ns": state.last_ns,
        "last_key": None if state.last_key is None else list(state.last_key[1:]),
        "last_report": None,
        "degraded": state.degraded,
        "initialised_from": None,
        "scans_closed": state.scans_closed,
        "counters": dict(manager.counters),
    }
    if state.initialised_from is not None:
        rest["initialised_from"] = [state.initialised_from[0].hex(), state.initialised_from[1]]
    if state.last_report is not None:
        report = dataclasses.asdict(state.last_report)
        del report["key"]
        rest["last_report"] = report
    arrays = {f"table_{name}": getattr(state.table, name) for name in (*ROW_FIELDS, "focal")}
    arrays |= {
        f"points_{f.name}": getattr(state.points, f.name) for f in dataclasses.fields(StartPoints)
    }
    arrays["deleted_track_id"] = state.deleted_track_id
    arrays["rest"] = np.frombuffer(json.dumps(rest).encode(), dtype=np.uint8)
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)  # type: ignore[arg-type]
    path.parent.mkdir(parents=True, exist_ok=True)
    neighbour = path.with_name(path.name + f".{os.getpid()}.tmp")
    try:
        neighbour.write_bytes(buffer.getbuffer())
        os.replace(neighbour, path)
    finally:
        neighbour.unlink(missing_ok=True)


def load(manager: TrackManager, path: Path) -> bool:
    """Give ``manager`` the state in ``path``; return whether there was one.

    Raises
    ------
    CheckpointError
        If the file exists and is not a checkpoint of this format.
    """
    if not path.exists():
        return False
    try:
        with np.load(path, allow_pickle=False) as data:
            rest = json.loads(bytes(data["rest"]).decode())
            if rest["format"] != FORMAT:
                raise CheckpointError(
                    f"checkpoint {path}: format {rest['format']}, this version reads {FORMAT}"
                )
            table = HypothesisTable(
                **{name: data[f"table_{name}"] for name in (*ROW_FIELDS, "focal")},
                frame=tuple(rest["frame"]),
                class_names=tuple(rest["class_names"]),
            )
            points = StartPoints(
                **{f.name: data[f"points_{f.name}"] for f in dataclasses.fields(StartPoints)}
            )
            deleted = data["deleted_track_id"]
    except CheckpointError:
        raise
    except (OSError, ValueError, KeyError, EOFError) as error:
        raise CheckpointError(f"checkpoint {path}: not readable ({error})") from error
    last_key = None if rest["last_key"] is None else ScanKey(manager.epoch, *rest["last_key"])
    report = None
    if rest["last_report"] is not None and last_key is not None:
        report = ScanReport(key=last_key, **rest["last_report"])
    origin = rest["initialised_from"]
    manager.state = ManagerState(
        table=table,
        points=points,
        next_track_id=rest["next_track_id"],
        next_hypothesis_id=rest["next_hypothesis_id"],
        last_ns=rest["last_ns"],
        last_key=last_key,
        last_report=report,
        deleted_track_id=deleted,
        degraded=rest["degraded"],
        initialised_from=None if origin is None else (bytes.fromhex(origin[0]), origin[1]),
        scans_closed=rest["scans_closed"],
    )
    manager.system_uuid = bytes.fromhex(rest["system_uuid"])
    manager.counters.update(rest["counters"])
    manager.resume()
    return True
