from __future__ import annotations

import doctest

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.attributes import classes as classes_module
from gda_tracker.attributes.bayes import class_update
from gda_tracker.attributes.classes import class_prediction

SUBMERGED, SNORKELLING = 0, 1
# A submerged boat begins to snorkel with probability 0.1 in a step, and ends with 0.4.
TRANSITION = np.array([[0.9, 0.4], [0.1, 0.6]])
# Likelihood of hearing a diesel: 0.05 submerged, 0.8 snorkelling.
HEARD, SILENT = np.log([0.05, 0.8]), np.log([0.95, 0.2])


def test_the_submarine_by_hand():
    # Mahler 2011, section 7.3. Certainly submerged, then the diesel is heard.
    predicted = class_prediction(np.array([1.0, 0.0]), TRANSITION)
    np.testing.assert_allclose(predicted, [0.9, 0.1])
    updated, log_likelihood = class_update(predicted, HEARD)
    # 0.9 * 0.05 = 0.045, 0.1 * 0.8 = 0.08, sum 0.125.
    np.testing.assert_allclose(updated, [0.36, 0.64], atol=1e-15)
    assert np.exp(log_likelihood) == pytest.approx(0.125, rel=1e-14)
    # 0.9 * 0.36 + 0.4 * 0.64 = 0.58; silence: 0.58 * 0.95 = 0.551, 0.42 * 0.2 = 0.084.
    predicted = class_prediction(updated, TRANSITION)
    np.testing.assert_allclose(predicted, [0.58, 0.42], atol=1e-15)
    updated, _ = class_update(predicted, SILENT)
    np.testing.assert_allclose(updated, [0.551 / 0.635, 0.084 / 0.635], atol=1e-15)


def test_a_boat_that_cannot_change_is_never_believed_to_snorkel():
    belief = np.array([1.0, 0.0])
    for _ in range(5):
        belief, _ = class_update(class_prediction(belief, np.eye(2)), HEARD)
    np.testing.assert_array_equal(belief, [1.0, 0.0])


@settings(derandomize=True, deadline=None, max_examples=20)
@given(st.integers(0, 2**32 - 1), st.integers(2, 4), st.integers(1, 5))
def test_prediction_and_update_equal_the_sum_over_all_paths(seed, classes, steps):
    random = np.random.default_rng(seed)
    transition = random.dirichlet(np.ones(classes), classes).T
    prior = random.dirichlet(np.ones(classes))
    likelihood = random.exponential(size=(steps, classes))
    belief, log_total = prior, 0.0
    for row in likelihood:
        belief, log_likelihood = class_update(class_prediction(belief, transition), np.log(row))
        log_total += log_likelihood
    ends = np.zeros(classes)
    for path in np.ndindex(*[classes] * (steps + 1)):
        weight = prior[path[0]]
        for k in range(steps):
            weight *= transition[path[k + 1], path[k]] * likelihood[k, path[k + 1]]
        ends[path[-1]] += weight
    np.testing.assert_allclose(belief, ends / ends.sum(), rtol=1e-11)
    assert log_total == pytest.approx(np.log(ends.sum()), abs=1e-11)


def test_many_tracks_with_transitions_of_their_own():
    random = np.random.default_rng(1)
    probability = random.dirichlet(np.ones(3), (4, 2))
    transition = random.dirichlet(np.ones(3), (4, 2, 3)).swapaxes(-1, -2)
    found = class_prediction(probability, transition)
    wanted = [[transition[i, j] @ probability[i, j] for j in range(2)] for i in range(4)]
    np.testing.assert_allclose(found, wanted, rtol=1e-14)
    np.testing.assert_allclose(found.sum(axis=-1), 1.0, rtol=1e-14)


def test_bad_transitions_are_refused():
    belief = np.array([0.5, 0.5])
    with pytest.raises(ValueError, match="sum 1 in each column"):
        class_prediction(belief, TRANSITION.T)
    with pytest.raises(ValueError, match=">= 0"):
        class_prediction(belief, np.array([[1.1, 0.0], [-0.1, 1.0]]))
    with pytest.raises(ValueError, match="sum 1"):
        class_prediction(belief, np.full((2, 2), np.nan))
    with pytest.raises(ValueError, match=r"\(\.\.\., C, C\)"):
        class_prediction(belief, np.ones((2, 3)))
    with pytest.raises(ValueError, match="classes of transition"):
        class_prediction(np.full(3, 1 / 3), TRANSITION)


def test_the_example_is_true():
    result = doctest.testmod(classes_module)
    assert result.attempted > 0
    assert result.failed == 0
