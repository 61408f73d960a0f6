from __future__ import annotations

import numpy as np
import pytest
from covering_examples import (
    plane_integral,
    polygon_slices,
    random_covariance,
    scalar_integral,
    star_polygon,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from gda_tracker.attributes.generalised_measurements import (
    Box,
    Everything,
    FuzzyDempsterShafer,
    GaussianShaped,
    Polygon,
    Projection,
    Rule,
    Sector,
    Statements,
    interval,
    mixture_grade,
    rule_grade,
    trapezoid,
)
from gda_tracker.attributes.generalised_measurements.conjunction import minimum

examples = settings(derandomize=True, deadline=None, max_examples=10)
seeds = st.integers(0, 2**32 - 1)
SURE = np.full((1, 1, 1), 1e-10)


def expectation(statements, mean, covariance):
    return statements.expectation(
        np.asarray(mean, dtype=float)[..., None, :], np.asarray(covariance)[..., None, :, :]
    )


def numerical(statement, mean, variance, knots):
    return scalar_integral(lambda z: statement(z[..., None])[..., 0], mean, variance, knots)


@examples
@given(seeds)
def test_fuzzy_dempster_shafer_equals_numerical_integration(seed):
    random = np.random.default_rng(seed)
    centres, shapes = random.normal(scale=2.0, size=2), random.uniform(0.1, 4.0, 2)
    corners = np.sort(random.normal(scale=3.0, size=(1, 4)))
    focal = (
        GaussianShaped(centres[:1, None], shapes[:1, None, None]),
        GaussianShaped(centres[1:, None], shapes[1:, None, None]),
        trapezoid(corners),
        Everything(1, 1),
    )
    statement = FuzzyDempsterShafer(random.dirichlet(np.ones(4))[None], focal)
    mean, variance = random.normal(), random.uniform(0.05, 9.0)
    found = expectation(statement, [mean], [[variance]])[0]
    assert found == pytest.approx(numerical(statement, mean, variance, corners), abs=1e-10)


def test_one_focal_set_is_a_fuzzy_statement():
    fuzzy = GaussianShaped([[1.0, 2.0], [0.0, 1.0]], [np.eye(2), 3.0 * np.eye(2)])
    statement = FuzzyDempsterShafer([[1.0], [1.0]], (fuzzy,))
    with_another = FuzzyDempsterShafer([[1.0, 0.0]] * 2, (fuzzy, Everything(2, 2)))
    mean, covariance = [[0.0, 0.0], [5.0, 1.0]], [np.eye(2), 2.0 * np.eye(2)]
    for other in (statement, with_another):
        np.testing.assert_allclose(
            expectation(other, mean, covariance), expectation(fuzzy, mean, covariance), rtol=1e-14
        )
        np.testing.assert_allclose(other(mean), fuzzy(mean))


def test_the_order_of_focal_sets_does_not_matter():
    focal = tuple(GaussianShaped([[c]], [[[1.0]]]) for c in (0.0, 1.0, 3.0))
    weights = np.array([[0.2, 0.5, 0.3]])
    one = FuzzyDempsterShafer(weights, focal)
    two = FuzzyDempsterShafer(weights[:, ::-1], focal[::-1])
    mean, variance = [[0.4]], [[[2.0]]]
    np.testing.assert_allclose(expectation(one, mean, variance), expectation(two, mean, variance))


def test_a_crisp_rule_violated_satisfied_and_inapplicable():
    # "If it is below 10, it is below 5" for 7, 3 and 20.
    rule = Rule(interval([-np.inf], [10.0]), interval([-np.inf], [5.0]))
    places = np.array([[7.0], [3.0], [20.0]])
    np.testing.assert_array_equal(rule(places)[:, 0], [0.0, 1.0, 0.5])
    np.testing.assert_allclose(
        expectation(rule, places, np.full((3, 1, 1), 1e-8))[:, 0], [0.0, 1.0, 0.5], atol=1e-12
    )


@examples
@given(seeds)
def test_rules_on_a_scalar_equal_numerical_integration(seed):
    random = np.random.default_rng(seed)
    corners = np.sort(random.normal(scale=3.0, size=(2, 1, 4)))
    smooth = GaussianShaped([[random.normal()]], [[[random.uniform(0.5, 4.0)]]])
    mean, variance = random.normal(), random.uniform(0.2, 9.0)
    piecewise = Rule(trapezoid(corners[0]), trapezoid(corners[1]))
    mixed = Rule(trapezoid(corners[0]), smooth)
    crossings = minimum(piecewise.antecedent, piecewise.consequent).knots
    found = expectation(piecewise, [mean], [[variance]])[0]
    assert found == pytest.approx(numerical(piecewise, mean, variance, crossings), abs=1e-10)

    def lead(z):
        points = np.reshape(z, (-1, 1))
        return np.squeeze(mixed.antecedent(points) - smooth(points))

    fine = np.union1d(np.linspace(-30.0, 30.0, 6001), corners[0])
    leads = lead(fine)
    crossings = [
        brentq(lead, fine[k], fine[k + 1], xtol=1e-14)
        for k in np.flatnonzero(leads[1:] * leads[:-1] < 0.0)
    ]
    knots = np.append(crossings, corners[0])
    found = expectation(mixed, [mean], [[variance]])[0]
    assert found == pytest.approx(numerical(mixed, mean, variance, knots), abs=1e-9)


@examples
@given(seeds)
def test_rules_on_regions_equal_numerical_integration(seed):
    # E[1_A 1_B] + (1 - E[1_A])/2, the first as an integral over the chords of both.
    random = np.random.default_rng(seed)
    vertices, mean = star_polygon(random, 6), random.normal(scale=2.0, size=2)
    covariance = random_covariance(random, 2)
    low, high = np.array([-1.0, -2.0]), np.array([2.0, 1.0])
    box, polygon = Box(low[None], high[None]), Polygon(vertices[None])
    chords = polygon_slices(vertices)

    def overlap(x):
        if not low[0] <= x <= high[0]:
            return []
        cut = [(max(a, low[1]), min(b, high[1])) for a, b in chords(x)]
        return [(a, b) for a, b in cut if a < b]

    start, end = vertices, np.roll(vertices, -1, axis=0)
    knots = [low[0], high[0], *vertices[:, 0]]
    for bound in (low[1], high[1]):
        share = (bound - start[:, 1]) / (end - start)[:, 1]
        knots += list((start[:, 0] + share * (end - start)[:, 0])[(share > 0) & (share < 1)])
    both = plane_integral(overlap, mean, covariance, knots)
    in_polygon = plane_integral(chords, mean, covariance, vertices[:, 0])
    found = expectation(Rule(polygon, box), mean, covariance)[0]
    assert found == pytest.approx(both + 0.5 * (1.0 - in_polygon), abs=1e-10)


def test_minimum_of_regions():
    square = Polygon([[[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]]] * 2)
    right = Sector([[1.0, -5.0]] * 2, [-0.5 * np.pi] * 2, [np.pi] * 2)
    away = Box([[1.0, 1.0], [7.0, 7.0]], [[5.0, 5.0], [8.0, 8.0]])
    low, high = np.zeros(2), np.full(2, 10.0)
    for one, two, areas in (
        (square, right, [2.0, 2.0]),
        (right, square, [2.0, 2.0]),
        (square, away, [1.0, 0.0]),
        (away, Box([[0.0, 0.0]] * 2, [[2.0, np.inf]] * 2), [4.0, 0.0]),
        (square, square, [4.0, 4.0]),
        (square, Everything(2, 2), [4.0, 4.0]),
        (Everything(2, 2), square, [4.0, 4.0]),
    ):
        both = minimum(one, two)
        np.testing.assert_allclose(both.average(low, high), np.array(areas) / 100.0, atol=1e-15)
        mean, covariance = [1.5, 1.5], np.diag([0.3, 0.2])
        wanted = expectation(square, mean, covariance) if areas == [4.0, 4.0] else None
        found = expectation(both, mean, covariance)
        assert wanted is None or np.allclose(found, wanted)
        assert (found[np.array(areas) == 0.0] == 0.0).all()
    assert minimum(right, right) is None


def test_a_rule_on_two_quantities():
    # "If it is within 10 km it is slow", on range [km] and speed [m/s], independent here.
    within = Projection(interval([-np.inf], [10.0]), [[1.0, 0.0]])
    slow = Projection(interval([-np.inf], [5.0]), [[0.0, 1.0]])
    crisp = Rule(
        Box([[-np.inf, -np.inf]], [[10.0, np.inf]]), Box([[-np.inf, -np.inf]], [[np.inf, 5.0]])
    )
    mean, covariance = np.array([9.0, 6.0]), np.diag([4.0, 9.0])
    near = expectation(within, mean, covariance)[0]
    slowly = expectation(slow, mean, covariance)[0]
    assert expectation(crisp, mean, covariance)[0] == pytest.approx(
        near * slowly + 0.5 * (1.0 - near), abs=1e-12
    )
    places = [[9.0, 6.0], [9.0, 4.0], [11.0, 6.0]]
    np.testing.assert_array_equal(crisp(places)[:, 0], [0.0, 1.0, 0.5])
    np.testing.assert_array_equal(Rule(within, slow)(places), crisp(places))


def test_a_fuzzy_rule_on_two_quantities_by_quadrature():
    within = Projection(GaussianShaped([[0.0]], [[[25.0]]]), [[1.0, 0.0]])
    slow = Projection(GaussianShaped([[0.0]], [[[4.0]]]), [[0.0, 1.0]])
    rule = Rule(within, slow, tolerance=1e-8)
    mean, covariance = np.array([3.0, 2.0]), np.array([[2.0, 0.5], [0.5, 1.0]])
    # The two memberships are equal on the lines |y| = 0.4 |x|: the kinks of the inner integral.
    slope = covariance[0, 1] / covariance[0, 0]
    variance = covariance[1, 1] - slope * covariance[0, 1]

    def inner(x):
        centre = mean[1] + slope * (x - mean[0])
        kinks = [-0.4 * abs(x), 0.4 * abs(x)]

        def along(y):
            return rule(np.stack([np.full_like(y, x), y], axis=-1))[..., 0]

        return scalar_integral(along, centre, variance, kinks)

    wanted = scalar_integral(np.vectorize(inner), mean[0], covariance[0, 0], [0.0])
    assert expectation(rule, mean, covariance)[0] == pytest.approx(wanted, abs=1e-9)


def test_averages():
    low, high = np.array([0.0, -1.0]), np.array([10.0, 3.0])
    ramp = trapezoid([[0.0, 4.0, 6.0, 8.0]])
    projected = Projection(ramp, [[0.5, 0.0]])
    # On 0..5: the ramp rises to 4, then 1.
    np.testing.assert_allclose(projected.average(low, high), (2.0 + 1.0) / 5.0)
    oblique = Projection(ramp, [[0.5, 0.25]])
    x = np.linspace(0.0, 1.0, 401)
    x = 0.5 * (x[1:] + x[:-1])
    grid = low + np.stack(np.meshgrid(x, x[::2], indexing="ij"), axis=-1) * (high - low)
    assert oblique.average(low, high)[0] == pytest.approx(oblique(grid).mean(), abs=1e-3)
    rule = Rule(interval([2.0], [6.0]), interval([4.0], [9.0]))
    np.testing.assert_allclose(
        rule.average(np.array([0.0]), np.array([10.0])), 0.2 + 0.5 * (1.0 - 0.4)
    )
    smooth = Rule(interval([2.0], [6.0]), GaussianShaped([[4.0]], [[[1.0]]]))
    places = np.linspace(0.0, 10.0, 20_001)[:, None]
    assert smooth.average(np.array([0.0]), np.array([10.0]))[0] == pytest.approx(
        smooth(places).mean(), abs=1e-4
    )
    doubtful = FuzzyDempsterShafer([[0.25, 0.75]], (ramp, Everything(1, 1)))
    ends = np.array([0.0]), np.array([8.0])
    np.testing.assert_allclose(doubtful.average(*ends), 0.25 * ramp.average(*ends) + 0.75)


def test_statements_of_different_kinds_side_by_side():
    fuzzy = GaussianShaped([[1.0, 0.0], [0.0, 2.0]], [np.eye(2)] * 2)
    sector = Sector([[0.0, 0.0]], [0.0], [1.0])
    together = Statements((fuzzy, sector, Everything(1, 2)))
    assert len(together) == 4
    mean, covariance = [[0.5, 0.5], [3.0, 1.0], [0.0, 9.0]], [np.eye(2)] * 3
    wanted = np.concatenate(
        [expectation(part, mean, covariance) for part in together.parts], axis=1
    )
    np.testing.assert_array_equal(expectation(together, mean, covariance), wanted)
    np.testing.assert_array_equal(
        together(mean), np.concatenate([part(mean) for part in together.parts], axis=1)
    )
    # Densities of their own for each statement.
    own = np.array([[0.5, 0.5], [3.0, 1.0], [0.0, 9.0], [1.0, 1.0]])
    found = together.expectation(own, np.tile(np.eye(2), (4, 1, 1)))
    diagonal = [expectation(together, own[m], np.eye(2))[m] for m in range(4)]
    np.testing.assert_allclose(found, diagonal, rtol=1e-13)
    np.testing.assert_allclose([together.grade(own)[m] for m in range(4)], together(own).diagonal())
    low, high = np.full(2, -5.0), np.full(2, 5.0)
    assert together.average(low, high).shape == (4,)


def test_memberships_of_classes():
    # 0.8 "fighter or drone", 0.2 anything, on drone, fighter, cargo.
    grades = np.array([[1.0, 1.0], [1.0, 1.0], [0.0, 1.0]])
    np.testing.assert_allclose(mixture_grade(np.array([0.8, 0.2]), grades), [1.0, 1.0, 0.2])
    corners = np.array([0.0, 0.5, 1.0])
    np.testing.assert_allclose(
        rule_grade(corners[:, None], corners),
        [[0.5, 0.5, 0.5], [0.25, 0.75, 0.75], [0.0, 0.5, 1.0]],
    )


def test_bad_combinations_are_refused():
    fuzzy = GaussianShaped([[0.0]], [[[1.0]]])
    with pytest.raises(ValueError, match="sum 1"):
        FuzzyDempsterShafer([[0.5, 0.4]], (fuzzy, Everything(1, 1)))
    with pytest.raises(ValueError, match="sum 1"):
        FuzzyDempsterShafer([[1.5, -0.5]], (fuzzy, Everything(1, 1)))
    with pytest.raises(ValueError, match="one dimension"):
        FuzzyDempsterShafer([[0.5, 0.5]], (fuzzy, Everything(1, 2)))
    with pytest.raises(ValueError, match="one dimension"):
        Rule(fuzzy, Everything(2, 1))
    with pytest.raises(ValueError, match="independent"):
        Projection(Everything(1, 2), [[1.0, 2.0], [2.0, 4.0]])
    with pytest.raises(ValueError, match="one or more"):
        Statements(())
