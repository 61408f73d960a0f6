"""Extremes of a history: worked values, consistency, and that nothing counts twice."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gda_tracker.kinematics.motion_extremes import (
    accelerations,
    extremes_of,
    more_extreme,
    no_extremes,
    size_of,
)

values = arrays(np.float64, (3, 4), elements=st.floats(0.0, 300.0))
deviations = arrays(np.float64, (3, 4), elements=st.floats(0.1, 20.0))
histories = st.tuples(values, deviations)


def test_worked_values():
    size, std = size_of(np.array([[30.0, 40.0]]), np.diag([4.0, 1.0])[None])
    # Along (0.6, 0.8): 0.36 4 + 0.64 1 = 2.08; across: 5 - 2.08.
    np.testing.assert_allclose([size[0], std[0]], np.sqrt([2500.0 - 2.92, 2.08]))
    time = np.array([0.0, 2.0, 4.0, 7.0])
    velocity = np.array([[[10.0, 0.0]], [[10.0, 4.0]], [[10.0, 8.0]], [[np.nan, 0.0]]])
    covariance = np.broadcast_to(0.5 * np.eye(2), (4, 1, 2, 2))
    size, std, first = accelerations(time, velocity, covariance, 3.0)
    # 4 s after 0 s, and 7 s after 4 s, which is not known: 8/4 with variance 2 0.5/16.
    np.testing.assert_allclose(size[:, 0], [np.sqrt(4.0 - 1.0 / 16.0), np.nan])
    np.testing.assert_allclose(std[0, 0], 0.25)
    assert first.tolist() == [True, False]


def test_an_uncertain_state_does_not_win_by_its_error():
    speed = np.array([[200.0], [230.0]]), np.array([[3.0], [40.0]])
    found = extremes_of(speed, (np.zeros((0, 1)), np.zeros((0, 1))))
    np.testing.assert_array_equal(found[0, :2], [[200.0, 3.0], [200.0, 3.0]])
    assert np.isnan(found[0, 2]).all()


@settings(max_examples=15, deadline=None)
@given(histories, histories)
def test_parts_may_overlap_and_come_in_any_order(one, other):
    """A history heard twice is the history: the errors of its states count once."""
    a, b = (extremes_of(part, part) for part in (one, other))
    whole = extremes_of(*[tuple(np.concatenate(pair) for pair in zip(one, other, strict=True))] * 2)
    np.testing.assert_array_equal(more_extreme(a, a), a)
    np.testing.assert_array_equal(more_extreme(more_extreme(a, b), a), more_extreme(a, b))
    np.testing.assert_array_equal(more_extreme(a, b), whole)
    np.testing.assert_array_equal(more_extreme(a, no_extremes(4)), a)
    np.testing.assert_array_equal(more_extreme(no_extremes(4), a), a)


def test_sizes_are_consistent():
    """(size - true) / std of noisy vectors has mean 0 and variance 1, far from zero."""
    random = np.random.default_rng(1)
    true = np.array([40.0, -25.0])
    # Where the noise is not round the direction's own error counts too, of the second order.
    for covariance, bias in ((5.0 * np.eye(2), 0.002), (np.array([[9.0, 3.0], [3.0, 4.0]]), 0.03)):
        noisy = random.multivariate_normal(true, covariance, 100_000)
        size, std = size_of(noisy, np.broadcast_to(covariance, (len(noisy), 2, 2)))
        normed = (size - np.hypot(*true)) / std
        assert abs(normed.mean()) < 4.0 / np.sqrt(len(normed)) + bias
        assert abs(normed.var() - 1.0) < 0.03
    # At a standstill too nothing greater is told than the deviation explains.
    size, std = size_of(noisy - true, np.broadcast_to(covariance, (len(noisy), 2, 2)))
    assert np.sqrt((size**2).mean()) < 1.3 * std.mean()
