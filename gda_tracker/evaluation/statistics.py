"""Means over runs and their standard errors."""

from __future__ import annotations

import math

import numpy as np

from gda_tracker.vocabulary.arrays import FloatArray


def mean_and_stderr(values: FloatArray) -> tuple[float, float]:
    """Mean and its standard error over the finite values, NaN where there are too few."""
    values = values[np.isfinite(values)]
    if not len(values):
        return math.nan, math.nan
    if len(values) == 1:
        return float(values[0]), math.nan
    return float(values.mean()), float(values.std(ddof=1) / math.sqrt(len(values)))


def root_mean_square(values: FloatArray) -> tuple[float, float]:
    """Root of the mean of mean squares per run (R,), and its standard error to first order.

    Squares of GOSPA's parts add up, so do the squares of these roots.
    """
    mean = float(values.mean()) if len(values) else math.nan
    if not mean > 0.0 or len(values) < 2:
        return math.sqrt(mean) if mean >= 0.0 else math.nan, math.nan
    root = math.sqrt(mean)
    return root, float(values.std(ddof=1) / math.sqrt(len(values))) / (2.0 * root)
