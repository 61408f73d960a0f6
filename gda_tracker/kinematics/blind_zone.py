"""The Doppler blind zone of a moving target indicator: what it hides, and what a miss then tells.

A radar that drops slow echoes detects a target that moves with the range rate r' relative to the
ground clutter around it with the probability

    P_D(x) = P_d [1 - exp(-log(2) (r'(x) / v)^2)],

v the speed at which half of P_d is left (minimum detectable velocity; Koch & Klemm 2001, Koch 2014
1.3.5: "Doppler blindness ... provided this phenomenon is described by appropriate sensor models").
The clutter stands, so that r' = u . v_target with u the direction to the target, however the
platform moves. The notch is a Gaussian in r':

    1 - P_D(x) = 1 - P_d + P_d c N(0; r'(x), s^2),   s^2 = v^2 / (2 log 2),   c = (2 pi s^2)^(1/2).

So a miss is a Gaussian sum: nothing is learnt, or a *fictitious measurement* of the range rate 0
with the variance s^2 of the notch; a detection has the likelihood P_d N(z; h(x), R) less the same
term, whose weight is negative. Over a Gaussian density with mean r and variance q of the range rate
the notch takes the share

    E = c N(0; r, q + s^2) = (s^2 / (s^2 + q))^(1/2) exp(-r^2 / (2 (s^2 + q))) < 1.

Densities after a miss and after a hit are reduced to Gaussians by their moments. The range rate is
linearised at the mean; its second-order terms widen q, in which they count as noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gda_tracker.kinematics.range_rate import second_order_terms
from gda_tracker.kinematics.sensor_models import SMALLEST_RANGE_M
from gda_tracker.vocabulary.arrays import FloatArray

# A detection deeper in the notch than that says nothing that a Gaussian could hold.
SMALLEST_VISIBLE_SHARE = 1e-3


@dataclass(frozen=True, slots=True)
class BlindZone:
    """A notch around range rate zero.

    ``speed_mps`` v > 0, where half of ``detection_probability`` P_d is left; ``sensor_xy_m`` (2,).
    """

    speed_mps: float
    detection_probability: float
    sensor_xy_m: FloatArray

    @property
    def variance(self) -> float:
        """s^2 [m2/s2], the variance of the fictitious measurement."""
        return self.speed_mps**2 / (2.0 * math.log(2.0))


@dataclass(slots=True)
class Notched:
    """N Gaussians and what the notch takes of them.

    ``share`` (N,) is E; ``mean`` (N, s), ``covariance`` (N, s, s) are those updated with the
    fictitious measurement.
    """

    share: FloatArray
    mean: FloatArray
    covariance: FloatArray


def detection_probability_at(range_rate_mps: FloatArray, zone: BlindZone) -> FloatArray:
    """P_D where the range rate relative to the clutter is known.

    >>> zone = BlindZone(2.0, 0.9, np.zeros(2))
    >>> detection_probability_at(np.array([0.0, 2.0, 20.0]), zone).tolist()
    [0.0, 0.45, 0.9]
    """
    visible = -np.expm1(-math.log(2.0) * np.square(np.asarray(range_rate_mps) / zone.speed_mps))
    seen: FloatArray = zone.detection_probability * visible
    return seen


def notched(mean: FloatArray, covariance: FloatArray, zone: BlindZone) -> Notched:
    """Return the part of each Gaussian that lies in the notch.

    Parameters
    ----------
    mean, covariance
        (N, s), (N, s, s): positions in the plane first; velocities begin at s / 2.
    zone
        The notch.
    """
    share, rate, crossed, total = _taken(mean, covariance, zone)
    gain = crossed / total[:, None]
    inside = mean - gain * rate[:, None]
    spread = covariance - gain[:, :, None] * crossed[:, None, :]
    return Notched(share, inside, 0.5 * (spread + spread.transpose(0, 2, 1)))


def notched_share(mean: FloatArray, covariance: FloatArray, zone: BlindZone) -> FloatArray:
    """E (N,), the share of each Gaussian that lies in the notch; arguments as :func:`notched`."""
    return _taken(mean, covariance, zone)[0]


def after_miss(
    mean: FloatArray, covariance: FloatArray, zone: BlindZone
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Moments of Gaussians after a scan without a detection.

    Parameters
    ----------
    mean, covariance, zone
        As in :func:`notched`.

    Returns
    -------
    factor, mean, covariance
        (N,) probability of the miss, 1 - P_d (1 - E); (N, s), (N, s, s) the moments of the sum of
        the prediction, with weight 1 - P_d, and of its part in the notch, with weight P_d E.
    """
    hidden = notched(mean, covariance, zone)
    seen = zone.detection_probability
    factor = 1.0 - seen + seen * hidden.share
    part = np.where(factor > 0.0, seen * hidden.share / np.where(factor > 0.0, factor, 1.0), 0.0)
    return factor, *_mixed(mean, covariance, hidden, part)


def after_hit(
    mean: FloatArray, covariance: FloatArray, zone: BlindZone
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Moments of Gaussians that a detection has updated, given that it was one at all.

    The density is that given less its part in the notch: a Gaussian sum with a negative weight,
    nowhere below zero.

    Returns
    -------
    factor, mean, covariance
        (N,) 1 - E, what the detection's likelihood has to be multiplied by beside P_d; the moments.
        What lies in the notch all but entirely stays as it is.
    """
    hidden = notched(mean, covariance, zone)
    factor = 1.0 - hidden.share
    clear = factor >= SMALLEST_VISIBLE_SHARE
    part = np.where(clear, -hidden.share / np.where(clear, factor, 1.0), 0.0)
    return factor, *_mixed(mean, covariance, hidden, part)


def _mixed(
    mean: FloatArray, covariance: FloatArray, hidden: Notched, part: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Moments of (1 - part) of the Gaussian and ``part`` (N,), maybe negative, of the hidden."""
    shift = hidden.mean - mean
    weight = part[:, None]
    spread = shift[:, :, None] * shift[:, None, :]
    # Relative to the Gaussian: no digits are lost on large coordinates.
    mixed = covariance + weight[..., None] * (
        hidden.covariance - covariance + (1.0 - weight[..., None]) * spread
    )
    return mean + weight * shift, 0.5 * (mixed + mixed.transpose(0, 2, 1))


def _taken(
    mean: FloatArray, covariance: FloatArray, zone: BlindZone
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """E, range rate (N,), its covariance (N, s) with the state, its variance with the notch's."""
    rate, slope, variance = _range_rate(mean, covariance, zone)
    crossed = (covariance @ slope[:, :, None])[:, :, 0]
    # With the second-order terms as noise the notch over the linear part is c N(0; r', s^2 + ..).
    total = np.einsum("ni,ni->n", slope, crossed) + variance + zone.variance
    share = np.sqrt(zone.variance / total) * np.exp(-0.5 * rate * rate / total)
    return share, rate, crossed, total


def _range_rate(
    mean: FloatArray, covariance: FloatArray, zone: BlindZone
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Range rate (N,) in the plane, its derivative (N, s), variance (N,) of higher terms."""
    size = mean.shape[1]
    v = slice(size // 2, size // 2 + 2)
    p, velocity = mean[:, :2] - zone.sensor_xy_m, mean[:, v]
    distance = np.maximum(np.hypot(p[:, 0], p[:, 1]), SMALLEST_RANGE_M)
    u = p / distance[:, None]
    rate = np.sum(u * velocity, axis=1)
    by_position = (velocity - rate[:, None] * u) / distance[:, None]
    slope = np.zeros_like(mean)
    slope[:, :2], slope[:, v] = by_position, u
    shift, variance = second_order_terms(covariance, u, by_position, rate, distance, None, v)
    return rate + shift, slope, variance
