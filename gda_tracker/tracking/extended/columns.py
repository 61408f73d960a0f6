"""What the hypotheses know of extents: the columns ``extended`` of the table.

In this order: X_xx, X_xy, X_yy of the expected extent [m2], the weight of its inverse Wishart
density, shape and rate of the Gamma density of the number of detections; (H, 0) without.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from gda_tracker.kinematics.extended.cell_ratios import silent_probability
from gda_tracker.kinematics.extended.detection_rate import predict_rate
from gda_tracker.kinematics.extended.ellipses import rotation
from gda_tracker.kinematics.extended.random_matrix import LEAST_WEIGHT
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.parameter_groups.extended import NONE
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array, IntArray, empty_floats
from gda_tracker.vocabulary.extents import PredictedExtents
from gda_tracker.vocabulary.hypotheses import Predictions

COLUMNS = 6
# Of a new object the rate is known as from two scans.
PRIOR_RATE_SHAPE = 2.0


@dataclass(slots=True)
class Extents:
    """Extents (H, 2, 2) [m2], their weights (H,), and the Gamma densities of the rates (H,)."""

    extent: FloatArray
    weight: FloatArray
    rate_shape: FloatArray
    rate_rate: FloatArray

    def select(self, rows: IntArray | Int32Array) -> Extents:
        """The given rows."""
        return Extents(
            self.extent[rows], self.weight[rows], self.rate_shape[rows], self.rate_rate[rows]
        )

    def packed(self) -> FloatArray:
        """Columns (H, 6) for the table."""
        x = self.extent
        return np.stack(
            [x[:, 0, 0], x[:, 0, 1], x[:, 1, 1], self.weight, self.rate_shape, self.rate_rate], 1
        )


def extents_of(table: HypothesisTable) -> Extents:
    """What the columns of a table say."""
    columns = table.extended
    extent = columns[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
    return Extents(extent, columns[:, 3], columns[:, 4], columns[:, 5])


def prior_extents(count: int, parameters: TrackManagerParameters) -> Extents:
    """What is known of new objects before their detections speak."""
    p, ones = parameters, np.ones(count)
    return Extents(
        np.tile(p.extent_radius_m**2 * np.eye(2), (count, 1, 1)),
        p.extent_prior_weight * ones,
        PRIOR_RATE_SHAPE * ones,
        PRIOR_RATE_SHAPE / p.detections_per_object * ones,
    )


def predict_extents(
    last: HypothesisTable, table: HypothesisTable, dt_s: float, parameters: TrackManagerParameters
) -> HypothesisTable:
    """Return the hypotheses with extents at the time of the scan.

    Parameters
    ----------
    last, table
        The same hypotheses before and after the prediction of their states, ``dt_s`` [s].
    parameters
        Those of the scan. Hypotheses get, or lose, their columns as these say.
    """
    p = parameters
    if p.extended_objects == NONE:
        if table.extended.shape[1]:
            table = table.copy()
            table.extended = empty_floats(len(table), 0)
            table.cell_members = table.cell_members[:0]
        return table
    table = table.copy()
    table.cell_members = table.cell_members[:0]
    if not table.extended.shape[1]:
        table.extended = prior_extents(len(table), p).packed()
        return table
    known = extents_of(table)
    if p.extent_turns_with_course:
        known.extent = turned(known.extent, turns(last, table))
    kept = math.exp(-dt_s / p.extent_memory_s)
    known.weight = LEAST_WEIGHT + (known.weight - LEAST_WEIGHT) * kept
    known.rate_shape, known.rate_rate = predict_rate(
        known.rate_shape, known.rate_rate, dt_s, p.detection_rate_memory_s
    )
    table.extended = known.packed()
    return table


def turns(before: HypothesisTable, after: HypothesisTable) -> FloatArray:
    """By how much the course of each hypothesis (H,) has turned [rad], as far as it is known.

    A course with the error variance s^2 counts by exp(-2 s^2), by which the mean of cos 2c shrinks:
    that of an object that hardly moves is not followed.
    """
    v0, v1 = before.mean[:, 2:4], after.mean[:, 2:4]
    angle = np.arctan2(
        v0[:, 0] * v1[:, 1] - v0[:, 1] * v1[:, 0], v0[:, 0] * v1[:, 0] + v0[:, 1] * v1[:, 1]
    )
    known = np.ones(len(angle))
    for one in (before, after):
        v = one.mean[:, 2:4]
        across = np.stack([-v[:, 1], v[:, 0]], axis=1)
        variance = np.einsum("hi,hij,hj->h", across, one.covariance[:, 2:4, 2:4], across)
        square = np.sum(v**2, axis=1) ** 2
        ratio = np.divide(variance, square, out=np.full(len(v), np.inf), where=square > 0.0)
        known = np.minimum(known, np.exp(-2.0 * ratio))
    return angle * known


def turned(extent: FloatArray, angle: FloatArray) -> FloatArray:
    """Extents (H, 2, 2), turned by angles (H,) [rad]."""
    turn = rotation(angle)
    found = turn @ extent @ np.swapaxes(turn, -1, -2)
    return 0.5 * (found + np.swapaxes(found, -1, -2))


def with_extents(
    predictions: Predictions, table: HypothesisTable, parameters: TrackManagerParameters
) -> Predictions:
    """Return predictions that tell the other stages of the extents.

    The probability of a detection is that of one at least: P_D (1 - p(0)).
    """
    known = extents_of(table)
    silent = silent_probability(known.rate_shape, known.rate_rate)
    return replace(
        predictions,
        detection_probability=predictions.detection_probability * (1.0 - silent),
        extents=PredictedExtents(
            known.extent,
            known.weight,
            known.rate_shape,
            known.rate_rate,
            parameters.extent_spread,
        ),
    )
