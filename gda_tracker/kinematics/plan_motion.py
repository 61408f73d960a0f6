"""Targets that carry out a plan: waypoints as artificial measurements of what is yet to come.

The plan goes straight at constant speed from waypoint to waypoint; a keeper is where it has him but
for an error e of position and velocity that white acceleration drives, x = plan(t) + e. A waypoint
says that the error of position is 0 at its time, with covariance W (Koch 2014, 1.3.6). What all
waypoints to come say of the error at an earlier time is a Gaussian factor

    h(e) = exp(-e' L e / 2)

which no measurement changes: at a waypoint L <- L + H' W^-1 H, and from a time back to one dt
earlier L <- F' (1 + L Q)^-1 L F. A target that keeps the plan moves as one that is going to be
measured at the waypoints: p(e' | e) h(e'), normalised, which is

    e' = B F e + noise of covariance B Q,  B = (1 + Q L)^-1.

Each waypoint counts once, and what a track is after any number of scans is the same as with
the waypoints processed first and the scans as out-of-sequence measurements, as Koch has it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gda_tracker.kinematics.context import Plan
from gda_tracker.kinematics.lane_motion import Entries
from gda_tracker.kinematics.motion_models import white_noise_acceleration
from gda_tracker.vocabulary.arrays import FloatArray

# Of a uniform distribution: over a disc of radius 1 in each coordinate, over [-1, 1].
OF_RADIUS = 0.5
OF_HALF_WIDTH = 1.0 / math.sqrt(3.0)
_EYE = np.eye(4)


@dataclass(frozen=True, slots=True)
class Ahead:
    """What waypoints to come say of a state: L (4, 4), and the planned state (4,)."""

    matrix: FloatArray
    planned: FloatArray

    def entered(self, mean: FloatArray, covariance: FloatArray) -> Entries:
        """What takes up the plan of states (N, 4), (N, 4, 4).

        A target does so with the probability h(e), certainly where the plan has it exactly. Of a
        Gaussian the share is the integral of h N(e; m, P), and what becomes of it the update with
        all waypoints to come.
        """
        error = mean - self.planned
        through = _EYE + covariance @ self.matrix
        after = np.linalg.solve(through, error[..., None])[..., 0]
        spread = np.linalg.solve(through, covariance)
        symmetric = np.asarray(0.5 * (spread + np.swapaxes(spread, -1, -2)), dtype=np.float64)
        squared = np.sum(error * (after @ self.matrix), axis=-1)
        share: FloatArray = np.exp(-0.5 * squared) / np.sqrt(np.linalg.det(through))
        return Entries(np.minimum(share, 1.0), self.planned + after, symmetric)


class PlanCourse:
    """A plan as a motion: where its waypoints pull a target of a given process noise.

    Parameters
    ----------
    plan
        The waypoints; of a uniform distribution over what each of them allows it takes the
        covariance, tolerance_m^2 / 4 in each coordinate, and tolerance_s^2 / 3 times the planned
        velocities, squared.
    acceleration_density_m2ps3
        White acceleration of those who keep the plan, > 0 [m2/s3].
    """

    def __init__(self, plan: Plan, acceleration_density_m2ps3: float) -> None:
        self.plan = plan
        self._density = acceleration_density_m2ps3
        self._time_ns = [int(t) for t in plan.time_ns]
        self._velocity = plan.velocity_mps
        # L at each waypoint, that one included; after the last there is nothing.
        self._at = [np.zeros((4, 4))]
        for k in range(len(self._time_ns) - 1, -1, -1):
            later = self._at[0]
            if k + 1 < len(self._time_ns):
                later = self._back(later, (self._time_ns[k + 1] - self._time_ns[k]) / 1e9)
            here = later.copy()
            here[:2, :2] += np.linalg.inv(waypoint_covariance(plan, k))
            self._at.insert(0, here)

    @property
    def end_ns(self) -> int:
        """Time of the last waypoint; from then on there is no plan."""
        return self._time_ns[-1]

    def planned(self, stamp_ns: int) -> FloatArray:
        """Planned state (4,); at a waypoint with the velocity after it.

        Before the first waypoint and after the last the way goes on as on the leg next to it.
        """
        leg = min(max(self._next(stamp_ns) - 1, 0), len(self._velocity) - 1)
        since_s = (stamp_ns - self._time_ns[leg]) / 1e9
        return np.concatenate(
            [self.plan.points[leg] + since_s * self._velocity[leg], self._velocity[leg]]
        )

    def ahead(self, stamp_ns: int) -> Ahead:
        """What the waypoints after ``stamp_ns`` say of a state at that time."""
        return Ahead(self._matrix(stamp_ns), self.planned(stamp_ns))

    def moved(
        self, mean: FloatArray, covariance: FloatArray, before_ns: int, after_ns: int
    ) -> tuple[FloatArray, FloatArray]:
        """Keepers (N, 4), (N, 4, 4) at ``before_ns``, moved to ``after_ns``.

        Past the last waypoint they go on without a plan.
        """
        error, now = mean - self.planned(before_ns), before_ns
        while now < after_ns:
            number = self._next(now)
            there = number < len(self._time_ns) and self._time_ns[number] <= after_ns
            until = self._time_ns[number] if there else after_ns
            known = self._at[number] if there else self._matrix(until)
            transition, noise = white_noise_acceleration((until - now) / 1e9, self._density)
            bridge = np.linalg.inv(_EYE + noise @ known)
            step, rest = bridge @ transition, bridge @ noise
            error = error @ step.T
            covariance = step @ covariance @ step.T + rest
            now = until
        symmetric = 0.5 * (covariance + np.swapaxes(covariance, -1, -2))
        return error + self.planned(after_ns), symmetric

    def _next(self, stamp_ns: int) -> int:
        """Number of the first waypoint after a time."""
        return int(np.searchsorted(self.plan.time_ns, stamp_ns, side="right"))

    def _matrix(self, stamp_ns: int) -> FloatArray:
        """L of the waypoints after a time."""
        number = self._next(stamp_ns)
        if number == len(self._time_ns):
            return self._at[number]
        return self._back(self._at[number], (self._time_ns[number] - stamp_ns) / 1e9)

    def _back(self, known: FloatArray, dt_s: float) -> FloatArray:
        """L a time ``dt_s`` earlier."""
        transition, noise = white_noise_acceleration(dt_s, self._density)
        matrix = transition.T @ np.linalg.solve(_EYE + known @ noise, known) @ transition
        earlier: FloatArray = 0.5 * (matrix + matrix.T)
        return earlier


def waypoint_covariance(plan: Plan, number: int) -> FloatArray:
    """Covariance (2, 2) of the artificial measurement of a waypoint [m2]."""
    covariance = np.eye(2) * (OF_RADIUS * plan.tolerance_m[number]) ** 2
    if len(plan.tolerance_s):
        ways = plan.velocity_mps[max(number - 1, 0) : number + 1]
        std_s = OF_HALF_WIDTH * plan.tolerance_s[number]
        covariance += std_s**2 * np.mean(ways[:, :, None] * ways[:, None, :], axis=0)
    return np.asarray(covariance)
