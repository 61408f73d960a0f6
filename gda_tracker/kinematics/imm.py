"""Interacting multiple models, batched over H hypotheses and M models.

A hypothesis is a Gaussian mixture over the models: ``weight`` (H, M), the probability of each
model, ``mean`` (H, M, s) and ``covariance`` (H, M, s, s). One cycle is :func:`mix`,
:func:`predict`, the measurement update of every component with any filter, :func:`reweight`.

Transition matrices are written as Koch 2014, (2.11) does: entry [j, i] is p(j | i), the probability
that model i is followed by model j, so that the **columns** sum to one (most programs have the
transpose). All models have one state; :func:`gda_tracker.kinematics.motion_models.embedded` puts a
smaller one into it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from scipy.linalg import expm

from gda_tracker.kinematics.mixtures import moments
from gda_tracker.vocabulary.arrays import FloatArray


def sojourn_transition(dt_s: float, mean_sojourn_s: Sequence[float]) -> FloatArray:
    """Model transition over a time step from the mean time that a target stays in each model.

    A Markov chain in continuous time that leaves model i at the rate 1/sojourn_i for any of the
    others alike. Two steps make the same as one of their length, whatever the scan times.

    Parameters
    ----------
    dt_s
        Time step [s], >= 0.
    mean_sojourn_s
        (M,) mean time in each model [s], > 0; infinite: it is never left.

    Returns
    -------
    ndarray
        (M, M), entry [j, i] = p(j | i); read-only, since it is cached.

    Raises
    ------
    ValueError
        If a time is out of range.
    """
    sojourn = tuple(float(value) for value in mean_sojourn_s)
    if not dt_s >= 0.0 or not sojourn or not all(value > 0.0 for value in sojourn):
        raise ValueError(
            f"dt_s = {dt_s}, mean_sojourn_s = {list(sojourn)}: allowed are a step >= 0 and times > "
            "0"
        )
    return _sojourn_transition(float(dt_s), sojourn)


@lru_cache(maxsize=256)
def _sojourn_transition(dt_s: float, sojourn: tuple[float, ...]) -> FloatArray:
    count = len(sojourn)
    rate = 1.0 / np.array(sojourn)
    generator = np.tile(rate / max(count - 1, 1), (count, 1))
    np.fill_diagonal(generator, -rate if count > 1 else 0.0)
    transition: FloatArray = expm(dt_s * generator)
    # Rounding must not make a probability negative or a column lose weight.
    transition = np.clip(transition, 0.0, 1.0)
    transition /= transition.sum(axis=0)
    transition.flags.writeable = False
    return transition


def acceleration_dependent_transition(
    stay: tuple[float, float], acceleration_mps2: FloatArray, largest_mps2: float
) -> FloatArray:
    """Transition between a calm and a manoeuvring model that depends on the acceleration.

    Parameters
    ----------
    stay
        p11 and p22, the probabilities to stay in the calm and in the manoeuvring model.
    acceleration_mps2
        (H, d) acceleration of each hypothesis, or (H, 2, d) one for each model before the step.
    largest_mps2
        q, a measure of the largest acceleration, > 0.

    Returns
    -------
    ndarray
        (H, 2, 2), entry [j, i] = p(j | i): with e = exp(-|a|^2 / (2 q^2))
        [[p11 e, 1 - p22 (1 - e)], [1 - p11 e, p22 (1 - e)]] (Koch 2014, (2.12)).
    """
    squared = np.sum(np.square(acceleration_mps2), axis=-1)
    fall = np.exp(-0.5 * squared / largest_mps2**2)
    calm, agile = (fall, fall) if fall.ndim == 1 else (fall[:, 0], fall[:, 1])
    transition = np.empty((len(fall), 2, 2))
    transition[:, 0, 0] = stay[0] * calm
    transition[:, 1, 1] = stay[1] * (1.0 - agile)
    transition[:, 1, 0] = 1.0 - transition[:, 0, 0]
    transition[:, 0, 1] = 1.0 - transition[:, 1, 1]
    return transition


def mix(
    weight: FloatArray, mean: FloatArray, covariance: FloatArray, transition: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Change of models: what each model starts from, and how probable it is.

    Parameters
    ----------
    weight, mean, covariance
        (H, M), (H, M, s), (H, M, s, s) after the last update.
    transition
        (M, M) or (H, M, M), entry [j, i] = p(j | i).

    Returns
    -------
    weight, mean, covariance
        Of the same shapes: p_j = sum_i p(j | i) p_i, and the moments of the mixture over i with
        the shares p(j | i) p_i / p_j. A model that no other can reach keeps the moments of the
        whole mixture.

    Raises
    ------
    ValueError
        If shapes do not fit: all models need the same state.

    Notes
    -----
    Koch 2014, (3.28)-(3.35), which match the moments after the prediction; with F_j the same for
    all i, mixing before it gives the same.
    """
    _check_shapes(weight, mean, covariance, transition)
    predicted, share = _mixing_shares(weight, transition)
    h, m, s = mean.shape
    centre = share @ mean
    inner = (share @ covariance.reshape(h, m, s * s)).reshape(h, m, s, s)
    deviation = mean[:, None, :, :] - centre[:, :, None, :]
    spread = np.swapaxes(share[..., None] * deviation, -1, -2) @ deviation
    total = inner + spread
    return predicted, centre, 0.5 * (total + np.swapaxes(total, -1, -2))


def _mixing_shares(weight: FloatArray, transition: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Predicted weights (H, M) and shares (H, M to, M from) that sum to one over the last axis."""
    joint = transition * weight[:, None, :]
    predicted = joint.sum(axis=-1)
    reachable = predicted[..., None] > 0.0
    divisor = np.where(reachable, predicted[..., None], weight.sum(axis=-1)[:, None, None])
    return predicted, np.where(reachable, joint, weight[:, None, :]) / divisor


def predict(
    mean: FloatArray, covariance: FloatArray, transition: FloatArray, noise: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Predict every model with its own F and Q, after :func:`mix`.

    ``transition``, ``noise`` are (M, s, s), or (H, M, s, s) for models that depend on the state;
    for those with a non-linear motion replace the mean by the moved one.
    """
    moved = (transition @ mean[..., None])[..., 0]
    return moved, transition @ covariance @ np.swapaxes(transition, -1, -2) + noise


def reweight(weight: FloatArray, log_likelihood: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Probabilities of the models after an update.

    Parameters
    ----------
    weight
        (H, M) predicted probabilities, or (H, M, M) of the pairs of models of GPB2.
    log_likelihood
        Of the same shape: log N(z; h(x_j), S_j) of each model.

    Returns
    -------
    weight, log_evidence
        The new probabilities (Koch 2014, (3.48)) and (H,) the log likelihood of the hypothesis,
        log sum_j p_j N_j. Computed from logarithms: no likelihood is too small.
    """
    axes = tuple(range(1, weight.ndim))
    with np.errstate(divide="ignore"):
        joint = np.log(weight) + log_likelihood
    peak = joint.max(axis=axes, keepdims=True)
    scaled = np.exp(joint - peak)
    total = scaled.sum(axis=axes, keepdims=True)
    evidence: FloatArray = (peak + np.log(total)).reshape(len(weight))
    return scaled / total, evidence


def branch(
    weight: FloatArray,
    mean: FloatArray,
    covariance: FloatArray,
    switching: FloatArray,
    transition: FloatArray,
    noise: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Predict every pair of models: GPB2, the second-order generalised pseudo-Bayesian filter.

    Parameters
    ----------
    weight, mean, covariance
        (H, M), (H, M, s), (H, M, s, s).
    switching
        (M, M) or (H, M, M), entry [j, i] = p(j | i).
    transition, noise
        F and Q of the models (M, s, s), or of each pair (H, M, M, s, s).

    Returns
    -------
    weight, mean, covariance
        (H, M, M), (H, M, M, s), (H, M, M, s, s); entry [h, j, i]: model i, then model j
        (Koch 2014, (3.28)-(3.30)).
    """
    _check_shapes(weight, mean, covariance, switching)
    if transition.ndim == 3:
        transition, noise = transition[:, None], noise[:, None]
    joint: FloatArray = switching * weight[:, None, :]
    moved = (transition @ mean[:, None, :, :, None])[..., 0]
    return joint, moved, transition @ covariance[:, None] @ np.swapaxes(transition, -1, -2) + noise


def merge_branches(
    weight: FloatArray, mean: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Match the moments over the earlier model after the update: the end of a cycle of GPB2.

    ``weight`` (H, M, M), ``mean`` (H, M, M, s), ``covariance`` (H, M, M, s, s) as from
    :func:`branch` with the measurement applied; returns (H, M), (H, M, s), (H, M, s, s). Unlike in
    an IMM the shares know the new measurement (Koch 2014, section 3.3.2, "An Alternative").
    """
    total = weight.sum(axis=-1)
    count = weight.shape[-1]
    share = np.where(
        total[..., None] > 0.0, weight / np.where(total > 0.0, total, 1.0)[..., None], 1.0 / count
    )
    merged_mean, merged_covariance = moments(share, mean, covariance)
    return total, merged_mean, merged_covariance


def combine(
    weight: FloatArray, mean: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Mean (H, s) and covariance (H, s, s) over the models (Koch 2014, (3.49), by moments)."""
    return moments(weight, mean, covariance)


def _check_shapes(
    weight: FloatArray, mean: FloatArray, covariance: FloatArray, transition: FloatArray
) -> None:
    h, m = weight.shape
    s = mean.shape[-1]
    if mean.shape != (h, m, s) or covariance.shape != (h, m, s, s):
        raise ValueError(
            f"weight {weight.shape}, mean {mean.shape}, covariance {covariance.shape}: allowed are "
            "(H, M), (H, M, s), (H, M, s, s), one state for all models"
        )
    if transition.shape not in ((m, m), (h, m, m)):
        raise ValueError(f"transition {transition.shape}: allowed are {(m, m)} and {(h, m, m)}")
