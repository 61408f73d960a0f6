"""Motion models: how a state moves between two scans.

A state holds all positions, then all velocities: in the plane ``[x, y, vx, vy]``.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from gda_tracker.vocabulary.arrays import FloatArray

FILTERS = ("cv",)


@lru_cache(maxsize=256)
def constant_velocity(
    dt_s: float, process_noise_std_mps2: float, dimension: int = 2
) -> tuple[FloatArray, FloatArray]:
    """Transition matrix and process noise of constant velocity.

    Parameters
    ----------
    dt_s
        Time step [s], >= 0.
    process_noise_std_mps2
        Standard deviation sigma_v of the acceleration, which is constant within a step [m/s2].
    dimension
        Number of position coordinates.

    Returns
    -------
    F, Q
        (s, s) with s = 2 ``dimension``; read-only, since they are cached.

    Notes
    -----
    Tchamova et al. 2004, section 14.2.2: Q = sigma_v^2 [[T^4/4, T^3/2], [T^3/2, T^2]] per
    coordinate.
    """
    eye = np.eye(dimension)
    step = np.array([[1.0, dt_s], [0.0, 1.0]])
    effect = np.array([process_noise_std_mps2 * dt_s**2 / 2.0, process_noise_std_mps2 * dt_s])
    transition: FloatArray = np.kron(step, eye)
    noise: FloatArray = np.kron(effect[:, None] * effect, eye)
    transition.flags.writeable = False
    noise.flags.writeable = False
    return transition, noise
