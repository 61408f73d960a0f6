"""Gaussian filters, batched: prediction and the first-order extended Kalman update."""

from __future__ import annotations

import numpy as np

from gda_tracker.kinematics.sensor_models import Innovations
from gda_tracker.vocabulary.arrays import FloatArray


def predict(
    mean: FloatArray, covariance: FloatArray, transition: FloatArray, noise: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Predict N states: x -> F x, P -> F P F' + Q for ``mean`` (N, s), ``covariance`` (N, s, s)."""
    return mean @ transition.T, transition @ covariance @ transition.T + noise


def update(
    mean: FloatArray, covariance: FloatArray, innovation: Innovations
) -> tuple[FloatArray, FloatArray]:
    """Extended Kalman update of N states with one measurement each.

    W = P H' S^-1, x + W v, P - W S W' (Koch 2014, (3.44); Tchamova et al. 2004, section 14.2.2).
    """
    s_rr, s_ra = innovation.covariance[:, 0, 0], innovation.covariance[:, 0, 1]
    s_aa = innovation.covariance[:, 1, 1]
    determinant = s_rr * s_aa - s_ra * s_ra
    inverse = np.empty_like(innovation.covariance)
    inverse[:, 0, 0], inverse[:, 1, 1] = s_aa / determinant, s_rr / determinant
    inverse[:, 0, 1] = inverse[:, 1, 0] = -s_ra / determinant
    gain = covariance @ innovation.jacobian(mean.shape[1]).transpose(0, 2, 1) @ inverse
    new_mean = mean + (gain @ innovation.residual[:, :, None])[:, :, 0]
    reduced = covariance - gain @ innovation.covariance @ gain.transpose(0, 2, 1)
    return new_mean, 0.5 * (reduced + reduced.transpose(0, 2, 1))
