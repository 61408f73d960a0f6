"""Fields about extended objects: cells of a scan, predicted extents, extents of tracks."""

from __future__ import annotations

from typing import Any

import numpy as np

from gda_tracker.io.fields import (
    MessageError,
    floats_from_field,
    floats_to_field,
    int32_from_field,
    int32_to_field,
    masks_from_field,
    require_size,
    reshape,
)
from gda_tracker.vocabulary.arrays import FloatArray
from gda_tracker.vocabulary.extents import PredictedExtents, ScanCells
from gda_tracker.vocabulary.tracks import Tracks


def cells_to_message(cells: ScanCells, message: Any) -> None:
    """Fill in the fields of a ``Scan`` message that are about cells."""
    message.cell_count = int32_to_field(cells.count)
    message.cell_scatter = floats_to_field(cells.scatter)
    message.cell_noise = floats_to_field(cells.noise)
    message.cell_log_false = floats_to_field(cells.log_false)
    message.cell_member = int32_to_field(cells.member)
    message.partition_probability = [float(cells.probability)]


def cells_from_message(message: Any, rows: int) -> ScanCells | None:
    """Return the cells of a ``Scan`` message with so many rows, ``None`` if it has none.

    Raises
    ------
    MessageError
        If sizes contradict each other, or a cell has no detection.
    """
    count = int32_from_field(message.cell_count)
    if not len(message.partition_probability):
        for name in ("cell_count", "cell_scatter", "cell_noise", "cell_log_false", "cell_member"):
            if len(getattr(message, name)):
                raise MessageError(f"{name} has elements, partition_probability has none")
        return None
    probability = floats_from_field(message.partition_probability)
    require_size(count, rows, "cell_count")
    if rows and count.min() < 1:
        raise MessageError(f"cell_count holds {count.min()}: allowed are numbers > 0")
    member = int32_from_field(message.cell_member)
    return ScanCells(
        count=count,
        scatter=_floats(message, "cell_scatter", rows, 2, 2),
        noise=_floats(message, "cell_noise", rows, 2, 2),
        log_false=_floats(message, "cell_log_false", rows),
        member=require_size(member, int(count.sum()), "cell_member"),
        probability=float(require_size(probability, 1, "partition_probability")[0]),
    )


def cells_of_report_from_message(message: Any) -> dict[str, Any]:
    """Return the fields of a report about cells; none where objects are points."""
    cells = masks_from_field(message.cells)
    if not len(cells):
        return {}
    probability = floats_from_field(message.partition_probability)
    return {
        "cells": int(require_size(cells, 1, "cells")[0]),
        "partition_probability": float(require_size(probability, 1, "partition_probability")[0]),
    }


def extents_to_message(extents: PredictedExtents, message: Any) -> None:
    """Fill in the fields of a ``Predictions`` message that are about extents."""
    message.extent = floats_to_field(extents.extent)
    message.extent_weight = floats_to_field(extents.weight)
    message.detection_rate_shape = floats_to_field(extents.rate_shape)
    message.detection_rate_rate = floats_to_field(extents.rate_rate)
    message.extent_spread = [float(extents.spread)]


def extents_from_message(message: Any, hypotheses: int) -> PredictedExtents | None:
    """Return the extents of so many hypotheses in a ``Predictions`` message, ``None`` if none.

    Raises
    ------
    MessageError
        If sizes contradict each other.
    """
    spread = floats_from_field(message.extent_spread)
    if not len(spread):
        if len(message.extent):
            raise MessageError("extent has elements, extent_spread has none")
        return None
    return PredictedExtents(
        extent=_floats(message, "extent", hypotheses, 2, 2),
        weight=_floats(message, "extent_weight", hypotheses),
        rate_shape=_floats(message, "detection_rate_shape", hypotheses),
        rate_rate=_floats(message, "detection_rate_rate", hypotheses),
        spread=float(require_size(spread, 1, "extent_spread")[0]),
    )


def extents_of_track_messages(message: Any) -> dict[str, Any]:
    """Return the fields of ``Tracks`` about extents in a ``TrackArray``; none without.

    Raises
    ------
    MessageError
        If sizes contradict each other.
    """
    tracks = message.tracks
    counts = int32_from_field(message.detection_counts)
    rows = int32_from_field(message.detection_rows)
    if not len(counts):
        if len(rows):
            raise MessageError("detection_rows has elements, detection_counts has none")
        return {}
    require_size(counts, len(tracks), "detection_counts")
    if counts.min() < 0:
        raise MessageError(f"detection_counts holds {counts.min()}: allowed are numbers >= 0")
    extent = np.zeros((len(tracks), 2, 2))
    for row, track in enumerate(tracks):
        extent[row] = reshape(floats_from_field(track.extent), (2, 2), "extent")
    return {
        "extent": extent,
        "extent_weight": np.array([float(track.extent_weight) for track in tracks]),
        "expected_detections": np.array([float(track.expected_detections) for track in tracks]),
        "detection_count": counts.copy(),
        "detection_rows": require_size(rows, int(counts.sum()), "detection_rows").copy(),
    }


def extent_columns(tracks: Tracks) -> dict[str, FloatArray]:
    """Extent (N, 2, 2) or (N, 0), and the numbers (N,) beside it, NaN without."""
    count = len(tracks)
    if not len(tracks.extent_weight):
        nothing = np.full(count, np.nan)
        return {
            "extent": np.zeros((count, 0)),
            "extent_weight": nothing,
            "expected_detections": nothing,
        }
    return {
        "extent": tracks.extent,
        "extent_weight": tracks.extent_weight,
        "expected_detections": tracks.expected_detections,
    }


def _floats(message: Any, name: str, *shape: int) -> FloatArray:
    return reshape(floats_from_field(getattr(message, name)), shape, name)
