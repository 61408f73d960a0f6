"""Two sensors without bias: the adaptive threshold, the best association and the k best.

(Ferry 2010, 3.1.1.) With a Poisson prior on the number of objects the log probability of an
association is a sum over its pairs, so it is an assignment problem: the costs are Mahalanobis
distances minus a threshold that depends on the two covariances.
"""

from __future__ import annotations

import heapq
import math

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.special import gamma

from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray

LOG_TWO_PI = math.log(2.0 * math.pi)


def estimated_prior_covariance(positions: FloatArray, sensor_of: IntArray) -> FloatArray:
    """Covariance (d, d) of positions (M, d) about the mean of their sensor (Ferry 2010, 3.16).

    Raises
    ------
    ValueError
        If there are too few positions, or they do not span all dimensions.
    """
    sensors = np.unique(sensor_of)
    deviations = np.concatenate(
        [positions[sensor_of == s] - positions[sensor_of == s].mean(axis=0) for s in sensors]
    )
    freedom = len(positions) - len(sensors)
    if freedom < positions.shape[1] or np.linalg.matrix_rank(deviations) < positions.shape[1]:
        raise ValueError(
            f"{len(positions)} positions of {len(sensors)} sensors are too few or too regular to "
            f"estimate it in {positions.shape[1]} dimensions"
        )
    return np.asarray(deviations.T @ deviations / freedom)


def region_volume(covariance: FloatArray, ellipsoid_dimension: int) -> float:
    """Volume of the region X^0 of objects with this covariance (Ferry 2010, 3.17).

    ``ellipsoid_dimension`` m: the region is a product of m-dimensional ellipsoids, as positions and
    velocities of physical space.
    """
    half = ellipsoid_dimension / 2.0
    theta = (1.0 + half) * gamma(half + 1.0) ** (-1.0 / half)
    sign, log_det = np.linalg.slogdet(2.0 * math.pi * theta * covariance)
    if sign <= 0:
        raise ValueError("covariance: allowed is a positive definite matrix")
    return math.exp(0.5 * float(log_det))


def estimated_object_count(sizes: IntArray, detection_probability: FloatArray) -> float:
    """Most likely mean nu of the Poisson prior (Ferry 2010, B.6)."""
    return float(np.sum(sizes) / np.sum(detection_probability))


def adaptive_threshold(
    first: FloatArray, second: FloatArray, volume: float, nu_q: float, robust: bool = True
) -> FloatArray:
    """A_ij of Mori and Chong (Ferry 2010, 3.13), or so that it holds for any covariance (3.14).

    Parameters
    ----------
    first : (n, d, d)
        Covariances of sensor 1.
    second : (m, d, d)
        Covariances of sensor 2.
    volume
        Of the region of objects.
    nu_q
        Expected number of objects times the chance that neither sensor sees one.
    robust
        (3.14): an uncertainty beyond the region is limited to it.
    """
    together = first[:, None] + second
    dimension = first.shape[-1]
    gain = 2.0 * math.log(volume) - dimension * LOG_TWO_PI - np.linalg.slogdet(together)[1]
    if robust:
        gain = np.maximum(gain, 0.0)
    return np.asarray(gain - 2.0 * math.log(nu_q))


def pair_costs(
    first: FloatArray,
    first_covariance: FloatArray,
    second: FloatArray,
    second_covariance: FloatArray,
    threshold: FloatArray,
) -> FloatArray:
    """Costs (n, m) of pairs, -2 log of the likelihood ratio to two objects (Ferry 2010, 3.12)."""
    difference = first[:, None] - second
    together = first_covariance[:, None] + second_covariance
    solved = np.linalg.solve(together, difference[..., None])[..., 0]
    return np.asarray((difference * solved).sum(axis=-1) - threshold)


def best_association(costs: FloatArray) -> tuple[IntArray, float]:
    """Association of least cost: the partner (n,) of each row, -1 for none; and the cost.

    A pair of positive cost is worse than two single measurements.
    """
    return _solve(costs, np.ones(costs.shape, dtype=np.bool_), np.ones(len(costs), dtype=np.bool_))


def k_best_associations(costs: FloatArray, k: int) -> list[tuple[IntArray, float]]:
    """The k associations of least cost, best first (Murty 1968); fewer if there are fewer.

    Costs are -2 log of probabilities up to a common constant, so exp(-cost / 2) compares them.
    """
    n, m = costs.shape
    everything = (np.ones((n, m), dtype=np.bool_), np.ones(n, dtype=np.bool_))
    partner, cost = _solve(costs, *everything)
    order = 0
    # (cost, order of discovery, partners, rows fixed, allowed pairs, allowed to stay single)
    waiting = [(cost, order, partner, 0, *everything)]
    found: list[tuple[IntArray, float]] = []
    while waiting and len(found) < k:
        cost, _, partner, fixed, pairs, alone = heapq.heappop(waiting)
        found.append((partner, cost))
        pairs, alone = pairs.copy(), alone.copy()
        # Row by row: all that agree with this one above the row, and not in it.
        for row in range(fixed, n):
            other_pairs, other_alone = pairs.copy(), alone.copy()
            if partner[row] < 0:
                other_alone[row] = False
            else:
                other_pairs[row, partner[row]] = False
            if other_alone[row] or other_pairs[row].any():
                solved, value = _solve(costs, other_pairs, other_alone)
                if math.isfinite(value):
                    order += 1
                    waiting_entry = (value, order, solved, row, other_pairs, other_alone)
                    heapq.heappush(waiting, waiting_entry)
            alone[row] = partner[row] < 0
            pairs[row] = False
            if partner[row] >= 0:
                pairs[:, partner[row]] = False
                pairs[row, partner[row]] = True
    return found


def _solve(costs: FloatArray, pairs: BoolArray, alone: BoolArray) -> tuple[IntArray, float]:
    """Least cost with the allowed pairs; infinite if there is no such association."""
    n, m = costs.shape
    matrix = np.full((n, m + n), np.inf)
    matrix[:, :m] = np.where(pairs, costs, np.inf)
    matrix[np.arange(n), m + np.arange(n)] = np.where(alone, 0.0, np.inf)
    try:
        row, column = linear_sum_assignment(matrix)
    except ValueError as error:
        if "infeasible" in str(error):
            return np.full(n, -1), math.inf
        raise
    return np.where(column < m, column, -1), float(matrix[row, column].sum())
