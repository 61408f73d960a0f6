import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate, stats

from gda_tracker.attributes import rcs

MODELS = (1, 2, 3, 4)


@pytest.mark.parametrize("swerling", MODELS)
@pytest.mark.parametrize("mean", [0.3, 1.2, 4.0])
def test_density_is_normalised_and_has_the_mean(swerling, mean):
    def moment(power):
        return integrate.quad(lambda s: s**power * rcs.density(s, mean, swerling), 0, np.inf)[0]

    assert moment(0) == pytest.approx(1.0, abs=1e-8)
    assert moment(1) == pytest.approx(mean, rel=1e-7)


@pytest.mark.parametrize("swerling", MODELS)
def test_cumulative_probability_is_the_integral_of_the_density(swerling):
    for s in (0.01, 0.5, 3.0, 20.0):
        integral = integrate.quad(lambda x: float(rcs.density(x, 1.2, swerling)), 0, s)[0]
        assert rcs.cumulative_probability(s, 1.2, swerling) == pytest.approx(integral, abs=1e-8)


def test_formulas_of_the_chapter():
    s = np.linspace(0.0, 30.0, 301)
    for a in (1.2, 4.0):
        np.testing.assert_allclose(
            rcs.density(s, a, 3), 4 * s / a**2 * np.exp(-2 * s / a), atol=1e-15
        )
        np.testing.assert_allclose(
            rcs.cumulative_probability(s, a, 3),
            1 - (1 + 2 * s / a) * np.exp(-2 * s / a),
            atol=1e-14,
        )
    np.testing.assert_allclose(rcs.density(s, 0.3, 2), np.exp(-s / 0.3) / 0.3, atol=1e-15)
    np.testing.assert_allclose(
        rcs.cumulative_probability(s, 0.3, 2), 1 - np.exp(-s / 0.3), atol=1e-14
    )


@settings(deadline=None, max_examples=50)
@given(st.floats(1e-3, 1 - 1e-6), st.floats(1e-3, 1e4), st.sampled_from(MODELS))
def test_inverse_undoes_the_cumulative_probability(probability, mean, swerling):
    s = rcs.inverse_cumulative_probability(probability, mean, swerling)
    assert rcs.cumulative_probability(s, mean, swerling) == pytest.approx(probability, rel=1e-9)


def test_inverse_solves_the_equation_of_the_chapter():
    x = np.linspace(0.01, 0.99, 99)
    y = 2 * rcs.inverse_cumulative_probability(x, 4.0, 3) / 4.0
    np.testing.assert_allclose((1 + y) * np.exp(-y), 1 - x, rtol=1e-10)


@pytest.mark.parametrize(("swerling", "variance"), [(1, 1.0), (2, 1.0), (3, 0.5), (4, 0.5)])
def test_samples_follow_the_model(swerling, variance):
    draws = rcs.sample(np.random.default_rng(7), 4.0, swerling, 100_000)
    assert draws.mean() == pytest.approx(4.0, abs=4 * 4.0 / np.sqrt(100_000))
    assert draws.var() == pytest.approx(variance * 16.0, rel=0.03)
    fit = stats.kstest(draws, lambda s: rcs.cumulative_probability(s, 4.0, swerling))
    assert fit.pvalue > 0.01


def test_a_sample_is_one_uniform_put_through_the_inverse():
    means, models = np.array([0.3, 1.2, 4.0]), np.array([2, 3, 3])
    draws = rcs.sample(np.random.default_rng(3), means, models)
    uniforms = np.random.default_rng(3).random(3)
    np.testing.assert_array_equal(
        draws, rcs.inverse_cumulative_probability(uniforms, means, models)
    )


def test_log_density_at_and_beyond_the_edges():
    assert rcs.log_density(-1.0, 1.2, 3) == -np.inf
    assert rcs.log_density(0.0, 1.2, 3) == -np.inf
    assert rcs.log_density(0.0, 0.3, 2) == pytest.approx(-np.log(0.3))
    # Far in the tail the density underflows, its log does not.
    assert rcs.log_density(1e6, 0.3, 2) == pytest.approx(-np.log(0.3) - 1e6 / 0.3)


def test_arguments_broadcast():
    values = rcs.log_density(np.array([[0.1], [2.0]]), np.array([0.3, 1.2, 4.0]), [2, 3, 3])
    assert values.shape == (2, 3)
    assert values[1, 2] == rcs.log_density(2.0, 4.0, 3)


@pytest.mark.parametrize("swerling", [0, 5, -1, 2.5])
def test_other_models_are_refused(swerling):
    with pytest.raises(ValueError, match="allowed are 1, 2, 3, 4"):
        rcs.log_density(1.0, 1.0, swerling)
