"""Sets of motion models for the ring, and the filters over them by plain loops with filterpy."""

from __future__ import annotations

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

SETS = {
    "velocity": {},
    "singer": {"imm_models": ["constant_velocity", "singer"]},
    "turn": {"imm_models": ["white_noise_acceleration", "coordinated_turn"]},
    "all": {
        "imm_models": ["constant_velocity", "van_keuk", "constant_acceleration", "coordinated_turn"]
    },
    "acceleration": {
        "imm_models": ["van_keuk", "singer"],
        "imm_switching": "acceleration",
        "imm_switching_acceleration_mps2": 3.0,
    },
}


def models_of(name: str, filter_: str = "imm") -> dict:
    """Parameters of the track manager."""
    chosen = SETS[name]
    count = len(chosen.get("imm_models", "ab"))
    return {
        "filter": filter_,
        "process_noise_std_mps2": 1.0,
        "imm_process_noise_factors": [0.3, 2.0, 1.0, 0.6][:count],
        "imm_mean_sojourn_s": [20.0, 5.0, 9.0, 12.0][:count],
        "imm_acceleration_std_mps2": 4.0,
        "imm_correlation_time_s": 7.0,
        **chosen,
    }


def loop_moments(weight, mean, covariance):
    """Moments of a mixture by a loop."""
    centre = sum(w * m for w, m in zip(weight, mean, strict=True))
    spread = sum(
        w * (c + np.outer(m - centre, m - centre))
        for w, m, c in zip(weight, mean, covariance, strict=True)
    )
    return centre, spread


def polar_update(mean, covariance, z, noise):
    """Update of one state by range and azimuth with filterpy's extended Kalman filter.

    Returns the mean, the covariance and the likelihood.
    """
    one = ExtendedKalmanFilter(dim_x=len(mean), dim_z=2)
    one.x, one.P, one.R = mean.copy(), covariance.copy(), noise

    def expected(x):
        return np.array([np.hypot(x[0], x[1]), np.arctan2(x[1], x[0])])

    def slope(x):
        h = np.zeros((2, len(x)))
        r = np.hypot(x[0], x[1])
        h[0, :2], h[1, :2] = x[:2] / r, np.array([-x[1], x[0]]) / r**2
        return h

    one.update(z, slope, expected)
    return one.x, one.P, one.likelihood
