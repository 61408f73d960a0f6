"""What is told of extended objects: in the tracks, and in the report of a scan."""

from __future__ import annotations

from typing import Any

import numpy as np

from gda_tracker.tracking.extended.columns import extents_of
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.vocabulary.scans import Scan


def extents_of_tracks(table: HypothesisTable) -> dict[str, Any]:
    """Fields of ``Tracks`` about extents; none where objects are points."""
    if not table.extended.shape[1]:
        return {}
    known = extents_of(table)
    called, member = table.cell_members[:, 0], table.cell_members[:, 1]
    order = np.argsort(called, kind="stable")
    ordered, wanted = called[order], table.detection_index
    first = np.searchsorted(ordered, wanted, side="left")
    count = np.searchsorted(ordered, wanted, side="right") - first
    begin = np.cumsum(count) - count
    rows = np.arange(count.sum()) + np.repeat(first - begin, count)
    return {
        "extent": known.extent,
        "extent_weight": known.weight,
        "expected_detections": known.rate_shape / known.rate_rate,
        "detection_count": count.astype(np.int32),
        "detection_rows": member[order][rows].astype(np.int32),
    }


def cells_of_report(scan: Scan) -> dict[str, Any]:
    """Fields of ``ScanReport`` about cells; none where detections are taken one by one."""
    if scan.cells is None:
        return {}
    return {"cells": len(scan), "partition_probability": scan.cells.probability}
