"""Likelihoods of 1..N objects: brute force, permanents, integrals, simulated detections."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom, poisson

from gda_tracker.association.joint import joint_log_partition
from gda_tracker.association.unresolved import resolution_hypotheses
from gda_tracker.formations.likelihood import (
    cardinality,
    cluster_log_ratio,
    expected_number,
    log_number_ratios,
    log_symmetric_polynomials,
)
from gda_tracker.formations.resolution import (
    MOST_OBJECTS,
    detection_counts,
    group_probabilities,
)

RESOLVED = np.full((1, 2), np.inf)


def counts(detection_probability, ratio=RESOLVED, most=5):
    ratio = np.asarray(ratio)
    seen = np.broadcast_to(detection_probability, (len(ratio),)).astype(float)
    return detection_counts(seen, group_probabilities(ratio, most))


def test_worked_values_of_koch_4_11_to_4_13():
    ratio = np.log([[1.0, 2.0, 5.0]])
    assert math.isclose(cluster_log_ratio(ratio)[0], math.log(8.0 / 3.0))
    np.testing.assert_allclose(cardinality(ratio), [[0.125, 0.25, 0.625]])
    assert math.isclose(expected_number(cardinality(ratio))[0], 2.5)


@given(st.lists(st.floats(-20.0, 20.0), max_size=6))
def test_symmetric_polynomials_are_sums_over_subsets(log_values):
    values = np.exp(log_values)
    expected = [
        sum(math.prod(chosen) for chosen in itertools.combinations(values, k)) for k in range(5)
    ]
    found = np.exp(log_symmetric_polynomials(np.array([log_values]).reshape(1, -1), 4)[0])
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize("n", range(1, 6))
def test_resolved_objects_have_the_partition_function_of_the_joint_engine(n):
    log_ratio = np.random.default_rng(n).normal(2.0, 2.0, 4)
    p_d = 0.8
    found = log_number_ratios(counts(p_d), log_ratio[None])[0, n - 1]
    weight = np.tile(math.log(p_d) + log_ratio, (n, 1))
    expected = joint_log_partition(weight, np.full(n, math.log(1.0 - p_d)), np.zeros(4))
    assert math.isclose(found, expected, rel_tol=1e-12)


def test_unresolved_objects_have_the_sum_over_groupings_and_assignments():
    # Groups of three objects by the polynomials of the joint engine's module, in expectation.
    tau, p_d = np.array([0.7, 2.0]), 0.9
    log_ratio = np.array([1.0, -0.5, 3.0])
    expected = 0.0
    for parts, polynomial in resolution_hypotheses(3).items():
        chance = sum(
            coefficient * mean_of_links(edges, tau) for edges, coefficient in polynomial.items()
        )
        weight = np.tile(math.log(p_d) + log_ratio, (len(parts), 1))
        idle = np.full(len(parts), math.log(1.0 - p_d))
        expected += chance * math.exp(joint_log_partition(weight, idle, np.zeros(3)))
    found = log_number_ratios(counts(p_d, tau[None]), log_ratio[None])[0, 2]
    assert math.isclose(found, math.log(expected), rel_tol=1e-12)


def mean_of_links(edges, tau):
    """E prod exp(-d^2 / 2) of normal positions, by the determinant of one axis after the other."""
    laplacian = np.zeros((3, 3))
    for a, b in edges:
        step = np.eye(3)[a] - np.eye(3)[b]
        laplacian += np.outer(step, step)
    return math.prod(np.linalg.det(np.eye(3) + t * laplacian) ** -0.5 for t in tau)


@pytest.mark.parametrize("n", [2, 4, MOST_OBJECTS])
def test_groups_are_those_of_simulated_positions(n):
    runs, tau = 20_000, np.array([3.0, 0.5])
    generator = np.random.default_rng(n)
    place = generator.normal(size=(runs, n, 2)) * np.sqrt(tau)
    gap = place[:, :, None] - place[:, None]
    linked = generator.random((runs, n, n)) < np.exp(-0.5 * (gap**2).sum(axis=3))
    linked = np.triu(linked, 1)
    reach = linked | linked.swapaxes(1, 2) | np.eye(n, dtype=bool)
    for _ in range(3):
        reach = (reach.astype(np.uint8) @ reach.astype(np.uint8)) > 0
    # As many groups as objects that no lower one reaches.
    lowest = ~np.triu(reach.swapaxes(1, 2), 1).any(axis=1)
    observed = np.bincount(lowest.sum(axis=1), minlength=n + 1) / runs
    expected = group_probabilities(tau[None], n)[0, n]
    assert math.isclose(expected.sum(), 1.0)
    error = 4.0 * np.sqrt(expected * (1.0 - expected) / runs) + 1e-9
    assert (np.abs(observed - expected) <= error).all()


def test_too_many_objects_for_the_graphs_are_refused():
    with pytest.raises(ValueError, match="7 objects with a limited resolution: allowed are 6"):
        group_probabilities(np.ones((1, 2)), 7)
    assert group_probabilities(RESOLVED, 9).shape == (1, 10, 10)


@given(st.floats(0.05, 0.99), st.floats(0.01, 50.0), st.floats(0.01, 50.0))
def test_counts_are_probabilities_and_fall_with_the_resolution(p_d, first, second):
    found = counts(p_d, [[first, second]])[0]
    np.testing.assert_allclose(found.sum(axis=1), 1.0)
    mean, resolved = found @ np.arange(6), counts(p_d)[0] @ np.arange(6)
    assert (mean <= resolved + 1e-12).all()


@pytest.mark.parametrize("ratio", [RESOLVED, [[1.5, 0.2]]])
def test_the_likelihood_integrates_to_one(ratio):
    # One dimension, objects N(0, 1), clutter uniform on [-5, 5]; sum over m.
    # e_k is additive: its mean over m independent false detections is C(m, k) E[f / rho]^k.
    rho = 0.3
    found = counts(0.8, ratio)
    total = np.zeros(5)
    mass = math.erf(5.0 / math.sqrt(2.0))
    for m in range(40):
        mean = np.full((1, m), math.log(mass / (10.0 * rho)))
        total += poisson.pmf(m, 10.0 * rho) * np.exp(log_number_ratios(found, mean)[0])
    np.testing.assert_allclose(total, 1.0, atol=1e-4)


def test_uniform_objects_have_the_likelihood_of_the_number_of_detections():
    p_d, false = 0.7, 1.3
    for m in range(8):
        ratio = log_number_ratios(counts(p_d), np.full((1, m), -math.log(false)))[0]
        for n in range(1, 6):
            sums = sum(binom.pmf(k, n, p_d) * poisson.pmf(m - k, false) for k in range(m + 1))
            expected = math.log(sums / poisson.pmf(m, false))
            assert math.isclose(ratio[n - 1], expected, rel_tol=1e-9, abs_tol=1e-9)


def test_ratios_have_mean_one_where_the_other_number_is_true():
    # E[LR_i / LR_j | j] = 1 by simulated scans of objects in places that are draws, with clutter.
    generator = np.random.default_rng(3)
    runs, p_d, rho, tau = 20_000, 0.6, 0.2, np.array([[1.0, 1.0]])
    found = counts(p_d, tau, 3)
    log_ratio = np.full((runs, 12), -np.inf)
    k = generator.choice(4, size=runs, p=found[0, 2])
    false = np.minimum(generator.poisson(10.0 * rho, runs), 9)
    place = np.where(
        np.arange(12) < k[:, None],
        generator.normal(size=(runs, 12)),
        generator.uniform(-5.0, 5.0, (runs, 12)),
    )
    there = np.arange(12) < (k + false)[:, None]
    value = -0.5 * place**2 - 0.5 * math.log(2.0 * math.pi) - math.log(rho)
    log_ratio[there] = value[there]
    ratio = log_number_ratios(np.repeat(found, runs, axis=0), log_ratio)
    for other in (0, 2):
        mean = np.exp(ratio[:, other] - ratio[:, 1])
        assert abs(mean.mean() - 1.0) < 4.0 * mean.std() / math.sqrt(runs)
