"""Sensor models: values by hand, derivatives, likelihoods against Monte Carlo, consistency."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from measurement_examples import MODELS, noise_of, sites_of

from gda_tracker.kinematics.measurement_kinds import MEASUREMENT_MODELS, MeasurementModel
from gda_tracker.kinematics.measurement_models import (
    Sites,
    compare,
    derivatives,
    expected,
    measure,
    update,
)
from gda_tracker.kinematics.sensor_models import wrap_angle

BY_NAME = pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
PLACE = st.floats(-3e4, 3e4)
SPEED = st.floats(-300.0, 300.0)


def test_values_by_hand():
    """3-4-5 triangles, (2.20)-(2.23)."""
    sites = Sites(np.array([[0.0, 0.0], [6.0, 0.0]]), np.array([[1.0, 0.0], [0.0, 2.0]]))
    state = np.array([3.0, 4.0, 2.0, 1.0])  # 5 m from both; relative (1, 1) and (2, -1)
    first, second = (3 * 1 + 4 * 1) / 5, (-3 * 2 + 4 * -1) / 5
    found = {model.name: measure(model, sites, state) for model in MODELS if model.has_reference}
    assert found["tdoa_fdoa"] == pytest.approx([0.0, first - second])
    assert found["bistatic_doppler"] == pytest.approx([10.0, first + second])
    assert found["fdoa"] == pytest.approx([first - second])
    alone = Sites(sites.position_m[:1], sites.velocity_mps[:1])
    doppler = measure(MEASUREMENT_MODELS["doppler"], alone, state)
    assert doppler == pytest.approx([5.0, math.atan2(4.0, 3.0), first])


@BY_NAME
@settings(max_examples=25)
@given(x=PLACE, y=PLACE, vx=SPEED, vy=SPEED)
def test_derivatives_are_those_of_finite_differences(model, x, y, vx, vy):
    sites = sites_of(model)
    state = np.array([x, y, vx, vy])
    if np.hypot(*(sites.position_m - state[:2]).T).min() < 200.0:
        return
    first, second = derivatives(model, sites, state[None])
    step = np.array([0.5, 0.5, 0.5, 0.5])
    ends = state + np.concatenate([np.diag(step), -np.diag(step)])
    values = measure(model, sites, ends)
    gap = values[:4] - values[4:]
    if "azimuth" in model.quantities:
        place = model.quantities.index("azimuth")
        gap[:, place] = wrap_angle(gap[:, place])
    np.testing.assert_allclose(first[0].T, gap / (2 * step[:, None]), rtol=1e-4, atol=2e-5)
    slopes, _ = derivatives(model, sites, ends)
    bent = (slopes[:4] - slopes[4:]) / (2 * step[:, None, None])
    np.testing.assert_allclose(second[0], bent.transpose(1, 2, 0), rtol=1e-3, atol=1e-6)


def _state_and_spread() -> tuple[np.ndarray, np.ndarray]:
    mean = np.array([[14_000.0, 9_000.0, -120.0, 70.0]])
    root = np.diag([500.0, 300.0, 30.0, 20.0])
    root[2, 0] = 9.0
    return mean, (root @ root.T)[None]


@BY_NAME
def test_the_likelihood_is_that_of_monte_carlo(model: MeasurementModel):
    """p(z) = E[N(z; h(x), R)] over the state, at measurements that the state brings about."""
    rng = np.random.default_rng(5)
    mean, covariance = _state_and_spread()
    covariance /= 9.0
    sites, noise = sites_of(model), noise_of(model)
    draws = rng.multivariate_normal(mean[0], covariance[0], 60_000)
    seen = measure(model, sites, draws)
    value = seen[:15] + rng.multivariate_normal(np.zeros(len(model)), noise, 15)
    of = expected(model, sites, mean, covariance).select(np.zeros(15, dtype=int))
    found = compare(of, value, np.tile(noise, (15, 1, 1))).log_likelihood()
    inverse = np.linalg.inv(noise)
    constant = 0.5 * np.linalg.slogdet(2.0 * np.pi * noise)[1]
    for one, log_likelihood in zip(value, found, strict=True):
        gap = one - seen
        each = np.exp(-0.5 * np.einsum("ni,ij,nj->n", gap, inverse, gap) - constant)
        error = each.std() / math.sqrt(len(each)) / each.mean()
        # The rest is what the third order leaves.
        assert log_likelihood == pytest.approx(math.log(each.mean()), abs=4 * error + 0.03)


@BY_NAME
def test_the_likelihood_integrates_to_one(model: MeasurementModel):
    """By quadrature over seven deviations of each quantity in its own unit."""
    mean, covariance = _state_and_spread()
    sites, noise = sites_of(model), noise_of(model)
    of = expected(model, sites, mean, covariance)
    at = compare(of, of.value.copy(), noise[None])
    width = 7.0 * np.sqrt(np.diagonal(at.covariance[0]))
    count = 35 if len(model) == 3 else 61
    axes = [np.linspace(-w, w, count) for w in width]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(model))
    rows = np.zeros(len(grid), dtype=int)
    centre = measure(model, sites, mean)
    pair = compare(of.select(rows), centre + grid, np.tile(noise, (len(grid), 1, 1)))
    cell = math.prod(axis[1] - axis[0] for axis in axes)
    assert np.exp(pair.log_likelihood()).sum() * cell == pytest.approx(1.0, abs=2e-3)


@settings(max_examples=20)
@given(spread_m=st.floats(10.0, 20_000.0))
def test_a_bearing_integrates_to_one_over_a_turn_however_wide_it_is(spread_m):
    model = MEASUREMENT_MODELS["bearing"]
    mean = np.array([[2_000.0, 300.0, 0.0, 0.0]])
    covariance = np.diag([100.0, spread_m, 1.0, 1.0])[None] ** 2
    of = expected(model, sites_of(model), mean, covariance)
    count = 4_000
    angle = (np.arange(count) + 0.5) / count * 2.0 * math.pi - math.pi
    noise = np.full((count, 1, 1), 1e-4)
    if of.covariance[0, 0, 0] > 30.0:
        return  # flat: more turns than are summed
    pair = compare(of.select(np.zeros(count, dtype=int)), angle[:, None], noise)
    total = np.exp(pair.log_likelihood()).sum() * 2.0 * math.pi / count
    assert total == pytest.approx(1.0, abs=1e-3)


@BY_NAME
def test_an_update_is_consistent(model: MeasurementModel):
    """Errors after one update are as large as the filter says: mean NEES within its 99.9 %."""
    rng = np.random.default_rng(11)
    mean, covariance = _state_and_spread()
    sites, noise, count = sites_of(model), noise_of(model), 4_000
    truth = rng.multivariate_normal(mean[0], covariance[0], count)
    error = rng.multivariate_normal(np.zeros(len(model)), noise, count)
    value = measure(model, sites, truth) + error
    means, spreads = np.tile(mean, (count, 1)), np.tile(covariance, (count, 1, 1))
    of = expected(model, sites, means, spreads)
    pair = compare(of, value, np.tile(noise, (count, 1, 1)))
    nis = pair.squared().mean()
    assert nis == pytest.approx(len(model), abs=4.0 * math.sqrt(2.0 * len(model) / count) + 0.02)
    found, spread = update(means, spreads, pair)
    gap = truth - found
    nees = np.einsum("ni,nij,nj->n", gap, np.linalg.inv(spread), gap).mean()
    assert nees == pytest.approx(4.0, abs=3.3 * math.sqrt(8.0 / count) + 0.05)


def test_the_rotated_frame_bears_a_prediction_that_knows_the_position_badly():
    """Far off across the line of sight, Taylor at the prediction takes a wrong direction."""
    rng = np.random.default_rng(3)
    truth = np.array([4_000.0, 0.0, 0.0, 150.0])
    spread = np.diag([1_500.0, 1_500.0, 100.0, 100.0])[None] ** 2
    count = 2_000
    means = truth + rng.multivariate_normal(np.zeros(4), spread[0], count)
    noise = np.diag([20.0, 0.005, 0.5]) ** 2
    sites = Sites(np.zeros((1, 2)), np.zeros((1, 2)))
    model, turned = MEASUREMENT_MODELS["doppler"], MEASUREMENT_MODELS["doppler_rotated"]
    value = measure(model, sites, truth) + rng.multivariate_normal(np.zeros(3), noise, count)
    nees = {}
    for each in (model, turned):
        spreads = np.tile(spread, (count, 1, 1))
        of = expected(each, sites, means, spreads)
        pair = compare(of, value, np.tile(noise, (count, 1, 1)))
        found, after = update(means, spreads, pair)
        rate = found[:, 2] - truth[2]
        nees[each.name] = float(np.mean(rate**2)) ** 0.5
        assert (
            np.mean(np.einsum("ni,nij,nj->n", gap := truth - found, np.linalg.inv(after), gap)) < 9
        )
    assert nees["doppler_rotated"] < 0.5 * nees["doppler"]


def test_a_state_of_other_size_is_refused():
    model = MEASUREMENT_MODELS["range"]
    mean, covariance = _state_and_spread()
    of = expected(model, sites_of(model), mean, covariance)
    pair = compare(of, of.value, noise_of(model)[None])
    with pytest.raises(ValueError, match="states of 5 components"):
        update(np.zeros((1, 5)), np.eye(5)[None], pair)
