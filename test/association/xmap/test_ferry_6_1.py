"""The sample calculation of Ferry 2010, section 6.1, number by number."""

from __future__ import annotations

import numpy as np
import pytest

from gda_tracker.association.xmap.features import log_feature_density
from gda_tracker.association.xmap.object_density import log_object_density
from gda_tracker.association.xmap.partitions import clusters_of, enumerate_associations
from gda_tracker.association.xmap.positions import (
    association_sums,
    eliminate,
    eliminate_one,
)
from gda_tracker.association.xmap.problem import example, read_problem
from gda_tracker.association.xmap.scoring import position_terms
from gda_tracker.association.xmap.solution import solve

# {(1, 1, 1), (2, 2, -), (3, 3, 2)} of the paper.
PLAUSIBLE = np.array([[0, 1, 2, 0, 1, 2, 0, 2]])
TABLE_IV = {
    0.452373: [[0, 0, None], [1, 1, 0], [2, 2, 1]],
    0.226248: [[0, 1, None], [1, 0, 0], [2, 2, 1]],
    0.137136: [[0, 0, 0], [1, 1, None], [2, 2, 1]],
    0.0765394: [[None, 1, None], [0, None, None], [1, 0, 0], [2, 2, 1]],
    0.0375843: [[None, 0, 0], [0, None, None], [1, 1, None], [2, 2, 1]],
}


@pytest.fixture(scope="module")
def problem():
    return read_problem(example("ferry_6_1"))


def parts(problem):
    """Cluster terms of the uncentred positions, as the paper has them, in its order of clusters."""
    clusters = clusters_of(PLAUSIBLE, problem.model.sizes)
    order = np.argsort(clusters.members[:, 0])
    terms, layout, _ = position_terms(problem.model, problem.data, clusters, centre=False)
    return clusters, order, terms, layout


def digits(value, count):
    return float(f"{value:.{count}g}")


def test_table_iv_to_six_digits(problem):
    solution = solve(problem.model, problem.data)
    assert len(solution.probability) == 778
    for place, (printed, objects) in enumerate(TABLE_IV.items()):
        assert digits(solution.probability[place], 6) == printed
        labels = solution.labels[place]
        found = {tuple((labels == k).nonzero()[0].tolist()) for k in np.unique(labels)}
        first = problem.model.first
        assert found == {
            tuple(int(first[s] + i) for s, i in enumerate(row) if i is not None) for row in objects
        }


def test_printed_cluster_values(problem):
    _, order, terms, _ = parts(problem)
    np.testing.assert_allclose(terms.cost[order, 0], [-87.4344, -0.2445, -23.8285], atol=5.1e-5)
    means = terms.vector[:2, order, 0].T
    printed = [[-4.87067, 3.66306], [1.62393, -1.04784], [3.09849, -1.43294]]
    np.testing.assert_allclose(means, printed, atol=5.1e-6)
    # V_0 - W_alpha is the cluster's part of H.
    prior = problem.model.prior_covariance
    w = [
        [[0.32753, -0.08142], [-0.08142, 0.33302]],
        [[2.78935, -2.85439], [-2.85439, 3.67734]],
        [[0.36425, -0.08525], [-0.08525, 0.33942]],
    ]
    for place, printed_w in zip(order, w, strict=True):
        found = prior - np.array(
            [
                [terms.matrix[0][0, place, 0], terms.matrix[0][1, place, 0]],
                [terms.matrix[0][1, place, 0], terms.matrix[1][0, place, 0]],
            ]
        )
        np.testing.assert_allclose(found, printed_w, atol=5.1e-6)


def test_printed_sums_and_kappa(problem):
    clusters, _, terms, layout = parts(problem)
    matrix, vector = association_sums(clusters.incidence, terms, layout)
    h_matrix = [matrix[0][0, 0, 0], matrix[0][1, 0, 0], matrix[1][0, 0, 0]]
    np.testing.assert_allclose(h_matrix, [20.519, -23.979, 28.650], atol=5.1e-4)
    np.testing.assert_allclose(vector[:2, 0, 0], [-0.14826, 1.18228], atol=5.1e-6)
    for k in range(2):
        eliminate_one(matrix, vector, k, np.zeros((1, 1)))
    w_star = [
        [0.56727, 0.05332, -0.18105, -0.20300],
        [0.48860, -0.10474, -0.20623],
        [0.34568, 0.08847],
        [0.63862],
    ]
    for k, row in enumerate(w_star):
        np.testing.assert_allclose(matrix[2 + k][:, 0, 0], row, atol=5.1e-6)
    np.testing.assert_allclose(vector[2:, 0, 0], [-5.5339, -0.04816, -1.2648, -6.9713], rtol=1e-4)
    whole = eliminate(*association_sums(clusters.incidence, terms, layout))
    assert whole[0, 0] == pytest.approx(-248.613, abs=5e-4)
    g = np.exp(-0.5 * (whole[0, 0] + terms.cost.sum()))
    assert g == pytest.approx(1.58147e78, rel=1e-5)


def test_printed_feature_densities(problem):
    model, values = problem.model.feature, problem.data.features

    def density(measurements, kind=0):
        sensors = tuple(problem.model.sensor_of[measurements].tolist())
        return np.exp(log_feature_density(model, sensors, values[measurements], kind))

    printed = [0.0595787, 0.00999947, 0.0221195, 2.06241]
    for kind, value in enumerate(printed):
        assert digits(density([2, 5, 7], kind), 6) == value
    assert digits(density([2]), 6) == 0.134963
    assert digits(density([5]), 6) == 0.142603
    assert digits(density([7]), 6) == 0.0859596


def test_printed_object_densities(problem):
    members = np.array([[2, 2, 1], [-1, -1, 1], [2, -1, 1], [2, 2, -1]])
    density = np.exp(log_object_density(problem.model, problem.data, members))[:, 0]
    assert [digits(value, 6) for value in density] == [
        0.000883213,
        0.00598235,
        0.00281482,
        0.00241721,
    ]


def test_printed_ratios_and_q(problem):
    members = np.array([[0, 0, 0], [1, 1, -1], [2, 2, 1]])
    together = log_object_density(problem.model, problem.data, members)[:, 0]
    ratios = []
    for row, log_density in zip(members, together, strict=True):
        single = np.full((int((row >= 0).sum()), 3), -1)
        for k, sensor in enumerate((row >= 0).nonzero()[0]):
            single[k, sensor] = row[sensor]
        apart = log_object_density(problem.model, problem.data, single)[:, 0].sum()
        ratios.append(digits(np.exp(log_density - apart), 6))
    assert ratios == [107662.0, 4673.65, 548368.0]
    assert problem.model.undetected == pytest.approx(0.001945, rel=1e-14)


def test_number_of_clusters(problem):
    assert len(clusters_of(enumerate_associations((3, 3, 2)), (3, 3, 2)).members) == 47
