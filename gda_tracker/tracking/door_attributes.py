"""Attributes at the door: what is no value of an attribute becomes unknown, by reason."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from gda_tracker.tracking.columns import Rejected, column, leave_out, table
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray
from gda_tracker.vocabulary.scans import Detections

LARGEST_ATTRIBUTE_COUNT = 64


def radar_cross_section(
    values: FloatArray | None, valid: Any, rows: np.ndarray, n: int, counts: Counter[str]
) -> tuple[FloatArray, BoolArray]:
    """RCS [m2] with zeros where unknown, and whether it is known."""
    # NaN counts as not valid, like any number but 1.
    flags = np.ones(n, dtype=bool) if valid is None else column(valid, n) == 1.0
    if values is None:
        return np.zeros(len(rows)), np.zeros(len(rows), dtype=bool)
    rcs, known = values[rows], flags[rows]
    leave_out(known, ~np.isfinite(rcs), "rcs_not_finite", counts)
    leave_out(known, rcs < 0.0, "rcs_negative", counts)
    rcs[~known] = 0.0
    return rcs, known


def further_attributes(
    detections: Detections, rows: np.ndarray, n: int, counts: Counter[str]
) -> tuple[tuple[str, ...], FloatArray | None, BoolArray | None]:
    """Further attributes of the detections in ``rows``.

    Returns
    -------
    names, values, known
        (A) names, (A, n) values with zeros where unknown, (A, n) whether they are known.
    """
    names = _attribute_names(detections.attribute_names)
    values = table(detections.attribute_values, len(names), n)
    valid = table(detections.attribute_valid, len(names), n)
    if not names:
        return (), None, None
    if values is None:
        raise Rejected("array_length_mismatch")
    values = values[:, rows]
    known = np.ones(values.shape, dtype=bool) if valid is None else valid[:, rows] == 1.0
    leave_out(known, ~np.isfinite(values), "attribute_not_finite", counts)
    return names, np.where(known, values, 0.0), known


def _attribute_names(names: Any) -> tuple[str, ...]:
    if isinstance(names, tuple | list) and not names:
        return ()
    try:
        found = tuple(names)
    except TypeError:
        raise Rejected("bad_attribute_names") from None
    texts = not isinstance(names, str) and all(isinstance(name, str) and name for name in found)
    if not texts or len(set(found)) < len(found) or len(found) > LARGEST_ATTRIBUTE_COUNT:
        raise Rejected("bad_attribute_names")
    return found
