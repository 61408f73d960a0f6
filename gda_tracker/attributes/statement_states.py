"""What statements about tracks say of where the tracks are.

A statement multiplies the density of a track by mu. Of the product its integral is needed, the
likelihood, and its first two moments, the state that goes on. With phi(u) = log of the mean of mu
under the Gaussian moved by L u, L L' = S being the covariance of its position, they are exactly

    likelihood exp(phi(0)),    mean p + L grad phi(0),    covariance L (1 + Hessian phi(0)) L',

for any mu (differentiate the Gaussian by its mean). For a region of Gaussian shape this is the
Kalman update by its centre; for any other, and mixtures of them, the Gaussian of the same moments.
The derivatives are differences of the fourth order of the closed mean, good to about 1e-6; what
a statement leaves of a variance is at least ``LEAST_VARIANCE`` of it. Velocities follow by their
correlation with the position.

Class and place hang together where the pieces of a statement differ in both. A row carries weights
of its classes; each statement multiplies them by the mean of mu(., c), divided by that mean over
the prediction, with which the class has been updated already
(:mod:`gda_tracker.attributes.statement_histories`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gda_tracker.attributes.statement_meaning import Meaning, track_meaning
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, Int32Array, IntArray
from gda_tracker.vocabulary.statements import TRACK, Statement

LEAST_VARIANCE = 1e-4
_STEP = 0.02
# Points u of the differences: the middle, then four along each axis, then two rings of corners.
_AXIS = np.array([[-2.0, 0.0], [-1.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
_CORNERS = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]])
_POINTS = _STEP * np.concatenate([[[0.0, 0.0]], _AXIS, _AXIS[:, ::-1], _CORNERS, 2.0 * _CORNERS])
_FIRST = np.array([1.0, -8.0, 8.0, -1.0]) / (12.0 * _STEP)
_SECOND = np.array([-1.0, 16.0, 16.0, -1.0]) / (12.0 * _STEP**2)
_MIXED = np.array([1.0, -1.0, -1.0, 1.0]) / (4.0 * _STEP**2)


@dataclass(frozen=True, slots=True)
class Rows:
    """R Gaussian states ``mean`` (R, s), ``covariance`` (R, s, s), positions first.

    ``class_weight`` (R, C) are weights of the classes, (R, 1) where classes play no part.
    """

    mean: FloatArray
    covariance: FloatArray
    class_weight: FloatArray


def region_meanings(
    statements: Sequence[Statement], class_names: tuple[str, ...]
) -> list[tuple[int, Meaning]]:
    """Track id and meaning of each statement that says where a track is, in order."""
    found = []
    for statement in statements:
        if statement.about == TRACK:
            meaning = track_meaning(statement, class_names)
            if meaning.regions:
                found.append((statement.track_id, meaning))
    return found


def hear(
    meaning: Meaning, rows: Rows, about: BoolArray, divisor: FloatArray | None = None
) -> tuple[Rows, FloatArray]:
    """Multiply the rows that a statement is about (R,) by its mu.

    Parameters
    ----------
    meaning
        Of the statement.
    rows
        Before it.
    about
        (R,) whether it is about the row.
    divisor
        (R, C) by which the means of mu(., c) are divided; ``None``: 1.

    Returns
    -------
    rows, mean
        The rows after it, their class weights no longer of the sum one, and the means (R, C) of
        mu(., c) before, 1 where it is about another row.
    """
    value = np.ones_like(rows.class_weight)
    which = np.flatnonzero(about)
    if not len(which):
        return rows, value
    weight = rows.class_weight[which]
    if divisor is not None:
        weight = weight / divisor[which]
    mean, covariance = rows.mean.copy(), rows.covariance.copy()
    position, spread = mean[which, :2], covariance[which, :2, :2]
    factor = np.asarray(np.linalg.cholesky(spread), dtype=np.float64)
    moved = position[:, None] + _POINTS @ factor.transpose(0, 2, 1)
    each = meaning.expectation(
        moved.reshape(-1, 2), np.repeat(spread, len(_POINTS), axis=0)
    ).reshape(len(which), len(_POINTS), -1)
    value[which] = each[:, 0]
    # Only ratios matter: the largest weight is one, so that no logarithm is of zero.
    top = np.maximum(weight.max(axis=1), np.finfo(np.float64).tiny)
    phi = np.log((each * (weight / top[:, None])[:, None]).sum(axis=2))
    gradient, hessian = _derivatives(phi)
    shrink = _bounded(np.eye(2) + hessian)
    mean[which], covariance[which] = _moved(
        mean[which], covariance[which], factor, gradient, shrink
    )
    classes = rows.class_weight.copy()
    classes[which] = weight * each[:, 0]
    return Rows(mean, covariance, classes), value


def _derivatives(phi: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Gradient (R, 2) and Hessian (R, 2, 2) from values (R, 17) at the points."""
    relative = phi - phi[:, :1]
    x, y = relative[:, 1:5], relative[:, 5:9]
    gradient = np.stack([x @ _FIRST, y @ _FIRST], axis=1)
    near, far = relative[:, 9:13] @ _MIXED, relative[:, 13:17] @ _MIXED / 4.0
    hessian = np.empty((len(phi), 2, 2))
    hessian[:, 0, 0], hessian[:, 1, 1] = x @ _SECOND, y @ _SECOND
    hessian[:, 0, 1] = hessian[:, 1, 0] = (4.0 * near - far) / 3.0
    return gradient, hessian


def _bounded(matrix: FloatArray) -> FloatArray:
    """Symmetric matrices (R, 2, 2) with eigenvalues of ``LEAST_VARIANCE`` at least."""
    values, vectors = np.linalg.eigh(matrix)
    scaled = vectors * np.maximum(values, LEAST_VARIANCE)[:, None]
    return np.asarray(scaled @ vectors.transpose(0, 2, 1), dtype=np.float64)


def _moved(
    mean: FloatArray,
    covariance: FloatArray,
    factor: FloatArray,
    gradient: FloatArray,
    shrink: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """States whose position has the new moments; what goes with it follows by regression."""
    # P H' S^-1 L = P H' L'^-1 in whitened coordinates.
    gain = np.linalg.solve(factor, covariance[:, :2]).transpose(0, 2, 1)
    new_mean = mean + (gain @ gradient[:, :, None])[:, :, 0]
    change = gain @ (shrink - np.eye(2)) @ gain.transpose(0, 2, 1)
    new = covariance + 0.5 * (change + change.transpose(0, 2, 1))
    return new_mean, new


def component_rows(start: Int32Array, rows: IntArray) -> tuple[IntArray, IntArray]:
    """Owner (R',) and component (R',) of every component of hypotheses ``rows`` (R,)."""
    first = np.asarray(start, dtype=np.int64)
    count = np.diff(first)[rows]
    owner = np.repeat(np.arange(len(rows)), count)
    begin = np.concatenate([[0], np.cumsum(count)])
    return owner, np.arange(begin[-1]) - begin[owner] + first[rows][owner]
