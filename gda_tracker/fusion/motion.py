"""Tracks at another time, and what a tracker learnt between two of its reports.

States are x, y, vx, vy. Everything works on arrays of tracks with a time step each.
"""

from __future__ import annotations

import numpy as np

from gda_tracker.vocabulary.arrays import BoolArray, FloatArray

STATE = 4

NEGLIGIBLE_INFORMATION = 1e-9
"""Share of a track's information below which a direction counts as not measured."""


def transition(dt_s: FloatArray) -> FloatArray:
    """F (M, 4, 4) of constant velocity for time steps (M,) [s]."""
    step = np.tile(np.eye(STATE), (len(dt_s), 1, 1))
    step[:, 0, 2] = step[:, 1, 3] = dt_s
    return step


def _per_coordinate(position: FloatArray, mixed: FloatArray, velocity: FloatArray) -> FloatArray:
    noise = np.zeros((len(position), STATE, STATE))
    for x in (0, 1):
        v = x + 2
        noise[:, x, x], noise[:, v, v] = position, velocity
        noise[:, x, v] = noise[:, v, x] = mixed
    return noise


def white_noise_covariance(dt_s: FloatArray, density_m2ps3: float) -> FloatArray:
    """Q (M, 4, 4) of an acceleration that is white in continuous time; steps may be divided."""
    t = np.abs(dt_s)
    return density_m2ps3 * _per_coordinate(t**3 / 3.0, t**2 / 2.0, t)


def scan_noise_covariance(dt_s: FloatArray, std_mps2: float) -> FloatArray:
    """Q (M, 4, 4) of an acceleration that is constant within a step, as ``track_manager`` has it.

    (Tchamova et al. 2004, section 14.2.2.)
    """
    t = np.abs(dt_s)
    return std_mps2**2 * _per_coordinate(t**4 / 4.0, t**3 / 2.0, t**2)


def tracker_noise_covariance(dt_s: float, period_s: float, std_mps2: float) -> FloatArray:
    """Q (4, 4) of a tracker whose acceleration is constant for each of its scans.

    Beyond a scan and a half the tracker has made several steps, which do not add up to one of their
    length: then as white noise of the same strength.
    """
    step = np.array([dt_s])
    if abs(dt_s) <= 1.5 * period_s:
        return scan_noise_covariance(step, std_mps2)[0]
    return white_noise_covariance(step, std_mps2**2 * period_s)[0]


def predict(
    mean: FloatArray, covariance: FloatArray, dt_s: FloatArray, noise: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Predict states (M, 4) with covariances (M, 4, 4) by time steps (M,), process noise Q."""
    step = transition(dt_s)
    moved = np.einsum("mij,mj->mi", step, mean)
    return moved, step @ covariance @ np.swapaxes(step, 1, 2) + noise


def new_information(
    before: tuple[FloatArray, FloatArray],
    after: tuple[FloatArray, FloatArray],
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Work out the equivalent measurement: what a tracker learnt since its last report.

    The inverse of a Kalman filter's update: information P^-1 - P_p^-1 and vector
    P^-1 x - P_p^-1 x_p, with the prediction x_p, P_p of the last report by the tracker's own motion
    model. Its error is that of the detections in between alone. So it is independent of the earlier
    ones and of other radars', whose tracks share the target's process noise. Where the tracker's
    motion model is another one the difference may have negative eigenvalues: these directions count
    as not measured.

    Parameters
    ----------
    before
        Predicted states (M, 4), covariances (M, 4, 4).
    after
        Reported states (M, 4), covariances (M, 4, 4).

    Returns
    -------
    information (M, 4, 4), vector (M, 4), clipped (M,)
        ``clipped``: where an eigenvalue was negative by more than rounding.
    """
    (expected, prior), (mean, covariance) = before, after
    # In units of the track's own standard deviations its information is the identity.
    root = np.linalg.cholesky(covariance)
    back = np.linalg.inv(root)
    known = np.swapaxes(root, 1, 2) @ np.linalg.inv(prior) @ root
    values, axes = np.linalg.eigh(0.5 * (known + np.swapaxes(known, 1, 2)))
    gain = 1.0 - values
    measured = gain > NEGLIGIBLE_INFORMATION
    shift = np.einsum("mji,mjk,mk->mi", axes, back, mean - expected)
    # Back to metres: columns of `out` are the directions in the space of information vectors.
    out = np.swapaxes(back, 1, 2) @ axes
    gain = np.where(measured, gain, 0.0)
    information = (out * gain[:, None, :]) @ np.swapaxes(out, 1, 2)
    vector = np.einsum("mij,mj->mi", out, np.where(measured, shift, 0.0))
    vector += np.einsum("mij,mj->mi", information, expected)
    return information, vector, np.asarray((values > 1.0 + 1e-6).any(axis=1))


def predict_information(
    information: FloatArray, vector: FloatArray, dt_s: float, density_m2ps3: float
) -> tuple[FloatArray, FloatArray]:
    """Predict Gaussians in information form, the state first, then constants such as biases.

    Exact also where the information is singular. A negative step gives what is known of an earlier
    time.

    Parameters
    ----------
    information : (N, n, n)
        n >= 4.
    vector : (N, n)
    """
    if dt_s == 0.0 or not len(information):
        return information, vector
    size = information.shape[-1]
    back = np.eye(size)
    back[0, 2] = back[1, 3] = -dt_s
    moved = back.T @ information @ back
    shifted = vector @ back
    noise = white_noise_covariance(np.array([dt_s]), density_m2ps3)[0]
    state = moved[:, :STATE, :STATE]
    # (state + Q^-1)^-1 without the inverse of Q, which may be zero.
    lost = noise @ np.linalg.inv(np.eye(STATE) + state @ noise)
    column = moved[:, :, :STATE] @ lost
    predicted = moved - column @ moved[:, :STATE, :]
    return (
        0.5 * (predicted + np.swapaxes(predicted, 1, 2)),
        shifted - np.einsum("nij,nj->ni", column, shifted[:, :STATE]),
    )
