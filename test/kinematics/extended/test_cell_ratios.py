"""What number and scatter of a cell say: against Monte Carlo, and as a density."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import gammaln
from scipy.stats import invwishart

from gda_tracker.kinematics.extended.cell_ratios import log_cell_ratios, silent_probability
from gda_tracker.kinematics.extended.mixtures import merge_extents, merge_rates
from gda_tracker.vocabulary import Predictions, Scan, ScanKey
from gda_tracker.vocabulary.extents import PredictedExtents, ScanCells
from gda_tracker.vocabulary.hypotheses import AssociationSettings

KEY = ScanKey(0, "radar", 0)
X = np.array([[9.0, 2.0], [2.0, 4.0]])


def scan_with(count, scatter, noise=0.0, log_false=0.0):
    n = len(count)
    none = np.zeros(n)
    cells = ScanCells(
        np.asarray(count, dtype=np.int32),
        np.asarray(scatter, dtype=float),
        np.tile(noise * np.eye(2), (n, 1, 1)),
        np.full(n, log_false),
        np.zeros(int(np.sum(count)), dtype=np.int32),
    )
    return Scan(
        KEY, "map", np.zeros(3), np.array([0.0, 0, 0, 1]), np.zeros(n, dtype=np.int32), none + 1.0,
        none, np.tile(np.eye(2), (n, 1, 1)), none, none > 0, cells=cells,
    )  # fmt: skip


def predictions_with(extent, weight, shape, rate, spread=0.25):
    h = 1
    return Predictions(
        KEY, AssociationSettings(), np.ones(h, dtype=int), np.zeros(h, dtype=int),
        np.ones(h, dtype=int), np.ones(h), np.array([0, 1], dtype=np.int32), np.ones(1),
        np.zeros(1, dtype=np.int32), np.zeros((1, 4)), np.eye(4)[None],
        extents=PredictedExtents(
            extent[None], np.array([weight]), np.array([shape]), np.array([rate]), spread
        ),
    )  # fmt: skip


def ratios(scan, predictions):
    n = len(scan)
    return log_cell_ratios(
        scan, predictions, np.zeros(n, dtype=np.int32), np.arange(n, dtype=np.int32)
    )


def test_counts_sum_to_one_where_one_detection_at_least_is_seen():
    count = np.arange(1, 400)
    scan = scan_with(count, np.zeros((len(count), 2, 2)))
    told = predictions_with(X, 12.0, 3.0, 0.4)
    # Scatter of all detections in one place: its density is known, and taken out.
    other = predictions_with(X, 12.0, 7.0, 2.0)
    p0 = silent_probability(np.array([3.0, 7.0]), np.array([0.4, 2.0]))
    gap = ratios(scan, told) - ratios(scan, other)
    reference = (
        gammaln(7.0 + count) - gammaln(7.0) - gammaln(count + 1.0) + 7.0 * math.log(2.0 / 3.0)
        - count * math.log(3.0)
    )  # fmt: skip
    total = np.exp(gap + reference).sum() / (1.0 - p0[1])
    assert total == pytest.approx(1.0, abs=1e-9)


def test_it_is_the_density_of_the_set_averaged_over_rate_and_extent():
    """Without noise the average over inverse Wishart extents and Gamma rates, by Monte Carlo."""
    rng = np.random.default_rng(5)
    weight, shape, rate, spread, n = 9.0, 4.0, 0.8, 0.25, 4
    points = rng.normal(0.0, 1.2, (n, 2))
    gaps = points - points.mean(axis=0)
    scatter = gaps.T @ gaps
    drawn = invwishart.rvs(weight + 3.0, weight * X, size=60_000, random_state=rng) * spread
    gamma = rng.gamma(shape, 1.0 / rate, len(drawn))
    # Density of n points, without that of their centroid given the extent, which the gate has.
    inverse, determinant = np.linalg.inv(drawn), np.linalg.det(drawn)
    quadratic = np.einsum("kij,ij->k", inverse, scatter)
    log_scatter = (
        -0.5 * quadratic - 0.5 * (n - 1) * np.log(determinant)
        - (n - 1) * math.log(2.0 * math.pi) - math.log(n)
    )  # fmt: skip
    # n! times the Poisson probability.
    log_set = n * np.log(gamma) - gamma
    seen = -np.expm1(-gamma)
    expected = np.exp(log_scatter).mean() * np.exp(log_set).mean() / seen.mean()
    found = np.exp(ratios(scan_with([n], [scatter]), predictions_with(X, weight, shape, rate)))
    error = np.exp(log_scatter).std() / np.exp(log_scatter).mean() / math.sqrt(len(drawn))
    assert found[0] == pytest.approx(expected, rel=5.0 * error + 0.01)


def test_false_detections_are_what_it_is_compared_with():
    plain = ratios(scan_with([3], [np.eye(2)]), predictions_with(X, 9.0, 4.0, 0.8))
    told = ratios(scan_with([3], [np.eye(2)], log_false=-2.5), predictions_with(X, 9.0, 4.0, 0.8))
    assert told == pytest.approx(plain + 2.5)


def test_points_say_nothing():
    scan = scan_with([1], [np.zeros((2, 2))])
    scan.cells = None
    assert ratios(scan, predictions_with(X, 9.0, 4.0, 0.8)) == 0.0


def test_one_density_is_merged_to_itself():
    row = np.arange(2)
    extent, weight = merge_extents(np.ones(2), row, np.stack([X, 2 * X]), np.array([5.0, 80.0]), 2)
    np.testing.assert_allclose(extent, np.stack([X, 2 * X]))
    np.testing.assert_allclose(weight, [5.0, 80.0], rtol=1e-9)
    shape, rate = merge_rates(np.ones(2), row, np.array([2.0, 30.0]), np.array([0.1, 4.0]), 2)
    np.testing.assert_allclose(shape, [2.0, 30.0])
    np.testing.assert_allclose(rate, [0.1, 4.0])


def test_mixtures_keep_mean_and_variance():
    """Against samples of the mixture."""
    rng = np.random.default_rng(3)
    extents, weights = np.stack([X, np.diag([2.0, 12.0])]), np.array([12.0, 25.0])
    share, row = np.array([0.3, 0.7]), np.zeros(2, dtype=int)
    extent, weight = merge_extents(share, row, extents, weights, 1)
    pick = rng.random(40_000) < share[0]
    drawn = np.where(
        pick[:, None, None],
        invwishart.rvs(weights[0] + 3.0, weights[0] * extents[0], len(pick), rng),
        invwishart.rvs(weights[1] + 3.0, weights[1] * extents[1], len(pick), rng),
    )
    merged = invwishart.rvs(weight[0] + 3.0, weight[0] * extent[0], len(pick), rng)
    np.testing.assert_allclose(drawn.mean(axis=0), extent[0], rtol=0.05, atol=0.05)
    assert merged.var(axis=0).sum() == pytest.approx(drawn.var(axis=0).sum(), rel=0.08)
    shape, rate = merge_rates(share, row, np.array([3.0, 40.0]), np.array([0.5, 4.0]), 1)
    gamma = np.where(pick, rng.gamma(3.0, 2.0, len(pick)), rng.gamma(40.0, 0.25, len(pick)))
    assert shape / rate == pytest.approx(gamma.mean(), rel=0.02)
    assert shape / rate**2 == pytest.approx(gamma.var(), rel=0.05)
