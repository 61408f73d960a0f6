"""NEES and NIS: bounds against sampling, a matched filter inside them, a mismatched one outside."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad

from gda_tracker.evaluation.consistency import (
    NormalisedErrors,
    chi_square_bounds,
    gated_bounds,
    gated_moments,
    normalised_squared,
    score_nees,
    score_nis,
)
from gda_tracker.evaluation.matching import match_run
from gda_tracker.evaluation.quality import combine_consistency
from gda_tracker.kinematics.gating import gate_threshold
from gda_tracker.kinematics.gaussian_filters import predict, update
from gda_tracker.kinematics.motion_models import constant_velocity
from gda_tracker.kinematics.sensor_models import PolarMeasurements, innovations
from gda_tracker.vocabulary import CONFIRMED, TENTATIVE, ScanKey, ScanTruth, Tracks


def test_bounds_are_chi_square_quantiles():
    # Bar-Shalom, Li and Kirubarajan 2001, section 5.4.2: 50 runs, 2 degrees of freedom each, 95 %.
    low, high = chi_square_bounds(2, 50)
    assert (100 * low / 2, 100 * high / 2) == pytest.approx((74.2, 129.6), abs=0.05)
    low, high = chi_square_bounds(4, np.array([1, 7]), 0.9)
    np.testing.assert_allclose(low, stats.chi2.ppf(0.05, [4, 28]) / [1, 7])
    np.testing.assert_allclose(high, stats.chi2.ppf(0.95, [4, 28]) / [1, 7])


def test_moments_inside_a_gate_are_those_of_the_truncated_density():
    for dimension, threshold in ((2, 9.21), (2, 1.0), (3, 5.0)):

        def moment(power, d=dimension, g=threshold):
            return quad(lambda x: x**power * stats.chi2.pdf(x, d), 0.0, g)[0]

        mean, square = moment(1) / moment(0), moment(2) / moment(0)
        found = gated_moments(dimension, threshold)
        assert found == pytest.approx((mean, square - mean**2), rel=1e-9)
    assert gated_moments(3, math.inf) == (3.0, 6.0)


def test_gated_bounds_hold_their_confidence():
    rng = np.random.default_rng(2)
    threshold = gate_threshold(0.9)
    values = rng.chisquare(2, (4000, 60))
    inside = values <= threshold
    means = (values * inside).sum(axis=1) / inside.sum(axis=1)
    low, high = gated_bounds(2, inside.sum(axis=1), threshold)
    assert np.mean((means >= low) & (means <= high)) == pytest.approx(0.95, abs=0.012)
    free = gated_bounds(2, 60, math.inf)
    assert free == pytest.approx(chi_square_bounds(2, 60))


def test_squared_error_over_covariance_by_hand():
    error = np.array([[3.0, 4.0], [1.0, 0.0]])
    covariance = np.array([np.diag([9.0, 4.0]), [[2.0, 1.0], [1.0, 2.0]]])
    np.testing.assert_allclose(normalised_squared(error, covariance), [5.0, 2.0 / 3.0])


@pytest.mark.parametrize(("factor", "inside"), [(1.0, True), (0.25, False), (4.0, False)])
def test_a_matched_filter_is_inside_its_bounds_and_no_other(factor, inside):
    """The tracker's own filter on its own model; ``factor`` misstates the measurement noise."""
    rng = np.random.default_rng(7)
    runs, scans, dt = 400, 40, 2.0
    transition, noise = constant_velocity(dt, 1.0)
    spread = np.diag([1e4, 1e4, 25.0, 25.0])
    true_noise = np.diag([20.0**2, 0.004**2])
    root, start = np.linalg.cholesky(noise + 1e-9 * np.eye(4)), np.array([8e3, 5e3, 30.0, -20.0])
    truth = start + rng.standard_normal((runs, 4)) @ np.linalg.cholesky(spread).T
    mean, covariance = np.tile(start, (runs, 1)), np.tile(spread, (runs, 1, 1))
    rows = np.arange(runs, dtype=np.int32)
    nees, nis = [], []
    for _ in range(scans):
        truth = truth @ transition.T + rng.standard_normal((runs, 4)) @ root.T
        mean, covariance = predict(mean, covariance, transition, noise)
        error = rng.standard_normal((runs, 2)) @ np.sqrt(true_noise)
        measured = PolarMeasurements(
            np.hypot(truth[:, 0], truth[:, 1]) + error[:, 0],
            np.arctan2(truth[:, 1], truth[:, 0]) + error[:, 1],
            np.tile(factor * true_noise, (runs, 1, 1)),
            np.zeros(2),
            None,
        )
        innovation = innovations(measured, mean, covariance, rows)
        nis.append(innovation.mahalanobis_squared()[0])
        mean, covariance = update(mean, covariance, innovation)
        nees.append(normalised_squared(mean - truth, covariance))
    for squared, dimension in ((np.array(nees), 4), (np.array(nis), 2)):
        each = [NormalisedErrors(row, np.arange(scans), dimension) for row in squared.T]
        found = combine_consistency(each, scans)
        assert found.expected == dimension
        np.testing.assert_array_equal(found.samples, runs)
        np.testing.assert_allclose(found.per_scan, squared.mean(axis=1))
        assert found.mean == pytest.approx(squared.mean())
        assert (found.inside >= 0.85) is inside
        assert (found.typical_lower <= found.mean <= found.typical_upper) is inside
        if not inside:
            assert (found.mean > dimension) is (factor < 1.0)


def scene(velocity=(1.0, 2.0)):
    truth = ScanTruth(
        "radar", 0, np.array([1, 2]), np.array([[0.0, 0, *velocity], [100.0, 0, *velocity]])
    )
    tracks = Tracks(
        ScanKey(0, "radar", 0),
        track_id=np.array([4, 5, 6]),
        status=np.array([CONFIRMED, CONFIRMED, TENTATIVE]),
        mean=np.array([[100.0, 3.0, 1.0, 2.0], [2.0, 0.0, 2.0, 2.0], [0.0, 0.0, 1.0, 2.0]]),
        covariance=np.tile(np.diag([4.0, 9.0, 0.25, 0.25]), (3, 1, 1)),
    )
    return tracks, truth


def test_nees_of_the_matched_tracks():
    tracks, truth = scene()
    found = score_nees([tracks], [truth], match_run([tracks], [truth], 10.0))
    # Target 1 has track 5: 4/4 + 1/.25, target 2 has track 4: 9/9.
    np.testing.assert_allclose(found.squared, [5.0, 1.0])
    assert found.dimension == 4


def test_nees_of_positions_where_velocities_are_unknown():
    tracks, truth = scene((math.nan, math.nan))
    found = score_nees([tracks], [truth], match_run([tracks], [truth], 10.0))
    np.testing.assert_allclose(found.squared, [1.0, 1.0])
    assert found.dimension == 2


def test_velocities_of_longer_states_are_found():
    tracks, truth = scene()
    wide = np.full((3, 6), 7.0)
    wide[:, [0, 1, 3, 4]] = tracks.mean
    covariance = np.tile(np.diag([4.0, 9.0, 1.0, 0.25, 0.25, 1.0]), (3, 1, 1))
    longer = Tracks(tracks.key, track_id=tracks.track_id, status=tracks.status)
    longer.mean, longer.covariance = wide, covariance
    found = score_nees([longer], [truth], match_run([longer], [truth], 10.0))
    np.testing.assert_allclose(found.squared, [5.0, 1.0])


def decided(chosen, squared, gate_probability=0.99):
    n = len(chosen)
    predictions = SimpleNamespace(
        track_id=np.array([4, 5, 6]),
        settings=SimpleNamespace(gate_probability=gate_probability),
    )
    associations = SimpleNamespace(
        hypothesis=np.arange(n, dtype=np.int32),
        chosen=np.array(chosen),
        mahalanobis_squared=np.array(squared),
    )
    return predictions, associations


def test_nis_counts_the_chosen_pairs_of_confirmed_tracks():
    tracks, _ = scene()
    predictions, associations = decided([True, False, True], [1.5, 2.5, 3.5])
    found = score_nis([tracks] * 2, [predictions] * 2, [associations] * 2, [None] * 2)
    np.testing.assert_allclose(found.squared, [1.5, 1.5])
    np.testing.assert_array_equal(found.scan, [0, 1])
    assert (found.dimension, found.threshold) == (2, gate_threshold(0.99))


def test_nis_of_other_dimensions_is_told_as_that_of_two_quantities():
    """Values at the same quantile of chi-square become the same, and the gate stays the gate."""
    tracks, _ = scene()
    values = [stats.chi2.ppf(p, 1) for p in (0.1, 0.5, 0.99)]
    one = decided([True, False, True], values)
    two = decided([True, False, True], [stats.chi2.ppf(p, 2) for p in (0.1, 0.5, 0.99)])
    three = decided([True, False, True], [stats.chi2.ppf(p, 3) for p in (0.1, 0.5, 0.99)])
    scans = list(zip(one, two, three, strict=True))
    found = score_nis([tracks] * 3, scans[0], scans[1], [None] * 3, [1, 2, 3])
    np.testing.assert_allclose(found.squared, np.full(3, stats.chi2.ppf(0.1, 2)))
    assert found.dimension == 2


def test_nis_needs_one_gate():
    tracks, _ = scene()
    one, other = decided([], []), decided([], [], 0.9)
    with pytest.raises(ValueError, match="gate_probability"):
        score_nis([tracks] * 2, [one[0], other[0]], [one[1], other[1]], [None] * 2)


def test_runs_without_any_error_combine_to_nothing():
    none = NormalisedErrors(np.zeros(0), np.zeros(0, dtype=np.int64), 4)
    found = combine_consistency([none, none], 3)
    assert math.isnan(found.mean)
    assert math.isnan(found.inside)
    assert math.isnan(found.typical_lower)
    some = NormalisedErrors(np.array([4.0, 5.0]), np.array([1, 1]), 4)
    found = combine_consistency([none, some], 3)
    assert (found.mean, found.dimension) == (4.5, 4)
    np.testing.assert_array_equal(found.samples, [0, 2, 0])
    assert np.isnan(found.per_scan[[0, 2]]).all()
    other = NormalisedErrors(np.array([4.0]), np.array([1]), 2)
    with pytest.raises(ValueError, match="allowed is one of each"):
        combine_consistency([some, other], 3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0, 5), "dimension = 0"),
        ((2, 0), "samples = 0"),
        ((2, 5, 1.0), "confidence = 1.0"),
    ],
)
def test_what_is_not_allowed_is_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        chi_square_bounds(*arguments)
    with pytest.raises(ValueError, match="threshold = 0"):
        gated_moments(2, 0.0)
