"""Track sets: what the set-valued tracker publishes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray, empty_floats
from gda_tracker.vocabulary.scans import ScanKey


def _ints() -> IntArray:
    return np.zeros(0, dtype=np.int64)


@dataclass(slots=True)
class TrackSetArray:
    """N track sets after one scan; message ``TrackSetArray``.

    By track, its ``best`` set, the one that speaks for it, first. ``centroid`` (N, 4) [m, m/s] is
    x, y, vx, vy,
    ``covariance`` P and ``matrix`` K (N, 4, 4): the means are centroid + K u with |u| <= 1, the
    state is Gaussian with P about each. ``position_radius_m``, ``speed_radius_mps`` (N,): longest
    half axes of the set. ``detection_index`` (N,) is the row in the source's ``Detections`` that
    the set was made with, -1 for none; ``may_own_index`` concatenates, by set, all rows that the
    predicted set may own, those of set i from ``may_own_start[i]`` to ``may_own_start[i + 1] - 1``.
    ``status`` (N,) of the track is ``TENTATIVE`` or ``CONFIRMED`` of
    :mod:`gda_tracker.vocabulary.tracks`; stamps in ns.
    """

    key: ScanKey
    frame_id: str = ""
    system_uuid: bytes = bytes(16)
    track_id: IntArray = field(default_factory=_ints)
    branch_id: IntArray = field(default_factory=_ints)
    parent_branch_id: IntArray = field(default_factory=_ints)
    status: IntArray = field(default_factory=_ints)
    best: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    centroid: FloatArray = field(default_factory=lambda: empty_floats(0, 4))
    covariance: FloatArray = field(default_factory=lambda: empty_floats(0, 4, 4))
    matrix: FloatArray = field(default_factory=lambda: empty_floats(0, 4, 4))
    position_radius_m: FloatArray = field(default_factory=empty_floats)
    speed_radius_mps: FloatArray = field(default_factory=empty_floats)
    score: FloatArray = field(default_factory=empty_floats)
    detection_index: IntArray = field(default_factory=_ints)
    may_own_start: IntArray = field(default_factory=lambda: np.zeros(1, dtype=np.int64))
    may_own_index: IntArray = field(default_factory=_ints)
    hits: IntArray = field(default_factory=_ints)
    misses: IntArray = field(default_factory=_ints)
    coasted_scans: IntArray = field(default_factory=_ints)
    first_detection_ns: IntArray = field(default_factory=_ints)
    last_detection_ns: IntArray = field(default_factory=_ints)
    deleted_track_id: IntArray = field(default_factory=_ints)
    deleted_branch_id: IntArray = field(default_factory=_ints)

    def __len__(self) -> int:
        return len(self.track_id)

    def may_own(self, row: int) -> IntArray:
        """Rows of the source's ``Detections`` that set ``row``, predicted, may own."""
        return self.may_own_index[self.may_own_start[row] : self.may_own_start[row + 1]]
