"""The sequential test of the number of objects: thresholds, errors, changes, probabilities."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gda_tracker.formations.likelihood import cardinality, log_number_ratios
from gda_tracker.formations.number_test import (
    NumberTests,
    advance_numbers,
    log_thresholds,
    merged_probability,
    transition,
)
from gda_tracker.formations.resolution import detection_counts, group_probabilities

SECOND = 10**9


def ratios(number_of_detections, p_d=0.9, false=0.2, most=5):
    """Log ratios (B, N) of scans with so many detections, uniform in the gate."""
    m = np.asarray(number_of_detections)
    there = np.arange(m.max(initial=0)) < m[:, None]
    found = detection_counts(
        np.full(len(m), p_d), group_probabilities(np.full((len(m), 2), np.inf), most)
    )
    return log_number_ratios(found, np.where(there, -math.log(false), -np.inf))


@given(st.integers(1, 12), st.floats(1e-6, 0.49), st.floats(1e-6, 0.49))
def test_the_errors_allowed_add_up_to_the_design(most, over, under):
    allowed = np.exp(-log_thresholds(most, over, under))
    np.fill_diagonal(allowed, 0.0)
    assert (np.tril(allowed).sum(axis=0) <= over * (1.0 + 1e-9)).all()
    assert (np.triu(allowed).sum(axis=0) <= under * (1.0 + 1e-9)).all()
    assert allowed[1, 0] >= 0.9 * over * (1.0 - 1e-9)


def test_a_decision_is_walds_and_the_test_begins_anew():
    tests = NumberTests.begin(1, 2, 0)
    thresholds = log_thresholds(2, 0.01, 0.02)
    step = np.array([[1.0, 3.0]])  # LR_2 over LR_1 grows by e^2 a scan, over LR_0 by e^3
    for k in range(1, 4):
        found = advance_numbers(tests, np.array([True]), step, k * SECOND, thresholds, 0.0)
        if len(found.rows):
            break
    # ln(1 / 0.009) = 4.7: the third scan.
    assert (k, found.number.tolist(), found.samples.tolist()) == (3, [2], [3])
    assert found.began_ns.tolist() == [SECOND]
    assert math.isclose(found.margin[0], 6.0)
    assert (tests.number[0], tests.since_ns[0], tests.samples[0]) == (2, 3 * SECOND, 0)
    assert not tests.log_ratio.any()


@pytest.mark.parametrize(("p_d", "design"), [(0.9, 0.01), (0.5, 0.1)])
@pytest.mark.parametrize("truth", [0, 2, 5])
def test_errors_keep_to_the_design(truth, p_d, design):
    generator = np.random.default_rng(truth)
    runs, false = 800, 0.3
    tests, decided = NumberTests.begin(runs, 5, 0), np.full(runs, -1)
    thresholds = log_thresholds(5, design, design)
    for k in range(150):
        open_ = decided < 0
        if not open_.any():
            break
        m = generator.binomial(truth, p_d, runs) + generator.poisson(false, runs)
        found = advance_numbers(tests, open_, ratios(m, p_d, false), k * SECOND, thresholds, 0.0)
        decided[found.rows] = found.number
    assert (decided >= 0).mean() > 0.95
    allowed = design + 3.0 * math.sqrt(design / runs)
    assert (decided > truth).mean() <= allowed
    assert ((decided < truth) & (decided >= 0)).mean() <= allowed


@given(st.integers(1, 8), st.floats(0.0, 1e5), st.floats(0.0, 1e6))
def test_transitions_are_probabilities_to_neighbours(most, elapsed, change):
    found = transition(most, np.array([elapsed]), change)[0]
    np.testing.assert_allclose(found.sum(axis=1), 1.0)
    off = np.abs(np.subtract.outer(np.arange(most), np.arange(most)))
    assert (found[off > 1] == 0.0).all()
    assert (found >= 0.0).all()


def test_without_changes_the_probabilities_are_kochs():
    generator = np.random.default_rng(0)
    tests, total = NumberTests.begin(3, 5, 0), np.zeros((3, 5))
    for k in range(5):
        step = generator.normal(size=(3, 5))
        total += step
        advance_numbers(
            tests, np.ones(3, bool), step, k * SECOND, log_thresholds(5, 1e-3, 1e-3), 0.0
        )
    np.testing.assert_allclose(tests.probability, cardinality(total))


def test_an_object_that_leaves_is_followed():
    generator = np.random.default_rng(5)
    tests = NumberTests.begin(200, 5, 0)
    thresholds = log_thresholds(5, 0.001, 0.001)
    everyone = np.ones(200, dtype=bool)
    for k in range(60):
        truth = 4 if k < 30 else 3
        m = generator.binomial(truth, 0.9, 200) + generator.poisson(0.2, 200)
        step = ratios(m, 0.9, 0.2)
        advance_numbers(tests, everyone, step, 4 * k * SECOND, thresholds, 600.0)
        if k in (29, 59):
            assert (tests.number == truth).mean() > 0.95
            assert (tests.probability.argmax(axis=1) + 1 == truth).mean() > 0.95
    assert (tests.since_ns[tests.number == 3] >= 4 * 30 * SECOND).all()


def test_what_is_not_observed_stays_as_it_was():
    tests = NumberTests.begin(2, 4, 7)
    step = np.tile(np.arange(4.0), (2, 1))
    thresholds = log_thresholds(4, 1e-3, 1e-3)
    advance_numbers(tests, np.array([True, False]), step, 9, thresholds, 60.0)
    assert tests.samples.tolist() == [1, 0]
    assert tests.last_ns.tolist() == [9, 7]
    np.testing.assert_array_equal(tests.probability[1], 0.25)


def test_an_impossible_number_is_never_accepted():
    tests = NumberTests.begin(1, 2, 0)
    step = np.array([[-np.inf, 50.0]])
    found = advance_numbers(tests, np.array([True]), step, 1, log_thresholds(2, 0.01, 0.01), 0.0)
    assert found.number.tolist() == [2]
    np.testing.assert_array_equal(tests.probability, [[0.0, 1.0]])


def test_two_clusters_that_merge_have_the_sum():
    one, two = np.array([1.0, 0, 0, 0, 0]), np.array([0, 0.25, 0.75, 0, 0])
    np.testing.assert_allclose(merged_probability(one, two), [0, 0, 0.25, 0.75, 0])
    np.testing.assert_allclose(merged_probability(two, two)[-1], 1.0 - 0.25**2)
    np.testing.assert_allclose(merged_probability(np.ones(1), np.ones(1)), [1.0])
