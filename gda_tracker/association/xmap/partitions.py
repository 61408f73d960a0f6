"""Associations as arrays: counted, enumerated, and the clusters that they are made of.

An association is a row of labels (M,), one per measurement of all sensors together: measurements
with the same label come from the same object, at most one per sensor. Labels are numbered by first
appearance, so equal associations are equal rows. A cluster is a row (r,): the index of the
measurement of each sensor, -1 for none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import combinations, permutations
from typing import NamedTuple

import numpy as np
import scipy.sparse

from gda_tracker.vocabulary.arrays import FloatArray, IntArray

MAX_CODES = 2**62
LARGEST_TABLE = 1 << 22


def association_count(sizes: Sequence[int]) -> int:
    """Number of associations of sensors with these numbers of measurements.

    >>> association_count((3, 3, 2))
    778
    """
    ways = {0: 1}
    for size in sizes:
        grown: dict[int, int] = {}
        for objects, count in ways.items():
            for shared in range(min(objects, size) + 1):
                pairings = math.comb(objects, shared) * math.perm(size, shared)
                key = objects + size - shared
                grown[key] = grown.get(key, 0) + count * pairings
        ways = grown
    return sum(ways.values())


def enumerate_associations(sizes: Sequence[int]) -> IntArray:
    """(A, M) labels of all associations; the first has an object per measurement."""
    labels = np.zeros((1, 0), dtype=np.int64)
    for size in sizes:
        objects = labels.max(axis=1, initial=-1) + 1
        grown = []
        for count in np.unique(objects).tolist():
            rows, added = labels[objects == count], _additions(count, size)
            grown.append(
                np.concatenate(
                    [np.repeat(rows, len(added), axis=0), np.tile(added, (len(rows), 1))], axis=1
                )
            )
        labels = np.concatenate(grown)
    # Most objects first: the null association leads.
    return labels[np.argsort(-labels.max(axis=1, initial=-1), kind="stable")]


@lru_cache(maxsize=64)
def _additions(objects: int, size: int) -> IntArray:
    """(X, size) labels that a sensor's measurements may take beside so many objects."""
    found = []
    for shared in range(min(objects, size) + 1):
        for chosen in combinations(range(size), shared):
            new = np.arange(objects, objects + size)
            rest = [i for i in range(size) if i not in chosen]
            new[rest] = np.arange(objects, objects + size - shared)
            partners = np.array(list(permutations(range(objects), shared)), dtype=np.int64)
            rows = np.tile(new, (len(partners), 1))
            rows[:, list(chosen)] = partners.reshape(len(partners), shared)
            found.append(rows)
    return np.concatenate(found)


def canonical(labels: IntArray) -> IntArray:
    """Labels (..., M) numbered by first appearance."""
    if labels.shape[-1] == 0:
        return labels
    flat = labels.reshape(-1, labels.shape[-1])
    same = flat[:, :, None] == flat[:, None, :]
    first = same.argmax(axis=2)
    opens = first == np.arange(flat.shape[1])
    number = np.cumsum(opens, axis=1) - 1
    return np.asarray(np.take_along_axis(number, first, axis=1).reshape(labels.shape))


class Clusters(NamedTuple):
    """The different clusters of some associations.

    Attributes
    ----------
    members : (C, r)
        Index of the measurement of each sensor, -1 for none.
    incidence : sparse (A, C)
        One where the association has the cluster.
    """

    members: IntArray
    incidence: scipy.sparse.csr_matrix

    def flags(self, sizes: Sequence[int]) -> FloatArray:
        """(C, M) one where the cluster has the measurement."""
        flags = np.zeros((len(self.members), sum(sizes)))
        first = np.cumsum([0, *sizes[:-1]])
        row, sensor = (self.members >= 0).nonzero()
        flags[row, first[sensor] + self.members[row, sensor]] = 1.0
        return flags


def clusters_of(labels: IntArray, sizes: Sequence[int]) -> Clusters:
    """Find the different clusters of associations with labels (A, M).

    Raises
    ------
    ValueError
        If there may be more clusters than 64-bit numbers.
    """
    strides = np.cumprod([1, *(size + 1 for size in sizes)], dtype=object)
    if strides[-1] >= MAX_CODES:
        raise ValueError(
            f"sizes = {tuple(sizes)}: the product of (size + 1) is {float(strides[-1]):.3g}; "
            f"allowed is less than {MAX_CODES:.3g}"
        )
    stride = strides[:-1].astype(np.int64)
    n_associations, n_measurements = labels.shape
    code = np.zeros((n_associations, n_measurements), dtype=np.int64)
    row = np.arange(n_associations)
    place = 0
    for sensor, size in enumerate(sizes):
        for index in range(size):
            code[row, labels[:, place]] += (index + 1) * stride[sensor]
            place += 1
    row, column = code.nonzero()
    used = code[row, column]
    if strides[-1] <= LARGEST_TABLE:
        seen = np.zeros(int(strides[-1]), dtype=np.bool_)
        seen[used] = True
        codes = seen.nonzero()[0]
        number = np.cumsum(seen)[used] - 1
    else:
        codes, number = np.unique(used, return_inverse=True)
    members = codes[:, None] // stride % (np.array(sizes) + 1) - 1
    starts = np.concatenate([[0], np.cumsum((code > 0).sum(axis=1))])
    incidence = scipy.sparse.csr_matrix(
        (np.ones(len(number)), number, starts), shape=(n_associations, len(codes))
    )
    return Clusters(members, incidence)
