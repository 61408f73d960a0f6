"""Unresolved targets against quadrature of the likelihood as it is written."""

import itertools

import numpy as np
import pytest
from scipy.stats import norm

from gda_tracker.association.unresolved import (
    ResolutionSensor,
    expected_unresolved_probability,
    interpretations,
    resolution_covariance,
    resolution_hypotheses,
    structure,
    terms,
    unresolved_probability,
)
from gda_tracker.association.unresolved_tracker import UnresolvedTracker

PD, PDU, RHO, R, RG, RU = 0.85, 0.9, 0.3, 0.2, 0.3, 1.4


def sensor(limited=True, clutter=RHO):
    return ResolutionSensor(
        np.eye(1),
        np.array([[R]]),
        np.array([[RG]]),
        PD,
        PDU,
        clutter,
        np.array([[RU]]) if limited else None,
    )


def pair_likelihood(x1, x2, z, rho=RHO):
    """The formula of two targets, written out."""
    pu = np.exp(-0.5 * (x1 - x2) ** 2 / RU)

    def n(value, at, variance):
        return norm.pdf(value, at, np.sqrt(variance))

    m = len(z)
    total = rho**m * (pu * (1 - PDU) + (1 - pu) * (1 - PD) ** 2)
    for zj in z:
        single = n(zj, x1, R) + n(zj, x2, R)
        group = n(zj, (x1 + x2) / 2, RG)
        total = total + rho ** (m - 1) * (pu * PDU * group + (1 - pu) * PD * (1 - PD) * single)
    for zi, zj in itertools.permutations(z, 2):
        total = total + rho ** (m - 2) * (1 - pu) * PD**2 * n(zi, x1, R) * n(zj, x2, R)
    return total


MEAN = np.array([0.4, -0.5])
COVARIANCE = np.array([[0.8, 0.2], [0.2, 0.5]])


def grid(size=2, points=241, width=6.0):
    axis = np.linspace(-width, width, points)
    each = np.stack(np.meshgrid(*[axis] * size, indexing="ij"), axis=-1).reshape(-1, size)
    return each, (axis[1] - axis[0]) ** size


def prior_density(x, mean, covariance):
    gap = x - mean
    pull = np.einsum("nd,de,ne->n", gap, np.linalg.inv(covariance), gap)
    return np.exp(-0.5 * pull) / np.sqrt(np.linalg.det(2 * np.pi * covariance))


def moments_of(found):
    weight = np.exp(found.log_weight)
    if hasattr(found, "sign"):
        weight = weight * found.sign
    total = weight.sum()
    mean = weight @ found.mean / total
    gap = found.mean - mean
    inner = found.covariance + gap[:, :, None] * gap[:, None, :]
    return total, mean, np.einsum("t,txy->xy", weight, inner) / total


@pytest.mark.parametrize("z", [[], [0.1], [0.5, -0.7], [0.2, 1.0, -2.0]])
def test_two_targets_against_quadrature(z):
    x, cell = grid()
    density = prior_density(x, MEAN, COVARIANCE) * pair_likelihood(x[:, 0], x[:, 1], z) * cell
    total = density.sum()
    mean = density @ x / total
    covariance = np.einsum("n,na,nb->ab", density, x - mean, x - mean) / total
    detections = np.array(z).reshape(-1, 1)
    exact = terms(MEAN[None], COVARIANCE[None], detections, sensor())
    assert (exact.sign < 0).any()
    merged = interpretations(np.zeros(1), MEAN[None], COVARIANCE[None], detections, sensor())
    for found in (exact, merged):
        got = moments_of(found)
        assert got[0] == pytest.approx(total, rel=1e-6)
        np.testing.assert_allclose(got[1], mean, atol=1e-6)
        np.testing.assert_allclose(got[2], covariance, atol=1e-6)
    assert (np.linalg.eigvalsh(merged.covariance) > 0).all()


def test_three_targets_against_every_graph_of_links():
    """The likelihood by its story: who is linked, which groups are seen, and in which detection."""
    x, cell = grid(3, 51, 5.0)
    mean, covariance = np.array([0.4, -0.5, 1.2]), 0.4 * np.eye(3) + 0.1
    z = [0.3, 1.0]
    total = np.zeros(len(x))
    pairs = list(itertools.combinations(range(3), 2))
    pu = {p: np.exp(-0.5 * (x[:, p[0]] - x[:, p[1]]) ** 2 / RU) for p in pairs}
    for linked in itertools.product((0, 1), repeat=3):
        chance = np.prod(
            [pu[p] if k else 1 - pu[p] for p, k in zip(pairs, linked, strict=True)], axis=0
        )
        groups = {0: {0}, 1: {1}, 2: {2}}
        for (a, b), k in zip(pairs, linked, strict=True):
            if k:
                joined = groups[a] | groups[b]
                for i in joined:
                    groups[i] = joined
        parts = {tuple(sorted(g)) for g in groups.values()}
        for choice in itertools.product(range(-1, 2), repeat=len(parts)):
            taken = [j for j in choice if j >= 0]
            if len(set(taken)) < len(taken):
                continue
            value = chance * RHO ** (2 - len(taken))
            for part, j in zip(parts, choice, strict=True):
                seen, noise = (PD, R) if len(part) == 1 else (PDU, RG)
                if j < 0:
                    value = value * (1 - seen)
                else:
                    value = value * seen * norm.pdf(z[j], x[:, part].mean(axis=1), np.sqrt(noise))
            total += value
    density = prior_density(x, mean, covariance) * total * cell
    exact = terms(mean[None], covariance[None], np.array(z)[:, None], sensor())
    got = moments_of(exact)
    assert got[0] == pytest.approx(density.sum(), rel=1e-4)
    np.testing.assert_allclose(got[1], density @ x / density.sum(), atol=1e-3)


def test_the_likelihood_integrates_to_one():
    """Without clutter: nothing, one or two detections, at fixed states far apart, near, at one."""
    axis = np.linspace(-9, 9, 721)
    step = axis[1] - axis[0]
    tiny = 1e-9
    for x1, x2 in ((3.0, -3.0), (0.5, -0.2), (0.0, 0.0)):
        state, sharp = np.array([[x1, x2]]), 1e-10 * np.eye(2)[None]
        none = moments_of(terms(state, sharp, np.empty((0, 1)), sensor(clutter=tiny)))[0]
        one = sum(
            moments_of(terms(state, sharp, np.array([[z]]), sensor(clutter=tiny)))[0]
            for z in axis[::4]
        )
        pairs = pair_likelihood(x1, x2, [axis[:, None], axis[None]], rho=tiny).sum()
        assert none + one * 4 * step + pairs * step**2 / 2 == pytest.approx(1.0, abs=1e-3)
        points = np.array([[0.3], [-0.4]])
        both = moments_of(terms(state, sharp, points, sensor(clutter=tiny)))[0]
        assert both == pytest.approx(pair_likelihood(x1, x2, points[:, 0], rho=tiny), abs=1e-6)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_hypotheses_are_probabilities(n):
    rng = np.random.default_rng(n)
    found = resolution_hypotheses(n)
    assert len(found) == {1: 1, 2: 2, 3: 5}[n]
    for _ in range(20):
        chance = {pair: rng.uniform() for pair in itertools.combinations(range(n), 2)}
        value = [
            sum(c * np.prod([chance[e] for e in edges]) for edges, c in polynomial.items())
            for polynomial in found.values()
        ]
        assert sum(value) == pytest.approx(1.0)
        assert min(value) >= 0.0


def test_resolution_by_distance():
    resolution = resolution_covariance(np.array([50.0, 0.02]))
    half = unresolved_probability(np.array([[50.0, 0.0], [0.0, 0.02], [0.0, 0.0]]), resolution)
    np.testing.assert_allclose(half, [0.5, 0.5, 1.0])
    rng = np.random.default_rng(0)
    covariance = np.diag([900.0, 1e-4])
    drawn = rng.multivariate_normal([30.0, 0.01], covariance, 100_000)
    exact = expected_unresolved_probability(np.array([30.0, 0.01]), covariance, resolution)
    assert exact == pytest.approx(unresolved_probability(drawn, resolution).mean(), rel=0.02)


def test_targets_far_apart_are_as_without_the_model():
    mean, covariance = np.array([[-40.0, 40.0]]), COVARIANCE[None]
    z = np.array([[-40.2], [40.5]])
    for a, b in zip(
        moments_of(terms(mean, covariance, z, sensor())),
        moments_of(terms(mean, covariance, z, sensor(limited=False))),
        strict=True,
    ):
        np.testing.assert_allclose(a, b, rtol=1e-9)


def test_wrong_input():
    with pytest.raises(ValueError, match="4 targets"):
        structure(4, 1, True)
    with pytest.raises(ValueError, match="finite"):
        terms(MEAN[None], COVARIANCE[None], np.array([[np.nan]]), sensor())
    with pytest.raises(ValueError, match="clutter_density = 0"):
        sensor(clutter=0.0)


def test_the_tracker_is_a_kalman_filter_where_nothing_is_ambiguous():
    """Two targets far apart, both surely seen, next to no clutter."""
    rng = np.random.default_rng(6)
    far = ResolutionSensor(
        np.eye(1, 2), np.eye(1), np.eye(1), 1.0 - 1e-9, 0.9, 1e-12, np.array([[4.0]])
    )
    step, noise = np.array([[1.0, 1.0], [0.0, 1.0]]), 0.01 * np.eye(2)
    start = np.array([[-500.0, 1.0], [500.0, -1.0]])
    tracker = UnresolvedTracker(start, np.tile(np.eye(2), (2, 1, 1)), far)
    mean, covariance = start.copy(), np.tile(np.eye(2), (2, 1, 1))
    for _ in range(5):
        tracker.predict(step, noise)
        mean, covariance = mean @ step.T, step @ covariance @ step.T + noise
        z = mean[:, :1] + rng.normal(size=(2, 1))
        assert np.isfinite(tracker.update(z[::-1]))
        gain = covariance[:, :, :1] / (covariance[:, :1, :1] + 1.0)
        mean = mean + (gain @ (z - mean[:, :1])[:, :, None])[:, :, 0]
        covariance = covariance - gain @ covariance[:, :1, :]
    np.testing.assert_allclose(tracker.estimate()[0], mean, atol=1e-6)
    np.testing.assert_allclose(tracker.estimate()[1][:2, :2], covariance[0], atol=1e-6)
    assert len(tracker.mixture.weight) == 1
    np.testing.assert_allclose(tracker.most_probable(), mean, atol=1e-6)
