"""Columns of a scan as a sensor sends them: made arrays of numbers, or the scan is refused."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from gda_tracker.vocabulary.arrays import BoolArray, FloatArray


class Rejected(ValueError):
    """A scan is refused as a whole; the message is the reason's name."""


def numbers(values: Any) -> FloatArray:
    """Float64 array of one dimension."""
    found = _floats(values)
    if found.ndim != 1:
        raise Rejected("malformed_array")
    return found


def column(values: Any, n: int) -> FloatArray:
    """Float64 array (n,)."""
    found = numbers(values)
    if len(found) != n:
        raise Rejected("array_length_mismatch")
    return found


def optional(values: Any, n: int) -> FloatArray | None:
    """Float64 array (n,), ``None`` for ``None``."""
    return None if values is None else column(values, n)


def table(values: Any, rows: int, columns: int) -> FloatArray | None:
    """Float64 array (rows, columns), ``None`` for ``None``; without elements any shape will do."""
    if values is None:
        return None
    found = _floats(values)
    if found.shape != (rows, columns) and (found.size or rows * columns):
        raise Rejected("array_length_mismatch")
    return found.reshape(rows, columns)


def leave_out(keep: BoolArray, bad: BoolArray, reason: str, counts: Counter[str]) -> None:
    """Take out of ``keep`` what is ``bad`` and count it by reason."""
    bad = bad & keep
    if bad.any():
        counts[reason] += int(np.count_nonzero(bad))
        keep[bad] = False


def _floats(values: Any) -> FloatArray:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise Rejected("malformed_array") from None
