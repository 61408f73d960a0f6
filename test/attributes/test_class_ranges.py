"""Ranges as likelihoods: worked values, brute force, quadrature, Monte Carlo, properties."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import logsumexp

from gda_tracker.attributes.class_ranges import areas, log_density, log_possibility, mean_grade

CORNERS = np.array(
    [
        [0.0, 0.0, 80.0, 100.0],
        [70.0, 100.0, 500.0, 600.0],
        [50.0, 50.0, 120.0, 120.0],
        [0.0, 40.0, 40.0, 80.0],
    ]
)
numbers = st.floats(0.0, 700.0)
deviations = st.floats(0.1, 60.0)


def grade(value, corners):
    """The trapezoids themselves, (n, K)."""
    a, b, c, d = corners.T
    r = value[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        up, down = (r - a) / (b - a), (d - r) / (d - c)
    inside = (r >= b) & (r <= c)
    found = np.where(inside, 1.0, np.where(r < b, up, down))
    return np.where((r < a) | (r > d), 0.0, found)


def test_worked_values():
    """On a rise of 30 from 70: at z = 70, s = 1 the best is u = s: g = 1/30, exp(-1/2)."""
    at = np.array([70.0, 300.0, 610.0])
    told = np.exp(log_possibility(at, np.ones(3), CORNERS[1:2]))[:, 0]
    # Beyond the end of the fall of 100: e = -10, u (u + 10) = 1, u = sqrt(26) - 5.
    u = np.sqrt(26.0) - 5.0
    beyond = u / 100.0 * np.exp(-0.5 * (10.0 + u) ** 2)
    np.testing.assert_allclose(told, [np.exp(-0.5) / 30.0, 1.0, beyond], rtol=1e-12)
    # Of a crisp range the density is the difference of two normal distribution functions.
    crisp = np.exp(log_density(np.array([50.0]), np.array([3.0]), CORNERS[2:3]))[0, 0]
    assert crisp == pytest.approx(0.5 / 70.0, rel=1e-9)
    np.testing.assert_allclose(areas(CORNERS), [90.0, 465.0, 70.0, 40.0])


@settings(max_examples=25, deadline=None)
@given(numbers, st.floats(1.0, 60.0))
def test_the_supremum_is_that_of_a_fine_lattice(value, std):
    lattice = np.linspace(0.0, 600.0, 12_001)
    g = grade(lattice, CORNERS)
    with np.errstate(divide="ignore"):
        brute = (np.log(g) - 0.5 * ((value - lattice[:, None]) / std) ** 2).max(axis=0)
    told = log_possibility(np.array([value]), np.array([std]), CORNERS)[0]
    np.testing.assert_allclose(told, brute, rtol=2e-2, atol=5e-3)
    # Nothing on the lattice is better.
    assert (told >= brute - 1e-9).all()


@settings(max_examples=25, deadline=None)
@given(numbers, deviations)
def test_the_mean_grade_is_that_of_quadrature(value, std):
    x = np.linspace(-9.0, 9.0, 4_001)
    weight = np.exp(-0.5 * x * x)
    brute = (weight[:, None] * grade(value + std * x, CORNERS)).sum(axis=0) / weight.sum()
    told = mean_grade(np.array([value]), np.array([std]), CORNERS)[0]
    np.testing.assert_allclose(told, brute, atol=2e-3)


@pytest.mark.parametrize("std", [0.5, 8.0, 50.0])
def test_a_density_integrates_to_one(std):
    z = np.linspace(-400.0, 1000.0, 14_001)
    told = log_density(z, np.full(len(z), std), CORNERS)
    np.testing.assert_allclose(np.exp(told).sum(axis=0) * (z[1] - z[0]), 1.0, rtol=1e-6)


def test_a_density_is_the_frequency_of_noisy_values_of_the_class():
    random = np.random.default_rng(3)
    n = 200_000
    # Draws from a trapezoid by the sum of two uniform numbers: 70, 100, 500, 530.
    corners = np.array([[70.0, 100.0, 500.0, 530.0]])
    values = 70.0 + random.uniform(0.0, 30.0, n) + random.uniform(0.0, 430.0, n)
    noisy = values + random.normal(0.0, 12.0, n)
    edges = np.array([40.0, 70.0, 85.0, 110.0, 300.0, 490.0, 530.0, 560.0])
    fine = np.linspace(40.0, 560.0, 52_001)
    density = np.exp(log_density(fine, np.full(len(fine), 12.0), corners))[:, 0]
    total = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * 0.01)])
    expected = np.diff(np.interp(edges, fine, total))
    share = np.histogram(noisy, edges)[0] / n
    error = np.sqrt(expected * (1.0 - expected) / n)
    assert (np.abs(share - expected) < 4.0 * error).all()


def test_by_densities_posteriors_are_calibrated():
    """Of the histories that are said to be of class c with probability p a share p is."""
    random = np.random.default_rng(4)
    corners = np.array([[40.0, 60.0, 100.0, 120.0], [80.0, 90.0, 300.0, 310.0]])
    n = 60_000
    true = random.integers(0, 2, n)
    a, b, c, _ = corners[true].T
    speed = a + random.uniform(0.0, 1.0, n) * (b - a) + random.uniform(0.0, 1.0, n) * (c - a)
    std = random.uniform(1.0, 15.0, n)
    told = log_density(speed + std * random.normal(size=n), std, corners)
    posterior = np.exp(told[:, 1] - logsumexp(told, axis=1))
    for low, high in ((0.02, 0.2), (0.2, 0.4), (0.4, 0.6), (0.6, 0.8), (0.8, 0.98)):
        some = (posterior > low) & (posterior <= high)
        gap = true[some].mean() - posterior[some].mean()
        assert abs(gap) < 4.0 * np.sqrt(0.25 / some.sum())


@settings(max_examples=25, deadline=None)
@given(numbers, deviations, st.floats(0.0, 50.0))
def test_a_wider_range_makes_nothing_less_possible(value, std, more):
    at = np.array([value]), np.array([std])
    wider = CORNERS + more * np.array([-1.0, -1.0, 1.0, 1.0])
    before, after = log_possibility(*at, CORNERS), log_possibility(*at, wider)
    assert (before <= 0.0).all()
    assert (after >= before - 1e-9).all()


@settings(max_examples=25, deadline=None)
@given(numbers, deviations, st.floats(0.1, 10.0))
def test_the_unit_does_not_matter(value, std, unit):
    at, other = np.array([value]), np.array([std])
    np.testing.assert_allclose(
        log_possibility(unit * at, unit * other, unit * CORNERS),
        log_possibility(at, other, CORNERS),
        rtol=1e-6,
        atol=1e-9,
    )
    one = log_density(unit * at, unit * other, unit * CORNERS) + np.log(unit)
    two = log_density(at, other, CORNERS)
    seen = two > -200.0
    np.testing.assert_allclose(one[seen], two[seen], rtol=1e-5, atol=1e-6)


def test_what_is_not_known_well_tells_nothing():
    for value in (0.0, 75.0, 400.0):
        at = np.array([value]), np.array([1e6])
        assert np.abs(log_possibility(*at, CORNERS)).max() < 1e-2
        assert np.ptp(log_density(*at, CORNERS)) < 1e-3
