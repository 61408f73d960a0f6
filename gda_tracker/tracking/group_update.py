"""What groups of unresolved targets do to the hypotheses: who may be in one, and their updates.

A member takes half of what the group's detection tells of the mean (Koch 2014, section 2.3.3;
:mod:`gda_tracker.kinematics.group_updates`). What P_u says of the distance, and 1 - P_u of pairs
that were resolved, weighs in the association and leaves the states alone: tracks keep no common
covariance, without which "they are near" would be counted anew on every scan.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gda_tracker.kinematics import imm
from gda_tracker.kinematics.group_updates import updated_members
from gda_tracker.kinematics.model_sets import HEAD, follow_head
from gda_tracker.kinematics.sensor_models import polar_measurements
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.model_states import set_models
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, Int32Array, IntArray
from gda_tracker.vocabulary.hypotheses import Associations
from gda_tracker.vocabulary.scans import Scan
from gda_tracker.vocabulary.tracks import CONFIRMED


def resolution_settings(parameters: TrackManagerParameters) -> dict[str, Any]:
    """Settings of the association for what the sensor resolves; none where it resolves all."""
    p = parameters
    if p.resolution_range_m == 0.0:
        return {}
    return {
        "resolution_range_m": p.resolution_range_m,
        "resolution_azimuth_rad": p.resolution_azimuth_rad,
        "unresolved_detection_probability": p.unresolved_detection_probability,
    }


def group_candidates(table: HypothesisTable, parameters: TrackManagerParameters) -> BoolArray:
    """Hypotheses (H,) of confirmed tracks, the only ones that may share a detection.

    A tentative track that could take a share of another's detections would never end. No entries
    where the sensor resolves all.
    """
    if parameters.resolution_range_m == 0.0:
        return np.zeros(0, dtype=np.bool_)
    return np.asarray(table.status == CONFIRMED, dtype=np.bool_)


def group_members(
    associations: Associations, events: IntArray
) -> tuple[Int32Array, Int32Array, Int32Array]:
    """Members, their partners and detections (2 K,) of K events."""
    first, second = associations.group_first[events], associations.group_second[events]
    return (
        np.concatenate([first, second]),
        np.concatenate([second, first]),
        np.tile(associations.group_detection[events], 2),
    )


def updated_by_groups(
    predicted: HypothesisTable,
    scan: Scan,
    rows: IntArray | Int32Array,
    partners: IntArray | Int32Array,
    detection: IntArray | Int32Array,
) -> HypothesisTable:
    """Rows (K,) of a predicted table, updated as members of groups with ``partners``.

    ``partners`` (K,) of groups of two, (K, 2) of groups of three.

    Range rates of a group's detection are left out: they are of both.
    """
    found = predicted.select(rows)
    if not len(found):
        return found
    measurements = polar_measurements(scan)
    others = partners.reshape(len(rows), -1)
    mean, covariance = predicted.mean[others], predicted.covariance[others]
    count = found.model_weight.shape[1]
    if not count:
        found.mean, found.covariance, _ = updated_members(
            measurements, found.mean, found.covariance, mean, covariance, detection
        )
        return found
    size = found.model_mean.shape[2]
    whole = found.model_mean.reshape(-1, size)
    spread = found.model_covariance.reshape(-1, size, size)
    new_mean, new_covariance, log_likelihood = updated_members(
        measurements,
        whole[:, :HEAD],
        spread[:, :HEAD, :HEAD],
        np.repeat(mean, count, axis=0),
        np.repeat(covariance, count, axis=0),
        np.repeat(detection.astype(np.int64), count),
    )
    if size > HEAD:
        new_mean, new_covariance = follow_head(whole, spread, new_mean, new_covariance)
    weight, _ = imm.reweight(found.model_weight, log_likelihood.reshape(-1, count))
    set_models(
        found,
        weight,
        new_mean.reshape(-1, count, size),
        new_covariance.reshape(-1, count, size, size),
    )
    return found


def assigned_alone(associations: Associations) -> Int32Array:
    """Detection of each hypothesis (H,) that has it for itself, -1 for the others."""
    assigned, shares = associations.assigned_detection, associations.group_chosen
    if not np.count_nonzero(shares):
        return assigned
    alone = assigned.copy()
    alone[associations.group_first[shares]] = -1
    alone[associations.group_second[shares]] = -1
    return alone


def update_chosen_groups(
    table: HypothesisTable, predicted: HypothesisTable, scan: Scan, associations: Associations
) -> None:
    """Give the members of the groups that were decided for their states."""
    if not len(associations.group_chosen):
        return
    events = np.flatnonzero(associations.group_chosen & (associations.group_detection >= 0))
    if not len(events):
        return
    rows, partners, detection = group_members(associations, events)
    put_states(table, rows, updated_by_groups(predicted, scan, rows, partners, detection))


def put_states(table: HypothesisTable, rows: IntArray | Int32Array, found: HypothesisTable) -> None:
    """Give rows (K,) of a table the states of ``found``."""
    for name in ("mean", "covariance", "model_weight", "model_mean", "model_covariance"):
        values = getattr(table, name).copy()
        values[rows] = getattr(found, name)
        setattr(table, name, values)


@dataclass(frozen=True, slots=True)
class SharedUpdates:
    """K hypotheses ``rows`` (K,) as members of groups: probabilities, and the states after it."""

    rows: Int32Array
    marginal: FloatArray
    updated: HypothesisTable


def shared_updates(
    predicted: HypothesisTable, scan: Scan, associations: Associations
) -> SharedUpdates:
    """Updates of all hypotheses that may be a member of a group with a detection."""
    events = np.flatnonzero(
        (associations.group_detection >= 0) & (associations.group_marginal > 0.0)
    )
    rows, partners, detection = group_members(associations, events)
    return SharedUpdates(
        rows,
        np.tile(associations.group_marginal[events], 2),
        updated_by_groups(predicted, scan, rows, partners, detection),
    )
