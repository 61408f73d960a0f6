"""One scan makes of every set its successors: one per detection that it may own, or itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gda_tracker.kinematics.set_valued.filter import TrackSets, update_sets
from gda_tracker.kinematics.set_valued.positions import STATE_SIZE, Positions
from gda_tracker.tracking.set_valued.branches import (
    MISSED,
    NO_DETECTION,
    Branches,
    new_branches,
    remembering,
)
from gda_tracker.tracking.set_valued.parameters import (
    ALL,
    ALWAYS,
    CONFIRMED_TRACKS,
    NEVER,
    SetValuedParameters,
)
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray

# Successors of a track that are filtered at all, for each set that it may keep.
MARGIN_OF_SUCCESSORS = 4


def grow(
    branches: Branches,
    positions: Positions,
    serial: IntArray,
    stamp_ns: int,
    parameters: SetValuedParameters,
) -> Branches:
    """Return the successors of sets that are predicted to the scan.

    Parameters
    ----------
    branches
        N predicted sets.
    positions
        s detections.
    serial
        (s,) numbers that no other detection has.
    stamp_ns
        Time of the scan.
    parameters
        Boldness, theta, what becomes of sets that may own detections.

    Returns
    -------
    Branches
        For each pair that the association test accepts the filtered set (equations 12 to 15 of
        Stirling & Thompson 1991); each set without one, and as ``miss_branches`` says others, as
        predicted. ``branch_id`` is that of the set before. Of a track, more than four times as
        many as it may keep are not filtered: those with the worst score.
    """
    may_own = parameters.test.associated(
        branches.sets, positions.observation, positions.observing, positions.std
    )
    branches = replace(branches, may_own=may_own)
    parent, detection = np.nonzero(may_own)
    gain = scores(branches.sets.select(parent), positions, detection, parameters)
    score = branches.score[parent] + gain
    good = _best_of_track(
        branches.track_id[parent], score, MARGIN_OF_SUCCESSORS * parameters.max_sets_per_track
    )
    parent, detection, score = parent[good], detection[good], score[good]
    before = branches.select(parent)
    filtered = replace(
        before,
        sets=update_sets(
            before.sets,
            positions.observation[detection],
            positions.observing[detection],
            positions.noise()[detection],
        ),
        score=score,
        memory=remembering(before.memory, serial[detection]),
        detection=detection.astype(np.int64),
        hits=before.hits + 1,
        coasted=np.zeros(len(parent), dtype=np.int64),
        last_ns=np.full(len(parent), stamp_ns, dtype=np.int64),
    )
    missed = branches.select(_lives_without(branches, parameters.miss_branches))
    coasting = replace(
        missed,
        score=missed.score + parameters.log_missed,
        memory=remembering(missed.memory, MISSED),
        detection=np.full(len(missed), NO_DETECTION, dtype=np.int64),
        misses=missed.misses + 1,
        coasted=missed.coasted + 1,
    )
    return filtered.joined(coasting)


def scores(
    sets: TrackSets, positions: Positions, detection: IntArray, parameters: SetValuedParameters
) -> FloatArray:
    """Log likelihood ratio (M,) of set i owning ``detection[i]`` against a false alarm.

    The set counts as what it is on average, uniform over its ellipsoid: with the second moment
    P + K K'/(n + 2), n the size of the state.
    """
    h = positions.observing[detection]
    moment = sets.covariance + sets.matrix @ sets.matrix.transpose(0, 2, 1) / (STATE_SIZE + 2)
    innovation = h @ moment @ h.transpose(0, 2, 1) + positions.noise()[detection]
    residual = positions.observation[detection] - (h @ sets.centroid[:, :, None])[:, :, 0]
    a, b, d = innovation[:, 0, 0], innovation[:, 0, 1], innovation[:, 1, 1]
    determinant = a * d - b * b
    x, y = residual[:, 0], residual[:, 1]
    square = (d * x * x - 2.0 * b * x * y + a * y * y) / determinant
    # Density of false alarms per area: per metre and radian, over the range.
    clutter = np.log(parameters.clutter_density_per_m_rad / positions.range_m[detection])
    density = -0.5 * square - 0.5 * np.log(determinant) - np.log(2.0 * np.pi)
    return parameters.log_detected + density - clutter


def _best_of_track(track_id: IntArray, score: FloatArray, count: int) -> BoolArray:
    """Which rows are among the ``count`` best of their track."""
    order = np.lexsort((-score, track_id))
    ordered = track_id[order]
    place = np.arange(len(order)) - np.searchsorted(ordered, ordered)
    good = np.zeros(len(order), dtype=bool)
    good[order] = place < count
    return good


def _lives_without(branches: Branches, miss_branches: str) -> BoolArray:
    """Which sets live on without a detection."""
    alone = np.count_nonzero(branches.may_own, axis=1) == 0
    if miss_branches == NEVER or not len(branches):
        return alone
    if miss_branches == ALWAYS:
        return np.ones(len(branches), dtype=bool)
    lives: BoolArray = alone | ambiguous(branches)
    return lives


def ambiguous(branches: Branches) -> BoolArray:
    """Which sets may own several detections, or one that another track's set may own too."""
    several = np.count_nonzero(branches.may_own, axis=1) > 1
    tracks, track = np.unique(branches.track_id, return_inverse=True)
    owners = np.zeros((len(tracks), branches.may_own.shape[1]), dtype=bool)
    np.logical_or.at(owners, track.ravel(), branches.may_own)
    shared = np.count_nonzero(owners, axis=0) > 1
    undecided: BoolArray = several | (branches.may_own & shared).any(axis=1)
    return undecided


def start(
    branches: Branches,
    claims: BoolArray,
    positions: Positions,
    serial: IntArray,
    stamp_ns: int,
    next_track_id: int,
    parameters: SetValuedParameters,
) -> Branches:
    """Begin a track with every detection that nothing claims.

    The set before any detection is the paper's: an ellipsoid as large as the field of view. It is
    filtered by the detection; its centre is taken where the detection is, so that no field of view
    need be known.
    """
    free = np.flatnonzero(~claims)
    state = np.zeros((len(free), STATE_SIZE))
    state[:, :2] = positions.position_m[free]
    p = parameters
    std = np.repeat([p.initial_position_std_m, p.initial_speed_std_mps], 2)
    radius = np.repeat([p.initial_position_radius_m, p.initial_speed_radius_mps], 2)
    before = TrackSets(
        state,
        np.repeat(np.diag(std**2)[None], len(free), axis=0),
        np.repeat(np.diag(radius)[None], len(free), axis=0),
    )
    sets = update_sets(
        before, positions.observation[free], positions.observing[free], positions.noise()[free]
    )
    ids = next_track_id + np.arange(len(free), dtype=np.int64)
    return new_branches(sets, ids, free, serial[free], branches.may_own.shape[1], stamp_ns)


def claimed(grown: Branches, living: Branches, claimants: str) -> BoolArray:
    """Which detections (s,) start no track.

    ``grown`` are all successors, ``living`` those that stay, sorted by track and score.
    """
    taken: BoolArray = np.zeros(grown.may_own.shape[1], dtype=bool)
    if claimants == ALL:
        np.any(grown.may_own, axis=0, out=taken)
        return taken
    if claimants == CONFIRMED_TRACKS:
        np.any(grown.may_own[grown.confirmed], axis=0, out=taken)
        return taken
    first = living.detection[living.rank() == 0]
    taken[first[first >= 0]] = True
    return taken
