"""The predictions of a scan: what the other stages need to know about the hypotheses."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from gda_tracker.tracking.group_update import group_candidates, resolution_settings
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.parameter_groups.sensor import GIVEN
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array
from gda_tracker.vocabulary.hypotheses import AssociationSettings, Predictions
from gda_tracker.vocabulary.scans import ScanKey


def predictions_of(
    key: ScanKey,
    table: HypothesisTable,
    parameters: TrackManagerParameters,
    clutter_density: FloatArray,
) -> Predictions:
    """Return the predictions of a table that stands at the time of the scan, with the settings.

    ``clutter_density`` (H,) is that around each hypothesis. Association knows one for all: their
    geometric mean.
    """
    h, models = table.model_weight.shape
    if table.spread > 1:
        start, model, weight, mean, covariance = _components_of_sums(table)
    elif models:
        start, model = _components(h, models, models // max(len(table.models), 1))
        weight = table.model_weight.reshape(h * models)
        # What is measured depends on position and velocity alone.
        s = table.mean.shape[1]
        mean = np.ascontiguousarray(table.model_mean[..., :s]).reshape(h * models, s)
        covariance = np.ascontiguousarray(table.model_covariance[..., :s, :s])
        covariance = covariance.reshape(h * models, s, s)
    else:
        start, model = _components(h, 1, 1)
        weight, mean, covariance = _ones(h), table.mean, table.covariance
    return Predictions(
        key=key,
        settings=AssociationSettings(
            decision=parameters.decision,
            attribute_term=parameters.attribute_term,
            missed_track_hypotheses=parameters.missed_track_hypotheses,
            gate_probability=parameters.gate_probability,
            clutter_density=common_density(clutter_density, parameters),
            history_policy=parameters.history_policy,
            forgetting_factor=parameters.share_kept,
            **resolution_settings(parameters),
        ),
        hypothesis_id=table.hypothesis_id,
        parent_id=table.parent_id,
        track_id=table.track_id,
        detection_probability=parameters.detection_probability * _ones(h),
        component_start=start,
        component_weight=weight,
        component_model=model,
        component_mean=mean,
        component_covariance=covariance,
        frame=table.frame,
        focal=table.focal,
        masses=table.masses,
        class_names=table.class_names,
        class_probability=table.class_probability,
        window_focal=table.window_focal,
        window_kind=table.window_kind,
        window_masses=table.window_masses,
        window_log_class_likelihood=table.window_log_class_likelihood,
        group_candidate=group_candidates(table, parameters),
    )


def _components_of_sums(
    table: HypothesisTable,
) -> tuple[Int32Array, Int32Array, FloatArray, FloatArray, FloatArray]:
    """First components, models, weights, means, covariances of sums, without what weighs 0."""
    s = table.mean.shape[1]
    held = table.model_weight > 0.0
    start = np.concatenate([[0], np.cumsum(held.sum(axis=1))]).astype(np.int32)
    count = max(len(table.models), 1)
    each = held.shape[1] // table.spread // count
    model = np.tile(np.arange(count, dtype=np.int32).repeat(each), table.spread)
    return (
        start,
        np.broadcast_to(model, held.shape)[held],
        table.model_weight[held],
        table.model_mean[held][:, :s],
        table.model_covariance[held][:, :s, :s],
    )


def common_density(density: FloatArray, parameters: TrackManagerParameters) -> float:
    """One density for all hypotheses; exactly the one given where it is that of all."""
    if parameters.clutter_density == GIVEN or not len(density):
        return parameters.clutter_density_per_m_rad
    with np.errstate(divide="ignore"):
        return float(np.exp(np.log(density).mean()))


@lru_cache(maxsize=256)
def _components(count: int, components: int, each: int) -> tuple[Int32Array, Int32Array]:
    """First component of ``count`` hypotheses, and the models of all, ``each`` after another."""
    arrays = (
        np.arange(0, (count + 1) * components, components, dtype=np.int32),
        np.tile(np.arange(components, dtype=np.int32) // each, count),
    )
    for array in arrays:
        array.flags.writeable = False
    return arrays


@lru_cache(maxsize=256)
def _ones(count: int) -> FloatArray:
    ones = np.ones(count)
    ones.flags.writeable = False
    return ones
