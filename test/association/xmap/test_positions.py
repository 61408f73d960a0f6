"""Theorem 4.3 against Theorem 4.2 and against the joint covariance of all positions."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse
from xmap_references import marginal_cost, random_covariance, random_scene, theorem_4_2

from gda_tracker.association.xmap.partitions import clusters_of, enumerate_associations
from gda_tracker.association.xmap.positions import (
    association_costs,
    bias_layout,
    cluster_terms,
    inverses,
)
from gda_tracker.association.xmap.scoring import position_terms

SIZES = [(2, 2), (3, 2), (2, 1, 2), (1, 2, 1, 2), (1, 1, 2, 1, 1)]


def costs(model, data, labels, centre=True):
    clusters = clusters_of(labels, model.sizes)
    terms, layout, _ = position_terms(model, data, clusters, centre)
    return association_costs(clusters.incidence, terms, layout)[:, 0]


def some(rng, labels, most=25):
    kept = rng.permutation(len(labels))[: most - 1]
    return labels[np.append(0, kept)]


def relative(values):
    """Differences to the null association, in units of the largest."""
    return np.asarray(values) - values[0]


@pytest.mark.parametrize("sizes", SIZES)
@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_finite_biases_as_theorem_4_2_and_the_joint_covariance(sizes, dimension):
    rng = np.random.default_rng([len(sizes), dimension])
    biases = [random_covariance(rng, dimension, 2.0) for _ in sizes]
    model, data = random_scene(rng, sizes, biases, dimension)
    labels = some(rng, enumerate_associations(sizes))
    ours = relative(costs(model, data, labels))
    blocks = relative([theorem_4_2(model, data, row) for row in labels])
    joint = relative([marginal_cost(model, data, row) for row in labels])
    np.testing.assert_allclose(ours, joint, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(blocks, joint, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("sizes", SIZES)
@pytest.mark.parametrize("kinds", ["diffuse", "one finite", "mixed", "unbiased", "mixed unbiased"])
def test_diffuse_and_absent_biases_as_the_joint_covariance(sizes, kinds):
    rng = np.random.default_rng([len(sizes), len(kinds)])
    finite = [random_covariance(rng, 2, 2.0) for _ in sizes]
    biases = {
        "diffuse": [None] * len(sizes),
        "one finite": [finite[0]] + [None] * (len(sizes) - 1),
        "mixed": [None if s == 1 else b for s, b in enumerate(finite)],
        "unbiased": [np.zeros((2, 2))] * len(sizes),
        "mixed unbiased": [np.zeros((2, 2)), *finite[1:-1], None],
    }[kinds]
    model, data = random_scene(rng, sizes, biases)
    labels = some(rng, enumerate_associations(sizes))
    ours = relative(costs(model, data, labels))
    joint = relative([marginal_cost(model, data, row) for row in labels])
    np.testing.assert_allclose(ours, joint, rtol=1e-9, atol=1e-9)


def test_a_wide_finite_bias_is_the_diffuse_one_without_loss_of_digits():
    rng = np.random.default_rng(3)
    model, data = random_scene(rng, (2, 2, 2), [None] * 3)
    labels = enumerate_associations(model.sizes)
    diffuse = relative(costs(model, data, labels))
    wide = type(model)(**{**vars(model), "bias_covariances": (np.eye(2) * 1e13,) * 3})
    np.testing.assert_allclose(relative(costs(wide, data, labels)), diffuse, rtol=1e-9, atol=1e-9)


def test_two_finite_biases_are_one_relative_bias():
    rng = np.random.default_rng(4)
    first, second = random_covariance(rng, 2, 1.0), random_covariance(rng, 2, 5.0)
    layout = bias_layout([first, second], (2, 3), 2)
    np.testing.assert_allclose(layout.prior_precision, np.linalg.inv(first + second), rtol=1e-12)
    assert not bias_layout([first, None, None], (1, 1, 1), 2).prior_precision.any()
    assert not bias_layout([None, None], (1, 1), 2).prior_precision.any()


def test_large_coordinates_cost_no_digits():
    rng = np.random.default_rng(5)
    model, data = random_scene(rng, (3, 2, 2), [None, np.eye(2), np.eye(2) * 4.0])
    labels = enumerate_associations(model.sizes)
    far = type(data)(data.positions + 2.0**22, data.covariances, data.calls)  # 4,000 km
    near = relative(costs(model, data, labels))
    np.testing.assert_allclose(relative(costs(model, far, labels)), near, rtol=1e-8, atol=1e-8)


def test_positions_of_a_scene_do_not_depend_on_the_others_of_the_batch():
    rng = np.random.default_rng(6)
    scenes = [random_scene(rng, (2, 2, 1), [None] * 3) for _ in range(5)]
    model = scenes[0][0]
    labels = enumerate_associations(model.sizes)
    clusters = clusters_of(labels, model.sizes)
    batch = type(scenes[0][1])(
        *(
            np.stack([getattr(data, name) for _, data in scenes], axis=1)
            for name in ("positions", "covariances", "calls")
        ),
        np.full((5, 5), np.nan),
    )
    terms, layout, _ = position_terms(model, batch, clusters)
    together = association_costs(clusters.incidence, terms, layout)
    for k, (_, data) in enumerate(scenes):
        np.testing.assert_allclose(together[:, k], costs(model, data, labels), rtol=1e-10)


def test_dense_and_sparse_sums_agree(monkeypatch):
    rng = np.random.default_rng(7)
    model, data = random_scene(rng, (3, 3), [None, np.eye(2)])
    labels = enumerate_associations(model.sizes)
    dense = costs(model, data, labels)
    monkeypatch.setattr("gda_tracker.association.xmap.positions.DENSE_CLUSTERS", 0)
    np.testing.assert_allclose(costs(model, data, labels), dense, rtol=1e-12)


def test_wide_measurements_leave_no_negative_pivot():
    """V_0 - W is taken in closed form: with V >> V_0 nothing cancels."""
    flags = np.eye(2)
    terms = cluster_terms(
        flags,
        inverses(np.stack([np.eye(2), np.eye(2)])[:, None] * 1e18),
        np.array([[1.0, 2.0], [3.0, 4.0]])[:, None],
        np.array([-1, -1]),
        np.eye(2),
    )
    layout = bias_layout([np.zeros((2, 2))] * 2, (1, 1), 2)
    cost = association_costs(scipy.sparse.csr_matrix(np.ones((1, 2))), terms, layout)
    # H = 2 V_0 (V_0 + V)^-1 V_0 = 2e-18 I, so log|H| = 2 log 2e-18, and the rest is nearly 0.
    assert cost[0, 0] == pytest.approx(2 * np.log(2e-18), rel=1e-12)
