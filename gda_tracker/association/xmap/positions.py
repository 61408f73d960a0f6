"""Positions: the likelihood of an association with all biases integrated out (Theorem 4.3).

The relative biases of the sensors to a reference sensor, and the centre of the objects, are
integrated in one elimination: M = [[H, G'], [G, F + D*]] has |M| = |H| |W*|, and what is left after
the centre's rows are eliminated is W*_- and b*_-. Sums over clusters alone make M, so each cluster
is worked out once and the associations sum by incidence.

Differences that cancel are taken in closed form: V_0 - W_alpha = W_alpha P_alpha V_0 with
P_alpha the sum of the inverse covariances; D* is the inverse of the prior covariance of the
relative biases, or zero where that is diffuse.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.sparse

from gda_tracker.vocabulary.arrays import FloatArray, IntArray

CHUNK_ELEMENTS = 12_000
"""Associations times scenes that are worked off together: their arrays stay in the cache."""

DENSE_CLUSTERS = 256
"""Up to so many clusters a dense product is faster than a sparse one."""


class BiasLayout(NamedTuple):
    """Which relative biases are unknown, and what is known of them.

    Attributes
    ----------
    variable : (r,)
        Number of the sensor's relative bias among the G unknown ones, -1 for the reference and for
        a sensor without measurements. Without bias there are several references.
    reference
        A sensor with variable -1.
    prior_precision : (G d, G d)
        D*_-.
    transfer : (r, G, d, d) or None
        Mean of the absolute biases given the relative ones; ``None`` if all are diffuse.
    spread : (d, d) or None
        Covariance, common to all sensors, of the absolute biases given the relative ones.
    """

    variable: IntArray
    reference: int
    prior_precision: FloatArray
    transfer: FloatArray | None
    spread: FloatArray | None


def bias_layout(
    bias_covariances: Sequence[FloatArray | None], sizes: Sequence[int], dimension: int
) -> BiasLayout:
    """Choose the reference and work out the prior of the relative biases (Ferry 2010, 4.22).

    Of the sensors with measurements the reference is one without bias if there is one, else the
    last one with a finite prior, else the last one.
    """
    present = [s for s, size in enumerate(sizes) if size]
    finite = {s: b for s in present if (b := bias_covariances[s]) is not None}
    unbiased = [s for s, covariance in finite.items() if not covariance.any()]
    references = unbiased or list(finite)[-1:] or present[-1:]
    reference = references[-1]
    variable = np.full(len(bias_covariances), -1)
    others = [s for s in present if s not in references]
    variable[others] = np.arange(len(others))
    identity = np.eye(dimension)
    precision = np.zeros((len(others) * dimension,) * 2)
    known = [s for s in others if s in finite]
    if known:
        prior = np.tile(finite[reference], (len(known), len(known)))
        for i, s in enumerate(known):
            block = slice(i * dimension, (i + 1) * dimension)
            prior[block, block] += finite[s]
        at = np.concatenate([variable[s] * dimension + np.arange(dimension) for s in known])
        precision[np.ix_(at, at)] = np.linalg.inv(prior)
    if not finite:
        return BiasLayout(variable, reference, precision, None, None)
    # Given the relative biases the reference's own is -D^-1 sum of (B^s)^-1 times theirs.
    transfer = np.zeros((len(bias_covariances), len(others), dimension, dimension))
    spread = np.zeros((dimension, dimension))
    if not unbiased:
        inverses = {s: np.linalg.inv(covariance) for s, covariance in finite.items()}
        spread = np.linalg.inv(np.sum(list(inverses.values()), axis=0))
        for s in known:
            transfer[:, variable[s]] -= spread @ inverses[s]
    for s in others:
        transfer[s, variable[s]] += identity
    return BiasLayout(variable, reference, precision, transfer, spread)


def centred(
    positions: FloatArray, sensor_of: IntArray, bias_covariances: Sequence[FloatArray | None]
) -> tuple[FloatArray, FloatArray]:
    """Positions (M, B, d) about zero, and the shift (r, B, d) of each sensor.

    A common shift, and one of each sensor with a diffuse bias, change no probability; without them
    large coordinates would cost digits.
    """
    shift = np.zeros((len(bias_covariances), *positions.shape[1:]))
    together = [s for s, b in enumerate(bias_covariances) if b is not None]
    for s, covariance in enumerate(bias_covariances):
        mine = sensor_of == s if covariance is None else np.isin(sensor_of, together)
        if mine.any():
            shift[s] = positions[mine].mean(axis=0)
    return positions - shift[sensor_of], shift


class ClusterTerms(NamedTuple):
    """What each cluster adds to the sums, for B scenes; n = d (1 + G) unknowns, the centre first.

    Attributes
    ----------
    matrix : n arrays (n - k, C, B)
        Row k of the upper triangle of M, without the prior.
    vector : (n, C, B)
    cost : (C, B)
        kappa_alpha (Ferry 2010, 4.10).
    """

    matrix: list[FloatArray]
    vector: FloatArray
    cost: FloatArray


def cluster_terms(
    flags: FloatArray,
    precisions: FloatArray,
    positions: FloatArray,
    variable_of: IntArray,
    prior_covariance: FloatArray,
) -> ClusterTerms:
    """Work out W, m, kappa and the parts of F, G, H, g, h of each cluster (4.10, 4.17, 4.24-4.26).

    Parameters
    ----------
    flags : (C, M)
        One where the cluster has the measurement.
    precisions : (M, B, d, d)
        Inverse covariances.
    positions : (M, B, d)
    variable_of : (M,)
        Number of the measurement's relative bias, -1 for none.
    prior_covariance : (d, d)
        V_0.
    """
    n_scenes, dimension = positions.shape[1:]
    unknowns = int(variable_of.max(initial=-1)) + 1
    weighted = np.einsum("mbij,mbj->mbi", precisions, positions)

    def total(values: FloatArray, variable: int | None = None) -> FloatArray:
        mask = flags if variable is None else flags * (variable_of == variable)
        return (mask @ values.reshape(len(values), -1)).reshape(len(flags), *values.shape[1:])

    precision, information = total(precisions), total(weighted)
    # W = (I + V0 P)^-1 V0, symmetric.
    scaled = np.eye(dimension) + prior_covariance @ precision
    right = np.broadcast_to(prior_covariance, scaled.shape)
    covariance = _symmetric(np.asarray(np.linalg.solve(scaled, right), dtype=np.float64))
    mean = np.einsum("cbij,cbj->cbi", covariance, information)
    cost = np.linalg.slogdet(scaled)[1] - np.einsum("cbi,cbi->cb", mean, information)
    size = dimension * (1 + unknowns)
    full = np.zeros((size, size, len(flags), n_scenes))
    vector = np.zeros((size, len(flags), n_scenes))
    blocks = [slice(k * dimension, (k + 1) * dimension) for k in range(1 + unknowns)]
    full[blocks[0], blocks[0]] = _leading(_symmetric(covariance @ precision @ prior_covariance))
    vector[blocks[0]] = np.moveaxis(mean, 2, 0)
    own = [total(precisions, k) for k in range(unknowns)]
    seen = [p @ covariance for p in own]
    for k in range(unknowns):
        full[blocks[0], blocks[k + 1]] = -_leading(np.swapaxes(seen[k], 2, 3))
        vector[blocks[k + 1]] = np.moveaxis(
            np.einsum("cbij,cbj->cbi", own[k], mean) - total(weighted, k), 2, 0
        )
        for j in range(k, unknowns):
            block = -seen[k] @ own[j]
            if j == k:
                block += own[k]
            full[blocks[k + 1], blocks[j + 1]] = _leading(block)
    rows = [np.ascontiguousarray(full[k, k:]) for k in range(size)]
    return ClusterTerms(rows, vector, cost)


def inverses(covariances: FloatArray) -> FloatArray:
    """Inverses of covariances (..., d, d), symmetric to the last digit."""
    return _symmetric(np.asarray(np.linalg.inv(covariances), dtype=np.float64))


def _symmetric(matrix: FloatArray) -> FloatArray:
    return 0.5 * (matrix + np.swapaxes(matrix, -1, -2))


def _leading(matrix: FloatArray) -> FloatArray:
    """(C, B, i, j) as (i, j, C, B)."""
    return np.moveaxis(matrix, (2, 3), (0, 1))


def association_costs(
    incidence: scipy.sparse.csr_matrix, terms: ClusterTerms, layout: BiasLayout
) -> FloatArray:
    """kappa([a]) plus the sum of kappa_alpha of associations (A, C) by incidence, as (A, B).

    (Ferry 2010, 4.8, 4.20.) Up to what is common to all associations, -1/2 of it is the log
    likelihood of the positions.
    """
    n_associations, n_scenes = incidence.shape[0], terms.cost.shape[1]
    costs = np.empty((n_associations, n_scenes))
    step = max(1, CHUNK_ELEMENTS // n_scenes)
    for begin in range(0, n_associations, step):
        rows = slice(begin, begin + step)
        share = incidence[rows]
        matrix, vector = association_sums(share, terms, layout)
        costs[rows] = eliminate(matrix, vector) + _product(share, terms.cost[None])[0]
    return costs


def association_sums(
    incidence: scipy.sparse.csr_matrix, terms: ClusterTerms, layout: BiasLayout
) -> tuple[list[FloatArray], FloatArray]:
    """M of each association as rows of its upper triangle (n - k, A, B), and (n, A, B).

    The vector is (h, g_s): the right-hand side to the unknowns V_0^-1 xi and relative biases.
    """
    size = len(terms.matrix)
    centre = size - len(layout.prior_precision)
    matrix = [_product(incidence, row) for row in terms.matrix]
    for k in range(centre, size):
        matrix[k] += layout.prior_precision[k - centre, k - centre :, None, None]
    return matrix, _product(incidence, terms.vector)


def eliminate(matrix: list[FloatArray], vector: FloatArray) -> FloatArray:
    """log|M| - v' M^-1 v of a stack, by elimination on the whole stack at once, in place.

    After step k the rows from k on are the Schur complement: what is left of M and v when the
    first k unknowns are integrated out.
    """
    cost = np.zeros(vector.shape[1:])
    for k in range(len(matrix)):
        eliminate_one(matrix, vector, k, cost)
    return cost


def eliminate_one(matrix: list[FloatArray], vector: FloatArray, k: int, cost: FloatArray) -> None:
    """Integrate unknown k out; add its log pivot minus its part of the quadratic form."""
    pivot_row = matrix[k]
    factor = pivot_row[1:] / pivot_row[0]
    share = vector[k] / pivot_row[0]
    cost += np.log(pivot_row[0])
    cost -= share * vector[k]
    for i in range(len(factor)):
        matrix[k + 1 + i] -= factor[i] * pivot_row[1 + i :]
        vector[k + 1 + i] -= pivot_row[1 + i] * share


def _product(incidence: scipy.sparse.csr_matrix, values: FloatArray) -> FloatArray:
    """Sum values (k, C, B) over the clusters of each association: (k, A, B)."""
    if incidence.shape[1] <= DENSE_CLUSTERS:
        return np.asarray(np.matmul(incidence.toarray(), values))
    return np.stack([incidence @ part for part in values])
