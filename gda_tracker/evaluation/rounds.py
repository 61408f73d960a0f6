"""What the rounds of a replay tell beside tracks and reports: gated pairs, and their time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gda_tracker.evaluation.innovations import GatedScan, gated_scan
from gda_tracker.tracking.ring import RingResult

ROUND = "whole round"


@dataclass
class Heard:
    """What a replay tells beside reports and tracks.

    ``gated`` has the pairs by sensor and stamp, ``latency_ms`` median and 95 % quantile by stage;
    ``told`` says whose time that is, and of which scans.
    """

    gated: dict[tuple[str, int], GatedScan] = field(default_factory=dict)
    latency_ms: dict[str, tuple[float, float]] = field(default_factory=dict)
    told: str = ""


class OfflineRounds:
    """Collects what the rounds of the offline ring tell, scan by scan."""

    def __init__(self) -> None:
        self._gated: dict[tuple[str, int], GatedScan] = {}
        self._seconds: dict[str, list[float]] = {}

    def note(self, result: RingResult) -> None:
        """Note one scan; one that was rejected tells nothing."""
        scan, predictions, decided = result.scan, result.predictions, result.associations
        if scan is None or predictions is None or decided is None:
            return
        key = result.report.key
        self._gated[key.sensor_id, key.stamp_ns] = gated_scan(scan, predictions, decided)
        for name, value in {**result.stage_s, ROUND: sum(result.stage_s.values())}.items():
            self._seconds.setdefault(name, []).append(value)

    def heard(self) -> Heard:
        """Return all of it."""
        return Heard(
            self._gated,
            {name: quantiles_ms(values) for name, values in self._seconds.items()},
            "Computing time of each part of a round, offline and without ROS, over all scans. "
            "The checks of the door are not in it.",
        )


def quantiles_ms(seconds: Sequence[float]) -> tuple[float, float]:
    """Median and 95 % quantile in ms."""
    median, most = 1e3 * np.percentile(np.asarray(seconds, dtype=np.float64), (50, 95))
    return float(median), float(most)
