"""Radars that are Kalman filters: the tracks that theory speaks of.

Targets move with white acceleration, constant for a scan; every radar detects each of its targets
on every scan and knows the motion model. So what a fusion says of its own errors can be checked.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from gda_tracker.fusion.motion import scan_noise_covariance, transition
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray
from gda_tracker.vocabulary.scans import ScanKey
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks

SECOND = 1_000_000_000
H = np.eye(2, 4)
START = np.diag([900.0, 900.0, 400.0, 400.0])
"""Covariance of the state with which a radar begins a track."""


def tracks_of(
    radar: int,
    stamp_s: float,
    mean: FloatArray,
    covariance: FloatArray,
    track_id: IntArray | None = None,
    belief: FloatArray | None = None,
    class_names: tuple[str, ...] = ("false_alarm", "fighter", "cargo"),
    system_uuid: bytes | None = None,
    frame_id: str = "map",
) -> Tracks:
    """Return confirmed tracks (n,) of a radar, each detected at the time.

    Without ids they are 100 times the number of the radar and more.
    """
    n, stamp_ns = len(mean), round(stamp_s * SECOND)
    zeros = np.zeros(n, dtype=np.int64)
    return Tracks(
        ScanKey(1, f"sensor_{radar}", stamp_ns),
        frame_id,
        bytes([radar + 1]) * 16 if system_uuid is None else system_uuid,
        np.arange(n) + 100 * radar if track_id is None else np.asarray(track_id),
        np.arange(n),
        np.full(n, CONFIRMED),
        np.array(mean, dtype=np.float64),
        np.array(covariance, dtype=np.float64),
        masses=np.zeros((n, 0)),
        class_names=class_names if belief is not None else (),
        class_probability=np.zeros((n, 0)) if belief is None else np.array(belief, dtype=float),
        conflict=np.zeros(n),
        hits=zeros + 1,
        misses=zeros,
        coasted_scans=zeros,
        first_detection_ns=zeros + 1,
        last_detection_ns=zeros + stamp_ns,
        detection_index=np.arange(n, dtype=np.int32),
    )


class KalmanRadars:
    """Targets with process noise, and radars with biases that track them.

    Parameters
    ----------
    bias_m : (r, 2)
        What is to be added to a radar's positions.
    seen : (r, n)
        Who is tracked by whom; all by all if left out.

    Attributes
    ----------
    states : (n, 4)
        True states at ``time_s``.
    local
        Mean (n, 4) and covariance (n, 4, 4) of each radar's tracks, seen or not.
    system_uuid
        Of each radar's tracker; ``None``: one made of its number.
    """

    def __init__(
        self,
        seed: int,
        bias_m: Any,
        n_targets: int = 4,
        process_noise_std_mps2: float = 2.0,
        std_m: float = 30.0,
        period_s: float = 1.0,
        seen: BoolArray | None = None,
    ) -> None:
        self._rng = np.random.default_rng(seed)
        self.bias_m: FloatArray = np.array(bias_m, dtype=np.float64)
        n_radars = len(self.bias_m)
        self.noise_mps2, self.period_s = process_noise_std_mps2, period_s
        self.seen = np.ones((n_radars, n_targets), dtype=np.bool_) if seen is None else seen
        self.measurement_noise = np.eye(2) * std_m**2
        scale = np.array([1e4, 1e4, 150.0, 150.0])
        self.states: FloatArray = self._rng.standard_normal((n_targets, 4)) * scale
        self.time_s = 0.0
        step = np.array([period_s])
        self.transition = transition(step)[0]
        self.process_noise = scan_noise_covariance(step, process_noise_std_mps2)[0]
        self.local: list[tuple[FloatArray, FloatArray]] = []
        self.system_uuid: list[bytes | None] = [None] * n_radars

    def step(self) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
        """Go on by a period; return what each radar newly learnt: values, covariance, matrix."""
        first = not self.local
        if not first:
            # Acceleration along each axis, constant for the period.
            push = self._rng.standard_normal((len(self.states), 2)) * self.noise_mps2
            effect = np.array([0.5 * self.period_s**2, self.period_s])
            self.states = self.states @ self.transition.T + np.concatenate(
                [effect[0] * push, effect[1] * push], axis=1
            )
        self.time_s += self.period_s
        if first:
            return [self._begin(radar) for radar in range(len(self.bias_m))]
        return [self._update(radar) for radar in range(len(self.bias_m))]

    def _begin(self, radar: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        noise = self._rng.standard_normal(self.states.shape) @ np.sqrt(START)
        mean = self.states + noise
        mean[:, :2] -= self.bias_m[radar]
        self.local.append((mean, np.tile(START, (len(mean), 1, 1))))
        return mean, START, np.eye(4)

    def _update(self, radar: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        noise = self._rng.standard_normal((len(self.states), 2))
        z = self.states[:, :2] - self.bias_m[radar] + noise @ np.sqrt(self.measurement_noise)
        mean, covariance = self.local[radar]
        mean = mean @ self.transition.T
        covariance = self.transition @ covariance @ self.transition.T + self.process_noise
        innovation = covariance[:, :2, :2] + self.measurement_noise
        gain = covariance[:, :, :2] @ np.linalg.inv(innovation)
        mean = mean + np.einsum("nij,nj->ni", gain, z - mean[:, :2])
        covariance = covariance - gain @ covariance[:, :2]
        self.local[radar] = mean, 0.5 * (covariance + np.swapaxes(covariance, 1, 2))
        return z, self.measurement_noise, H

    def move(self, radar: int, shift_m: Any) -> None:
        """Let all that a radar reports jump by ``shift_m`` (2,)."""
        shift = np.array([*shift_m, 0.0, 0.0])
        self.bias_m[radar] -= shift[:2]
        mean, covariance = self.local[radar]
        self.local[radar] = mean + shift, covariance

    def message(self, radar: int, belief: FloatArray | None = None) -> Tracks:
        """Return the tracks of a radar, with class beliefs (n, 3) if given."""
        mean, covariance = self.local[radar]
        rows = self.seen[radar].nonzero()[0]
        return tracks_of(
            radar,
            self.time_s,
            mean[rows],
            covariance[rows],
            rows + 100 * radar,
            None if belief is None else belief[rows],
            system_uuid=self.system_uuid[radar],
        )
