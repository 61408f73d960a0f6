"""Associations as arrays: counted, all different, all there."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.association.xmap.partitions import (
    association_count,
    canonical,
    clusters_of,
    enumerate_associations,
)


def brute_force(sizes):
    """All labellings in which no sensor has a label twice, by trying every one."""
    sensor = np.repeat(np.arange(len(sizes)), sizes)
    total = len(sensor)
    found = set()
    for labels in itertools.product(range(total), repeat=total):
        if len({(s, k) for s, k in zip(sensor.tolist(), labels, strict=True)}) == total:
            found.add(tuple(canonical(np.array([labels]))[0].tolist()))
    return found


@pytest.mark.parametrize("sizes", [(2, 2), (1, 1, 1), (3, 2), (2, 1, 2), (1, 1, 1, 1, 1), (0, 2)])
def test_all_associations(sizes):
    labels = enumerate_associations(sizes)
    assert set(map(tuple, labels.tolist())) == brute_force(sizes)
    assert len(labels) == association_count(sizes)
    assert labels[0].tolist() == list(range(sum(sizes)))


@settings(max_examples=30, deadline=None)
@given(st.lists(st.integers(0, 4), min_size=1, max_size=4))
def test_counts_are_numbers_of_different_rows(sizes):
    if association_count(sizes) > 20_000:
        sizes = sizes[:2]
    labels = enumerate_associations(sizes)
    assert len(np.unique(labels, axis=0)) == len(labels) == association_count(sizes)
    np.testing.assert_array_equal(canonical(labels), labels)


def test_known_counts():
    assert association_count((3, 3, 2)) == 778
    assert association_count((1,) * 5) == 52  # Bell number
    assert association_count((10, 10)) == 234662231  # Table 14.1 of the 2004 chapter


@pytest.mark.parametrize("table", [1 << 22, 1])
def test_clusters_put_together_are_the_associations(table, monkeypatch):
    monkeypatch.setattr("gda_tracker.association.xmap.partitions.LARGEST_TABLE", table)
    sizes = (2, 0, 3, 1)
    labels = enumerate_associations(sizes)
    clusters = clusters_of(labels, sizes)
    flags = clusters.flags(sizes)
    assert len(np.unique(clusters.members, axis=0)) == len(clusters.members)
    dense = clusters.incidence.toarray()
    for row, share in zip(labels, dense, strict=True):
        mine = flags[share > 0]
        np.testing.assert_array_equal(mine.sum(axis=0), np.ones(6))
        together = (mine.T @ mine) > 0
        np.testing.assert_array_equal(together, row[:, None] == row)


def test_too_many_clusters_are_refused():
    with pytest.raises(ValueError, match="allowed is less than"):
        clusters_of(np.zeros((1, 12 * 20), dtype=np.int64), (12,) * 20)
