"""Error rates of the tests, by Monte Carlo on the tracks of Kalman filters, or of a tracker.

The errors of a linear filter whose models hold do not depend on where the target goes. So the
errors are simulated once, with process noise and all, and laid on a path that stays exactly at the
bound of a hypothesis, where the tests err most. The errors of a tracker on targets that move
straight on, but for process noise, are laid on such paths in the same way (:class:`Followed`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gda_tracker.events.lane_test import LaneTest
from gda_tracker.events.motion_tests import AccelerationTest, StopTest
from gda_tracker.events.parameters import EventParameters
from gda_tracker.events.plan_test import PlanTest
from gda_tracker.events.samples import SampleClock, States
from gda_tracker.events.sequential import DIRECTION_LOSS, H0, H1, OPEN
from gda_tracker.kinematics.context import FORWARD, Lane, LaneMap, Plan
from gda_tracker.kinematics.motion_models import constant_velocity
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray

# Mean of what a Gaussian random walk of unit steps exceeds a far bound by (Siegmund 1985).
MEAN_OVERSHOOT = 0.5826
SPEED_MPS = 15.0
LANE_WIDTH_M, LANE_MARGIN_M = 20.0, 30.0
PLAN_TOLERANCE_M, PLAN_MARGIN_M = 20.0, 32.0
QUANTITIES = ("lane", "plan", "stop", "acceleration")


@dataclass(frozen=True, slots=True)
class Matched:
    """Errors (K, N, 4) of N Kalman tracks at K scans, their covariances (K, 4, 4), and the step."""

    error: FloatArray
    covariance: FloatArray
    dt_s: float

    @property
    def scans(self) -> int:
        """Number K of scans."""
        return len(self.error)

    @property
    def track_id(self) -> IntArray:
        """All tracks there are."""
        return np.arange(self.error.shape[1])

    def at(self, scan: int) -> tuple[IntArray, FloatArray, FloatArray, BoolArray]:
        """Ids (n,), errors (n, 4), covariances (n, 4, 4), who was detected (n,) on a scan."""
        runs = self.error.shape[1]
        every = np.ones(runs, dtype=bool)
        covariance = np.tile(self.covariance[scan], (runs, 1, 1))
        return self.track_id, self.error[scan], covariance, every


@dataclass(frozen=True, slots=True)
class Followed:
    """Errors of the tracks of a tracker: per scan ids, errors, covariances, who was detected.

    The arrays of a scan are those of :meth:`Matched.at`, by rising id.
    """

    each: list[tuple[IntArray, FloatArray, FloatArray, BoolArray]]
    dt_s: float

    @property
    def scans(self) -> int:
        """Number K of scans."""
        return len(self.each)

    @property
    def track_id(self) -> IntArray:
        """All tracks there are."""
        return np.unique(np.concatenate([ids for ids, *_ in self.each]))

    def at(self, scan: int) -> tuple[IntArray, FloatArray, FloatArray, BoolArray]:
        """As :meth:`Matched.at`."""
        return self.each[scan]


@dataclass(frozen=True, slots=True)
class Counted:
    """Decisions of finished tests: of either hypothesis, and the time that each took [s]."""

    h0: int
    h1: int
    duration_s: FloatArray

    @property
    def total(self) -> int:
        """Number of decisions."""
        return self.h0 + self.h1


def matched_tracks(
    runs: int,
    scans: int,
    generator: np.random.Generator,
    *,
    dt_s: float = 1.0,
    position_std_m: float = 20.0,
    process_noise_std_mps2: float = 1.0,
) -> Matched:
    """Simulate targets of constant velocity with process noise, and filter them.

    From the second detection on, started from two; the process noise is in truth and filter.
    """
    transition, noise = constant_velocity(dt_s, process_noise_std_mps2)
    noise_root = np.array([[dt_s**2 / 2.0, 0.0], [0.0, dt_s**2 / 2.0], [dt_s, 0.0], [0.0, dt_s]])
    measured_noise = position_std_m**2 * np.eye(2)
    truth = np.zeros((runs, 4))
    first = generator.normal(0.0, position_std_m, (runs, 2))
    kick = generator.normal(0.0, process_noise_std_mps2, (runs, 2)) @ noise_root.T
    truth = truth @ transition.T + kick
    second = truth[:, :2] + generator.normal(0.0, position_std_m, (runs, 2))
    mean = np.hstack([second, (second - first) / dt_s])
    variance = position_std_m**2
    # of position, both, velocity; the first step's kick has moved the velocity by q dt / 2
    covariance = np.kron(
        np.array(
            [
                [variance, variance / dt_s],
                [
                    variance / dt_s,
                    2.0 * variance / dt_s**2 + (process_noise_std_mps2 * dt_s) ** 2 / 4.0,
                ],
            ]
        ),
        np.eye(2),
    )
    errors, covariances = [mean - truth], [covariance]
    for _ in range(scans - 1):
        kick = generator.normal(0.0, process_noise_std_mps2, (runs, 2)) @ noise_root.T
        truth = truth @ transition.T + kick
        measured = truth[:, :2] + generator.normal(0.0, position_std_m, (runs, 2))
        mean = mean @ transition.T
        covariance = transition @ covariance @ transition.T + noise
        gain = covariance[:, :2] @ np.linalg.inv(covariance[:2, :2] + measured_noise)
        mean = mean + (measured - mean[:, :2]) @ gain.T
        covariance = covariance - gain @ covariance[:2]
        covariance = (covariance + covariance.T) / 2.0
        errors.append(mean - truth)
        covariances.append(covariance)
    return Matched(np.array(errors), np.array(covariances), dt_s)


def count_decisions(
    quantity: str,
    hypothesis: int,
    matched: Matched | Followed,
    parameters: EventParameters,
    *,
    independence_factor: float | None = None,
    lane_margin_m: float = LANE_MARGIN_M,
) -> Counted:
    """Run one of the :data:`QUANTITIES` on tracks at the bound of ``H0`` or of ``H1``.

    ``independence_factor`` in place of the parameter may be 0: every state is used.
    """
    clock = SampleClock(
        parameters.independence_factor if independence_factor is None else independence_factor
    )
    test = _test(quantity, matched, parameters, lane_margin_m)
    counts = {H0: 0, H1: 0}
    durations = []
    for scan in range(matched.scans):
        track_id, error, covariance, detected = matched.at(scan)
        stamp_ns = round(scan * matched.dt_s * 1e9)
        mean = _true_state(quantity, hypothesis, scan * matched.dt_s, parameters, lane_margin_m)
        mean = mean + error
        if isinstance(test, LaneTest):
            # What is not on the lane is put into its middle, from where its next test begins.
            mean[test.lane_of(track_id) < 0] = [SPEED_MPS * scan * matched.dt_s, 0, SPEED_MPS, 0]
        due = clock.due(stamp_ns, track_id, covariance, detected)
        states = States(stamp_ns, track_id, mean[:, :2], mean[:, 2:], covariance, detected, due)
        _, decisions = test.step(states)
        for verdict in counts:
            counts[verdict] += int(np.count_nonzero(decisions.verdict == verdict))
        done = decisions.verdict != OPEN
        durations.append((stamp_ns - decisions.began_ns[done]) * 1e-9)
    return Counted(counts[H0], counts[H1], np.concatenate(durations))


def expected_rate(hypothesis: int, step: float, sides: int, parameters: EventParameters) -> float:
    """Rate of wrong decisions at a bound, of a one-sided test with Gaussian steps.

    Wald's bounds, with what the ratio exceeds a threshold by when it crosses it (Siegmund 1985):
    log B + 0.583 ``step`` and log A - 0.583 ``step`` in their place. For an object at one of the
    ``sides`` the others are silent, so that the mean ratio needs B times ``sides`` on that one.

    Parameters
    ----------
    hypothesis
        Which is true, ``H0`` or ``H1``.
    step
        (b - a) / s, distance of the bounds in standard deviations of an estimate.
    """
    test = parameters.thresholds()
    upper = math.exp(test.log_accept + MEAN_OVERSHOOT * step) * sides
    lower = math.exp(test.log_reject - MEAN_OVERSHOOT * step)
    wrong = (1.0 - lower) / (upper - lower)
    return wrong if hypothesis == H0 else lower * (upper - 1.0) / (upper - lower)


def _test(
    quantity: str,
    matched: Matched | Followed,
    parameters: EventParameters,
    lane_margin_m: float,
) -> LaneTest | PlanTest | StopTest | AccelerationTest:
    if quantity == "stop":
        return StopTest(parameters)
    if quantity == "acceleration":
        return AccelerationTest(parameters)
    end_s = matched.scans * matched.dt_s
    points = np.array([[-1e3, 0.0], [1e3 + SPEED_MPS * end_s, 0.0]])
    if quantity == "lane":
        return LaneTest(
            LaneMap((Lane("lane", points, LANE_WIDTH_M, lane_margin_m, FORWARD),)), parameters
        )
    if quantity != "plan":
        raise ValueError(f"quantity = {quantity!r}: allowed is one of {', '.join(QUANTITIES)}")
    plans = tuple(
        Plan(
            "plan",
            int(number),
            np.array([0, round(end_s * 1e9)]),
            np.array([[0.0, 0.0], [SPEED_MPS * end_s, 0.0]]),
            np.full(2, PLAN_TOLERANCE_M),
            PLAN_MARGIN_M,
        )
        for number in matched.track_id
    )
    return PlanTest(plans, parameters)


def _true_state(
    quantity: str, hypothesis: int, time_s: float, parameters: EventParameters, lane_margin_m: float
) -> FloatArray:
    """State (4,) of a target that stays at the bound of a hypothesis."""
    usual = hypothesis == H0
    if quantity == "stop":
        speed = parameters.moving_speed_mps if usual else parameters.stopped_speed_mps
        return np.array([speed * time_s, 0.0, speed, 0.0])
    if quantity == "acceleration":
        a = (
            parameters.steady_acceleration_mps2
            if usual
            else DIRECTION_LOSS * parameters.event_acceleration_mps2
        )
        return np.array([0.5 * a * time_s**2, 0.0, a * time_s, 0.0])
    if quantity == "lane":
        offset = LANE_WIDTH_M / 2.0 + (0.0 if usual else lane_margin_m)
    else:
        # Along one of the directions, where the bound of h1 is nearest.
        far = DIRECTION_LOSS * (PLAN_TOLERANCE_M + PLAN_MARGIN_M)
        offset = PLAN_TOLERANCE_M if usual else far
    return np.array([SPEED_MPS * time_s, offset, SPEED_MPS, 0.0])
