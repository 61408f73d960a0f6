"""The gates of a scan as shapes to be shown: one per track, with the scan's median noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gda_tracker.kinematics.gating import gate_threshold
from gda_tracker.kinematics.sensor_models import polar_measurements, predicted_measurements
from gda_tracker.vocabulary.arrays import FloatArray, IntArray
from gda_tracker.vocabulary.hypotheses import Predictions
from gda_tracker.vocabulary.scans import Scan
from gda_tracker.vocabulary.tracks import Tracks


@dataclass(slots=True)
class Gates:
    """The gates of G tracks: (z - h)' S^-1 (z - h) <= threshold over range and azimuth (14.1).

    ``range_m``, ``azimuth_rad`` (G,) the predicted measurement h, ``covariance`` (G, 2, 2) S with
    the scan's median noise [m2, m rad, rad2].
    """

    track_id: IntArray
    range_m: FloatArray
    azimuth_rad: FloatArray
    covariance: FloatArray
    threshold: float

    def outlines(self, sensor_xy_m: FloatArray, points: int) -> FloatArray:
        """Return the edge of each gate in the plane (G, ``points`` + 1, 2) [m], closed.

        It is the image of the ellipse in range and azimuth, bent where the gate is wide.
        """
        angle = np.linspace(0.0, 2.0 * np.pi, points + 1)
        circle = np.sqrt(self.threshold) * np.stack([np.cos(angle), np.sin(angle)])
        range_off, azimuth_off = np.moveaxis(np.linalg.cholesky(self.covariance) @ circle, 1, 0)
        reach = np.maximum(self.range_m[:, None] + range_off, 0.0)
        # Once round is all there is.
        azimuth = self.azimuth_rad[:, None] + np.clip(azimuth_off, -np.pi, np.pi)
        return sensor_xy_m + reach[..., None] * np.stack([np.cos(azimuth), np.sin(azimuth)], -1)


def gates_of(scan: Scan, predictions: Predictions, previous: Tracks | None) -> Gates | None:
    """Gates of the leading hypotheses; none without a detection, whose noise is a part of them.

    Of a sensor with a model of its own there are none either: its gate need not be round a place.

    ``previous`` are the tracks after the scan before: of the hypotheses of a track, the gate is
    that of the one that spoke for it then.
    """
    if not len(scan) or scan.sensor_model:
        return None
    rows = _leading(predictions, previous)
    noise = np.median(polar_measurements(scan).covariance, axis=0)
    # Of the components of a mixture the heaviest.
    start = predictions.component_start
    owner = np.repeat(np.arange(len(predictions)), np.diff(start))
    order = np.lexsort((-predictions.component_weight, owner))
    component = order[start[:-1]][rows]
    predicted = predicted_measurements(
        predictions.component_mean[component, :2],
        predictions.component_covariance[component, :2, :2],
        scan.sensor_position_m[:2],
    )
    return Gates(
        predictions.track_id[rows],
        predicted.range_m,
        predicted.azimuth_rad,
        predicted.covariance + noise,
        gate_threshold(predictions.settings.gate_probability),
    )


def _leading(predictions: Predictions, previous: Tracks | None) -> IntArray:
    """One row per track, by rising id: of the hypothesis that spoke for it, else the first."""
    spoke = np.zeros(len(predictions), dtype=bool)
    if previous is not None:
        spoke = np.isin(predictions.hypothesis_id, previous.hypothesis_id)
    order = np.lexsort((~spoke, predictions.track_id))
    _, first = np.unique(predictions.track_id[order], return_index=True)
    return np.asarray(order[first], dtype=np.int64)
