"""What comes out of a fusion: fused tracks, and how they came about."""

from __future__ import annotations

import numpy as np

from gda_tracker.fusion.association import TrackAssociation
from gda_tracker.fusion.class_beliefs import class_probabilities
from gda_tracker.fusion.combination import covariance_intersection, fuse_independent
from gda_tracker.fusion.parameters import (
    EQUIVALENT_MEASUREMENTS,
    INDEPENDENT,
    TrackFusionParameters,
)
from gda_tracker.fusion.snapshot import Snapshot
from gda_tracker.fusion.targets import FusedTargets
from gda_tracker.vocabulary.arrays import FloatArray, IntArray
from gda_tracker.vocabulary.fused_tracks import FusedTracks, TrackAssociations

Head = tuple[int, bytes, int]


def fused_tracks_of(
    head: Head,
    parameters: TrackFusionParameters,
    radar_states: tuple[str, ...],
    classes: tuple[str, ...],
    class_prior: FloatArray,
    snapshot: Snapshot,
    mine: IntArray,
    targets: FusedTargets,
    deleted: IntArray,
) -> FusedTracks:
    """Gather the fused tracks; ``mine`` (M,) is the target of each track."""
    stamp_ns, system_uuid, sequence = head
    n, n_radars = len(targets.identity), len(parameters.radars)
    row = np.searchsorted(targets.identity, mine)
    place = (row, snapshot.radar)
    member = np.zeros((n, n_radars), dtype=np.bool_)
    member[place] = True
    track_id = np.zeros((n, n_radars), dtype=np.int64)
    track_id[place] = snapshot.track_id
    log_likelihood = np.zeros((n, len(classes)))
    with np.errstate(divide="ignore"):
        np.add.at(log_likelihood, row, np.log(snapshot.likelihood))
    # A class that every radar rules out by itself, each another one: nothing is left.
    log_likelihood[np.isneginf(log_likelihood).all(axis=1)] = 0.0
    mean, covariance = _states(parameters, snapshot, place, member, targets)
    return FusedTracks(
        stamp_ns,
        parameters.fusion_frame,
        system_uuid,
        sequence,
        parameters.fusion_rule,
        tuple(parameters.radars),
        radar_states,
        classes,
        targets.identity.copy(),
        mean,
        covariance,
        class_probabilities(log_likelihood, class_prior),
        _existence(snapshot, row, n),
        targets.probability.copy(),
        member,
        track_id,
        targets.fusions.copy(),
        targets.first_ns.copy(),
        deleted,
    )


def _states(
    parameters: TrackFusionParameters,
    snapshot: Snapshot,
    place: tuple[IntArray, IntArray],
    member: np.ndarray,
    targets: FusedTargets,
) -> tuple[FloatArray, FloatArray]:
    if parameters.fusion_rule == EQUIVALENT_MEASUREMENTS:
        return targets.states(parameters.bias_minimum_probability)
    biases = targets.biases(parameters.bias_minimum_probability)
    mean = np.zeros((*member.shape, 4))
    covariance = np.tile(np.eye(4), (*member.shape, 1, 1))
    mean[place], covariance[place] = snapshot.mean, snapshot.covariance
    mean[..., :2] += biases.mean
    covariance[..., :2, :2] += biases.covariance
    rule = fuse_independent if parameters.fusion_rule == INDEPENDENT else covariance_intersection
    return rule(mean, covariance, member)


def _existence(snapshot: Snapshot, row: IntArray, n: int) -> FloatArray:
    """Chance (N,) that one track at least has a target behind it."""
    known = np.isfinite(snapshot.existence)
    nothing = np.ones(n)
    np.multiply.at(nothing, row[known], 1.0 - np.clip(snapshot.existence[known], 0.0, 1.0))
    told = np.zeros(n, dtype=np.bool_)
    told[row[known]] = True
    return np.where(told, 1.0 - nothing, np.nan)


def associations_of(
    head: Head,
    parameters: TrackFusionParameters,
    snapshot: Snapshot,
    mine: IntArray,
    found: TrackAssociation,
    targets: FusedTargets,
) -> TrackAssociations:
    """Gather how the tracks belong together, and the biases."""
    stamp_ns, system_uuid, sequence = head
    biases = targets.biases(parameters.bias_minimum_probability).hidden()
    reference = targets.unknowns.reference
    return TrackAssociations(
        stamp_ns,
        parameters.fusion_frame,
        system_uuid,
        sequence,
        tuple(parameters.radars),
        np.bincount(snapshot.radar, minlength=len(parameters.radars)),
        snapshot.track_id,
        mine,
        found.pairs,
        found.labels,
        found.probability,
        found.chosen_row,
        found.chosen_probability,
        found.covered,
        found.method,
        parameters.radars[reference] if reference >= 0 else "",
        biases.mean,
        biases.covariance,
        found.biases.mean,
        found.biases.covariance,
    )
