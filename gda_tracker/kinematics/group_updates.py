"""One detection of two targets that the sensor did not resolve, in range and azimuth.

The detection of a group lies at the mean of what the sensor would measure of each: z = (h(x1) +
h(x2)) / 2 with its own noise (Koch 2014, section 2.3.3). The members were predicted on their own:
what is shared by their errors is not known to a track.

The first detection of a group makes the members' errors opposed: their mean is known, their
distance as little as before. A second one then tells less of each member than of two independent
ones, in the end nothing. Not knowing, a member loses the half of the covariance that independence
would take off it: for small R the mean over all correlations from none to -1, since the reduction
is proportional to 1 + correlation. With the whole of it tracks were too sure of themselves after
some scans in the cell, and lost targets.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gda_tracker.kinematics.sensor_models import Innovations, PolarMeasurements, innovations
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array, IntArray

LOG_TWO_PI = math.log(2.0 * math.pi)
KNOWN_SHARE = 0.5
"""Of the reduction of a member's covariance that an independent partner would allow."""


@dataclass(frozen=True, slots=True)
class GroupInnovations:
    """Innovations of E groups of two.

    ``mean`` (E, 2) [m, rad] from the group's predicted detection, ``difference`` (E, 2) h(x1) -
    h(x2); ``first``, ``second`` (E, 2, 2) H P H' of the members, ``noise`` (E, 2, 2).
    """

    mean: FloatArray
    difference: FloatArray
    first: FloatArray
    second: FloatArray
    noise: FloatArray

    def given_unresolved(self, resolution: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Squared distance and log density (E,) of the detections, given that P_u spoke.

        P_u(d) = exp(-d' R_u^-1 d / 2) is a measurement "d = 0" with covariance R_u. Where one
        member is known better than the other, d and the mean are correlated: it moves the mean.
        """
        between = 0.5 * (self.first - self.second)
        spread = self.first + self.second + resolution
        gain = np.swapaxes(np.linalg.solve(spread, np.swapaxes(between, -1, -2)), -1, -2)
        residual = self.mean + (gain @ self.difference[:, :, None])[:, :, 0]
        total = 0.25 * (self.first + self.second) + self.noise
        total = total - gain @ np.swapaxes(between, -1, -2)
        return squared_and_density(residual, total)


def squared_and_density(
    residual: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Squared distance and log density (E,) of residuals (E, 2) with covariances (E, 2, 2)."""
    solved = np.linalg.solve(covariance, residual[:, :, None])[:, :, 0]
    squared = np.sum(residual * solved, axis=1)
    return squared, -0.5 * (squared + np.linalg.slogdet(covariance)[1]) - LOG_TWO_PI


def group_innovations(
    measurements: PolarMeasurements,
    mean: FloatArray,
    covariance: FloatArray,
    first: IntArray,
    second: IntArray,
    detection: Int32Array | IntArray,
) -> GroupInnovations:
    """Innovations of groups of states ``first`` and ``second`` (E,) with detections (E,)."""
    columns = detection.astype(np.int32)
    one, two = (
        innovations(measurements, mean[rows], covariance[rows], columns) for rows in (first, second)
    )
    noise = measurements.covariance[columns]
    return GroupInnovations(
        0.5 * (one.residual + two.residual),
        two.residual - one.residual,
        one.covariance - noise,
        two.covariance - noise,
        noise,
    )


def updated_members(
    measurements: PolarMeasurements,
    mean: FloatArray,
    covariance: FloatArray,
    partner_mean: FloatArray,
    partner_covariance: FloatArray,
    detection: Int32Array | IntArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Update E states by the detections of groups with n - 1 partners each.

    W = P1 H1' / n S_g^-1 with S_g = sum_i Hi Pi Hi' / n^2 + R: the detection tells a share of each
    member's place. P1 becomes P1 - W S_g W' / 2 (:data:`KNOWN_SHARE`).

    Parameters
    ----------
    measurements
        Of the scan.
    mean, covariance
        (E, s), (E, s, s).
    partner_mean, partner_covariance
        (E, n - 1, s), (E, n - 1, s, s).
    detection
        (E,) rows of the scan.

    Returns
    -------
    mean, covariance, log_likelihood
        (E, s), (E, s, s), (E,) log N(z; sum_i h(xi) / n, S_g).
    """
    columns = detection.astype(np.int32)
    noise = measurements.covariance[columns]
    one: Innovations = innovations(measurements, mean, covariance, columns)
    residual, total = one.residual, one.covariance
    for place in range(partner_mean.shape[1]):
        other = innovations(
            measurements, partner_mean[:, place], partner_covariance[:, place], columns
        )
        residual, total = residual + other.residual, total + other.covariance
    count = float(partner_mean.shape[1] + 1)
    residual = residual / count
    total = (total - count * noise) / (count * count) + noise
    _, log_likelihood = squared_and_density(residual, total)
    share = one.jacobian(mean.shape[1]) / count
    gain = np.swapaxes(np.linalg.solve(total, share @ covariance), -1, -2)
    moved = mean + (gain @ residual[:, :, None])[:, :, 0]
    reduced = covariance - KNOWN_SHARE * gain @ total @ np.swapaxes(gain, -1, -2)
    return moved, 0.5 * (reduced + np.swapaxes(reduced, -1, -2)), log_likelihood
