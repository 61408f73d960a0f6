"""Random matrices against Monte Carlo integration, Bayes on samples and worked limits."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2, invwishart, kstest, multivariate_normal
from scipy.stats import t as student

from gda_tracker.kinematics.extended.ellipses import extent_of, rotation
from gda_tracker.kinematics.extended.random_matrix import (
    Cells,
    ExtendedStates,
    cells_of,
    feldmann_log_likelihood,
    feldmann_update,
    koch_update,
    predict,
)

seeds = st.integers(0, 2**32 - 1)
EXTENT = np.array([[3.0, 0.8], [0.8, 1.2]])
KOCH = np.array([[0.4, 0.1], [0.1, 0.3]])


def one(covariance, weight=9.0, extent=EXTENT, mean=(0.3, -0.2, 1.0, 2.0)):
    return ExtendedStates(
        np.array([mean]), np.array([covariance]), np.array([extent]), np.array([weight])
    )


def cell(points, noise=None):
    label = np.zeros(len(points), dtype=np.int64)
    return cells_of(points, label, None if noise is None else np.array([noise] * len(points)))


def sample_extents(rng, states, number):
    weight = states.weight[0]
    return invwishart.rvs(weight + 3.0, weight * states.extent[0], number, random_state=rng)


def log_points(points, centre, covariance):
    """Log prod_j N(z_j; centre, covariance) for M samples of centre and covariance."""
    gap = points[None] - centre[:, None]
    pull = np.einsum("mjd,mde,mje->m", gap, np.linalg.inv(covariance), gap)
    log_det = np.linalg.slogdet(2.0 * np.pi * covariance)[1]
    return -0.5 * (pull + len(points) * log_det)


@pytest.mark.parametrize("spread", [1.0, 0.25])
@pytest.mark.parametrize("n", [1, 4])
def test_koch_is_bayes_on_samples(n, spread):
    """Evidence, mean position and mean extent against importance sampling from the prior."""
    rng = np.random.default_rng(n)
    states = one(KOCH)
    points = rng.multivariate_normal([0.5, 0.1], spread * EXTENT, n)
    extent = sample_extents(rng, states, 25_000)
    centre = states.mean[0, :2] + np.einsum(
        "mde,me->md",
        np.linalg.cholesky(extent) * np.sqrt(KOCH[0, 0]),
        rng.normal(size=(len(extent), 2)),
    )
    likelihood = np.exp(log_points(points, centre, spread * extent))
    updated, log_likelihood = koch_update(states, cell(points), spread)
    evidence = likelihood.mean()
    error = likelihood.std() / np.sqrt(len(likelihood))
    assert np.exp(log_likelihood[0]) == pytest.approx(evidence, abs=4.5 * error)
    share = likelihood / likelihood.sum()
    samples = 1.0 / np.sum(share**2)
    at = share @ centre
    tolerance = 5.0 * np.sqrt(share @ (centre - at) ** 2 / samples)
    assert (np.abs(updated.mean[0, :2] - at) < tolerance).all()
    expected = np.einsum("m,mde->de", share, extent)
    spread_of = np.sqrt(np.einsum("m,mde->de", share, (extent - expected) ** 2) / samples)
    assert (np.abs(updated.extent[0] - expected) < 5.0 * spread_of).all()
    # Var(x | Z) = P~ E[X | Z].
    inner = np.einsum("m,md,me->de", share, centre - at, centre - at)
    assert inner == pytest.approx(
        updated.covariance[0, 0, 0] * updated.extent[0], rel=0.1, abs=0.03
    )


def test_koch_update_is_the_same_at_once_and_one_by_one():
    points = np.random.default_rng(3).normal(size=(6, 2)) * [2.0, 1.0]
    states = one(KOCH)
    at_once, log_at_once = koch_update(states, cell(points), 0.25)
    log_sum = 0.0
    for point in points:
        states, log_one = koch_update(states, cell(point[None]), 0.25)
        log_sum += log_one[0]
    assert log_sum == pytest.approx(log_at_once[0])
    for name in ("mean", "covariance", "extent", "weight"):
        np.testing.assert_allclose(getattr(states, name), getattr(at_once, name), rtol=1e-10)


def plane(width=80.0, points=801):
    """A grid (n, 2), finer towards its middle, and the area that each point stands for."""
    u = np.linspace(-1.0, 1.0, points)
    axis, step = width * u**3, width * 3.0 * u**2 * (u[1] - u[0])
    x, y = np.meshgrid(axis, axis)
    return np.stack([x.ravel(), y.ravel()], axis=1), np.outer(step, step).ravel()


def log_of_pairs(log_of, states, first, points, noise=None):
    """Log likelihood of each of the points together with those of ``first`` (k, 2)."""
    number, k = len(points), len(first) + 1
    sets = np.concatenate([np.tile(first, (number, 1, 1)), points[:, None]], axis=1)
    cells = cells_of(
        sets.reshape(-1, 2),
        np.repeat(np.arange(number), k),
        None if noise is None else np.tile(noise, (number * k, 1, 1)),
    )
    return log_of(states.select(np.zeros(number, dtype=np.int64)), cells)


def test_likelihoods_integrate_to_one():
    """Over one detection; Koch's also over the second given the first."""
    points, area = plane(points=201)
    none, first = np.empty((0, 2)), np.array([[0.9, 0.4]])

    def log_koch(states, cells):
        return koch_update(states, cells, 0.25)[1]

    koch, feldmann = one(KOCH), one(np.diag([0.5, 0.4, 1.0, 1.0]))
    assert area @ np.exp(log_of_pairs(log_koch, koch, none, points)) == pytest.approx(1, abs=2e-3)
    pair = log_of_pairs(log_koch, koch, first, points) - log_koch(koch, cell(first))[0]
    assert area @ np.exp(pair) == pytest.approx(1, abs=2e-3)
    for noise in (np.zeros((2, 2)), 0.5 * np.eye(2)):
        alone = log_of_pairs(feldmann_log_likelihood, feldmann, none, points, noise)
        assert area @ np.exp(alone) == pytest.approx(1, abs=2e-3)


@pytest.mark.parametrize("n", [2, 4])
def test_feldmann_likelihood_of_n_detections_integrates_to_one(n):
    """By importance sampling with a wide Student proposal; the noise does not matter."""
    rng = np.random.default_rng(8)
    states = one(np.diag([0.5, 0.4, 1.0, 1.0]))
    number, freedom = 8_000, 4.0
    points = states.mean[0, :2] + 1.5 * rng.standard_t(freedom, (number, n, 2))
    log_proposal = student.logpdf((points - states.mean[0, :2]) / 1.5, freedom).sum(axis=(1, 2))
    log_proposal -= 2 * n * np.log(1.5)
    many = states.select(np.zeros(number, dtype=np.int64))
    label = np.repeat(np.arange(number), n)
    cells = cells_of(points.reshape(-1, 2), label, np.tile(0.3 * np.eye(2), (number * n, 1, 1)))
    ratio = np.exp(feldmann_log_likelihood(many, cells) - log_proposal)
    assert ratio.mean() == pytest.approx(1.0, abs=4.5 * ratio.std() / np.sqrt(number))


@pytest.mark.parametrize("noise", [0.0, 0.4])
def test_feldmann_likelihood_is_near_the_integral_over_states_and_extents(noise):
    rng = np.random.default_rng(5)
    covariance = np.diag([0.15, 0.1, 1.0, 1.0])
    states = one(covariance, weight=30.0)
    extent = sample_extents(rng, states, 15_000)
    centre = rng.multivariate_normal(states.mean[0, :2], covariance[:2, :2], len(extent))
    sensor = noise * np.eye(2)
    errors = []
    for _ in range(5):
        points = rng.multivariate_normal([0.4, 0.0], 0.25 * EXTENT + sensor, 6)
        exact = np.log(np.exp(log_points(points, centre, 0.25 * extent + sensor)).mean())
        errors.append(feldmann_log_likelihood(states, cell(points, sensor))[0] - exact)
    assert np.abs(errors).max() < 0.25
    assert abs(np.mean(errors)) < 0.05


def test_koch_is_calibrated_on_matched_data():
    """Truth from the prior: position and area of the extent at uniform quantiles, NEES = s."""
    rng = np.random.default_rng(11)
    number = 800
    prior = one(KOCH, weight=8.0)
    extent = sample_extents(rng, prior, number)
    root = np.linalg.cholesky(extent)
    state = np.einsum(
        "ab,mbd,mcd->mac", np.linalg.cholesky(KOCH), rng.normal(size=(number, 2, 2)), root
    ).reshape(number, 4)
    state += prior.mean
    states = prior.select(np.zeros(number, dtype=np.int64))
    for _ in range(3):
        count = 1 + rng.poisson(2.0, number)
        label = np.repeat(np.arange(number), count)
        offset = np.einsum("nde,ne->nd", root[label], rng.normal(size=(len(label), 2)))
        states, _ = koch_update(states, cells_of(state[label, :2] + offset, label))
    gap = (state - states.mean).reshape(number, 2, 2)
    inner = np.linalg.inv(states.covariance)
    nees = np.einsum("nad,nab,nde,nbe->n", gap, inner, np.linalg.inv(extent), gap)
    assert nees.mean() == pytest.approx(4.0, abs=4.5 * np.sqrt(8.0 / number))
    # e' X^-1 e has a Gamma density under the posterior: Wishart marginal.
    freedom = states.weight + 3.0
    ratio = states.weight * np.linalg.inv(extent)[:, 0, 0]
    ratio /= np.linalg.inv(states.extent)[:, 0, 0]
    assert kstest(chi2.cdf(ratio, freedom), "uniform").pvalue > 1e-3


def test_feldmann_kinematics_are_those_of_a_kalman_filter_with_the_extent_as_noise():
    points = np.array([[1.0, 0.0], [0.0, 2.0], [1.5, 1.0]])
    states = one(np.diag([0.5, 0.4, 1.0, 1.0]))
    states.covariance[0, 0, 2] = states.covariance[0, 2, 0] = 0.3
    sensor = 0.2 * np.eye(2)
    updated, _ = feldmann_update(states, cell(points, sensor))
    observation = np.eye(2, 4)
    total = observation @ states.covariance[0] @ observation.T + (0.25 * EXTENT + sensor) / 3.0
    gain = states.covariance[0] @ observation.T @ np.linalg.inv(total)
    residual = points.mean(axis=0) - states.mean[0, :2]
    np.testing.assert_allclose(updated.mean[0], states.mean[0] + gain @ residual)
    np.testing.assert_allclose(
        updated.covariance[0], states.covariance[0] - gain @ total @ gain.T, atol=1e-12
    )


def test_noise_is_not_taken_for_extent():
    """A point target under noise: the extent shrinks; without the noise it would be the noise."""
    rng = np.random.default_rng(2)
    sensor = np.eye(2)
    with_noise = without = one(np.diag([0.01, 0.01, 1e-4, 1e-4]), extent=np.eye(2), mean=[0] * 4)
    for _ in range(60):
        with_noise, without = (
            predict(one_of, np.eye(4), 1e-4 * np.eye(4), 1.0, 10.0)
            for one_of in (with_noise, without)
        )
        points = rng.multivariate_normal([0.0, 0.0], sensor + 0.25 * 0.04 * np.eye(2), 8)
        with_noise = feldmann_update(with_noise, cell(points, sensor))[0]
        without = feldmann_update(without, cell(points))[0]
    assert np.trace(with_noise.extent[0]) < 0.9
    assert np.trace(without.extent[0]) == pytest.approx(8.0, rel=0.25)


def test_prediction_keeps_the_extent_and_forgets_its_certainty():
    states = one(np.eye(4), weight=20.0)
    step = np.eye(4) + np.eye(4, k=2)
    ahead = predict(states, step, 0.1 * np.eye(4), 1.0, 5.0)
    np.testing.assert_allclose(ahead.mean, [[1.3, 1.8, 1.0, 2.0]])
    np.testing.assert_allclose(ahead.extent, states.extent)
    assert ahead.weight[0] == pytest.approx(2.0 + 18.0 * np.exp(-0.2))
    far = predict(states, step, 0.1 * np.eye(4), 1e4, 5.0)
    assert far.weight[0] == pytest.approx(2.0)
    # Two steps forget as one of their length.
    twice = predict(predict(states, step, np.eye(4), 0.4, 5.0), step, np.eye(4), 0.6, 5.0)
    assert twice.weight[0] == pytest.approx(ahead.weight[0])
    turned = predict(states, step, np.eye(4), 1.0, 5.0, rotation(0.5))
    np.testing.assert_allclose(turned.extent[0], rotation(0.5) @ EXTENT @ rotation(-0.5))


def test_koch_prediction_is_that_of_each_coordinate():
    states = one(KOCH)
    ahead = predict(states, np.array([[1.0, 2.0], [0.0, 1.0]]), 0.1 * np.eye(2), 2.0, 5.0)
    np.testing.assert_allclose(ahead.mean, [[2.3, 3.8, 1.0, 2.0]])
    np.testing.assert_allclose(ahead.covariance[0, 1, 1], 0.4)


@settings(max_examples=10, deadline=None)
@given(seeds)
def test_turning_the_axes_turns_the_result(seed):
    """Rotating everything rotates the estimates and leaves the likelihood; any order of tracks."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(5, 2)) * [3.0, 1.0]
    turn = rotation(rng.uniform(-3, 3))
    both = np.kron(np.eye(2), turn)
    covariance = np.diag([0.5, 0.4, 1.0, 1.0])
    sensor = np.diag([0.3, 0.1])
    straight = one(covariance)
    turned = ExtendedStates(
        straight.mean @ both.T,
        both @ straight.covariance @ both.T,
        turn @ EXTENT @ turn.T,
        straight.weight,
    )
    a, log_a = feldmann_update(straight, cell(points, sensor))
    b, log_b = feldmann_update(turned, cell(points @ turn.T, turn @ sensor @ turn.T))
    np.testing.assert_allclose(b.extent[0], turn @ a.extent[0] @ turn.T, atol=1e-9)
    np.testing.assert_allclose(b.mean, a.mean @ both.T, atol=1e-9)
    assert log_a[0] == pytest.approx(log_b[0])


def test_tracks_do_not_influence_each_other():
    rng = np.random.default_rng(4)
    label = np.array([0, 1, 1, 0, 2, 2, 2, -1])
    cells = cells_of(rng.normal(size=(8, 2)), label, np.tile(0.1 * np.eye(2), (8, 1, 1)))
    many = one(np.eye(4)).select(np.zeros(3, dtype=np.int64))
    many.extent = extent_of(np.array([[2, 1], [3, 1], [1, 1]]), np.array([0.1, 0.2, 0.3]))
    together, log_together = feldmann_update(many, cells)
    for i in range(3):
        row = np.array([i])
        alone, log_alone = feldmann_update(many.select(row), cells.select(row))
        np.testing.assert_allclose(alone.extent[0], together.extent[i])
        assert log_alone[0] == pytest.approx(log_together[i])


def test_cells_are_centroid_and_scatter():
    points = np.array([[0.0, 0.0], [2.0, 0.0], [1.0, 3.0], [5.0, 5.0]])
    cells = cells_of(points, np.array([0, 0, 0, 1]))
    np.testing.assert_allclose(cells.centroid, [[1.0, 1.0], [5.0, 5.0]])
    np.testing.assert_allclose(cells.scatter[0], 2.0 * np.cov(points[:3].T))
    np.testing.assert_array_equal(cells.count, [3, 1])
    assert isinstance(cells, Cells)
    with pytest.raises(ValueError, match="cell 1 has no detection"):
        cells_of(points, np.array([0, 0, 2, 2]))
    with pytest.raises(ValueError, match="finite"):
        cells_of(np.array([[np.nan, 0.0]]), np.array([0]))


def test_factorisation_of_the_book():
    """(2.50) = (2.51) x (2.54) up to a constant in x and X."""
    rng = np.random.default_rng(1)
    points = rng.normal(size=(4, 2))
    cells = cell(points)
    ratios = []
    for _ in range(5):
        centre = rng.normal(size=2)
        root = rng.normal(size=(2, 2))
        extent = root @ root.T + np.eye(2)
        direct = multivariate_normal(centre, extent).logpdf(points).sum()
        centroid = multivariate_normal(centre, extent / 4.0).logpdf(cells.centroid[0])
        wishart = -1.5 * np.linalg.slogdet(extent)[1]
        wishart -= 0.5 * np.trace(np.linalg.solve(extent, cells.scatter[0]))
        ratios.append(direct - centroid - wishart)
    np.testing.assert_allclose(ratios, ratios[0])
