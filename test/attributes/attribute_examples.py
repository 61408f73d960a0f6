"""Scans and predictions for the tests of the two attribute stages."""

from __future__ import annotations

import numpy as np

from gda_tracker.vocabulary import AssociationSettings, Predictions, Scan, ScanKey

KEY = ScanKey(3, "radar", 5_000_000_000)
FOUR = {
    "class_names": ["false_alarm", "drone", "fighter", "cargo"],
    "class_rcs_mean_m2": [0.3, 0.05, 1.2, 4.0],
    "class_rcs_swerling": [2, 1, 3, 4],
    "class_labels": ["FA", "D", "F", "C"],
    "class_prior": [],
}


def scan_of(rcs_m2, valid=None, **fields):
    rcs_m2 = np.asarray(rcs_m2, dtype=np.float64)
    n = len(rcs_m2)
    return Scan(
        key=KEY,
        frame_id="map",
        sensor_position_m=np.zeros(3),
        sensor_orientation_xyzw=np.array([0.0, 0.0, 0.0, 1.0]),
        source_index=np.arange(n, dtype=np.int32),
        range_m=np.full(n, 1000.0),
        azimuth_rad=np.zeros(n),
        noise_covariance=np.tile(np.eye(2), (n, 1, 1)),
        rcs_m2=rcs_m2,
        rcs_valid=np.ones(n, dtype=np.bool_)
        if valid is None
        else np.asarray(valid, dtype=np.bool_),
        **fields,
    )


def predictions_of(term, n_hypotheses, **beliefs):
    h = n_hypotheses
    ids = np.arange(h, dtype=np.int64)
    return Predictions(
        key=KEY,
        settings=AssociationSettings(attribute_term=term),
        hypothesis_id=ids,
        parent_id=ids,
        track_id=ids,
        detection_probability=np.full(h, 0.9),
        component_start=np.arange(h + 1, dtype=np.int32),
        component_weight=np.ones(h),
        component_model=np.zeros(h, dtype=np.int32),
        component_mean=np.zeros((h, 4)),
        component_covariance=np.tile(np.eye(4), (h, 1, 1)),
        **beliefs,
    )
