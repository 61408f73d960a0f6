"""Services of the track manager: ``reset``, ``save_state`` and ``load_state``."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from gda_tracker.nodes.services import Refused, offer
from gda_tracker.tracking import checkpoint


def offer_state_services(node: Any) -> None:
    """Offer the services on a track manager's node.

    ``~/reset`` ends all tracks; ids go on. ``~/save_state`` and ``~/load_state`` write and read the
    file that the parameter ``state_path`` names. Scans that were under way are answered
    ``rejected``. A load that is refused changes nothing.
    """
    offer(node, "reset", lambda: _reset(node))
    offer(node, "save_state", lambda: _save(node))
    offer(node, "load_state", lambda: _load(node))


def _next_epoch(node: Any) -> int:
    return max(time.time_ns(), node.manager.epoch + 1)


def _path(node: Any) -> Path:
    path = node.parameters.state_path
    if not path:
        raise Refused("parameter state_path is empty: set it to the file first")
    return Path(path).expanduser()


def _living(node: Any) -> int:
    return int(node.manager.state.table.chosen.sum())


def _reset(node: Any) -> str:
    ended = _living(node)
    dropped = node.manager.reset(_next_epoch(node))
    node.start_afresh(dropped)
    return f"{ended} tracks ended, {len(dropped)} scans dropped"


def _save(node: Any) -> str:
    path = _path(node)
    try:
        checkpoint.save(node.manager, path)
    except checkpoint.CheckpointError as error:
        raise Refused(str(error)) from error
    closed = node.manager.state.scans_closed
    return f"{_living(node)} tracks after {closed} scans saved to {path}"


def _load(node: Any) -> str:
    path = _path(node)
    try:
        dropped = checkpoint.restore(node.manager, path, _next_epoch(node))
    except checkpoint.CheckpointError as error:
        raise Refused(str(error)) from error
    node.start_afresh(dropped)
    closed = node.manager.state.scans_closed
    return (
        f"{_living(node)} tracks after {closed} scans loaded from {path}, "
        f"{len(dropped)} scans dropped"
    )
