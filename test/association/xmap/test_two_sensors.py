"""The adaptive threshold: against the exact probabilities and against all associations."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from xmap_references import random_covariance

from gda_tracker.association.xmap.two_sensors import (
    adaptive_threshold,
    best_association,
    estimated_object_count,
    estimated_prior_covariance,
    k_best_associations,
    pair_costs,
    region_volume,
)


def all_associations(costs):
    n, m = costs.shape
    found = []
    for partner in itertools.product(range(-1, m), repeat=n):
        used = [j for j in partner if j >= 0]
        if len(set(used)) == len(used):
            found.append((sum(costs[i, j] for i, j in enumerate(partner) if j >= 0), partner))
    return sorted(found)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 3), st.integers(0, 4), st.integers(0, 10**6), st.integers(1, 80))
def test_k_best_are_those_of_all(n, m, seed, k):
    costs = np.random.default_rng(seed).normal(size=(n, m)) * 3.0
    exact = all_associations(costs)[:k]
    found = k_best_associations(costs, k)
    assert len(found) == len(exact)
    np.testing.assert_allclose([cost for _, cost in found], [cost for cost, _ in exact], atol=1e-9)
    assert len({tuple(partner.tolist()) for partner, _ in found}) == len(found)
    partner, cost = best_association(costs)
    assert cost == pytest.approx(exact[0][0], abs=1e-9)
    assert tuple(partner.tolist()) == tuple(found[0][0].tolist())


def test_costs_are_likelihood_ratios_by_quadrature():
    """(3.10) with the integrals over the region that (3.12) takes for one."""
    first, second = np.array([[0.3]]), np.array([[-0.4]])
    v1, v2 = np.array([[[0.5]]]), np.array([[[0.8]]])
    half, nu, p1, p2 = 50.0, 3.0, 0.9, 0.7
    x = np.linspace(-half, half, 200_001)
    step = x[1] - x[0]

    def density(y, v):
        return np.exp(-0.5 * (y - x) ** 2 / v) / math.sqrt(2 * math.pi * v)

    uniform = 1.0 / (2 * half)
    together = nu * p1 * p2 * (uniform * density(0.3, 0.5) * density(-0.4, 0.8)).sum() * step
    alone = nu * p1 * (1 - p2) * (uniform * density(0.3, 0.5)).sum() * step
    alone *= nu * p2 * (1 - p1) * (uniform * density(-0.4, 0.8)).sum() * step
    threshold = adaptive_threshold(v1, v2, 2 * half, nu * (1 - p1) * (1 - p2))
    cost = pair_costs(first, v1, second, v2, threshold)
    assert cost[0, 0] == pytest.approx(-2.0 * math.log(together / alone), rel=1e-6)


def test_threshold_follows_the_covariances_and_stays_finite():
    v1 = np.stack([np.eye(2), np.eye(2) * 100.0])
    plain = adaptive_threshold(v1, v1, 1e4, 0.1, robust=False)
    assert plain[0, 0] > plain[0, 1] > plain[1, 1]
    robust = adaptive_threshold(v1 * 1e9, v1, 1e4, 0.1)
    assert np.all(robust == -2.0 * math.log(0.1))  # (3.14): uncertainty is limited to the region


@pytest.mark.parametrize(("dimension", "theta"), [(1, 6 / math.pi), (2, 2.0), (3, 2.0678)])
def test_volume_of_the_region(dimension, theta):
    covariance = np.eye(dimension) * 4.0
    volume = (2 * math.pi * theta * 4.0) ** (dimension / 2)
    assert region_volume(covariance, dimension) == pytest.approx(volume, rel=1e-4)


def test_an_interval_has_the_length_that_its_covariance_says():
    # Uniform on a length L: variance L^2 / 12.
    assert region_volume(np.array([[25.0 / 12.0]]), 1) == pytest.approx(5.0)


def test_estimates():
    rng = np.random.default_rng(1)
    positions = rng.normal(size=(9, 2))
    sensor = np.repeat([0, 1], [4, 5])
    moved = positions + np.where(sensor[:, None] == 1, 100.0, 0.0)  # biases do not matter
    found = estimated_prior_covariance(moved, sensor)
    np.testing.assert_allclose(found, estimated_prior_covariance(positions, sensor), atol=1e-10)
    pooled = 3 * np.cov(positions[:4].T) + 4 * np.cov(positions[4:].T)
    np.testing.assert_allclose(found, pooled / 7, atol=1e-10)
    assert estimated_object_count(np.array([4, 5]), np.array([0.9, 0.6])) == pytest.approx(6.0)
    with pytest.raises(ValueError, match="too few or too regular"):
        estimated_prior_covariance(positions[:3], np.array([0, 0, 1]))
    with pytest.raises(ValueError, match="too few or too regular"):
        estimated_prior_covariance(np.outer(np.arange(9.0), [1.0, 2.0]), sensor)


def test_many_measurements_by_assignment():
    rng = np.random.default_rng(2)
    objects = rng.uniform(0.0, 1000.0, (40, 2))
    v1 = np.stack([random_covariance(rng, 2, 3.0) for _ in range(40)])
    v2 = np.stack([random_covariance(rng, 2, 3.0) for _ in range(30)])
    first = objects + np.stack([rng.multivariate_normal(np.zeros(2), v) for v in v1])
    second = objects[:30] + np.stack([rng.multivariate_normal(np.zeros(2), v) for v in v2])
    threshold = adaptive_threshold(v1, v2, 1e6, 40 * 0.1 * 0.25)
    costs = pair_costs(first, v1, second, v2, threshold)
    partner, cost = best_association(costs)
    assert (partner[:30] == np.arange(30)).mean() > 0.9
    ranked = k_best_associations(costs, 20)
    assert ranked[0][1] == pytest.approx(cost)
    assert np.all(np.diff([value for _, value in ranked]) >= -1e-9)
