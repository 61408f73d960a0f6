"""What detections, type calls and features say of a cluster: P^J alpha (Ferry 2010, 5.15)."""

from __future__ import annotations

import numpy as np

from gda_tracker.association.xmap.features import log_feature_density
from gda_tracker.association.xmap.model import SensorData, SensorModel
from gda_tracker.vocabulary.arrays import FloatArray, IntArray


def log_object_density(model: SensorModel, data: SensorData, members: IntArray) -> FloatArray:
    """Log P^J alpha (C, B) of clusters (C, r): a sum over the types of the object.

    Detection probability, confusion matrices and features may all depend on the type.
    """
    data = data.batched()
    n_scenes = data.positions.shape[1]
    result = np.empty((len(members), n_scenes))
    seen = members >= 0
    patterns, group = np.unique(seen, axis=0, return_inverse=True)
    group = group.reshape(-1)
    with np.errstate(divide="ignore"):
        log_prior = np.log(model.types.prior)
        log_seen = np.log(model.types.detection)
        log_missed = np.log1p(-model.types.detection)
        log_confusion = [np.log(matrix) for matrix in model.types.confusion]
    for number, pattern in enumerate(patterns):
        rows = (group == number).nonzero()[0]
        sensors = tuple(pattern.nonzero()[0].tolist())
        at = (members[rows][:, sensors] + model.first[list(sensors)]).T  # (k, X)
        calls = data.calls[at]
        values = data.features[at]
        constant = log_prior + np.where(pattern[:, None], log_seen, log_missed).sum(axis=0)
        total = np.full((len(rows), n_scenes), -np.inf)
        for kind in range(len(log_prior)):
            term = np.full((len(rows), n_scenes), constant[kind])
            for j, sensor in enumerate(sensors):
                term += log_confusion[sensor][kind][calls[j]]
            if model.feature is not None and np.isfinite(constant[kind]):
                term += log_feature_density(model.feature, sensors, values, kind)
            total = np.logaddexp(total, term)
        result[rows] = total
    return result


def detection_pattern_probability(model: SensorModel, members: IntArray) -> FloatArray:
    """(C, T) chance that an object is of type t and seen by just the clusters' sensors (C.3)."""
    seen = (members >= 0)[:, :, None]
    detection = model.types.detection
    return np.asarray(model.types.prior * np.where(seen, detection, 1.0 - detection).prod(axis=1))
