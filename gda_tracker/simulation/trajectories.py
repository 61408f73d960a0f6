"""Recorded trajectories: where somebody was at some times, and from that at all times between."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from gda_tracker.vocabulary.arrays import FloatArray, IntArray


@dataclass(slots=True)
class Trajectory:
    """One target.

    ``time_s`` (K,) rises, ``position_m`` and ``velocity_mps`` are (K, 3), East, North, up.
    ``rcs_mean_m2`` and ``swerling`` are what a radar sees of it. Between two reports further apart
    than ``longest_gap_s`` nobody knows where it was.
    """

    target_id: int
    class_name: str
    time_s: FloatArray
    position_m: FloatArray
    velocity_mps: FloatArray
    rcs_mean_m2: float
    swerling: int
    longest_gap_s: float
    _spline: CubicHermiteSpline = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Lay the path: cubic between reports, with the velocity of each."""
        if len(self.time_s) < 2 or not (np.diff(self.time_s) > 0.0).all():
            raise ValueError("a trajectory needs two times or more, each later than the last")
        self._spline = CubicHermiteSpline(self.time_s, self.position_m, self.velocity_mps)

    def states(self, times_s: FloatArray) -> FloatArray:
        """Return states (T, 6) at times (T,): position and velocity, NaN where it is not known."""
        states = np.concatenate(
            [self._spline(times_s, extrapolate=False), self._spline(times_s, 1, extrapolate=False)],
            axis=1,
        )
        after = np.clip(np.searchsorted(self.time_s, times_s), 1, len(self.time_s) - 1)
        gap = self.time_s[after] - self.time_s[after - 1]
        states[gap > self.longest_gap_s] = np.nan
        return states


def spread_out(time_s: FloatArray, least_gap_s: float) -> IntArray:
    """Return rows of reports at least so far apart in time, beginning with the first.

    Receivers stamp reports some seconds late or early; the closer two of them, the more that turns
    into a speed that nobody had.
    """
    kept: list[int] = []
    for row, time in enumerate(time_s):
        if not kept or time - time_s[kept[-1]] >= least_gap_s:
            kept.append(row)
    return np.array(kept, dtype=np.int64)


def without_jumps(time_s: FloatArray, position_m: FloatArray, max_speed_mps: float) -> IntArray:
    """Return rows of reports that can be reached from the last one kept at this speed.

    The first one counts as right if the second can be reached from it, else it is left out.
    """
    kept: list[int] = []
    for row in range(len(time_s)):
        if kept:
            elapsed = time_s[row] - time_s[kept[-1]]
            way = np.linalg.norm(position_m[row] - position_m[kept[-1]])
            if way > max_speed_mps * max(elapsed, 1.0):
                if len(kept) == 1:
                    kept[0] = row
                continue
        kept.append(row)
    return np.array(kept, dtype=np.int64)
