"""The association likelihood ratio test against 100,000 members of each set."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import dblquad, tplquad
from set_examples import literal_log_ratios, members_by_projection, random_sets

from gda_tracker.kinematics.set_valued.association_test import (
    MEASUREMENT,
    STATE,
    AssociationTest,
)
from gda_tracker.kinematics.set_valued.filter import TrackSets
from gda_tracker.kinematics.set_valued.possible_region import (
    _in_many_dimensions,
    distance_integral,
)

POINTS = 100_000
# What 100,000 points may miss of a supremum; decisions closer to the threshold prove nothing.
BAND = {1: 2e-3, 2: 0.02, 3: 0.25}


def cases(rng, r, sets_count, observations):
    """Sets that observations lie in, beside, and just within reach of."""
    sets = random_sets(rng, sets_count, size=1.2)
    h = rng.standard_normal((observations, r, 4))
    rho = rng.uniform(0.3, 2.0, (observations, r))
    return sets, (5.0 - r) * rng.standard_normal((observations, r)), h, rho


@pytest.mark.parametrize("r", [1, 2, 3])
def test_decisions_are_those_of_a_hundred_thousand_members(r):
    rng = np.random.default_rng([1991, r])
    tests = [AssociationTest(0.3, 3.0, space) for space in (MEASUREMENT, STATE)]
    threshold = math.log(0.3)
    compared = accepted = finite = near = slivers = 0
    for _ in range(2):
        sets, z, h, rho = cases(rng, r, 4, 4)
        ratios = [test.log_ratio(sets, z, h, rho) for test in tests]
        decisions = [test.associated(sets, z, h, rho) for test in tests]
        integral = distance_integral(3.0 * rho)
        for j, i in np.ndindex(4, 4):
            x = members_by_projection(sets, j, h[i], POINTS, rng)
            highest = literal_log_ratios(sets, j, x, z[i], h[i], rho[i], 3.0, integral[i])
            for high, ratio, decision in zip(highest, ratios, decisions, strict=True):
                # No member beats the supremum, and the members come close to it.
                assert ratio[j, i] >= high - 1e-9
                if high == -np.inf and ratio[j, i] > -np.inf:
                    slivers += 1
                    continue
                if np.isfinite(ratio[j, i]):
                    finite += 1
                    assert ratio[j, i] - high < 20.0 * BAND[r]
                if abs(high - threshold) < BAND[r]:
                    near += 1
                    continue
                compared += 1
                accepted += decision[j, i]
                assert decision[j, i] == (high >= threshold)
    assert compared >= 58
    assert near + slivers <= 6
    assert finite >= 8
    assert 8 <= accepted <= compared - 8


@pytest.mark.parametrize("scale", [100.0, 0.01])
def test_in_measurement_space_the_unit_of_length_changes_nothing(scale):
    rng = np.random.default_rng(5)
    for r in (1, 2, 3):
        sets, z, h, rho = cases(rng, r, 12, 12)
        other = TrackSets(scale * sets.centroid, scale**2 * sets.covariance, scale * sets.matrix)
        test = AssociationTest(0.5, 3.0)
        ratio, scaled = (
            test.log_ratio(sets, z, h, rho),
            test.log_ratio(other, scale * z, h, scale * rho),
        )
        np.testing.assert_array_equal(np.isfinite(ratio), np.isfinite(scaled))
        finite = np.isfinite(ratio)
        assert finite.any()
        np.testing.assert_allclose(scaled[finite], ratio[finite], rtol=1e-7, atol=1e-7)
        np.testing.assert_array_equal(
            test.associated(sets, z, h, rho), test.associated(other, scale * z, h, scale * rho)
        )


def test_as_printed_the_unit_of_length_decides():
    rng = np.random.default_rng(6)
    sets, z, h, rho = cases(rng, 2, 20, 20)
    test = AssociationTest(0.5, 3.0, STATE)
    ratio = test.log_ratio(sets, z, h, rho)
    finite = np.isfinite(ratio)
    changed = {}
    for scale in (100.0, 0.01):
        other = TrackSets(scale * sets.centroid, scale**2 * sets.covariance, scale * sets.matrix)
        scaled = test.log_ratio(other, scale * z, h, scale * rho)
        # A density over four components against one over two.
        np.testing.assert_allclose(
            scaled[finite] - ratio[finite], -2.0 * math.log(scale), rtol=1e-6
        )
        changed[scale] = (
            test.associated(sets, z, h, rho) != test.associated(other, scale * z, h, scale * rho)
        ).sum()
    assert changed[100.0] > 10 or changed[0.01] > 10


def test_an_observation_that_a_member_explains_is_always_associated():
    sets = TrackSets(np.zeros((1, 4)), np.eye(4)[None], np.diag([3.0, 1.0, 1.0, 1.0])[None])
    h = np.eye(2, 4)
    z = np.array([[2.9, 0.0], [3.1, 0.0], [0.0, 0.0], [0.0, 9.0]])
    ratio = AssociationTest(1.0, 3.0).log_ratio(sets, z, h, np.ones(2))
    assert np.isposinf(ratio[0, [0, 2]]).all()
    assert np.isfinite(ratio[0, 1])
    assert np.isneginf(ratio[0, 3])


def test_a_point_set_by_hand():
    # H P H' = R = I: M = I/2 and H P+ H' = I/2; a box of half width 3.
    sets = TrackSets(np.array([[2.0, 1.0]]), np.eye(2)[None], np.zeros((1, 2, 2)))
    integral = 27.0 * (4.0 / 3.0 * math.sqrt(2.0) + 4.0 / 3.0 * math.asinh(1.0))
    expected = -0.25 * 5.0 - math.log(math.pi) - 0.5 * math.log(5.0) + math.log(integral)
    z, one = np.zeros((1, 2)), np.ones(2)
    ratio = AssociationTest(0.5, 3.0).log_ratio(sets, z, np.eye(2), one)
    assert ratio[0, 0] == pytest.approx(expected, abs=1e-9)
    # n = r = 2: both spaces are one.
    printed = AssociationTest(0.5, 3.0, STATE).log_ratio(sets, z, np.eye(2), one)
    assert printed[0, 0] == pytest.approx(expected, abs=1e-9)
    assert np.isneginf(AssociationTest(0.5, 1.9).log_ratio(sets, z, np.eye(2), one)[0, 0])


@pytest.mark.parametrize("rank", [0, 1])
def test_sets_without_area_are_the_limit_of_thin_ones(rank):
    rng = np.random.default_rng(7)
    centre, covariance = np.array([[2.0, 1.5]]), np.array([[[2.0, 0.3], [0.3, 1.0]]])
    flat = np.outer([1.0, -0.4], [1.0, 0.0])[None] * rank
    thin = flat + 1e-7 * rng.standard_normal((1, 2, 2))
    arguments = (np.zeros((1, 2)), np.eye(2), np.array([1.0, 0.7]))
    test = AssociationTest(0.5, 3.0)
    limit = test.log_ratio(TrackSets(centre, covariance, thin), *arguments)
    found = test.log_ratio(TrackSets(centre, covariance, flat), *arguments)
    assert np.isfinite(found).all()
    np.testing.assert_allclose(found, limit, atol=1e-5)


def test_bolder_is_fewer_and_a_larger_region_is_more_feasible():
    rng = np.random.default_rng(8)
    sets, z, h, rho = cases(rng, 2, 30, 30)
    counts = [AssociationTest(b, 3.0).associated(sets, z, h, rho).sum() for b in (0.0, 0.1, 1.0)]
    assert counts[0] > counts[1] > counts[2]
    feasible = [
        np.isneginf(AssociationTest(0.5, t).log_ratio(sets, z, h, rho)).sum() for t in (1.0, 3.0)
    ]
    assert feasible[0] > feasible[1]
    # Timid as can be: all that is seriously possible.
    possible = AssociationTest(0.5, 3.0).log_ratio(sets, z, h, rho) > -np.inf
    np.testing.assert_array_equal(AssociationTest(0.0, 3.0).associated(sets, z, h, rho), possible)


def test_each_pair_is_what_it_is_alone_and_in_any_order():
    rng = np.random.default_rng(9)
    sets, z, h, rho = cases(rng, 2, 5, 6)
    test = AssociationTest(0.5, 3.0)
    together = test.log_ratio(sets, z, h, rho)
    turned = test.log_ratio(sets.select(np.arange(5)[::-1]), z[::-1], h[::-1], rho[::-1])
    np.testing.assert_allclose(turned[::-1, ::-1], together, rtol=1e-9)
    alone = test.log_ratio(sets.select(np.array([3])), z[2:3], h[2], rho[2])
    np.testing.assert_allclose(alone[0, 0], together[3, 2], rtol=1e-9)
    assert test.log_ratio(sets, z[:0], h[:0], rho[:0]).shape == (5, 0)
    assert test.log_ratio(sets.select(np.zeros(0, dtype=int)), z, h, rho).shape == (0, 6)


def test_the_integral_of_distance():
    for a, b in ((1.0, 2.0), (0.3, 5.0), (7.0, 7.0)):
        exact = 4.0 * dblquad(math.hypot, 0.0, a, 0.0, b, epsabs=1e-9, epsrel=1e-9)[0]
        assert distance_integral(np.array([[a, b]]))[0] == pytest.approx(exact, rel=1e-8)
    cube = 8.0 * tplquad(lambda x, y, z: math.sqrt(x * x + y * y + z * z), 0, 1, 0, 2, 0, 0.5)[0]
    assert distance_integral(np.array([[1.0, 2.0, 0.5]]))[0] == pytest.approx(cube, rel=1e-7)
    # The formula for any dimension agrees with the closed one, also for long boxes.
    boxes = np.array([[1.0, 2.0], [3.0, 3.0], [1.0, 500.0]])
    np.testing.assert_allclose(_in_many_dimensions(boxes), distance_integral(boxes), rtol=1e-10)
    assert distance_integral(np.array([[3.0]]))[0] == 9.0


@pytest.mark.parametrize(
    ("values", "match"),
    [
        ({"boldness": 1.5}, "boldness = 1.5: allowed is a number >= 0 and <= 1"),
        ({"boldness": math.nan}, "boldness = nan"),
        ({"theta": 0.0}, "theta = 0.0: allowed is a number > 0"),
        ({"theta": math.inf}, "theta = inf"),
        ({"space": "both"}, "space = 'both': allowed is one of measurement, state"),
    ],
)
def test_what_is_not_allowed_is_refused(values, match):
    with pytest.raises(ValueError, match=match):
        AssociationTest(**values)


def test_arrays_that_do_not_fit_are_refused():
    sets = random_sets(np.random.default_rng(1), 2)
    test = AssociationTest()
    z, h, rho = np.zeros((3, 2)), np.eye(2, 4), np.ones(2)
    with pytest.raises(ValueError, match="observation of shape"):
        test.log_ratio(sets, z[0], h, rho)
    with pytest.raises(ValueError, match="observing of shape"):
        test.log_ratio(sets, z, np.eye(3, 4), rho)
    with pytest.raises(ValueError, match="std of shape"):
        test.log_ratio(sets, z, h, np.ones(3))
    with pytest.raises(ValueError, match="allowed are numbers > 0"):
        test.log_ratio(sets, z, h, np.array([1.0, 0.0]))
    with pytest.raises(ValueError, match="r = 0"):
        distance_integral(np.zeros((1, 0)))
