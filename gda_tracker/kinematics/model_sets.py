"""Sets of different motion models in one common state, so that an IMM or GPB2 can mix them.

In the plane the common state is ``[x, y, vx, vy]``, then ``[ax, ay]`` if a model of the set knows
an acceleration, then ``[w]`` [rad/s] if one knows a turn rate. A model draws those components that
it does not know anew on every step, with zero mean and the standard deviation of the set: that is
what a model that does know them starts from when a target changes to it
(:func:`gda_tracker.kinematics.motion_models.embedded`). Measurements are of the first four
components alone, the head; the others follow by :func:`follow_head`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from gda_tracker.kinematics.motion_models import (
    constant_acceleration,
    constant_velocity,
    embedded,
    singer,
    standstill,
    van_keuk,
    white_noise_acceleration,
)
from gda_tracker.kinematics.turn_models import coordinated_turn
from gda_tracker.vocabulary.arrays import FloatArray

CONSTANT_VELOCITY, WHITE_NOISE_ACCELERATION = "constant_velocity", "white_noise_acceleration"
CONSTANT_ACCELERATION, VAN_KEUK, SINGER = "constant_acceleration", "van_keuk", "singer"
COORDINATED_TURN = "coordinated_turn"
STANDSTILL = "standstill"
MODELS = (
    CONSTANT_VELOCITY,
    WHITE_NOISE_ACCELERATION,
    STANDSTILL,
    CONSTANT_ACCELERATION,
    VAN_KEUK,
    SINGER,
    COORDINATED_TURN,
)
ACCELERATION_MODELS = (CONSTANT_ACCELERATION, VAN_KEUK, SINGER)
# Positions and velocities in the plane.
HEAD = 4


@dataclass(frozen=True)
class ModelSet:
    """M motion models in the plane with a common state of s components.

    Parameters
    ----------
    names
        (M,) of ``MODELS``; the same one may stand in it several times.
    noise_std_mps2
        (M,) > 0, the noise of each: the standard deviation of the acceleration [m/s2]; that of its
        change within a second for ``constant_acceleration``; for ``white_noise_acceleration`` the
        speed [m/s] by which a target changes its velocity within a second (both are roots of
        spectral densities, [m/s^2.5] and [m/s^1.5]); for ``standstill`` a speed [m/s].
    correlation_time_s
        theta of ``van_keuk`` and ``singer``.
    acceleration_std_mps2, turn_rate_std_radps
        What is thought of the acceleration, in each coordinate, and of the turn rate of a target
        of which neither is known, > 0.
    turn_noise_std_radps2
        Change of the turn rate in ``coordinated_turn``, constant within a step, >= 0.
    """

    names: tuple[str, ...]
    noise_std_mps2: tuple[float, ...]
    correlation_time_s: float
    acceleration_std_mps2: float
    turn_rate_std_radps: float
    turn_noise_std_radps2: float

    def __post_init__(self) -> None:
        unknown = [name for name in self.names if name not in MODELS]
        if unknown or not self.names or len(self.names) != len(self.noise_std_mps2):
            raise ValueError(
                f"names = {list(self.names)}, noise_std_mps2 = {list(self.noise_std_mps2)}: "
                f"allowed are one of {', '.join(MODELS)} and a number for each model"
            )

    def __len__(self) -> int:
        return len(self.names)

    @property
    def accelerates(self) -> bool:
        """Whether the state has an acceleration."""
        return any(name in ACCELERATION_MODELS for name in self.names)

    @property
    def turns(self) -> bool:
        """Whether the state has a turn rate; then the motion depends on the state."""
        return COORDINATED_TURN in self.names

    @property
    def size(self) -> int:
        """Number s of components of the common state."""
        return HEAD + 2 * self.accelerates + self.turns

    @property
    def tail_std(self) -> FloatArray:
        """Standard deviations (s - 4,) of the components beyond the head where nothing is known."""
        accelerations = [self.acceleration_std_mps2] * (2 * self.accelerates)
        return np.array(accelerations + [self.turn_rate_std_radps] * self.turns)

    def extended(self, mean: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """States (N, 4), (N, 4, 4) in the common state (N, s), (N, s, s)."""
        n, s = len(mean), self.size
        if s == HEAD:
            return mean, covariance
        full, full_covariance = np.zeros((n, s)), np.zeros((n, s, s))
        full[:, :HEAD], full_covariance[:, :HEAD, :HEAD] = mean, covariance
        full_covariance[:, range(HEAD, s), range(HEAD, s)] = self.tail_std**2
        return full, full_covariance

    def matrices(self, dt_s: float) -> tuple[FloatArray, FloatArray]:
        """F and Q (M, s, s) over ``dt_s`` [s]; read-only, since they are cached.

        Those of ``coordinated_turn`` depend on the state: F is that of a target that flies straight
        on; :meth:`moved` and :meth:`moved_pairs` put the right one in its place.
        """
        return _matrices(self, float(dt_s))

    def moved(self, mean: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:
        """States (H, M, s) moved by their own models.

        Returns
        -------
        mean, F
            (H, M, s), and the derivative of the motion (M, s, s), or (H, M, s, s) in a set that
            turns.
        """
        transition, _ = self.matrices(dt_s)
        moved = (transition @ mean[..., None])[..., 0]
        if not self.turns or dt_s == 0.0:
            return moved, transition
        full = np.tile(transition, (len(mean), 1, 1, 1))
        for j in self._turning:
            moved[:, j], full[:, j] = self._turned(mean[:, j], transition[j], j, dt_s)
        return moved, full

    def moved_pairs(self, mean: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:
        """States (H, M, s) moved by every model, for GPB2 and retrodiction.

        Returns
        -------
        mean, F
            (H, M, M, s) and (H, M, M, s, s) or (M, 1, s, s); entry [h, j, i] is state i moved by
            model j.
        """
        transition, _ = self.matrices(dt_s)
        h, m, s = mean.shape
        moved = (transition[:, None] @ mean[:, None, :, :, None])[..., 0]
        if not self.turns or dt_s == 0.0:
            return moved, transition[:, None]
        full = np.broadcast_to(transition[:, None], (h, m, m, s, s)).copy()
        for j in self._turning:
            turned, slope = self._turned(mean.reshape(h * m, s), transition[j], j, dt_s)
            moved[:, j], full[:, j] = turned.reshape(h, m, s), slope.reshape(h, m, s, s)
        return moved, full

    @property
    def _turning(self) -> list[int]:
        return [j for j, name in enumerate(self.names) if name == COORDINATED_TURN]

    def _turned(
        self, mean: FloatArray, straight: FloatArray, model: int, dt_s: float
    ) -> tuple[FloatArray, FloatArray]:
        """States (N, s) moved by a nearly coordinated turn, and the derivative (N, s, s)."""
        own = [*range(HEAD), self.size - 1]
        part, slope, _ = coordinated_turn(
            mean[:, own], dt_s, self.noise_std_mps2[model], self.turn_noise_std_radps2
        )
        moved, full = np.zeros_like(mean), np.tile(straight, (len(mean), 1, 1))
        moved[:, own] = part
        full[:, np.array(own)[:, None], own] = slope
        return moved, full


@lru_cache(maxsize=256)
def _matrices(models: ModelSet, dt_s: float) -> tuple[FloatArray, FloatArray]:
    """F and Q of a set (M, s, s), read-only."""
    if dt_s == 0.0:
        # Nothing moves, and nothing is drawn anew either.
        f = np.tile(np.eye(models.size), (len(models), 1, 1))
        q = np.zeros_like(f)
    else:
        made = [_model(models, j, dt_s) for j in range(len(models))]
        f, q = np.stack([one for one, _ in made]), np.stack([noise for _, noise in made])
    f.flags.writeable = q.flags.writeable = False
    return f, q


def _model(models: ModelSet, model: int, dt_s: float) -> tuple[FloatArray, FloatArray]:
    """F and Q (s, s) of one model in the common state."""
    name, std, s = models.names[model], models.noise_std_mps2[model], models.size
    tail = models.tail_std
    if name == COORDINATED_TURN:
        # The turn rate stands last, behind accelerations that a turn does not know.
        _, (f,), q = coordinated_turn(
            np.zeros((1, HEAD + 1)), dt_s, std, models.turn_noise_std_radps2
        )
        own = [*range(HEAD), s - 1]
        full, noise = np.zeros((s, s)), np.diag([*np.zeros(HEAD), *tail**2])
        full[np.ix_(own, own)], noise[np.ix_(own, own)] = f, q
        return full, noise
    if name == CONSTANT_VELOCITY:
        f, q = constant_velocity(dt_s, std)
    elif name == WHITE_NOISE_ACCELERATION:
        f, q = white_noise_acceleration(dt_s, std**2)
    elif name == STANDSTILL:
        f, q = standstill(dt_s, std)
    elif name == CONSTANT_ACCELERATION:
        f, q = constant_acceleration(dt_s, std**2)
    elif name == VAN_KEUK:
        f, q = van_keuk(dt_s, std, models.correlation_time_s)
    else:
        f, q = singer(dt_s, std, models.correlation_time_s)
    return embedded(f, q, s, tail[len(f) - HEAD :])


def follow_head(
    mean: FloatArray,
    covariance: FloatArray,
    head_mean: FloatArray,
    head_covariance: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """States whose first components have been updated, the others following by regression.

    Parameters
    ----------
    mean, covariance
        (N, s), (N, s, s) before the update.
    head_mean, head_covariance
        (N, h), (N, h, h) of the first h components after it.

    Returns
    -------
    mean, covariance
        (N, s), (N, s, s) after it. With G = P_th P_hh^-1 the others are x_t + G (x_h' - x_h),
        P_tt + G (P_hh' - P_hh) G', G P_hh': what they are given the head stays as it was. For a
        measurement of the head alone that is the Kalman update of the whole state.
    """
    h = head_mean.shape[1]
    before = covariance[:, :h, :h]
    gain = np.swapaxes(np.linalg.solve(before, covariance[:, :h, h:]), -1, -2)
    after, spread = np.empty_like(mean), np.empty_like(covariance)
    after[:, :h], spread[:, :h, :h] = head_mean, head_covariance
    after[:, h:] = mean[:, h:] + (gain @ (head_mean - mean[:, :h])[..., None])[..., 0]
    crossed = gain @ head_covariance
    spread[:, h:, :h], spread[:, :h, h:] = crossed, np.swapaxes(crossed, -1, -2)
    tail = covariance[:, h:, h:] + gain @ (head_covariance - before) @ np.swapaxes(gain, -1, -2)
    spread[:, h:, h:] = 0.5 * (tail + np.swapaxes(tail, -1, -2))
    return after, spread
