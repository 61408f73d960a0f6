"""Track states that may be taken as independent estimates: which, and when.

The errors of consecutive filtered states are correlated. A filter forgets: with velocity in its
state the correlation decays within its memory, which its own covariance tells without knowledge of
the motion model or of the noise of the sensor,

    memory = sqrt(position variance / velocity variance),

in the steady state of a constant-velocity filter 1.4 times the time constant of its poles. After
two memories the correlation of positions and of velocities is within 0.05 in the steady state,
after three it is negative, down to -0.08 (-0.15 where the memory is shorter than a scan), which
makes a sum of states vary less, not more. A test computes these numbers. Scans without a detection
bring no state that is new.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gda_tracker.events.sequential import aligned
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray

_CLOCK = np.dtype([("track_id", np.int64), ("next_ns", np.int64)])
_NOW = np.zeros((), dtype=_CLOCK)
_NOW["next_ns"] = np.iinfo(np.int64).min
# Waits longer than this are as good as for ever, and keep stamps within 64 bits.
LONGEST_WAIT_S = 1e6


@dataclass(frozen=True, slots=True)
class States:
    """Tracks of one scan that can be tested, by rising id.

    ``position`` (N, 2) [m], ``velocity`` (N, 2) [m/s], ``covariance`` (N, 4, 4) of both,
    ``detected`` (N,) on this scan, ``due`` (N,) independent of the last state that was used.
    ``looked``: whether a track without a detection was missed; on a scan that was given up, or
    decided without all that was known, it was not.
    """

    stamp_ns: int
    track_id: IntArray
    position: FloatArray
    velocity: FloatArray
    covariance: FloatArray
    detected: BoolArray
    due: BoolArray
    looked: bool = True

    def select(self, which: BoolArray) -> States:
        """Return those that ``which`` (N,) marks."""
        return States(
            self.stamp_ns,
            self.track_id[which],
            self.position[which],
            self.velocity[which],
            self.covariance[which],
            self.detected[which],
            self.due[which],
            self.looked,
        )

    def position_covariance(self) -> FloatArray:
        """Return (N, 2, 2) [m2]."""
        return self.covariance[:, :2, :2]

    def velocity_covariance(self) -> FloatArray:
        """Return (N, 2, 2) [m2/s2]."""
        return self.covariance[:, 2:, 2:]


def memory_s(covariance: FloatArray) -> FloatArray:
    """Memory (N,) [s] of the filter behind each covariance, of the slowest direction.

    The square root of the largest eigenvalue of P_vv^-1 P_pp.

    Parameters
    ----------
    covariance
        (N, 4, 4) positive definite, of x, y, vx, vy.
    """
    ratio = np.linalg.solve(covariance[:, 2:, 2:], covariance[:, :2, :2])
    half = (ratio[:, 0, 0] + ratio[:, 1, 1]) / 2.0
    determinant = ratio[:, 0, 0] * ratio[:, 1, 1] - ratio[:, 0, 1] * ratio[:, 1, 0]
    largest = half + np.sqrt(np.maximum(half**2 - determinant, 0.0))
    memory: FloatArray = np.sqrt(largest)
    return memory


def wait_ns(memory: FloatArray, factor: float) -> IntArray:
    """Time (N,) until the next independent state [ns]."""
    wait: IntArray = np.rint(np.minimum(factor * memory, LONGEST_WAIT_S) * 1e9).astype(np.int64)
    return wait


@dataclass(slots=True)
class SampleClock:
    """Knows of each track from when on its state is independent of the one last used."""

    factor: float
    _rows: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=_CLOCK))

    def due(
        self, stamp_ns: int, track_id: IntArray, covariance: FloatArray, detected: BoolArray
    ) -> BoolArray:
        """Return (N,) which tracks have an independent state, and take it as used."""
        rows = aligned(self._rows, track_id, _NOW)
        due: BoolArray = detected & (rows["next_ns"] <= stamp_ns)
        rows["next_ns"][due] = stamp_ns + wait_ns(memory_s(covariance[due]), self.factor)
        self._rows = rows
        return due
