from __future__ import annotations

import doctest
import importlib
import pkgutil

import numpy as np
import pytest
from covering_examples import random_covariance, scalar_integral
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ndtr
from scipy.stats import multivariate_normal

from gda_tracker.attributes import generalised_measurements
from gda_tracker.attributes.generalised_measurements import (
    Box,
    Everything,
    FuzzyDempsterShafer,
    GaussianShaped,
    QuadratureError,
    Sector,
    Statements,
    interval,
    log_association_likelihood,
    log_association_likelihood_by_quadrature,
    log_clutter_likelihood,
    log_generalised_likelihood,
    trapezoid,
)

examples = settings(derandomize=True, deadline=None, max_examples=15)
seeds = st.integers(0, 2**32 - 1)
POSITION = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])


def random_tracks(random, count, s=4):
    return random.normal(scale=3.0, size=(count, s)), np.array(
        [random_covariance(random, s) for _ in range(count)]
    )


def random_fuzzy(random, count, d=2):
    return GaussianShaped(
        random.normal(scale=3.0, size=(count, d)),
        np.array([random_covariance(random, d) for _ in range(count)]),
    )


@examples
@given(seeds)
def test_fuzzy_statements_equation_by_equation(seed):
    # (41), (60), (62), (73) with scipy's density.
    random = np.random.default_rng(seed)
    fuzzy, (mean, covariance) = random_fuzzy(random, 3), random_tracks(random, 4)
    noise = random_covariance(random, 2)
    deterministic = log_association_likelihood(fuzzy, mean, covariance, POSITION)
    noisy = log_association_likelihood(fuzzy, mean, covariance, POSITION, noise)
    seen = log_generalised_likelihood(fuzzy, mean @ POSITION.T, noise)
    for i in range(4):
        for j in range(3):
            c, shape = fuzzy.centre[j], fuzzy.shape[j]
            prefactor = 0.5 * np.log(np.linalg.det(2.0 * np.pi * shape))
            spread = POSITION @ covariance[i] @ POSITION.T
            place = POSITION @ mean[i]
            for found, total in (
                (deterministic, shape + spread),
                (noisy, shape + noise + spread),
                (seen, shape + noise),
            ):
                wanted = prefactor + multivariate_normal(place, total).logpdf(c)
                assert found[i, j] == pytest.approx(wanted, abs=1e-9, rel=1e-12)


@examples
@given(seeds)
def test_random_fuzzy_dempster_shafer_keeps_the_prefactor(seed):
    # (81) with C + R inside N only.
    random = np.random.default_rng(seed)
    focal = (random_fuzzy(random, 3), random_fuzzy(random, 3))
    weights = random.dirichlet(np.ones(2), 3)
    mean, covariance = random_tracks(random, 2)
    noise = random_covariance(random, 2)
    found = np.exp(
        log_association_likelihood(
            FuzzyDempsterShafer(weights, focal), mean, covariance, POSITION, noise
        )
    )
    for i in range(2):
        for j in range(3):
            wanted = 0.0
            for w, part in zip(weights[j], focal, strict=True):
                total = part.shape[j] + noise + POSITION @ covariance[i] @ POSITION.T
                prefactor = np.sqrt(np.linalg.det(2.0 * np.pi * part.shape[j]))
                density = multivariate_normal(POSITION @ mean[i], total).pdf(part.centre[j])
                wanted += w * prefactor * density
            assert found[i, j] == pytest.approx(wanted, rel=1e-10)


@examples
@given(seeds)
def test_noise_and_track_add_up(seed):
    # (69) by two integrations, one after the other, is (70) by one.
    random = np.random.default_rng(seed)
    statement = trapezoid(np.sort(random.normal(scale=3.0, size=(1, 4))))
    mean, variance, noise = random.normal(), random.uniform(0.3, 4.0), random.uniform(0.3, 4.0)

    def seen(x):
        return np.exp(log_generalised_likelihood(statement, x[..., None], [[noise]]))[..., 0]

    wanted = scalar_integral(seen, mean, variance)
    found = log_association_likelihood(statement, [[mean]], [[[variance]]], None, [[noise]])
    assert np.exp(found[0, 0]) == pytest.approx(wanted, abs=1e-10)


def test_deterministic_likelihoods_are_memberships():
    statement = trapezoid([[0.0, 1.0, 2.0, 4.0]])
    np.testing.assert_allclose(
        np.exp(log_generalised_likelihood(statement, [[0.5], [1.5], [9.0]])),
        [[0.5], [1.0], [0.0]],
    )


def test_the_area_of_a_gaussian_statement():
    # The integral of l(Theta | x) over x is the area under g, as long as the track is flat.
    shape = np.array([[2.0, 0.5], [0.5, 1.0]])
    flat = 1e10 * np.eye(2)
    found = log_association_likelihood(GaussianShaped([[1.0, 2.0]], [shape]), [[0.0, 0.0]], [flat])
    wanted = np.sqrt(np.linalg.det(2.0 * np.pi * shape)) / (2.0 * np.pi * 1e10)
    assert np.exp(found[0, 0]) == pytest.approx(wanted, rel=1e-9)


def test_tracks_and_statements_in_any_order_and_one_by_one():
    random = np.random.default_rng(7)
    fuzzy = random_fuzzy(random, 3)
    sector = Sector(random.normal(size=(2, 2)), [0.0, 2.0], [1.0, 4.0])
    statements = Statements((fuzzy, sector, Box([[0.0, 0.0]], [[2.0, np.inf]])))
    mean, covariance = random_tracks(random, 5)
    noise = random_covariance(random, 2)
    found = log_association_likelihood(statements, mean, covariance, POSITION, noise)
    assert found.shape == (5, 6)
    order = random.permutation(5)
    turned = log_association_likelihood(statements, mean[order], covariance[order], POSITION, noise)
    np.testing.assert_allclose(turned, found[order], rtol=1e-13)
    backwards = Statements(statements.parts[::-1])
    np.testing.assert_allclose(
        log_association_likelihood(backwards, mean, covariance, POSITION, noise),
        found[:, [5, 3, 4, 0, 1, 2]],
        rtol=1e-13,
    )
    for i in range(5):
        for j in range(3):
            one = GaussianShaped(fuzzy.centre[[j]], fuzzy.shape[[j]])
            single = log_association_likelihood(one, mean[[i]], covariance[[i]], POSITION, noise)
            assert single[0, 0] == pytest.approx(found[i, j], rel=1e-12)


def test_a_noisy_bearing_sector_by_quadrature():
    # A bearing from 0.1 to 0.4 rad, measured with 0.05 rad, of a target near (1000, 200) m.
    sector = interval([0.1], [0.4])
    mean = np.array([[1000.0, 0.0, 200.0, 0.0]])
    covariance = np.diag([6400.0, 1.0, 4900.0, 1.0])[None]

    def bearing(place):
        return np.arctan2(place[..., 1], place[..., 0])[..., None]

    found = log_association_likelihood_by_quadrature(
        sector, mean, covariance, bearing, POSITION, [[0.05**2]]
    )[0, 0]
    x, w = np.polynomial.hermite_e.hermegauss(80)
    grid = np.stack(np.meshgrid(1000.0 + 80.0 * x, 200.0 + 70.0 * x, indexing="ij"), axis=-1)
    angle = bearing(grid)[..., 0]
    seen = ndtr((0.4 - angle) / 0.05) - ndtr((0.1 - angle) / 0.05)
    wanted = np.einsum("i,j,ij->", w, w, seen) / (2.0 * np.pi)
    assert np.exp(found) == pytest.approx(wanted, abs=1e-10)
    # Without noise it is the sector itself, whose jump the quadrature cannot follow to 1e-10.
    exact = log_association_likelihood(
        Sector([[0.0, 0.0]], [0.1], [0.3]), mean, covariance, POSITION
    )[0, 0]
    small = log_association_likelihood_by_quadrature(
        sector, mean, covariance, bearing, POSITION, [[0.004**2]], tolerance=1e-6
    )[0, 0]
    assert np.exp(small) == pytest.approx(np.exp(exact), abs=1e-3)


def test_quadrature_of_a_linear_measurement_is_the_closed_form():
    random = np.random.default_rng(3)
    fuzzy, (mean, covariance) = random_fuzzy(random, 2), random_tracks(random, 3)
    noise = np.eye(2)
    np.testing.assert_allclose(
        np.exp(
            log_association_likelihood_by_quadrature(
                fuzzy, mean, covariance, lambda y: y, POSITION, noise
            )
        ),
        np.exp(log_association_likelihood(fuzzy, mean, covariance, POSITION, noise)),
        atol=1e-9,
    )


def test_clutter_likelihoods():
    # (47) for false alarms spread evenly over 100 x 50.
    low, high = [0.0, 0.0], [100.0, 50.0]
    statements = Statements(
        (
            GaussianShaped([[50.0, 25.0]], [[[4.0, 1.0], [1.0, 2.0]]]),
            Box([[10.0, 10.0]], [[20.0, 20.0]]),
            Everything(1, 2),
            Box([[200.0, 10.0]], [[210.0, 20.0]]),
        )
    )
    found = np.exp(log_clutter_likelihood(statements, low, high))
    area = 2.0 * np.pi * np.sqrt(7.0)
    np.testing.assert_allclose(found, [area / 5000.0, 100.0 / 5000.0, 1.0, 0.0], rtol=1e-12)


def test_bad_arguments_are_refused():
    fuzzy = GaussianShaped([[0.0, 0.0]], [np.eye(2)])
    tracks = [[0.0, 0.0]], [np.eye(2)]
    with pytest.raises(ValueError, match="measurement_matrix has the shape"):
        log_association_likelihood(fuzzy, *tracks, [[1.0, 0.0]])
    with pytest.raises(ValueError, match="covariance has the shape"):
        log_association_likelihood(fuzzy, [[0.0, 0.0]], [[1.0]])
    with pytest.raises(ValueError, match="mean holds NaN"):
        log_association_likelihood(fuzzy, [[np.nan, 0.0]], [np.eye(2)])
    with pytest.raises(ValueError, match="noise_covariance has the shape"):
        log_association_likelihood(fuzzy, *tracks, None, [[1.0]])
    with pytest.raises(ValueError, match="points have the shape"):
        log_generalised_likelihood(fuzzy, [[0.0]], np.eye(2))
    with pytest.raises(ValueError, match="low < high"):
        log_clutter_likelihood(fuzzy, [0.0, 1.0], [1.0, 1.0])
    with pytest.raises(ValueError, match="state_matrix has the shape"):
        log_association_likelihood_by_quadrature(fuzzy, *tracks, lambda y: y, [[1.0]])
    assert issubclass(QuadratureError, ArithmeticError)


def test_the_examples_are_true():
    attempted = 0
    for module in pkgutil.iter_modules(
        generalised_measurements.__path__, generalised_measurements.__name__ + "."
    ):
        result = doctest.testmod(importlib.import_module(module.name))
        assert result.failed == 0
        attempted += result.attempted
    assert attempted > 10
