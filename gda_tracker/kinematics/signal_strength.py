"""Signal strength as part of a target's state: Swerling I, inverse Gamma densities, N at a time.

A signal has the strength z [1, noise power = 1]; a target of mean strength x gives z exponential
with mean theta = 1 + x, drawn anew on every look. Signals above the threshold lambda are detections
(Koch 2014, (2.42)-(2.49)). What is known of theta is inverse Gamma, IG(shape a, scale b), conjugate
to it: 1/theta is Gamma with the mean a/b. The density runs over all theta > 0, though theta >= 1:
a prior should leave little below 1.

``shape`` and ``scale`` (N,) go together as :class:`Strengths`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import digamma, polygamma

from gda_tracker.vocabulary.arrays import FloatArray

LEAST_SHAPE = 1.0
# Thresholds below this share of the scale would leave a difference of nearly equal numbers.
FAINT = 1e-7


@dataclass(slots=True)
class Strengths:
    """Inverse Gamma densities of theta = 1 + x: ``shape`` (...) > 0 and ``scale`` (...) > 0."""

    shape: FloatArray
    scale: FloatArray

    def mean_strength(self) -> FloatArray:
        """Expected x = E[theta] - 1, infinite for shape <= 1."""
        with np.errstate(divide="ignore"):
            mean = self.scale / (self.shape - 1.0)
        return np.where(self.shape > 1.0, mean, np.inf) - 1.0

    def log_moments(self) -> tuple[FloatArray, FloatArray]:
        """Mean and variance of log theta."""
        return np.log(self.scale) - digamma(self.shape), polygamma(1, self.shape)


@lru_cache(maxsize=64)
def threshold(false_alarm_probability: float) -> float:
    """Lambda = -log P_F: noise alone exceeds it with the probability P_F.

    Raises
    ------
    ValueError
        Unless 0 < P_F <= 1.
    """
    if not 0.0 < false_alarm_probability <= 1.0:
        raise ValueError(
            f"false_alarm_probability = {false_alarm_probability}: allowed are numbers > 0 and <= 1"
        )
    return -math.log(false_alarm_probability)


def swerling_detection_probability(
    strength: FloatArray, false_alarm_probability: float
) -> FloatArray:
    """P_D = P_F^(1 / (1 + x)) of targets with the mean strengths x (Koch 2014, (2.46)).

    Examples
    --------
    >>> round(float(swerling_detection_probability(np.array(9.0), 1e-4)), 4)
    0.3981
    """
    found: FloatArray = np.exp(-threshold(false_alarm_probability) / (1.0 + strength))
    return found


def log_clutter_density(signal: FloatArray, lambda_: float, clutter: float = 0.0) -> FloatArray:
    """Log density of a false detection's strength z > lambda (Koch 2014, (2.48)).

    ``clutter`` is its mean strength c: 0 for noise.
    """
    return (lambda_ - signal) / (1.0 + clutter) - math.log1p(clutter)


def detection_probability(strengths: Strengths, lambda_: float) -> FloatArray:
    """Mean P_D over what is known of the strength: (b / (b + lambda))^a."""
    return np.exp(-strengths.shape * np.log1p(lambda_ / strengths.scale))


def log_signal_density(strengths: Strengths, signal: FloatArray) -> FloatArray:
    """Log density of a signal z, detected or not: a b^a / (b + z)^(a + 1).

    Its integral from lambda on is :func:`detection_probability`, so P_D must not be multiplied to
    it (Koch 2014, (2.49)).
    """
    a, b = strengths.shape, strengths.scale
    return np.log(a) + a * np.log(b) - (a + 1.0) * np.log(b + signal)


def predict_strength(strengths: Strengths, dt_s: float, memory_s: float) -> Strengths:
    """Forget: a and b shrink by exp(-dt / memory), but the shape not below 1.

    Exact for a strength whose inverse is multiplied by B / eta on each step, B being Beta(eta a,
    (1 - eta) a): its expectation stays.
    """
    kept = np.maximum(math.exp(-dt_s / memory_s), np.minimum(1.0, LEAST_SHAPE / strengths.shape))
    return Strengths(strengths.shape * kept, strengths.scale * kept)


def update_detected(strengths: Strengths, signal: FloatArray) -> Strengths:
    """Exact posterior after a detection of the strength z: IG(a + 1, b + z)."""
    return Strengths(strengths.shape + 1.0, strengths.scale + signal)


def update_missed(strengths: Strengths, lambda_: float) -> Strengths:
    """Posterior after no detection, by the first two moments of 1/theta.

    1 - exp(-lambda / theta) makes a difference of two: IG(a, b) minus P_D IG(a, b + lambda). Where
    lambda is nothing beside b it is lambda / theta, which makes IG(a + 1, b).
    """
    nothing = lambda_ < FAINT * strengths.scale
    if np.any(nothing):
        some = Strengths(strengths.shape, np.where(nothing, lambda_, strengths.scale))
        found = update_missed(some, lambda_)
        return Strengths(
            np.where(nothing, strengths.shape + 1.0, found.shape),
            np.where(nothing, strengths.scale, found.scale),
        )
    seen = detection_probability(strengths, lambda_)
    return combine(
        np.stack([np.ones_like(seen), -seen]),
        Strengths(
            np.stack([strengths.shape, strengths.shape]),
            np.stack([strengths.scale, strengths.scale + lambda_]),
        ),
    )


def combine(weight: FloatArray, strengths: Strengths) -> Strengths:
    """One density of a mixture of M along the first axis, by the moments of 1/theta.

    Weights (M, ...) of any positive sum; they may be negative, as those of a missed detection are.
    """
    share = weight / weight.sum(axis=0)
    mean = np.sum(share * strengths.shape / strengths.scale, axis=0)
    square = np.sum(share * strengths.shape * (strengths.shape + 1.0) / strengths.scale**2, axis=0)
    variance = square - mean**2
    return Strengths(mean**2 / variance, mean / variance)


def log_scan_ratio(
    strengths: Strengths,
    kinematic_log_likelihood: FloatArray,
    signal: FloatArray,
    clutter_density: float,
    lambda_: float,
    clutter: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Log ratio of the scan's likelihoods, target against none, and who caused what.

    Parameters
    ----------
    strengths
        (N,) predicted.
    kinematic_log_likelihood, signal
        (N, m) log N(z_j; H x, S), -inf where there is no detection, and the strengths.
    clutter_density
        rho_F, in one over the unit of the kinematic measurement.
    lambda_, clutter
        Threshold and mean strength of false detections.

    Returns
    -------
    log_ratio, weight
        (N,) the log of (2.49) over rho_F, and (N, 1 + m) probabilities of a miss and of each
        detection.
    """
    one = Strengths(strengths.shape[:, None], strengths.scale[:, None])
    missed = -np.expm1(-strengths.shape * np.log1p(lambda_ / strengths.scale))
    log_pair = (
        kinematic_log_likelihood
        + log_signal_density(one, signal)
        - log_clutter_density(signal, lambda_, clutter)
        - math.log(clutter_density)
    )
    log_all = np.concatenate([np.log(missed)[:, None], log_pair], axis=1)
    peak = log_all.max(axis=1)
    weight = np.exp(log_all - peak[:, None])
    total = weight.sum(axis=1)
    return peak + np.log(total), weight / total[:, None]


def update_strength(
    strengths: Strengths, weight: FloatArray, signal: FloatArray, lambda_: float
) -> Strengths:
    """Posterior (N,) given the probabilities (N, 1 + m) of a miss and of each detection."""
    missed = update_missed(strengths, lambda_)
    seen = update_detected(Strengths(strengths.shape[:, None], strengths.scale[:, None]), signal)
    shape = np.broadcast_to(seen.shape, signal.shape)
    return combine(
        weight.T,
        Strengths(
            np.concatenate([missed.shape[None], shape.T]),
            np.concatenate([missed.scale[None], seen.scale.T]),
        ),
    )
