"""Several sensors at one time, against the filter that takes them one after the other."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from gda_tracker.kinematics.measurement_fusion import (
    cumulative_detection_probability,
    effective_measurement,
    mean_update_interval,
)


def test_equal_sensors_follow_the_square_root_law():
    value = np.array([[1.0, 2.0], [3.0, 6.0], [5.0, 1.0]])
    noise = np.tile(np.array([[4.0, 1.0], [1.0, 9.0]]), (3, 1, 1))
    fused, covariance, _ = effective_measurement(value, noise)
    np.testing.assert_allclose(fused, value.mean(axis=0))
    np.testing.assert_allclose(covariance, noise[0] / 3.0)


def test_the_product_of_likelihoods_is_that_of_the_effective_measurement():
    """(2.25) equals (2.26) times a factor that does not depend on the state."""
    rng = np.random.default_rng(2)
    value = rng.normal(size=(4, 3, 2))
    root = rng.normal(size=(4, 3, 2, 2))
    noise = root @ root.swapaxes(-1, -2) + 0.1 * np.eye(2)
    fused, covariance, log_factor = effective_measurement(value, noise)
    for row in range(4):
        for state in rng.normal(size=(5, 2)):
            each = [
                multivariate_normal.logpdf(state, value[row, s], noise[row, s]) for s in range(3)
            ]
            one = multivariate_normal.logpdf(state, fused[row], covariance[row])
            assert sum(each) == pytest.approx(one + log_factor[row])


def test_cumulative_detection():
    """(2.29), (2.30) by hand: intervals 2 and 6 s make 1.5 s, with 3/4 and 1/4 looks."""
    assert mean_update_interval([2.0, 6.0]) == pytest.approx(1.5)
    found = cumulative_detection_probability([0.9, 0.6], [2.0, 6.0])
    assert found == pytest.approx(1.0 - 0.1**0.75 * 0.4**0.25)
    assert cumulative_detection_probability([0.9, 0.6]) == pytest.approx(0.96)


@pytest.mark.parametrize(
    "call",
    [
        lambda: mean_update_interval([]),
        lambda: mean_update_interval([0.0]),
        lambda: cumulative_detection_probability([1.1]),
        lambda: cumulative_detection_probability([0.5], [1.0, 2.0]),
    ],
)
def test_what_is_not_allowed_is_named(call):
    with pytest.raises(ValueError, match="allowed are"):
        call()
