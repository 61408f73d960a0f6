"""Hypothesis probabilities for generalised measurements (Mahler 2011, sections 3, 5 and 7).

The log weights of a joint hypothesis theta are those of the engines of this package: a pair
weighs p_D l(Theta_j | i), a track without measurement 1 - p_D, an unassigned measurement
lambda c(Theta_j). The weight of theta is p_D^n_theta (1 - p_D)^(n - n_theta) times the clutter
factors of the unassigned measurements times the likelihoods of the assigned ones; in (24) the
exponent n_theta stands already inside the printed K, which (23) and (54) raise to it once more. As
c(Theta_j) depends on the measurement, lambda c stays inside for each.

What a human says may change an association. Two tracks have come close in a gap of the radar, one
rather a fighter, one rather a cargo aircraft; their uncertainty is 400 m.

>>> from gda_tracker.association.joint import joint_marginals
>>> from gda_tracker.attributes.bayes import class_update
>>> from gda_tracker.attributes.generalised_measurements import (
...     GaussianShaped, log_association_likelihood, log_clutter_likelihood)
>>> place = np.array([[0.0, -40.0], [0.0, 40.0]])
>>> spread = np.array([400.0**2 * np.eye(2)] * 2)
>>> fighter_or_cargo = np.array([[0.9, 0.1], [0.1, 0.9]])
>>> region = [-2000.0, -2000.0], [2000.0, 2000.0]

The radar detects one target in the south and one in the north, with a noise of 30 m. (A detection
is a fuzzy statement so sharp that only its centre counts.) Left alone it keeps the order:

>>> south_north = np.array([[0.0, -80.0], [-50.0, 180.0]])
>>> detections = GaussianShaped(south_north, np.array([1e-4 * np.eye(2)] * 2))
>>> def associate(place, spread):
...     likelihood = log_association_likelihood(
...         detections, place, spread, noise_covariance=30.0**2 * np.eye(2))
...     return joint_log_weights(
...         likelihood, 0.9, 0.01, log_clutter_likelihood(detections, *region))
>>> most_probable_assignment(associate(place, spread)).tolist()
[0, 1]

Before it did, somebody said "the fighter is by the buoy", a place known to 200 m, with memberships
of 0.9 for a fighter and 0.2 for a cargo aircraft. The class tells whom it was about:

>>> buoy = GaussianShaped([[100.0, 500.0]], [200.0**2 * np.eye(2)])
>>> said = np.log([[0.9, 0.2]])
>>> likelihood = log_joint_likelihood(
...     log_association_likelihood(buoy, place, spread), fighter_or_cargo, said)
>>> weights = joint_log_weights(
...     likelihood, 0.5, 0.1, log_clutter_likelihood(buoy, *region) + np.log(0.5))
>>> joint_marginals(*weights).round(2).tolist()
[[0.71], [0.28]]
>>> about = int(most_probable_assignment(weights).argmax())
>>> about
0

A likelihood of Gaussian shape updates the track as a measurement of c with covariance C would
(section 5.3), and the class by Bayes' rule. Now the same detections go the other way round:

>>> gain = spread[about] @ np.linalg.inv(spread[about] + buoy.shape[0])
>>> place[about] += gain @ (buoy.centre[0] - place[about])
>>> spread[about] -= gain @ spread[about]
>>> class_update(fighter_or_cargo[about], said[0])[0].round(2).tolist()
[0.98, 0.02]
>>> most_probable_assignment(associate(place, spread)).tolist()
[1, 0]
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gda_tracker.association.best_hypothesis import best_hypothesis
from gda_tracker.association.errors import AssociationInputError, NoFeasibleHypothesis
from gda_tracker.association.joint import joint_log_partition
from gda_tracker.attributes.bayes import log_class_mixture
from gda_tracker.vocabulary.arrays import FloatArray, IntArray


class JointLogWeights(NamedTuple):
    """Log weights of the joint hypotheses of n tracks and m measurements, for the engines.

    ``joint_marginals(*weights)`` and ``best_hypothesis(*weights)`` take them as they are.
    """

    log_weight: FloatArray
    log_idle_track: FloatArray
    log_idle_measurement: FloatArray


def joint_log_weights(
    log_likelihood: ArrayLike,
    detection_probability: ArrayLike,
    clutter_rate: float,
    log_clutter_likelihood: ArrayLike,
) -> JointLogWeights:
    """Log weights of n tracks and m measurements of any kind.

    Parameters
    ----------
    log_likelihood
        (n, m) log l(Theta_j | i) (46), or log l(z_j | i) (9) of a traditional measurement; -inf
        where it is impossible.
    detection_probability
        () or (n,) p_D of each track, from 0 to 1.
    clutter_rate
        lambda, expected number of false alarms, >= 0.
    log_clutter_likelihood
        (m,) log c(Theta_j) (47), or log c(z_j), in the same unit as the likelihoods.

    Raises
    ------
    AssociationInputError
        For a wrong shape, NaN, +inf, or a probability or rate out of its range.

    Examples
    --------
    A statement fits the second track; was it a false alarm, at 0.1 expected ones?

    >>> from gda_tracker.association.joint import joint_marginals
    >>> log_likelihood = np.log([[0.01], [0.6]])
    >>> weights = joint_log_weights(log_likelihood, 0.5, 0.1, np.log([0.2]))
    >>> joint_marginals(*weights).round(3).tolist()
    [[0.016], [0.952]]
    """
    pairs = np.asarray(log_likelihood, dtype=np.float64)
    if pairs.ndim != 2:
        raise AssociationInputError(
            f"log_likelihood has the shape {pairs.shape}: allowed is (n, m)"
        )
    n, m = pairs.shape
    detection = np.asarray(detection_probability, dtype=np.float64)
    clutter = np.asarray(log_clutter_likelihood, dtype=np.float64)
    if detection.shape not in ((), (n,)):
        raise AssociationInputError(
            f"detection_probability has the shape {detection.shape}: allowed is () or ({n},)"
        )
    if clutter.shape != (m,):
        raise AssociationInputError(
            f"log_clutter_likelihood has the shape {clutter.shape}: allowed is ({m},)"
        )
    if not ((detection >= 0.0) & (detection <= 1.0)).all():
        raise AssociationInputError(
            f"detection_probability = {detection.tolist()}: allowed are numbers from 0 to 1"
        )
    if not 0.0 <= clutter_rate < np.inf:
        raise AssociationInputError(f"clutter_rate = {clutter_rate}: allowed is a number >= 0")
    for name, values in (("log_likelihood", pairs), ("log_clutter_likelihood", clutter)):
        if not (values < np.inf).all():
            raise AssociationInputError(f"{name} has NaN or +inf: allowed are numbers and -inf")
    with np.errstate(divide="ignore"):
        log_detected = np.broadcast_to(np.log(detection), (n,))
        log_missed = np.broadcast_to(np.log1p(-detection), (n,)).copy()
        log_rate = np.log(clutter_rate)
    return JointLogWeights(pairs + log_detected[:, None], log_missed, clutter + log_rate)


def log_joint_likelihood(
    log_kinematic: FloatArray, class_probability: FloatArray, class_log_likelihood: FloatArray
) -> FloatArray:
    """Log l(phi, z | i) (n, m) of place and class together, independent given the track (86)-(89).

    The hypothesis probability then factorises as well (90)-(92), with the detection and clutter
    factors counted once: they stand in :func:`joint_log_weights`.

    Parameters
    ----------
    log_kinematic
        (n, m) log l(z_j | i) or log l(Theta_j | i).
    class_probability
        (n, C) f(c | i).
    class_log_likelihood
        (m, C) log f(phi_j | c).
    """
    return log_kinematic + log_class_mixture(class_probability[:, None], class_log_likelihood)


def log_hypothesis_weight(weights: JointLogWeights, assignment: ArrayLike) -> FloatArray:
    """Log weights (...) of joint hypotheses: log of (22), (49), (54) without the factor e^-lambda.

    Parameters
    ----------
    weights
        Of n tracks and m measurements.
    assignment
        (..., n) measurement of each track, -1 for none.

    Raises
    ------
    AssociationInputError
        For a wrong shape, a measurement that is not there, or one that two tracks share.
    """
    n, m = weights.log_weight.shape
    theta = _checked(assignment, n, m)
    assigned = theta >= 0
    column = np.where(assigned, theta, 0)
    bordered = np.concatenate([weights.log_weight, weights.log_idle_track[:, None]], axis=1)
    of_tracks = bordered[np.arange(n), np.where(assigned, column, m)].sum(axis=-1)
    used = (theta[..., None] == np.arange(m)).any(axis=-2)
    idle = np.where(used, 0.0, weights.log_idle_measurement)
    return np.asarray(of_tracks + idle.sum(axis=-1))


def global_distance_squared(weights: JointLogWeights, assignment: ArrayLike) -> FloatArray:
    """Squared global association distance (...): -2 log of the weight of a hypothesis (17).

    It is -2 times the sum of log l over the tracks, up to a constant, only where p_D = 1 and the
    clutter likelihood is the same for all measurements; the factor -1/2 printed in (53) is wrong.
    Arguments as in :func:`log_hypothesis_weight`.
    """
    return -2.0 * log_hypothesis_weight(weights, assignment)


def log_hypothesis_probability(weights: JointLogWeights, assignment: ArrayLike) -> FloatArray:
    """Log posterior probabilities (...) of joint hypotheses: (15), (23), (51), (54), normalised.

    Arguments as in :func:`log_hypothesis_weight`.

    Raises
    ------
    NoFeasibleHypothesis
        If every joint hypothesis has weight zero.
    """
    log_partition = joint_log_partition(*weights)
    if log_partition == -np.inf:
        raise NoFeasibleHypothesis("every joint hypothesis has weight zero")
    return log_hypothesis_weight(weights, assignment) - log_partition


def most_probable_assignment(weights: JointLogWeights) -> IntArray:
    """Measurement of each track (n,), -1 for none, in the most probable joint hypothesis (16).

    Raises
    ------
    NoFeasibleHypothesis
        If every joint hypothesis has weight zero.
    """
    best = best_hypothesis(*weights)
    if best is None:
        raise NoFeasibleHypothesis("every joint hypothesis has weight zero")
    return best


def _checked(assignment: ArrayLike, n: int, m: int) -> IntArray:
    theta = np.asarray(assignment)
    if theta.ndim == 0 or theta.shape[-1] != n or not np.issubdtype(theta.dtype, np.integer):
        raise AssociationInputError(
            f"assignment has the shape {theta.shape} and type {theta.dtype}: allowed are integers "
            f"(..., {n})"
        )
    if ((theta < -1) | (theta >= m)).any():
        raise AssociationInputError(f"assignment: allowed are -1 and 0 to {m - 1}")
    ordered = np.sort(theta, axis=-1)
    if ((ordered[..., 1:] == ordered[..., :-1]) & (ordered[..., 1:] >= 0)).any():
        raise AssociationInputError("assignment: allowed is a measurement with one track at most")
    return theta.astype(np.int64)
