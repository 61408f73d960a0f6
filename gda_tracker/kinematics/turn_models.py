"""Nearly coordinated turn: constant speed and turn rate, up to noise; it depends on the state.

The state holds all positions, all velocities, then the turn rate: ``[x, y, vx, vy, w]`` in the
plane, ``[x, y, z, vx, vy, vz, w]`` in space, where the turn is horizontal and the vertical speed
constant. The turn rate w [rad/s] is positive counter-clockwise.
"""

from __future__ import annotations

import numpy as np

from gda_tracker.kinematics.motion_models import constant_velocity
from gda_tracker.vocabulary.arrays import FloatArray

# Below this turn within a step the derivatives of the chord are taken from their series.
SMALL_TURN_RAD = 1e-2


def coordinated_turn(
    mean: FloatArray,
    dt_s: float,
    acceleration_std_mps2: float,
    turn_acceleration_std_radps2: float,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Move states on a turn and linearise the motion.

    Parameters
    ----------
    mean
        (N, 5) or (N, 7) states.
    dt_s
        Time step [s], >= 0.
    acceleration_std_mps2
        Standard deviation of the acceleration, constant within the step [m/s2], >= 0.
    turn_acceleration_std_radps2
        Standard deviation of the change of the turn rate, constant within the step [rad/s2], >= 0.

    Returns
    -------
    mean, F, Q
        (N, s) the moved states, (N, s, s) the Jacobian of the motion, (s, s) the noise:
        P -> F P F' + Q.

    Raises
    ------
    ValueError
        If the states do not have 5 or 7 components.

    Notes
    -----
    A counter-clockwise circle through the position: with a = w T the displacement is
    T [sin(a)/a v - (1 - cos(a))/a v_perp], v_perp = (vy, -vx). (Koch 2014, section 2.2 refers to
    the surveys that list it.)
    """
    size = mean.shape[1]
    if size not in (5, 7):
        raise ValueError(f"states of {size} components: allowed are 5 (plane) and 7 (space)")
    d = (size - 1) // 2
    vx, vy, angle = mean[:, d], mean[:, d + 1], dt_s * mean[:, -1]
    sine, cosine = np.sin(angle), np.cos(angle)
    along, across, along_slope, across_slope = _chord(angle, sine, cosine)

    motion, noise = constant_velocity(dt_s, acceleration_std_mps2, d)
    jacobian = np.zeros((len(mean), size, size))
    jacobian[:, :-1, :-1] = motion
    jacobian[:, -1, -1] = 1.0
    for row, sign, own, other in ((0, -1.0, vx, vy), (1, 1.0, vy, vx)):
        same, cross = d + row, d + 1 - row
        jacobian[:, row, same], jacobian[:, row, cross] = dt_s * along, sign * dt_s * across
        jacobian[:, same, same], jacobian[:, same, cross] = cosine, sign * sine
        jacobian[:, row, -1] = dt_s**2 * (along_slope * own + sign * across_slope * other)
        jacobian[:, same, -1] = dt_s * (-sine * own + sign * cosine * other)
    # In the velocity the motion is linear.
    moved = (jacobian[:, :, :-1] @ mean[:, :-1, None])[:, :, 0]
    moved[:, -1] = mean[:, -1]
    full_noise = np.zeros((size, size))
    full_noise[:-1, :-1] = noise
    full_noise[-1, -1] = (turn_acceleration_std_radps2 * dt_s) ** 2
    return moved, jacobian, full_noise


def _chord(
    a: FloatArray, sine: FloatArray, cosine: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """sin(a)/a, (1 - cos(a))/a and their derivatives, (N,) each, also where a is 0."""
    along = np.sinc(a / np.pi)
    across = np.sin(a / 2.0) * np.sinc(a / (2.0 * np.pi))
    square = a * a
    small = np.abs(a) < SMALL_TURN_RAD
    divisor = np.where(small, 1.0, a)
    along_series = -a / 3.0 * (1.0 - square / 10.0 * (1.0 - square / 28.0))
    across_series = 0.5 - square / 8.0 * (1.0 - square / 18.0)
    along_slope = np.where(small, along_series, (cosine - along) / divisor)
    across_slope = np.where(small, across_series, (sine - across) / divisor)
    return along, across, along_slope, across_slope
