"""JPDA*: marginals without the permutations that make tracks coalesce.

Of all joint hypotheses that detect the same tracks D and use the same measurements U, only the
heaviest counts (Blom & Bloem 2000, "Probabilistic data association avoiding track coalescence").
The others permute the measurements among the tracks, and a mean over permutations draws tracks
that are close to each other together.

The best permutation v(D, U) follows from smaller ones, v(D, U) = max over j in U of
w_ij v(D without i, U without j) with i the last of D, so all pairs (D, U), binomial(n + m, n) of
them, are worked off by size. Logarithms throughout: nothing overflows or underflows.
"""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import combinations
from typing import NamedTuple

import numpy as np

from gda_tracker.association.assignment import LOG_VANISHING
from gda_tracker.association.choices import BEST_PERMUTATIONS, ENGINES
from gda_tracker.association.clustering import Clusters
from gda_tracker.association.weightings import JointWeights
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array, IntArray

MAX_PATTERNS = 200_000
"""Largest number of pairs (D, U) of a cluster: 10 x 10, or 5 x 33, are below it."""

CHUNK_ELEMENTS = 4_000_000
"""Doubles one pass of a batch may hold, roughly."""


def pattern_count(n: int, m: int) -> int:
    """Number of pairs (D, U) of n tracks and m measurements."""
    return math.comb(n + m, n)


def best_permutation_marginals(
    log_weight: FloatArray, log_idle_track: FloatArray, log_idle_measurement: FloatArray
) -> FloatArray:
    """Marginals (B, n, m) of B clusters over the best permutation of each (D, U).

    Idle weights of zero are taken as the limit of vanishing ones. Of permutations of the same
    weight one counts.

    Parameters
    ----------
    log_weight : (B, n, m)
        log w_ij, -inf outside the gate.
    log_idle_track : (B, n)
        log r_i.
    log_idle_measurement : (B, m)
        log c_j.
    """
    batch, n, m = log_weight.shape
    room = max(1, CHUNK_ELEMENTS // (3 * pattern_count(n, m)))
    if batch > room:
        cuts = range(0, batch, room)
        return np.concatenate(
            [
                best_permutation_marginals(
                    log_weight[cut : cut + room],
                    log_idle_track[cut : cut + room],
                    log_idle_measurement[cut : cut + room],
                )
                for cut in cuts
            ]
        )
    idle_track = np.maximum(log_idle_track, LOG_VANISHING)
    idle_measurement = np.maximum(log_idle_measurement, LOG_VANISHING)

    # v by size, the measurement that the last of D has, and the weight of the whole hypothesis.
    sizes = min(n, m) + 1
    value = np.zeros((batch, 1, 1))
    taken: list[IntArray] = []
    log_total = []
    for size in range(sizes):
        tracks, measurements = _subsets(n, size), _subsets(m, size)
        if size:
            ways = (
                log_weight[:, tracks.last[:, None, None], measurements.members[None]]
                + value[:, tracks.without_last[:, None, None], measurements.without[None]]
            )
            taken.append(ways.argmax(axis=3))
            value = ways.max(axis=3)
        idle = (idle_track @ tracks.absent.T)[:, :, None]
        log_total.append(value + idle + (idle_measurement @ measurements.absent.T)[:, None])
    heaviest = np.max([part.max(axis=(1, 2)) for part in log_total], axis=0)
    weight = [np.exp(part - heaviest[:, None, None]) for part in log_total]
    total = np.sum([part.sum(axis=(1, 2)) for part in weight], axis=0)

    # Back from the largest: what a hypothesis weighs passes to the pair of its last track and on.
    marginals = np.zeros((batch, n, m))
    cluster = np.arange(batch)[:, None, None]
    passing = weight[-1]
    for size in range(sizes - 1, 0, -1):
        tracks, measurements = _subsets(n, size), _subsets(m, size)
        row = np.arange(len(measurements.members))
        chosen = taken[size - 1]
        detection = measurements.members[row, chosen]
        place = (cluster, tracks.last[:, None], detection)
        np.add.at(marginals, tuple(np.broadcast_arrays(*place)), passing)
        further = weight[size - 1]
        place = (cluster, tracks.without_last[:, None], measurements.without[row, chosen])
        np.add.at(further, tuple(np.broadcast_arrays(*place)), passing)
        passing = further
    marginals /= total[:, None, None]
    return marginals


def without_permutations(
    clusters: Clusters, weights: JointWeights, marginals: FloatArray, engine: Int32Array
) -> tuple[FloatArray, Int32Array]:
    """Replace the marginals (P,) of all pairs, where the cluster is small enough, by JPDA*'s.

    Clusters with a smaller side of 1 have no permutations and stay as they are. So do those with
    more than ``MAX_PATTERNS`` pairs (D, U); ``engine`` (G,) then still names theirs.

    Returns
    -------
    marginals, engine
        New arrays.
    """
    marginals, engine = marginals.copy(), engine.copy()
    for group in clusters.groups:
        larger, smaller = clusters.larger[group.clusters], group.sizes
        log_weight: FloatArray | None = None
        for n, m in np.unique(np.stack([larger, smaller], axis=1), axis=0).tolist():
            if m == 1 or pattern_count(n, m) > MAX_PATTERNS:
                continue
            if log_weight is None:
                log_weight = group.dense(weights.log_pair, -np.inf)
            alike = (larger == n) & (smaller == m)
            found = np.zeros(group.shape)
            found[alike, :n, :m] = best_permutation_marginals(
                log_weight[alike, :n, :m],
                weights.log_idle[group.steps[alike, :n]],
                weights.log_idle[group.elements[alike, :m]],
            )
            mine = alike[group.place[0]]
            marginals[group.pairs[mine]] = found[group.place][mine]
            engine[group.clusters[alike]] = ENGINES.index(BEST_PERMUTATIONS)
    return marginals, engine


class _Subsets(NamedTuple):
    """The subsets of one size k of n things, X of them, in lexicographic order.

    ``members`` (X, k); ``without`` (X, k) is the subset of size k - 1 without each member;
    ``last`` (X,) the last member and ``without_last`` (X,) the subset without it; ``absent``
    (X, n) is 1 for what is not in the subset.
    """

    members: IntArray
    without: IntArray
    last: IntArray
    without_last: IntArray
    absent: FloatArray


@lru_cache(maxsize=256)
def _subsets(n: int, size: int) -> _Subsets:
    members = np.array(list(combinations(range(n), size)), dtype=np.int64)
    members = members.reshape(math.comb(n, size), size)
    absent = np.ones((len(members), n))
    np.put_along_axis(absent, members, 0.0, axis=1)
    without = np.zeros((len(members), size), dtype=np.int64)
    if size:
        number = {subset: k for k, subset in enumerate(combinations(range(n), size - 1))}
        without[:] = [
            [number[(*subset[:k], *subset[k + 1 :])] for k in range(size)]
            for subset in map(tuple, members.tolist())
        ]
        last, without_last = members[:, -1], without[:, -1]
    else:
        last = without_last = np.zeros(0, dtype=np.int64)
    found = _Subsets(members, without, last, without_last, absent)
    for array in found:
        array.setflags(write=False)
    return found
