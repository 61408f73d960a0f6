"""The Cramer-Rao bound of a target that moves straight on, seen by sensors with models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gda_tracker.kinematics.measurement_kinds import MeasurementModel
from gda_tracker.kinematics.measurement_models import Sites, derivatives
from gda_tracker.kinematics.motion_models import constant_velocity
from gda_tracker.vocabulary.arrays import FloatArray


@dataclass(frozen=True)
class Look:
    """One measurement: when, by which model from where, with which noise (m, m)."""

    time_s: float
    model: MeasurementModel
    sites: Sites
    noise: FloatArray


def cramer_rao_bounds(
    start: FloatArray, looks: Sequence[Look], prior_information: FloatArray
) -> FloatArray:
    """Least covariance of any unbiased estimate after each look.

    Parameters
    ----------
    start
        (4,) state [x, y, vx, vy] at the first look; from there the target moves straight on.
    looks
        K measurements in the order of time, none of them missed.
    prior_information
        (4, 4) what is known of the state before the first, an inverse covariance.

    Returns
    -------
    (K, 4, 4) array
        J^-1 with J = F^-T J F^-1 + H' R^-1 H from look to look, H at the true states: without
        process noise the information is a sum. Singular where the looks do not tell the state, and
        infinite there.
    """
    information = np.array(prior_information, dtype=np.float64)
    state = np.array(start, dtype=np.float64)
    bounds = np.empty((len(looks), 4, 4))
    time_s = looks[0].time_s if looks else 0.0
    for place, look in enumerate(looks):
        transition, _ = constant_velocity(look.time_s - time_s, 1.0)
        back, _ = constant_velocity(time_s - look.time_s, 1.0)
        time_s, state = look.time_s, transition @ state
        slope = derivatives(look.model, look.sites, state[None])[0][0]
        information = back.T @ information @ back + slope.T @ np.linalg.solve(look.noise, slope)
        try:
            bounds[place] = np.linalg.inv(information)
        except np.linalg.LinAlgError:
            bounds[place] = np.inf
    return bounds
