"""Gaussian sums from single measurements, against the posterior on a grid."""

from __future__ import annotations

import numpy as np
import pytest
from measurement_examples import MODELS, noise_of, observed_at, sites_of

from gda_tracker.kinematics.gaussian_sum_starts import Reach, start_sums
from gda_tracker.kinematics.measurement_kinds import MEASUREMENT_MODELS
from gda_tracker.kinematics.measurement_models import measure

REACH = Reach(nearest_m=800.0, farthest_m=30_000.0, components=16, max_speed_mps=300.0)
STARTING = [model for model in MODELS if model.starts]
STATE = np.array([[14_000.0, 9_000.0, -120.0, 70.0]])


@pytest.mark.parametrize("model", STARTING, ids=lambda model: model.name)
def test_the_truth_lies_where_the_sum_has_weight(model):
    """The density at the truth is not far below the highest, and the sum is as wide as it says."""
    sums = start_sums(observed_at(model, STATE), REACH)
    assert sums.weight.sum(axis=1) == pytest.approx(1.0)
    assert (np.linalg.eigvalsh(sums.covariance[0]) > 0.0).all()
    gap = STATE[0] - sums.mean[0]
    squared = np.einsum("ki,kij,kj->k", gap, np.linalg.inv(sums.covariance[0]), gap)
    assert squared.min() < 9.0


@pytest.mark.parametrize("name", ["bearing", "range", "bistatic", "tdoa"])
def test_the_sum_is_the_posterior_of_a_target_anywhere_in_reach(name):
    """Its density over the plane against the normalised likelihood: most of the weight agrees."""
    model = MEASUREMENT_MODELS[name]
    noise = 900.0 * noise_of(model)  # wide enough for a grid
    seen = observed_at(model, STATE)
    seen.noise = np.tile(noise, (1, 1, 1))
    sums = start_sums(seen, REACH)
    axis = np.linspace(-42_000.0, 52_000.0, 260)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    grid = np.stack([x, y, 0 * x, 0 * x], axis=-1).reshape(-1, 4)
    middle = sites_of(model).position_m.mean(axis=0)
    distance = np.hypot(*(grid[:, :2] - middle).T)
    gap = seen.value[0, 0] - measure(model, sites_of(model), grid)[:, 0]
    if name == "bearing":
        gap = (gap + np.pi) % (2 * np.pi) - np.pi
    wanted = np.exp(-0.5 * gap**2 / noise[0, 0])
    if name in ("bearing", "tdoa"):
        wanted = wanted * (distance <= REACH.farthest_m)
    wanted /= wanted.sum()
    found = np.zeros(len(grid))
    for weight, mean, covariance in zip(
        sums.weight[0], sums.mean[0], sums.covariance[0], strict=True
    ):
        step = grid[:, :2] - mean[:2]
        spread = covariance[:2, :2]
        squared = np.einsum("ni,ij,nj->n", step, np.linalg.inv(spread), step)
        found += weight * np.exp(-0.5 * squared) / np.sqrt(np.linalg.det(spread))
    found /= found.sum()
    assert 0.5 * np.abs(found - wanted).sum() < 0.25


def test_a_frequency_difference_takes_weight_from_a_part_of_the_hyperbola():
    with_rate = start_sums(observed_at(MEASUREMENT_MODELS["tdoa_fdoa"], STATE), REACH)
    without = start_sums(observed_at(MEASUREMENT_MODELS["tdoa"], STATE), REACH)
    entropy = [-(s.weight * np.log(s.weight + 1e-300)).sum() for s in (with_rate, without)]
    assert entropy[0] < entropy[1]


def test_a_difference_beyond_the_base_line_lies_on_its_extension():
    """Noise may make the difference larger than the sensors are apart."""
    model = MEASUREMENT_MODELS["tdoa"]
    seen = observed_at(model, STATE)
    seen.value[:] = 20_000.0
    sums = start_sums(seen, REACH)
    assert np.isfinite(sums.mean).all()
    first, second = sites_of(model).position_m
    beyond = (sums.mean[0, :, :2] - second) @ (second - first)
    assert (beyond > 0.0).mean() > 0.9


def test_range_rates_alone_bound_no_position():
    with pytest.raises(ValueError, match="fdoa"):
        start_sums(observed_at(MEASUREMENT_MODELS["fdoa"], STATE), REACH)
