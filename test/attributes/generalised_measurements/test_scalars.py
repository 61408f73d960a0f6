from __future__ import annotations

import numpy as np
import pytest
from covering_examples import scalar_integral
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import log_ndtr
from scipy.stats import norm

from gda_tracker.attributes.generalised_measurements import (
    PiecewiseLinear,
    interval,
    quantised,
    trapezoid,
    triangle,
)

examples = settings(derandomize=True, deadline=None, max_examples=40)
seeds = st.integers(0, 2**32 - 1)


def expectation(statements, mean, variance):
    return statements.expectation(np.reshape(mean, (-1, 1, 1)), np.reshape(variance, (-1, 1, 1, 1)))


def random_piecewise(random, count, knots):
    places = np.sort(random.normal(scale=4.0, size=(count, knots)), axis=1)
    jump = random.integers(0, knots - 1, count)
    places[np.arange(count), jump] = places[np.arange(count), jump + 1]
    grades = random.uniform(size=(count, knots)) * (random.random((count, knots)) < 0.7)
    return PiecewiseLinear(places, grades)


@examples
@given(seeds)
def test_piecewise_linear_equals_numerical_integration(seed):
    random = np.random.default_rng(seed)
    statements = random_piecewise(random, 3, 5)
    mean = random.normal(scale=4.0, size=2)
    variance = 10.0 ** random.uniform(-3.0, 2.0, 2)
    found = expectation(statements, mean, variance)
    for t in range(2):
        for m in range(3):
            wanted = scalar_integral(
                lambda z, m=m: statements(z[..., None])[..., m],
                mean[t],
                variance[t],
                statements.knots[m],
            )
            assert found[t, m] == pytest.approx(wanted, abs=1e-9, rel=1e-9)


@examples
@given(seeds)
def test_intervals_are_differences_of_the_normal_probability(seed):
    random = np.random.default_rng(seed)
    low, high = np.sort(random.normal(scale=3.0, size=(2, 4)), axis=0)
    low[0], high[1] = -np.inf, np.inf
    mean, deviation = random.normal(size=6), random.uniform(0.1, 3.0, 6)
    wanted = norm.cdf(high, mean[:, None], deviation[:, None]) - norm.cdf(
        low, mean[:, None], deviation[:, None]
    )
    found = expectation(interval(low, high), mean, deviation**2)
    np.testing.assert_allclose(found, wanted, atol=1e-14)


@pytest.mark.parametrize("sigmas", [5.0, 38.0, 200.0, 1e4])
def test_log_probability_of_a_far_interval(sigmas):
    mean, variance = np.zeros((1, 1)), np.ones((1, 1, 1))
    beyond = interval([sigmas, -np.inf], [np.inf, -sigmas])
    np.testing.assert_allclose(
        beyond.log_expectation(mean, variance), log_ndtr(-sigmas), rtol=1e-14
    )


def test_a_far_ramp_keeps_its_digits():
    # Near s the density is that of s times exp(-s t): the ramp t integrates to 1/s^2 (1 - 3/s^2..).
    statement = trapezoid([[30.0, 31.0, np.inf, np.inf]])
    log = statement.log_expectation(np.zeros((1, 1)), np.ones((1, 1, 1)))[0]
    t = np.linspace(0.0, 3.0, 300_001)
    scaled = np.minimum(t, 1.0) * np.exp(-30.0 * t - 0.5 * t * t)
    dense = 0.5 * ((scaled[1:] + scaled[:-1]) * np.diff(t)).sum()
    assert log == pytest.approx(np.log(dense / np.sqrt(2 * np.pi)) - 450.0, abs=1e-7)


@pytest.mark.parametrize("place", [0.0, 1.3, 20.0])
@pytest.mark.parametrize("width", [1e-12, 1e-6, 1e-2])
def test_short_pieces_keep_their_digits(place, width):
    # The expansion of the density about the middle, to the next order in the width.
    low, high = place, place + width
    width = high - low
    mean, variance = np.zeros((1, 1)), np.ones((1, 1, 1))
    middle = 0.5 * (low + high)
    curvature = 1.0 + (middle**2 - 1.0) * width**2 / 24.0
    wanted = norm.logpdf(middle) + np.log(width * curvature)
    found = interval([low], [high]).log_expectation(mean, variance)[0]
    assert found == pytest.approx(wanted, abs=1e-11 + (1.0 + place) ** 4 * width**4)
    # A triangle whose halves are that short weighs as much as a box of one of them.
    tent = triangle([low - width], [low], [high]).log_expectation(mean, variance)[0]
    wanted = norm.logpdf(low) + np.log(width * (1.0 + (low**2 - 1.0) * width**2 / 12.0))
    tolerance = 1e-11 + (1.0 + place) ** 4 * width**4 + 1e-15 * (1.0 + place) / width
    assert tent == pytest.approx(wanted, abs=tolerance)


def test_one_knot_in_the_smallest_density_is_its_grade():
    statements = trapezoid([[0.0, 1.0, 2.0, 4.0]])
    places = np.array([-1.0, 0.5, 1.5, 3.0, 5.0])
    np.testing.assert_allclose(
        expectation(statements, places, np.full(5, 1e-16)),
        statements(places[:, None]),
        atol=1e-12,
    )


def test_grades_by_hand():
    statements = trapezoid(
        [
            [0.0, 1.0, 2.0, 4.0],
            [1.0, 1.0, 2.0, 2.0],
            [-np.inf, -np.inf, 1.0, 3.0],
            [1.0, 2.0, np.inf, np.inf],
            [-np.inf, -np.inf, np.inf, np.inf],
        ]
    )
    grades = statements([[-9.0], [0.5], [1.0], [2.0], [3.0], [9.0]])
    np.testing.assert_array_equal(grades[:, 0], [0.0, 0.5, 1.0, 1.0, 0.5, 0.0])
    np.testing.assert_array_equal(grades[:, 1], [0.0, 0.0, 1.0, 1.0, 0.0, 0.0])
    np.testing.assert_array_equal(grades[:, 2], [1.0, 1.0, 1.0, 0.5, 0.0, 0.0])
    np.testing.assert_array_equal(grades[:, 3], [0.0, 0.0, 0.0, 1.0, 1.0, 1.0])
    np.testing.assert_array_equal(grades[:, 4], 1.0)
    assert triangle([0.0], [1.0], [3.0])([[1.0], [2.0]]).tolist() == [[1.0], [0.5]]


def test_quantised_values_share_out_the_probability():
    edges = [-1.0, 0.0, 2.0]
    cells = quantised([-5.0, -1.0, 1.9, 2.0], edges)
    np.testing.assert_array_equal(cells([[-3.0], [-0.5], [1.0], [7.0]]), np.eye(4))
    shares = expectation(cells, [0.3], [2.0])
    assert shares.sum() == pytest.approx(1.0, abs=1e-14)


@examples
@given(seeds)
def test_minimum_and_average(seed):
    random = np.random.default_rng(seed)
    one, two = random_piecewise(random, 2, 4), random_piecewise(random, 2, 6)
    both = one.minimum(two)
    places = random.uniform(-9.0, 9.0, (200, 1))
    np.testing.assert_allclose(both(places), np.minimum(one(places), two(places)), atol=1e-12)
    low, high = -2.0, 5.0
    fine = np.linspace(low, high, 20_001)[:, None]
    middle = 0.5 * (fine[1:] + fine[:-1])
    np.testing.assert_allclose(
        one.average(np.array([low]), np.array([high])), one(middle).mean(axis=0), atol=1e-3
    )


def test_average_by_hand():
    statements = trapezoid([[0.0, 1.0, 2.0, 4.0], [3.0, 3.0, 9.0, 9.0]])
    np.testing.assert_allclose(
        statements.average(np.array([-1.0]), np.array([3.0])), [(0.5 + 1.0 + 0.75) / 4.0, 0.0]
    )


@pytest.mark.parametrize(
    ("corners", "match"),
    [
        ([[1.0, 0.0, 2.0, 3.0]], "nondecreasing"),
        ([[-np.inf, 0.0, 2.0, 3.0]], "shoulder"),
        ([[0.0, 1.0, 2.0, np.inf]], "shoulder"),
        ([[np.inf, np.inf, np.inf, np.inf]], "-inf on the left"),
        ([[0.0, 1.0, np.nan, 3.0]], "NaN"),
        ([[0.0, 1.0, 2.0]], "shape"),
    ],
)
def test_bad_corners_are_refused(corners, match):
    with pytest.raises(ValueError, match=match):
        trapezoid(corners)


def test_bad_statements_are_refused():
    with pytest.raises(ValueError, match="from 0 to 1"):
        PiecewiseLinear([[0.0, 1.0]], [[0.0, 1.5]])
    with pytest.raises(ValueError, match="increasing"):
        quantised([1.0], [2.0, 2.0])
    with pytest.raises(ValueError, match="variance"):
        expectation(interval([0.0], [1.0]), [0.0], [0.0])
    statement = interval([0.0], [1.0])
    with pytest.raises(ValueError, match="read-only"):
        statement.knots[0, 0] = 3.0
