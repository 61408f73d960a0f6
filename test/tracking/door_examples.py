"""Scans as sensors send them, for the tests of the door and the track manager."""

from __future__ import annotations

import numpy as np

from gda_tracker.tracking.door import DefaultNoise
from gda_tracker.vocabulary import Detections

NOISE = DefaultNoise(
    range_std_m=30.0, azimuth_std_rad=0.005, elevation_std_rad=0.01, range_rate_std_mps=1.0
)
SECOND = 1_000_000_000


def detections_of(stamp_s=1.0, n=3, sensor_id="radar", **fields) -> Detections:
    """``n`` good detections; ``fields`` replace what the test is about."""
    values = {
        "range_m": 1000.0 + 100.0 * np.arange(n),
        "azimuth_rad": 0.1 * np.arange(n),
        "rcs_m2": 1.0 + np.arange(n),
    }
    return Detections(sensor_id, round(stamp_s * SECOND), **{**values, **fields})
