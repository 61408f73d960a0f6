import numpy as np
import pytest
from scipy import stats

from gda_tracker.attributes.memberships import (
    DensityMembership,
    HistogramMembership,
    HistogramSettings,
)
from gda_tracker.attributes.rcs import cumulative_probability, density

MEANS, MODELS = [0.3, 1.2, 4.0], [2, 3, 3]


def histogram(**changes):
    return HistogramMembership(MEANS, MODELS, HistogramSettings(**changes))


def test_bins_hold_the_share_of_draws():
    membership = histogram()
    assert membership.grades.shape == (3, 300)
    share = np.diff(
        cumulative_probability(membership.edges_m2, np.array(MEANS)[:, None], [[2], [3], [3]]),
        axis=1,
    )
    # Binomial counts: no bin of 10000 draws is off by five standard deviations.
    deviation = np.sqrt(share * (1 - share) / 10_000)
    assert (np.abs(membership.grades - share) <= 5 * deviation + 1e-4).all()
    assert membership.grades.sum(axis=1) == pytest.approx([1.0, 1.0, 1.0], abs=1e-3)


def test_many_draws_in_narrow_bins_come_close_to_the_density():
    membership = histogram(n_draws=500_000, bin_width_m2=0.05)
    s = np.linspace(0.1, 8.0, 400)
    grades = membership(s)
    exact = DensityMembership(MEANS, MODELS)(s)
    np.testing.assert_allclose(
        grades / grades.sum(axis=1, keepdims=True),
        exact / exact.sum(axis=1, keepdims=True),
        atol=0.05,
    )


def test_draws_are_made_class_after_class_from_one_seed():
    uniforms = np.random.default_rng(2004).random((3, 10_000))
    # The inverse cumulative probability of the gamma distribution, from another library function.
    draws = [
        stats.gamma.ppf(u, shape, scale=mean / shape)
        for u, shape, mean in zip(uniforms, (1, 2, 2), MEANS, strict=True)
    ]
    counts = [np.histogram(d, 300, (0.0, 30.0))[0] for d in draws]
    np.testing.assert_allclose(histogram().grades, np.array(counts) / 10_000, atol=1.01e-4)
    assert not np.array_equal(histogram(seed=1).grades, histogram().grades)
    np.testing.assert_array_equal(histogram().grades, histogram().grades)


def test_peak_normalisation_makes_each_maximum_one():
    area, peak = histogram(), histogram(normalisation="peak")
    np.testing.assert_array_equal(peak.grades.max(axis=1), 1.0)
    np.testing.assert_allclose(
        peak.grades * area.grades.max(axis=1, keepdims=True), area.grades, atol=1e-15
    )


def test_linear_interpolation_between_centres():
    membership = histogram()
    centres = np.array([0.05, 0.15, 1.25, 29.95])
    rows = membership.grades[:, [0, 1, 12, 299]].T
    np.testing.assert_allclose(membership(centres)[:3], rows[:3], atol=1e-15)
    np.testing.assert_allclose(
        membership(np.array([0.10]))[0], 0.5 * (rows[0] + rows[1]), atol=1e-15
    )
    # Left of the first centre the first bin holds: a tiny RCS is very small, not big.
    np.testing.assert_array_equal(membership(np.array([0.001]))[0], rows[0])


def test_nearest_takes_the_bin():
    membership = histogram(interpolation="nearest")
    np.testing.assert_array_equal(
        membership(np.array([0.0, 0.02, 0.099, 0.101])), membership.grades[:, [0, 0, 0, 1]].T
    )


@pytest.mark.parametrize("interpolation", ["linear", "nearest"])
def test_where_all_grades_are_zero_the_largest_class_is_certain(interpolation):
    membership = histogram(interpolation=interpolation)
    np.testing.assert_array_equal(membership(np.array([31.0, 1e5])), [[0, 0, 1], [0, 0, 1]])
    gap = np.flatnonzero(~membership.grades.any(axis=0))
    assert len(gap)
    np.testing.assert_array_equal(membership(membership.edges_m2[gap[-1:]] + 0.05), [[0, 0, 1]])


def test_the_largest_class_need_not_be_the_last():
    membership = HistogramMembership([0.3, 4.0, 1.2], MODELS, HistogramSettings())
    np.testing.assert_array_equal(membership(np.array([50.0])), [[0, 1, 0]])


def test_a_width_that_does_not_divide_the_range_cuts_the_last_bin():
    membership = histogram(bin_width_m2=0.7, max_rcs_m2=2.0)
    np.testing.assert_allclose(membership.edges_m2, [0.0, 0.7, 1.4, 2.0])
    assert membership.grades.shape == (3, 3)


def test_densities_are_exact_and_never_all_zero():
    membership = DensityMembership(MEANS, MODELS)
    s = np.array([0.01, 1.0, 10.0])
    np.testing.assert_allclose(membership(s), density(s[:, None], MEANS, MODELS))
    np.testing.assert_array_equal(membership(np.array([1e6])), [[0, 0, 1]])


def test_beyond_underflow_the_slowest_density_wins():
    # exp(-s/3) falls off slower than exp(-2s/4).
    membership = DensityMembership([3.0, 4.0], [2, 3])
    np.testing.assert_array_equal(membership(np.array([1e5])), [[1, 0]])
