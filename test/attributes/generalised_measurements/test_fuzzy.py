from __future__ import annotations

import numpy as np
import pytest
from covering_examples import random_covariance, scalar_integral
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from gda_tracker.attributes.generalised_measurements import (
    Everything,
    GaussianShaped,
    Membership,
    QuadratureError,
    Sector,
)

examples = settings(derandomize=True, deadline=None, max_examples=10)
seeds = st.integers(0, 2**32 - 1)


@examples
@given(seeds)
def test_gaussian_shape_in_one_dimension(seed):
    random = np.random.default_rng(seed)
    centre, mean = random.normal(scale=3.0, size=2)
    shape, variance = 10.0 ** random.uniform(-2.0, 2.0, 2)
    statement = GaussianShaped([[centre]], [[[shape]]])
    wanted = scalar_integral(
        lambda z: np.exp(-0.5 * (z - centre) ** 2 / shape),
        mean,
        variance,
        centre + np.sqrt(shape) * np.array([-6.0, -2.0, 0.0, 2.0, 6.0]),
    )
    found = statement.expectation(np.array([[mean]]), np.array([[[variance]]]))
    assert found[0] == pytest.approx(wanted, abs=1e-12, rel=1e-9)
    assert statement([mean])[0] == pytest.approx(np.exp(-0.5 * (mean - centre) ** 2 / shape))


@examples
@given(seeds)
def test_gaussian_shape_in_the_plane(seed):
    random = np.random.default_rng(seed)
    centre, mean = random.normal(size=(2, 2))
    shape, covariance = (random_covariance(random, 2, 2.0) for _ in range(2))
    # The sum over a grid is exact to rounding for what is smooth and vanishes at both ends.
    x = np.linspace(-25.0, 25.0, 501)
    grid = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1)
    step = grid - centre
    grades = np.exp(-0.5 * np.einsum("xyi,ij,xyj->xy", step, np.linalg.inv(shape), step))
    wanted = (grades * multivariate_normal(mean, covariance).pdf(grid)).sum() * 0.1**2
    found = GaussianShaped(centre[None], shape[None]).expectation(mean[None], covariance[None])[0]
    assert found == pytest.approx(wanted, abs=1e-9)


def test_a_sharp_statement_is_a_measurement_of_its_centre():
    # C -> 0: sqrt(det 2 pi C) times the conventional likelihood N(c; m, S).
    mean, covariance = np.array([1.0, -2.0]), np.array([[4.0, 1.0], [1.0, 3.0]])
    centre, shape = np.array([2.0, 0.5]), 1e-10 * np.array([[2.0, 0.3], [0.3, 1.0]])
    found = GaussianShaped(centre[None], shape[None]).log_expectation(mean[None], covariance[None])
    constant = 0.5 * np.log(np.linalg.det(2.0 * np.pi * shape))
    conventional = multivariate_normal(mean, covariance).logpdf(centre)
    assert found[0] == pytest.approx(constant + conventional, abs=1e-9)


def test_a_vague_statement_says_nothing():
    random = np.random.default_rng(0)
    mean = random.normal(size=(5, 1, 2))
    covariance = np.array([random_covariance(random, 2) for _ in range(5)])[:, None]
    vague = GaussianShaped([[3.0, 4.0]], [1e14 * np.eye(2)])
    everything = Everything(3, 2)
    np.testing.assert_allclose(vague.log_expectation(mean, covariance), 0.0, atol=1e-12)
    np.testing.assert_array_equal(everything.log_expectation(mean, covariance), np.zeros((5, 3)))
    np.testing.assert_array_equal(everything(mean[:, 0]), np.ones((5, 3)))


def test_a_singular_density_is_allowed_for_a_gaussian_shape():
    statement = GaussianShaped([[1.0, 2.0]], [[[4.0, 0.0], [0.0, 9.0]]])
    place = np.array([[2.0, 5.0]])
    at_point = statement.expectation(place, np.zeros((1, 2, 2)))
    np.testing.assert_allclose(at_point, statement(place[0]))


@examples
@given(seeds)
def test_averages_over_a_box(seed):
    random = np.random.default_rng(seed)
    low, high = np.array([-2.0, -3.0]), np.array([4.0, 1.0])
    fuzzy = GaussianShaped(random.normal(size=(2, 2)), [random_covariance(random, 2, 2.0)] * 2)
    x, w = np.polynomial.legendre.leggauss(200)
    grid = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1)
    grades = fuzzy(low + 0.5 * (grid + 1.0) * (high - low))
    wanted = 0.25 * np.einsum("i,j,ijm->m", w, w, grades)
    np.testing.assert_allclose(fuzzy.average(low, high), wanted, atol=1e-9)
    line = GaussianShaped([[0.5]], [[[2.0]]])
    wanted = 0.5 * w @ line(x[:, None] * 3.0)[:, 0]
    assert line.average(np.array([-3.0]), np.array([3.0]))[0] == pytest.approx(wanted, abs=1e-12)


def test_any_membership_is_integrated_numerically():
    closed = GaussianShaped([[1.0, 0.0], [3.0, 2.0]], [np.eye(2), [[2.0, 1.0], [1.0, 2.0]]])
    numerical = Membership(closed.grade, 2, 2)
    mean, covariance = np.array([[[0.5, 1.0]], [[2.0, 2.0]]]), np.eye(2)[None]
    np.testing.assert_allclose(
        numerical.expectation(mean, covariance), closed.expectation(mean, covariance), atol=1e-9
    )
    low, high = np.array([-2.0, -3.0]), np.array([4.0, 1.0])
    np.testing.assert_allclose(numerical.average(low, high), closed.average(low, high), atol=1e-9)


def test_a_cauchy_membership():
    heavy = Membership(lambda z: 1.0 / (1.0 + z[..., 0] ** 2), 1, 1)
    found = heavy.expectation(np.array([[0.7]]), np.array([[[25.0]]]))[0]
    wanted = scalar_integral(lambda z: 1.0 / (1.0 + z * z), 0.7, 25.0, np.linspace(-5, 5, 41))
    assert found == pytest.approx(wanted, abs=1e-10)


def test_a_jump_in_the_plane_is_refused_by_the_quadrature_not_answered_wrongly(monkeypatch):
    from gda_tracker.attributes.generalised_measurements import quadrature

    monkeypatch.setattr(quadrature, "MAX_POINTS", 200_000)
    sector = Sector([[0.0, 0.0]], [0.3], [1.0])
    jump = Membership(sector.grade, 1, 2)
    with pytest.raises(QuadratureError, match="tolerance 1e-10"):
        jump.expectation(np.zeros((1, 2)), np.eye(2)[None])
    loose = Membership(sector.grade, 1, 2, tolerance=1e-2)
    found = loose.expectation(np.zeros((1, 2)), np.eye(2)[None])[0]
    assert found == pytest.approx(1.0 / (2.0 * np.pi), abs=1e-2)


def test_bad_statements_are_refused():
    with pytest.raises(ValueError, match="not symmetric"):
        GaussianShaped([[0.0, 0.0]], [[[1.0, 0.5], [0.0, 1.0]]])
    with pytest.raises(ValueError, match="positive definite"):
        GaussianShaped([[0.0]], [[[0.0]]])
    with pytest.raises(ValueError, match="shape has the shape"):
        GaussianShaped([[0.0, 1.0]], [[[1.0]]])
    with pytest.raises(ValueError, match="from 0 to 1"):
        Membership(lambda z: 2.0 + z[..., 0] ** 2, 1, 1)([[0.0]])
    with pytest.raises(ValueError, match="dimension of an integral = 3"):
        Membership(lambda z: z[..., 0] * 0.0, 1, 3).expectation(np.zeros((1, 3)), np.eye(3)[None])
    with pytest.raises(ValueError, match="allowed is"):
        GaussianShaped([[0.0]], [[[1.0]]])([[0.0, 1.0]])
