"""The predictions of a scan: what the other stages need to know about the hypotheses."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array
from gda_tracker.vocabulary.hypotheses import AssociationSettings, Predictions
from gda_tracker.vocabulary.scans import ScanKey


def predictions_of(
    key: ScanKey, table: HypothesisTable, parameters: TrackManagerParameters
) -> Predictions:
    """Return the predictions of a table that stands at the time of the scan, with the settings."""
    start, weight, model = _one_component_each(len(table))
    return Predictions(
        key=key,
        settings=AssociationSettings(
            decision=parameters.decision,
            attribute_term=parameters.attribute_term,
            missed_track_hypotheses=parameters.missed_track_hypotheses,
            gate_probability=parameters.gate_probability,
            clutter_density=parameters.clutter_density_per_m_rad,
        ),
        hypothesis_id=table.hypothesis_id,
        parent_id=table.parent_id,
        track_id=table.track_id,
        detection_probability=parameters.detection_probability * weight,
        component_start=start,
        component_weight=weight,
        component_model=model,
        component_mean=table.mean,
        component_covariance=table.covariance,
        frame=table.frame,
        focal=table.focal,
        masses=table.masses,
        class_names=table.class_names,
        class_probability=table.class_probability,
    )


@lru_cache(maxsize=256)
def _one_component_each(count: int) -> tuple[Int32Array, FloatArray, Int32Array]:
    """First component, weights and models of ``count`` hypotheses with one component each."""
    arrays = np.arange(count + 1, dtype=np.int32), np.ones(count), np.zeros(count, dtype=np.int32)
    for array in arrays:
        array.flags.writeable = False
    return arrays
