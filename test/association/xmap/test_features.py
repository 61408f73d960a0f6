"""Features: closed forms against quadrature over the feature's state."""

from __future__ import annotations

import numpy as np
import pytest
from xmap_references import quadrature_feature

from gda_tracker.association.xmap.features import log_feature_density
from gda_tracker.association.xmap.model import GAUSSIAN, VON_MISES, FeatureModel


def random_model(rng, kind, sensors=4, types=2):
    shape = (sensors, types)
    present, absent = rng.uniform(0.5, 1.0, shape), rng.uniform(0.0, 0.5, shape)
    return FeatureModel(
        kind=kind,
        exists=rng.uniform(0.3, 1.0, types),
        obeys_model=rng.uniform(0.5, 1.0, shape),
        declared_if_present=present,
        declared_if_absent=absent,
        missing_if_present=1.0 - present,
        missing_if_absent=1.0 - absent,
        std=rng.uniform(0.1, 0.6, shape),
        jump_probability=rng.uniform(0.0, 0.5, shape) if kind == VON_MISES else np.zeros(shape),
        prior_mean=rng.normal(size=types),
        prior_std=rng.uniform(0.5, 3.0, types),
    )


@pytest.mark.parametrize("kind", [GAUSSIAN, VON_MISES])
@pytest.mark.parametrize("seed", range(12))
def test_densities_equal_quadrature(kind, seed):
    rng = np.random.default_rng(seed)
    model = random_model(rng, kind)
    sensors = tuple(np.sort(rng.permutation(4)[: rng.integers(1, 5)]).tolist())
    values = rng.normal(size=len(sensors)) * 2.0
    values[rng.random(len(values)) < 0.3] = np.nan
    for t in range(2):
        ours = float(log_feature_density(model, sensors, values, t))
        literal = quadrature_feature(model, sensors, values, t)
        assert ours == pytest.approx(np.log(literal), abs=1e-9)


def test_sharp_features_do_not_underflow():
    model = FeatureModel(
        VON_MISES,
        np.ones(1),
        *(np.ones((2, 1)) for _ in range(5)),
        std=np.full((2, 1), 0.01),
        jump_probability=np.zeros((2, 1)),
        prior_mean=np.zeros(1),
        prior_std=np.ones(1),
    )
    found = float(log_feature_density(model, (0, 1), np.array([0.0, np.pi]), 0))
    # exp(-20000) is no number; the logarithm is: I0(0) / I0(10^4)^2 / (2 pi)^2.
    log_i0 = 1e4 - 0.5 * np.log(2 * np.pi * 1e4) + np.log1p(1 / 8e4 + 9 / 128e8)
    assert found == pytest.approx(-2 * log_i0 - 2 * np.log(2 * np.pi), rel=1e-12)


def test_values_missing_everywhere_say_nothing_where_the_sensor_does_not_say_how():
    rng = np.random.default_rng(1)
    model = random_model(rng, GAUSSIAN, types=1)
    silent = FeatureModel(
        **{
            **vars(model),
            "exists": np.ones(1),
            "missing_if_present": np.ones((4, 1)),
            "missing_if_absent": np.ones((4, 1)),
        }
    )
    nothing = np.array([np.nan, np.nan])
    assert float(log_feature_density(silent, (0, 1), nothing, 0)) == pytest.approx(0.0, abs=1e-12)
