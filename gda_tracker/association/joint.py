"""Exact association probabilities of a cluster of tracks and measurements.

A joint hypothesis gives every track at most one measurement and every measurement to at most one
track. Its weight is the product of w_ij over its pairs, r_i over its idle tracks and c_j over its
unassigned measurements (Tchamova et al. 2004, 14.4.1: w = P_d g, r = 1 - P_d, c = beta).
Hypotheses are never enumerated: over subsets the cost is larger side x smaller side x 2^smaller
side, and for sparse clusters over their open nodes (``frontier.py``) it is linear in their length.
"""

from __future__ import annotations

import math
from operator import index
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gda_tracker.association.choices import LOOPY_BELIEF_PROPAGATION
from gda_tracker.association.clustering import find_clusters
from gda_tracker.association.engine_choice import always_subsets, choose_engine
from gda_tracker.association.errors import ClusterTooLarge, NoFeasibleHypothesis
from gda_tracker.association.frontier import frontier_marginals
from gda_tracker.association.scaling import scale
from gda_tracker.association.subsets import memory_elements, sweep, terminal_weights
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray

MAX_ELEMENTS = 20
"""Largest smaller side of a dense cluster; about 0.2 GB and some seconds at 20 x 20."""

MAX_LOG_WEIGHT = 1e9
"""Largest finite log weight, by magnitude."""

CHUNK_ELEMENTS = 4_000_000
"""Doubles one pass of a batch may hold."""


class JointProbabilities(NamedTuple):
    """Marginals (B, n, m), log partition (B,) and whether any hypothesis has weight (B,)."""

    marginals: FloatArray
    log_partition: FloatArray
    feasible: BoolArray


def joint_marginals(
    log_weight: ArrayLike, log_idle_track: ArrayLike, log_idle_measurement: ArrayLike
) -> FloatArray:
    """Probability of each pair: the share of the joint hypotheses that hold it, by weight.

    Exact (to about 1e-13) for any spread of the log weights. Weights of zero are given as -inf:
    pairs outside the gate, r = 0 (P_d = 1), c = 0 (no clutter).

    Parameters
    ----------
    log_weight : (n, m)
        log w_ij.
    log_idle_track : (n,)
        log r_i.
    log_idle_measurement : (m,)
        log c_j.

    Returns
    -------
    (n, m) probabilities; 1 minus a row's sum is the probability that the track is idle.

    Raises
    ------
    NoFeasibleHypothesis
        If every joint hypothesis has weight zero.
    ClusterTooLarge
        If the smaller side of a part without gates to others exceeds ``MAX_ELEMENTS``, and its
        gates are not sparse enough either.
    ValueError
        For a wrong shape, NaN, +inf, or a finite log weight beyond ``MAX_LOG_WEIGHT``.

    Examples
    --------
    One track, one measurement, w = r = c = 1: assigned or not, with equal weight.

    >>> joint_marginals([[0.0]], [0.0], [0.0])
    array([[0.5]])
    """
    return _single(log_weight, log_idle_track, log_idle_measurement).marginals[0]


def joint_log_partition(
    log_weight: ArrayLike, log_idle_track: ArrayLike, log_idle_measurement: ArrayLike
) -> float:
    """Log of the summed weight of all joint hypotheses; -inf if every one has weight zero.

    Parameters and errors as in :func:`joint_marginals`.

    Examples
    --------
    >>> round(np.exp(joint_log_partition(np.zeros((2, 3)), np.zeros(2), np.zeros(3))))
    13
    """
    try:
        found = _single(log_weight, log_idle_track, log_idle_measurement)
    except NoFeasibleHypothesis:
        return -math.inf
    return float(found.log_partition[0])


def joint_marginals_batch(
    log_weight: FloatArray,
    log_idle_track: FloatArray,
    log_idle_measurement: FloatArray,
    least_assigned: IntArray | None = None,
) -> JointProbabilities:
    """Like :func:`joint_marginals` for B clusters of one shape at once, without checks.

    A cluster without a feasible hypothesis has zero marginals, log partition -inf and ``feasible``
    False.

    Parameters
    ----------
    log_weight : (B, n, m)
    log_idle_track : (B, n)
    log_idle_measurement : (B, m)
    least_assigned : (B,), optional
        Only hypotheses with at least so many pairs count.
    """
    batch, n, m = log_weight.shape
    if min(n, m) == 0:
        log_partition = log_idle_track.sum(axis=1) + log_idle_measurement.sum(axis=1)
        return JointProbabilities(np.zeros((batch, n, m)), log_partition, log_partition > -np.inf)
    if m > n:
        turned = joint_marginals_batch(
            log_weight.swapaxes(1, 2), log_idle_measurement, log_idle_track, least_assigned
        )
        return turned._replace(marginals=turned.marginals.swapaxes(1, 2))
    return bordered_marginals(
        _bordered(log_weight, log_idle_track, log_idle_measurement), least_assigned
    )


def bordered_marginals(
    bordered: FloatArray, least_assigned: IntArray | None = None
) -> JointProbabilities:
    """Like :func:`joint_marginals_batch`, for weights in one array; the array is overwritten.

    NaN and +inf make a cluster infeasible.

    Parameters
    ----------
    bordered : (B, S + 1, K + 1)
        Log weights of pairs, with idle steps in the last column, idle elements in the last row and
        0 in the corner; the cost is exponential in K.
    least_assigned : (B,), optional
        Only hypotheses with at least so many pairs count.
    """
    batch, steps, elements = len(bordered), bordered.shape[1] - 1, bordered.shape[2] - 1
    room = max(1, CHUNK_ELEMENTS // memory_elements(steps, elements))
    if batch > room:
        chunks = [slice(first, first + room) for first in range(0, batch, room)]
        parts = [
            bordered_marginals(
                bordered[chunk], None if least_assigned is None else least_assigned[chunk]
            )
            for chunk in chunks
        ]
        return JointProbabilities(*(np.concatenate(part) for part in zip(*parts, strict=True)))

    taken = scale(bordered)
    np.exp(bordered, out=bordered)
    terminal = terminal_weights(bordered[:, steps], least_assigned)
    sums, total = sweep(bordered[:, :steps], terminal)
    feasible = total > 0.0
    if feasible.all():
        log_partition = np.log(total) + taken
    else:
        total = np.where(feasible, total, 1.0)
        log_partition = np.where(feasible, np.log(total) + taken, -np.inf)
        sums[~feasible] = 0.0
    marginals = sums[:, :, :elements]
    marginals /= total[:, None, None]
    return JointProbabilities(marginals, log_partition, feasible)


def hypothesis_count(n: int, m: int) -> int:
    """Number of joint hypotheses of n tracks and m measurements that all gate each other.

    The subset recursion with unit weights, in exact integers: f_i(S) then depends on the size s of
    S only, f_i(s) = f_{i-1}(s) + s f_{i-1}(s - 1). (Tchamova et al. 2004, table 14.1)

    Examples
    --------
    >>> hypothesis_count(10, 10)
    234662231
    """
    n, m = index(n), index(m)
    if n < 0 or m < 0:
        raise ValueError(f"n = {n}, m = {m}: allowed are integers >= 0")
    steps, elements = max(n, m), min(n, m)
    ways = [1] + [0] * elements
    for _ in range(steps):
        ways = [ways[s] + (s * ways[s - 1] if s else 0) for s in range(elements + 1)]
    return sum(math.comb(elements, s) * ways[s] for s in range(elements + 1))


def _bordered(
    log_weight: FloatArray, log_idle_track: FloatArray, log_idle_measurement: FloatArray
) -> FloatArray:
    """One array (B, n + 1, m + 1) as :func:`bordered_marginals` takes it; B = 1 without B."""
    n, m = log_weight.shape[-2:]
    bordered = np.zeros((*log_weight.shape[:-2], n + 1, m + 1))
    bordered[..., :n, :m] = log_weight
    bordered[..., :n, m] = log_idle_track
    bordered[..., n, :m] = log_idle_measurement
    return bordered.reshape(-1, n + 1, m + 1)


def _single(
    log_weight: ArrayLike, log_idle_track: ArrayLike, log_idle_measurement: ArrayLike
) -> JointProbabilities:
    weight = np.asarray(log_weight, dtype=np.float64)
    track = np.asarray(log_idle_track, dtype=np.float64)
    measurement = np.asarray(log_idle_measurement, dtype=np.float64)
    if weight.ndim != 2:
        raise ValueError(f"log_weight has shape {weight.shape}: allowed is (n, m)")
    n, m = weight.shape
    if track.shape != (n,):
        raise ValueError(f"log_idle_track has shape {track.shape}: allowed is ({n},)")
    if measurement.shape != (m,):
        raise ValueError(f"log_idle_measurement has shape {measurement.shape}: allowed is ({m},)")
    _check_values("log_weight", weight)
    _check_values("log_idle_track", track)
    _check_values("log_idle_measurement", measurement)
    if always_subsets(max(n, m), min(n, m), MAX_ELEMENTS):
        found = joint_marginals_batch(weight[None], track[None], measurement[None])
    else:
        found = _by_clusters(weight, track, measurement)
    if not found.feasible[0]:
        raise NoFeasibleHypothesis(
            f"every joint hypothesis of {n} tracks and {m} measurements has weight zero"
        )
    return found


def _by_clusters(
    weight: FloatArray, track: FloatArray, measurement: FloatArray
) -> JointProbabilities:
    """Answer the parts that share no gate one by one, each by the cheaper exact engine."""
    rows, columns = np.nonzero(weight > -np.inf)
    pair_cluster = find_clusters(
        rows.astype(np.int32), columns.astype(np.int32), *weight.shape
    ).pair_cluster
    marginals = np.zeros((1, *weight.shape))
    log_partition = (
        np.delete(track, np.unique(rows)).sum() + np.delete(measurement, np.unique(columns)).sum()
    )
    for cluster in range(pair_cluster.max(initial=-1) + 1):
        mine = pair_cluster == cluster
        tracks, row = np.unique(rows[mine], return_inverse=True)
        measurements, column = np.unique(columns[mine], return_inverse=True)
        part = _one_cluster(
            weight[np.ix_(tracks, measurements)],
            track[tracks],
            measurement[measurements],
            row,
            column,
        )
        marginals[0, rows[mine], columns[mine]] = part.marginals[0, row, column]
        log_partition += part.log_partition[0]
    feasible = log_partition > -np.inf
    return JointProbabilities(
        marginals if feasible else np.zeros_like(marginals),
        np.array([log_partition]),
        np.array([feasible]),
    )


def _one_cluster(
    weight: FloatArray, track: FloatArray, measurement: FloatArray, row: IntArray, column: IntArray
) -> JointProbabilities:
    n, m = weight.shape
    if m > n:
        turned = _one_cluster(weight.T, measurement, track, column, row)
        return turned._replace(marginals=turned.marginals.swapaxes(1, 2))
    engine, order = choose_engine(row, column, n, m, MAX_ELEMENTS)
    if engine == LOOPY_BELIEF_PROPAGATION:
        raise ClusterTooLarge(
            f"a cluster of {n} x {m} tracks and measurements: for exact marginals the smaller side "
            f"may have at most {MAX_ELEMENTS} unless the gates are sparse"
        )
    if order is None:
        return joint_marginals_batch(weight[None], track[None], measurement[None])
    answer = frontier_marginals(order, row, column, _bordered(weight, track, measurement))
    marginals = np.zeros((1, n, m))
    marginals[0, row, column] = answer.marginals[0]
    return JointProbabilities(marginals, answer.log_partition, answer.feasible)


def _check_values(name: str, values: FloatArray) -> None:
    allowed = np.abs(values) <= MAX_LOG_WEIGHT  # False for NaN
    if not allowed.all():
        allowed |= values == -np.inf
    if not allowed.all():
        raise ValueError(
            f"{name} holds {values[~allowed][0]}: allowed are -inf and finite values of magnitude "
            f"up to {MAX_LOG_WEIGHT:g}"
        )
