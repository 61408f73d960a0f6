"""Gaussian sums on the table of hypotheses: parts, moments, reduction, joining."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gda_tracker.kinematics.gaussian_sum_starts import Sums
from gda_tracker.kinematics.mixtures import moments
from gda_tracker.parameters import from_mapping
from gda_tracker.tracking.gaussian_sums import (
    joined,
    merge_components,
    parts_of,
    reduce_sums,
    set_sums,
    widened,
    with_parts,
)
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.tracking.predictions import predictions_of
from gda_tracker.tracking.state_update import predict_states
from gda_tracker.vocabulary.scans import ScanKey

FILTERS = ("cv", "imm", "gpb2")


def _parameters(name: str) -> TrackManagerParameters:
    return from_mapping(TrackManagerParameters, {"filter": name})


def _sums(seed: int, rows: int = 3, parts: int = 5) -> Sums:
    rng = np.random.default_rng(seed)
    weight = rng.random((rows, parts)) + 0.05
    root = rng.normal(size=(rows, parts, 4, 4))
    covariance = root @ root.swapaxes(-1, -2) + np.eye(4)
    mean = 1e5 + 30.0 * rng.normal(size=(rows, parts, 4))
    return Sums(weight / weight.sum(axis=1, keepdims=True), mean, covariance, np.zeros(rows))


def _table(sums: Sums, parameters: TrackManagerParameters) -> HypothesisTable:
    rows = len(sums.weight)
    mean, covariance = moments(sums.weight, sums.mean, sums.covariance)
    table = HypothesisTable(hypothesis_id=np.arange(rows) + 1, mean=mean, covariance=covariance)
    table.track_id = table.parent_id = table.hypothesis_id
    table.masses = np.zeros((rows, 0))
    table.class_probability = np.zeros((rows, 0))
    set_sums(table, sums, np.arange(rows), parameters)
    return table


@pytest.mark.parametrize("name", FILTERS)
def test_a_table_of_sums_has_their_moments(name):
    sums = _sums(1)
    table = _table(sums, _parameters(name))
    mean, covariance = moments(sums.weight, sums.mean, sums.covariance)
    assert table.spread == 5
    np.testing.assert_allclose(table.mean, mean)
    np.testing.assert_allclose(table.covariance, covariance, rtol=1e-6, atol=1e-6)
    parts, weight = parts_of(table)
    np.testing.assert_allclose(weight, sums.weight)
    again = table.copy()
    with_parts(again, parts, weight)
    np.testing.assert_allclose(again.model_mean, table.model_mean)
    np.testing.assert_allclose(again.model_weight, table.model_weight)


@pytest.mark.parametrize("name", FILTERS)
def test_each_part_is_predicted_as_if_it_were_alone(name):
    parameters = _parameters(name)
    sums = _sums(2)
    found = predict_states(_table(sums, parameters), 4.0, parameters)
    for part in range(5):
        one = Sums(np.ones((3, 1)), sums.mean[:, [part]], sums.covariance[:, [part]], np.zeros(3))
        alone = predict_states(_table(one, parameters), 4.0, parameters)
        assert alone.spread == 1
        parts, weight = parts_of(found)
        rows = np.arange(3) * 5 + part
        np.testing.assert_allclose(parts.mean[rows], alone.mean)
        np.testing.assert_allclose(parts.covariance[rows], alone.covariance, rtol=1e-9)
        np.testing.assert_allclose(weight, sums.weight)


@pytest.mark.parametrize("name", FILTERS)
def test_a_scan_without_detections_keeps_the_moments(name):
    """Pairs of models merge, parts merge: neither changes mean and covariance."""
    parameters = _parameters(name)
    table = predict_states(_table(_sums(3), parameters), 2.0, parameters)
    mean, covariance = table.mean, table.covariance
    merge_components(table, parameters)
    np.testing.assert_allclose(table.mean, mean)
    np.testing.assert_allclose(table.covariance, covariance, rtol=1e-6, atol=1e-4)
    assert table.model_weight.shape[1] == table.spread * max(len(table.models), 1)


@settings(max_examples=25)
@given(seed=st.integers(0, 10_000), distance=st.floats(0.0, 8.0), name=st.sampled_from(FILTERS))
def test_merging_keeps_the_moments(seed, distance, name):
    table = _table(_sums(seed), _parameters(name))
    mean, covariance = table.mean, table.covariance
    reduce_sums(table, 0.0, distance, 100)
    np.testing.assert_allclose(table.mean, mean, rtol=1e-12)
    np.testing.assert_allclose(table.covariance, covariance, rtol=1e-6, atol=1e-4)
    assert 1 <= table.spread <= 5


def test_pruning_and_capping_keep_the_heaviest():
    sums = _sums(4)
    sums.weight[:] = [0.5, 0.3, 0.15, 0.049, 0.001]
    table = _table(sums, _parameters("cv"))
    reduce_sums(table, 0.01, 0.0, 3)
    assert table.spread == 3
    np.testing.assert_allclose(table.model_weight, np.tile([0.5, 0.3, 0.15], (3, 1)) / 0.95)
    np.testing.assert_array_equal(table.model_mean, sums.mean[:, :3])
    reduce_sums(table, 0.0, 0.0, 1)
    assert table.spread == 1
    assert table.model_weight.shape[1] == 0
    np.testing.assert_array_equal(table.mean, sums.mean[:, 0])


def test_rows_have_as_many_parts_as_they_need():
    """What a row has not weighs nothing and is not told the other stages."""
    sums = _sums(5)
    sums.weight[1] = [1.0, 0.0, 0.0, 0.0, 0.0]
    table = _table(sums, _parameters("cv"))
    reduce_sums(table, 0.0, 0.0, 100)
    parameters = _parameters("cv")
    told = predictions_of(ScanKey(0, "a", 0), table, parameters, np.full(3, 1e-6))
    np.testing.assert_array_equal(np.diff(told.component_start), [5, 1, 5])
    assert (told.component_weight > 0.0).all()
    np.testing.assert_allclose(np.add.reduceat(told.component_weight, told.component_start[:-1]), 1)


@pytest.mark.parametrize("name", FILTERS)
def test_tables_with_and_without_sums_are_joined(name):
    parameters = _parameters(name)
    wide = _table(_sums(6), parameters)
    narrow = _table(_sums(7, parts=1), parameters)
    both, turned = joined(narrow, wide), joined(wide, narrow)
    assert both.spread == turned.spread == 5
    np.testing.assert_allclose(both.mean[:3], narrow.mean)
    np.testing.assert_allclose(turned.mean[3:], narrow.mean)
    assert widened(wide, 5) is wide
    reduce_sums(both, 0.0, 0.0, 100)
    np.testing.assert_allclose(both.mean[:3], narrow.mean, rtol=1e-12)
    np.testing.assert_allclose(both.covariance[:3], narrow.covariance, rtol=1e-9, atol=1e-6)
