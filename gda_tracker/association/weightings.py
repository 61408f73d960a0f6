"""Weights of the joint hypotheses of a scan, as all engines and decisions take them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from gda_tracker.vocabulary.arrays import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class JointWeights:
    """One weighting of the joint hypotheses of a scan, in logarithms.

    ``log_pair`` (P,) is log w of each pair, ``log_idle`` (H + n + 1,) log r of each hypothesis,
    then log c of each detection, then 0 for padding. Where ``least_assigned`` (G,) is given, only
    hypotheses with at least so many pairs count. ``fallback`` makes the weighting for clusters
    where every hypothesis has weight zero; without it their marginals are zero.
    """

    log_pair: FloatArray
    log_idle: FloatArray
    least_assigned: IntArray | None = None
    fallback: Callable[[], JointWeights] | None = None
