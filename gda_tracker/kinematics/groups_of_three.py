"""One detection of three targets that the sensor did not resolve.

Each two of them are linked with their own P_u, independently; they are one group where at least two
of the three links are there: P_3 = u12 u13 u23 + u12 u13 (1 - u23) + .. (the groupings of
:func:`gda_tracker.association.unresolved.resolution_hypotheses`; Koch 2014, section 2.3.3). The
group's detection lies at the mean of the three. A link is a measurement "distance 0" with the
covariance R_u, so that the detection's density is a mixture over the four ways to be linked.
"""

from __future__ import annotations

import numpy as np

from gda_tracker.kinematics.group_updates import squared_and_density
from gda_tracker.kinematics.sensor_models import PolarMeasurements, innovations
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array, IntArray

LINKS = np.array([[1.0, -1.0, 0.0], [1.0, 0.0, -1.0], [0.0, 1.0, -1.0]])
"""Distances of the pairs (0, 1), (0, 2) and (1, 2) of three."""
WAYS = ((0, 1, 2), (0, 1), (0, 2), (1, 2))
"""Which of the links are there in each of the four ways to be one group."""


def way_probabilities(unresolved: FloatArray) -> FloatArray:
    """Probability (E, 4) of each of :data:`WAYS`; ``unresolved`` (E, 3) are P_u of the links."""
    return np.stack(
        [
            np.prod([unresolved[:, i] if i in way else 1.0 - unresolved[:, i] for i in range(3)], 0)
            for way in WAYS
        ],
        axis=1,
    )


def three_log_likelihood(
    measurements: PolarMeasurements,
    mean: FloatArray,
    covariance: FloatArray,
    unresolved: FloatArray,
    resolution: FloatArray,
    detection: Int32Array | IntArray,
) -> tuple[FloatArray, FloatArray]:
    """Squared distance and log density (E,) of detections, given that three are one group.

    Parameters
    ----------
    measurements
        Of the scan.
    mean, covariance
        (E, 3, s), (E, 3, s, s) of the members, which were predicted on their own.
    unresolved
        (E, 3) mean P_u of the links, two of them above 0.
    resolution
        R_u (2, 2) in range and azimuth.
    detection
        (E,) rows of the scan.

    Returns
    -------
    squared, log_likelihood
        The squared distance is the least over the ways that are possible.
    """
    columns = detection.astype(np.int32)
    found = [innovations(measurements, mean[:, i], covariance[:, i], columns) for i in range(3)]
    noise = measurements.covariance[columns]
    residual = np.stack([one.residual for one in found], axis=1)
    spread = np.stack([one.covariance - noise for one in found], axis=1)
    weight = way_probabilities(unresolved)
    squared, log_density = np.empty(weight.shape), np.empty(weight.shape)
    for place, way in enumerate(WAYS):
        squared[:, place], log_density[:, place] = given_links(
            residual, spread, noise, LINKS[list(way)], resolution
        )
    with np.errstate(divide="ignore"):
        log_weight = np.log(weight / weight.sum(axis=1, keepdims=True))
    least = np.where(weight > 0.0, squared, np.inf).min(axis=1)
    return least, np.logaddexp.reduce(log_weight + log_density, axis=1)


def given_links(
    residual: FloatArray,
    spread: FloatArray,
    noise: FloatArray,
    links: FloatArray,
    resolution: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Squared distance and log density (E,) at the mean of n members with given links.

    Parameters
    ----------
    residual, spread
        (E, n, 2) of the detection from each member, (E, n, 2, 2) H P H' of each.
    noise
        (E, 2, 2).
    links
        (l, n) the distances that were measured as 0: 1 and -1 at the two members.
    resolution
        R_u (2, 2).
    """
    count, n = residual.shape[:2]
    size = 2 * len(links)
    # Covariance of the distances with each other, and with the mean.
    both = np.einsum("li,ki,eixy->elxky", links, links, spread)
    both += np.einsum("lk,xy->lxky", np.eye(len(links)), resolution)
    with_mean = np.einsum("li,eixy->exly", links, spread).reshape(count, 2, size) / n
    solved = np.linalg.solve(both.reshape(count, size, size), np.swapaxes(with_mean, -1, -2))
    gain = np.swapaxes(solved, -1, -2)
    apart = np.einsum("li,eix->elx", links, residual).reshape(count, size, 1)
    left = residual.mean(axis=1) - (gain @ apart)[:, :, 0]
    total = spread.sum(axis=1) / n**2 + noise - gain @ np.swapaxes(with_mean, -1, -2)
    return squared_and_density(left, total)
