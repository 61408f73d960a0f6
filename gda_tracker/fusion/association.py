"""Which tracks of several radars belong together: exact probabilities (Ferry 2010).

Positions and velocities of the tracks are the measurements of ``association.xmap``, with a bias of
the positions and none of the velocities. The class beliefs are their features: each track brings
the likelihood of every class.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse
from scipy.sparse.csgraph import connected_components
from scipy.special import chdtri

from gda_tracker.association.xmap.json_values import ProblemError
from gda_tracker.association.xmap.model import (
    LOG_DIFFUSE,
    CountPrior,
    ObjectTypes,
    SensorData,
    SensorModel,
)
from gda_tracker.association.xmap.partitions import association_count
from gda_tracker.association.xmap.solution import ENUMERATION, GIBBS, Sampling, Solution, solve
from gda_tracker.fusion.biases import Biases
from gda_tracker.fusion.motion import STATE
from gda_tracker.fusion.parameters import TrackFusionParameters
from gda_tracker.fusion.snapshot import Snapshot
from gda_tracker.vocabulary.arrays import FloatArray, IntArray

NONE, FAILED = "none", "failed"

VELOCITY_BIAS_STD_MPS = 1e-3
"""In place of zero, which has no inverse."""

SPLIT_TAIL = 1e-9
"""Chance that two tracks of a target lie in different parts of a divided problem."""

CHAINS = 2


@dataclass(frozen=True)
class TrackAssociation:
    """Associations of the M tracks of a snapshot, most probable first.

    Attributes
    ----------
    labels : (K, M)
        Tracks of the same target have the same label; at most ``top_associations``.
    probability : (K,)
    chosen : (M,)
        Labels of the association to use, from 0 without a gap: the most probable one, unless that
        takes apart or joins what was otherwise until now and is not much more probable.
    chosen_row
        Its row, -1 if it is not among the K.
    chosen_probability
    cluster_probability : (number of labels in ``chosen``,)
        That exactly these tracks belong to one target, over all associations.
    pairs : (M, M)
        That two tracks belong to one target.
    covered
        Share of the probability that was looked at.
    method
        ``enumeration``, ``gibbs``, ``none`` where no two radars have tracks, or ``failed``: too
        many tracks, or no association is possible; they stay together as they were.
    biases
        Of these tracks alone with the prior given, over all associations; NaN: not known.
    """

    labels: IntArray
    probability: FloatArray
    chosen: IntArray
    chosen_row: int
    chosen_probability: float
    cluster_probability: FloatArray
    pairs: FloatArray
    covered: float
    method: str
    biases: Biases


def associate(
    snapshot: Snapshot,
    parameters: TrackFusionParameters,
    prior: Biases,
    class_prior: FloatArray,
) -> TrackAssociation:
    """Associate tracks, given what is known of the biases beforehand.

    Where the biases are known better than the tracks, the problem falls into parts that are too far
    apart to have to do with each other, and each is solved by itself.
    """
    parts = _parts(snapshot, prior)
    solved = [_solve(snapshot, part, parameters, prior, class_prior) for part in parts]
    return _join(snapshot, parts, solved, parameters, prior)


def changes_of_company(labels: IntArray, radar: IntArray, company: IntArray) -> IntArray:
    """Number (A,) of pairs that were together and are not, or were apart and are not."""
    known = company >= 0
    i, j = np.triu_indices(len(radar), 1)
    looked_at = known[i] & known[j] & (radar[i] != radar[j])
    i, j = i[looked_at], j[looked_at]
    before = company[i] == company[j]
    return np.asarray(((labels[:, i] == labels[:, j]) != before).sum(axis=1))


@dataclass(frozen=True)
class _Part:
    """The solution of a part: associations, the choice, and what was learnt of the biases."""

    labels: IntArray
    probability: FloatArray
    chosen: int
    cluster_probability: FloatArray
    pairs: FloatArray
    covered: float
    method: str
    biases: Biases | None


def _parts(snapshot: Snapshot, prior: Biases) -> list[IntArray]:
    """Rows of each part, smallest first row first."""
    everything = np.arange(len(snapshot))
    present = np.unique(snapshot.radar)
    if len(present) < 2:
        return [everything] if len(everything) else []
    bias = np.trace(prior.covariance[present], axis1=1, axis2=2).max()
    own = np.median(np.trace(snapshot.covariance[:, :2, :2], axis1=1, axis2=2))
    if bias > own:
        return [everything]
    mean = snapshot.mean.copy()
    mean[:, :2] += prior.mean[snapshot.radar]
    covariance = snapshot.covariance.copy()
    covariance[:, :2, :2] += prior.covariance[snapshot.radar]
    difference = mean[:, None] - mean
    together = covariance[:, None] + covariance
    solved = np.linalg.solve(together, difference[..., None])[..., 0]
    near = (difference * solved).sum(axis=2) <= float(chdtri(STATE, SPLIT_TAIL))
    # Tracks that were together are asked whether they part.
    near |= (snapshot.company[:, None] == snapshot.company) & (snapshot.company >= 0)
    near &= snapshot.radar[:, None] != snapshot.radar
    count, part = connected_components(scipy.sparse.csr_matrix(near), directed=False)
    return [(part == k).nonzero()[0] for k in range(count)]


def _solve(
    snapshot: Snapshot,
    rows: IntArray,
    parameters: TrackFusionParameters,
    prior: Biases,
    class_prior: FloatArray,
) -> _Part:
    radar = snapshot.radar[rows]
    if len(np.unique(radar)) < 2:
        alone = np.arange(len(rows))
        return _Part(
            alone[None], np.ones(1), 0, np.ones(len(rows)), np.eye(len(rows)), 1.0, NONE, None
        )
    try:
        solution = _solution(snapshot, rows, parameters, prior, class_prior)
    except ProblemError:
        return _as_before(snapshot.company[rows], radar)
    changes = changes_of_company(solution.labels, radar, snapshot.company[rows])
    with np.errstate(divide="ignore"):
        weight = np.log(solution.probability) - changes * np.log(parameters.switching_odds)
    chosen = int(weight.argmax())
    return _Part(
        solution.labels,
        solution.probability,
        chosen,
        _cluster_probabilities(solution, chosen),
        solution.pairs + np.eye(len(rows)),
        solution.covered,
        solution.method,
        _biases(solution, prior, radar),
    )


def _as_before(company: IntArray, radar: IntArray) -> _Part:
    """Leave tracks where they were; those without company stay alone."""
    n = len(company)
    alone = company.max(initial=-1) + 1 + np.arange(n)
    labels = np.unique(np.where(company >= 0, company, alone), return_inverse=True)[1].reshape(-1)
    unknown = np.zeros(int(labels.max()) + 1)
    return _Part(labels[None], np.zeros(1), 0, unknown, np.eye(n), 0.0, FAILED, None)


def _solution(
    snapshot: Snapshot,
    rows: IntArray,
    parameters: TrackFusionParameters,
    prior: Biases,
    class_prior: FloatArray,
) -> Solution:
    if len(rows) > parameters.max_associated_tracks:
        raise ProblemError(
            f"{len(rows)} tracks: allowed are {parameters.max_associated_tracks} "
            "(max_associated_tracks)"
        )
    radar = snapshot.radar[rows]
    n_radars = len(prior.mean)
    sizes = tuple(np.bincount(radar, minlength=n_radars).tolist())
    n_classes = max(len(class_prior), 1)
    types = class_prior if len(class_prior) else np.ones(1)
    likelihood = snapshot.likelihood[rows] if len(class_prior) else np.ones((len(rows), 1))
    # Each track calls a type of its own, whose column of the confusion matrix is its likelihood:
    # only the ratios of a column count.
    confusion = tuple(
        likelihood[radar == s].T if sizes[s] else np.ones((n_classes, 1)) for s in range(n_radars)
    )
    calls = np.concatenate([np.arange(size) for size in sizes])
    detection = np.array(parameters.of_radars("track_probability"))
    bias = np.zeros((n_radars, STATE, STATE))
    bias[:, :2, :2] = prior.covariance
    bias[:, [2, 3], [2, 3]] = np.where(
        prior.covariance.any(axis=(1, 2)), VELOCITY_BIAS_STD_MPS**2, 0.0
    )[:, None]
    model = SensorModel(
        sizes,
        np.diag(np.repeat([parameters.region_std_m**2, parameters.speed_std_mps**2], 2)),
        tuple(bias),
        ObjectTypes(types, np.tile(detection[:, None], (1, n_classes)), confusion),
        CountPrior(LOG_DIFFUSE),
        np.array(parameters.of_radars("expected_false_tracks")),
    )
    positions = snapshot.mean[rows].copy()
    positions[:, :2] += prior.mean[radar]
    data = SensorData(positions, snapshot.covariance[rows], calls)
    enumerated = association_count(sizes) <= parameters.max_enumerated
    return solve(
        model,
        data,
        ENUMERATION if enumerated else GIBBS,
        Sampling(sweeps=parameters.sampling_sweeps, chains=CHAINS),
    )


def _cluster_probabilities(solution: Solution, chosen: int) -> FloatArray:
    """Chance of each cluster of an association, that its tracks and no others are together."""
    labels = solution.labels
    mine = labels[chosen]
    found = np.empty(int(mine.max()) + 1)
    for number in range(len(found)):
        inside = mine == number
        first = labels[:, inside.argmax()][:, None]
        same = ((labels == first) == inside).all(axis=1)
        found[number] = solution.probability[same].sum()
    return found


def _biases(solution: Solution, prior: Biases, radar: IntArray) -> Biases:
    """Biases from the engine's, which come on top of the prior means."""
    bias = solution.bias
    # All priors are finite here.
    assert bias.mean is not None
    assert bias.covariance is not None
    mean = bias.mean[:, :2] + prior.mean
    there = np.isin(np.arange(len(mean)), radar)
    return Biases(
        np.where(there[:, None], mean, prior.mean),
        np.where(there[:, None, None], bias.covariance[:, :2, :2], prior.covariance),
    )


def _join(
    snapshot: Snapshot,
    parts: list[IntArray],
    solved: list[_Part],
    parameters: TrackFusionParameters,
    prior: Biases,
) -> TrackAssociation:
    """Put the parts together: probabilities multiply."""
    n, most = len(snapshot), parameters.top_associations
    labels, probability = np.zeros((1, n), dtype=np.int64), np.ones(1)
    row, chosen = 0, np.zeros(n, dtype=np.int64)
    chosen_probability, clusters, pairs = 1.0, [np.zeros(0)], np.zeros((n, n))
    offset, next_label, covered, methods = 0, 0, 1.0, {NONE}
    for rows, part in zip(parts, solved, strict=True):
        # The k most probable of all are made of the k most probable of each.
        together = probability[:, None] * part.probability[:most]
        order = np.argsort(-together, axis=None, kind="stable")[:most]
        left, right = np.unravel_index(order, together.shape)
        place = ((left == row) & (right == part.chosen)).nonzero()[0] if row >= 0 else []
        row = int(place[0]) if len(place) else -1
        probability = together[left, right]
        labels = labels[left]
        labels[:, rows] = part.labels[right] + offset
        offset += int(part.labels.max(initial=-1)) + 1
        chosen[rows] = part.labels[part.chosen] + next_label
        next_label += len(part.cluster_probability)
        chosen_probability *= float(part.probability[part.chosen])
        clusters.append(part.cluster_probability)
        pairs[np.ix_(rows, rows)] = part.pairs
        covered *= part.covered
        methods.add(part.method)
    found = [part.biases for part in solved if part.biases is not None]
    biases = found[0] if len(found) == 1 else combined_biases(found, prior)
    method = next(name for name in (FAILED, GIBBS, ENUMERATION, NONE) if name in methods)
    return TrackAssociation(
        labels,
        probability,
        chosen,
        row,
        chosen_probability,
        np.concatenate(clusters),
        pairs,
        covered,
        method,
        biases.hidden(),
    )


def combined_biases(parts: list[Biases], prior: Biases) -> Biases:
    """Biases from parts that had the same prior, which counts once."""
    known = prior.covariance.any(axis=(1, 2))
    mean, covariance = prior.mean.copy(), prior.covariance.copy()
    if not parts or not known.any():
        return Biases(mean, covariance)
    base = np.linalg.inv(covariance[known])
    information, vector = base.copy(), np.einsum("rij,rj->ri", base, mean[known])
    for part in parts:
        own = np.linalg.inv(part.covariance[known])
        information += own - base
        vector += np.einsum("rij,rj->ri", own, part.mean[known])
        vector -= np.einsum("rij,rj->ri", base, mean[known])
    covariance[known] = np.linalg.inv(information)
    mean[known] = np.einsum("rij,rj->ri", covariance[known], vector)
    return Biases(mean, covariance)
