from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from gda_tracker.association.clustering import (
    FEW_CLUSTERS,
    MAX_PATTERN_PAIRS,
    find_clusters,
    gated_detections,
)

examples = settings(derandomize=True, deadline=None, max_examples=50)
gate_graphs = st.tuples(
    st.integers(1, 25), st.integers(1, 25), st.floats(0.0, 0.3), st.integers(0, 2**32)
)


def draw_pairs(h, n, share, seed):
    return np.nonzero(np.random.default_rng(seed).random((h, n)) < share)


def reference_labels(hypothesis, detection, h, n):
    """Cluster of each pair by scipy, numbered in the order of the first pair."""
    graph = coo_array((np.ones(len(hypothesis)), (hypothesis, detection + h)), shape=(h + n, h + n))
    _, label = connected_components(graph, directed=False)
    _, first, inverse = np.unique(label[hypothesis], return_index=True, return_inverse=True)
    return first.argsort().argsort()[inverse]


@examples
@given(gate_graphs, st.integers(1, 5))
def test_clusters_are_the_connected_components(drawn, padded_size):
    h, n, share, seed = drawn
    hypothesis, detection = draw_pairs(h, n, share, seed)
    clusters = find_clusters(
        hypothesis.astype(np.int32), detection.astype(np.int32), h, n, padded_size
    )
    expected = reference_labels(hypothesis, detection, h, n)
    np.testing.assert_array_equal(clusters.pair_cluster, expected)
    np.testing.assert_array_equal(clusters.pair_count, np.bincount(expected))


@examples
@given(gate_graphs, st.integers(1, 5))
def test_groups_hold_every_cluster_once_and_place_its_pairs(drawn, padded_size):
    h, n, share, seed = drawn
    hypothesis, detection = draw_pairs(h, n, share, seed)
    clusters = find_clusters(
        hypothesis.astype(np.int32), detection.astype(np.int32), h, n, padded_size
    )
    seen_clusters, seen_pairs = [], []
    for group in clusters.groups:
        seen_clusters += group.clusters.tolist()
        seen_pairs += group.pairs.tolist()
        slot, step, element = group.place
        np.testing.assert_array_equal(group.clusters[slot], clusters.pair_cluster[group.pairs])
        ends = np.sort(
            [group.steps[slot, step], group.elements[slot, element]], axis=0
        )  # hypotheses have the lower numbers
        np.testing.assert_array_equal(ends[0], hypothesis[group.pairs])
        np.testing.assert_array_equal(ends[1], detection[group.pairs] + h)
        for index, cluster in enumerate(group.clusters):
            mine = clusters.pair_cluster == cluster
            sides = [
                np.unique(hypothesis[mine]).tolist(),
                (np.unique(detection[mine]) + h).tolist(),
            ]
            steps = [node for node in group.steps[index].tolist() if node != h + n]
            elements = [node for node in group.elements[index].tolist() if node != h + n]
            assert sorted([steps, elements]) == sorted(sides)
            assert len(steps) == clusters.larger[cluster] >= clusters.smaller[cluster]
            assert len(elements) == clusters.smaller[cluster] == group.sizes[index]
            if group.shape[2] > padded_size:
                assert clusters.smaller[cluster] == group.shape[2]
        assert (group.steps[:, -1] == h + n).all()
    assert sorted(seen_clusters) == list(range(len(clusters)))
    assert sorted(seen_pairs) == list(range(len(hypothesis)))


def test_no_pairs():
    none = np.zeros(0, dtype=np.int32)
    clusters = find_clusters(none, none, 3, 0)
    assert len(clusters) == 0
    assert clusters.groups == ()


@examples
@given(gate_graphs)
def test_gated_detections_are_numbered_in_order(drawn):
    h, n, share, seed = drawn
    _, detection = draw_pairs(h, n, share, seed)
    gated, place = gated_detections(detection.astype(np.int32), n)
    np.testing.assert_array_equal(gated, np.unique(detection))
    np.testing.assert_array_equal(gated[place], detection)


def test_kept_patterns_do_not_mix():
    one = np.array([0, 1], dtype=np.int32), np.array([0, 0], dtype=np.int32)
    other = np.array([0, 1], dtype=np.int32), np.array([0, 1], dtype=np.int32)
    for _ in range(2):
        assert find_clusters(*one, 2, 2).pair_cluster.tolist() == [0, 0]
        assert find_clusters(*other, 2, 2).pair_cluster.tolist() == [0, 1]
        padding = [group.steps[0, -1] for group in find_clusters(*other, 3, 4).groups]
        assert padding == [7]
    assert find_clusters(*one, 2, 2) is find_clusters(*one, 2, 2)
    with pytest.raises(ValueError, match="read-only"):
        find_clusters(*one, 2, 2).pair_cluster[0] = 1


def test_large_patterns_are_not_kept():
    many = np.arange(MAX_PATTERN_PAIRS + 1, dtype=np.int32)
    first, second = (find_clusters(many, many, len(many), len(many)) for _ in range(2))
    assert first is not second
    np.testing.assert_array_equal(first.pair_cluster, second.pair_cluster)


def test_a_long_chain_is_one_cluster():
    # Worst case for labels that spread along pairs, in a shuffled order of detections.
    h = 2000
    shuffled = np.random.default_rng(1).permutation(h + 1)
    hypothesis = np.repeat(np.arange(h), 2)
    detection = shuffled[np.stack([np.arange(h), np.arange(h) + 1], axis=1).ravel()]
    clusters = find_clusters(hypothesis.astype(np.int32), detection.astype(np.int32), h, h + 1)
    assert len(clusters) == 1
    assert (clusters.larger[0], clusters.smaller[0]) == (h + 1, h)


@pytest.mark.parametrize("copies", [2, FEW_CLUSTERS + 1])
def test_small_clusters_of_different_shape_share_a_group(copies):
    # 1 x 2, 2 x 1 and 1 x 1, repeated.
    hypothesis, detection = [], []
    for copy in range(copies):
        hypothesis += [4 * copy, 4 * copy, 4 * copy + 1, 4 * copy + 2, 4 * copy + 3]
        detection += [4 * copy, 4 * copy + 1, 4 * copy + 2, 4 * copy + 2, 4 * copy + 3]
    clusters = find_clusters(
        np.array(hypothesis, dtype=np.int32),
        np.array(detection, dtype=np.int32),
        4 * copies,
        4 * copies,
    )
    assert len(clusters) == 3 * copies
    assert [group.shape for group in clusters.groups] == [(3 * copies, 2, 1)]


def test_part_of_a_group():
    hypothesis = np.array([0, 0, 1, 2, 2], dtype=np.int32)
    detection = np.array([0, 1, 2, 3, 4], dtype=np.int32)
    (group,) = find_clusters(hypothesis, detection, 3, 5).groups
    part = group.part(np.array([0, 2]))
    assert part.clusters.tolist() == [0, 2]
    assert part.pairs.tolist() == [0, 1, 3, 4]
    values = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    np.testing.assert_array_equal(part.dense(values, -1.0), group.dense(values, -1.0)[[0, 2]])
