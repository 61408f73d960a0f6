"""Tracks: the answer to "what is there?" after each scan."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gda_tracker.vocabulary.arrays import FloatArray, Int32Array, IntArray, MaskArray, empty_floats
from gda_tracker.vocabulary.scans import ScanKey

TENTATIVE = 0
CONFIRMED = 1
# Fields of tracks that may be left out.
NOT_KNOWN = (
    "existence_probability",
    "signal_strength",
    "signal_strength_std_db",
    "detection_probability",
)


def _ints() -> IntArray:
    return np.zeros(0, dtype=np.int64)


@dataclass(slots=True)
class Tracks:
    """N live tracks after one scan, by rising track id; message ``TrackArray``.

    ``mean`` (N, s) [m, m/s] and ``covariance`` (N, s, s); ``class_probability`` (N, C), pignistic
    where the attribute term works with belief masses; ``masses`` (N, E) over the Venn bitmasks
    ``focal``; ``conflict`` (N,) of the last fusion; ``existence_probability`` (N,) of a target
    behind the track, NaN where nothing is known of it; ``signal_strength`` (N,) estimated mean
    strength of its signals [mean noise powers], ``signal_strength_std_db`` (N,) [dB] the standard
    deviation of 1 plus it, ``detection_probability`` (N,) what follows, NaN where not estimated;
    ``detection_index`` (N,) row in the
    source's ``Detections``, -1 for none; stamps in ns. ``status`` (N,) is ``TENTATIVE`` or
    ``CONFIRMED``.

    Of extended objects, else empty: ``extent`` (N, 2, 2) [m2], the expected matrix X of the ellipse
    y' X^-1 y = 1; ``extent_weight`` (N,), how many detections it is known from, so that a semi-axis
    a is known to a / sqrt(2 (weight - 2)); ``expected_detections`` (N,) in a scan;
    ``detection_count`` (N,) in this one, with their rows in the source's ``Detections`` in
    ``detection_rows``, track after track; ``detection_index`` is that nearest to their centroid.
    """

    key: ScanKey
    frame_id: str = ""
    system_uuid: bytes = bytes(16)
    track_id: IntArray = field(default_factory=_ints)
    hypothesis_id: IntArray = field(default_factory=_ints)
    status: IntArray = field(default_factory=_ints)
    mean: FloatArray = field(default_factory=lambda: empty_floats(0, 4))
    covariance: FloatArray = field(default_factory=lambda: empty_floats(0, 4, 4))
    frame: tuple[str, ...] = ()
    focal: MaskArray = field(default_factory=lambda: np.zeros(0, dtype=np.uint32))
    masses: FloatArray = field(default_factory=lambda: empty_floats(0, 0))
    class_names: tuple[str, ...] = ()
    class_probability: FloatArray = field(default_factory=lambda: empty_floats(0, 0))
    conflict: FloatArray = field(default_factory=empty_floats)
    existence_probability: FloatArray = field(default_factory=empty_floats)
    signal_strength: FloatArray = field(default_factory=empty_floats)
    signal_strength_std_db: FloatArray = field(default_factory=empty_floats)
    detection_probability: FloatArray = field(default_factory=empty_floats)
    hits: IntArray = field(default_factory=_ints)
    misses: IntArray = field(default_factory=_ints)
    coasted_scans: IntArray = field(default_factory=_ints)
    first_detection_ns: IntArray = field(default_factory=_ints)
    last_detection_ns: IntArray = field(default_factory=_ints)
    detection_index: Int32Array = field(default_factory=lambda: np.zeros(0, dtype=np.int32))
    deleted_track_id: IntArray = field(default_factory=_ints)
    degraded: bool = False
    extent: FloatArray = field(default_factory=lambda: empty_floats(0, 2, 2))
    extent_weight: FloatArray = field(default_factory=empty_floats)
    expected_detections: FloatArray = field(default_factory=empty_floats)
    detection_count: Int32Array = field(default_factory=lambda: np.zeros(0, dtype=np.int32))
    detection_rows: Int32Array = field(default_factory=lambda: np.zeros(0, dtype=np.int32))

    def __post_init__(self) -> None:
        """Say of what tracks were made without that it is not known."""
        count = len(self.track_id)
        if not count:
            return
        missing = [name for name in NOT_KNOWN if not len(getattr(self, name))]
        if missing:
            unknown = np.full(count, np.nan)
            for name in missing:
                setattr(self, name, unknown)

    def __len__(self) -> int:
        return len(self.track_id)
