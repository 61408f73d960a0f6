import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.attributes.bayes import class_update, forget, log_class_mixture


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 2**32 - 1))
def test_bayes_rule_in_logs_is_bayes_rule(seed):
    random = np.random.default_rng(seed)
    prior = random.dirichlet(np.ones(4), 6)
    likelihood = random.exponential(size=(6, 4))
    posterior, log_likelihood = class_update(prior, np.log(likelihood))
    total = (prior * likelihood).sum(axis=1)
    np.testing.assert_allclose(posterior, prior * likelihood / total[:, None], rtol=1e-12)
    np.testing.assert_allclose(log_likelihood, np.log(total), atol=1e-12)
    np.testing.assert_array_equal(log_class_mixture(prior, np.log(likelihood)), log_likelihood)


def test_likelihoods_that_underflow_still_decide():
    posterior, log_likelihood = class_update(
        np.array([[0.5, 0.5, 0.0]]), np.array([[-5000.0, -5001.0, 0.0]])
    )
    odds = np.exp(-1.0)
    np.testing.assert_allclose(posterior, [[1 / (1 + odds), odds / (1 + odds), 0.0]])
    assert log_likelihood[0] == pytest.approx(-5000.0 + np.log(0.5 * (1 + odds)))


def test_an_impossible_attribute_keeps_the_history():
    history = np.array([[1.0, 0.0], [0.5, 0.5]])
    with np.errstate(all="raise"):
        posterior, log_likelihood = class_update(history, np.array([[-np.inf, 2.0], [0.0, 0.0]]))
    np.testing.assert_array_equal(posterior, history)
    assert log_likelihood[0] == -np.inf
    assert log_likelihood[1] == 0.0


def test_forgetting_spreads_over_the_possible_classes():
    forgotten = forget(np.array([[0.0, 0.9, 0.1], [0.0, 1.0, 0.0]]), 0.8)
    np.testing.assert_allclose(forgotten, [[0.0, 0.82, 0.18], [0.0, 1.0, 0.0]])


def test_no_rows():
    posterior, log_likelihood = class_update(np.zeros((0, 3)), np.zeros((0, 3)))
    assert posterior.shape == (0, 3)
    assert log_likelihood.shape == (0,)
