"""The set-valued Kalman filter (Stirling & Thompson 1991, section III, equations 5 to 8, 12 to 15).

A track set holds the Gaussian distributions N(x, P) of all means x in an ellipsoid,
{c + K u : |u| <= 1}. Every mean goes through the same Kalman filter; since that filter is affine in
the mean, the ellipsoid stays one, and three arrays say it all: centroid c, covariance P, matrix K.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray


@dataclass(slots=True)
class TrackSets:
    """N track sets over states of n components.

    ``centroid`` (N, n), ``covariance`` P (N, n, n) positive definite, ``matrix`` K (N, n, k) with
    any k and any rank: K = 0 is a point, for which all this is the Kalman filter.
    """

    centroid: FloatArray
    covariance: FloatArray
    matrix: FloatArray

    def __len__(self) -> int:
        return len(self.centroid)

    def select(self, rows: IntArray | BoolArray | slice) -> TrackSets:
        """Return the sets of the given rows."""
        return TrackSets(self.centroid[rows], self.covariance[rows], self.matrix[rows])

    def joined(self, other: TrackSets) -> TrackSets:
        """Return these sets and then those of ``other``, of the same n and k."""
        return TrackSets(
            np.concatenate([self.centroid, other.centroid]),
            np.concatenate([self.covariance, other.covariance]),
            np.concatenate([self.matrix, other.matrix]),
        )

    def radius(self, rows: slice) -> FloatArray:
        """Longest half axis (N,) of the sets seen in the components ``rows`` of the state alone."""
        part = self.matrix[:, rows]
        if not len(part):
            return np.zeros(0)
        return np.sqrt(np.maximum(np.linalg.eigvalsh(part @ part.transpose(0, 2, 1))[:, -1], 0.0))


def predict_sets(sets: TrackSets, transition: FloatArray, process_noise: FloatArray) -> TrackSets:
    """Predict sets by one time step, equations (6) to (8): c = F c, P = F P F' + Q, K = F K.

    Parameters
    ----------
    sets
        N track sets.
    transition, process_noise
        F and G Q G', (n, n) for all or (N, n, n).
    """
    turned = np.swapaxes(transition, -1, -2)
    return TrackSets(
        (transition @ sets.centroid[:, :, None])[:, :, 0],
        transition @ sets.covariance @ turned + process_noise,
        transition @ sets.matrix,
    )


def update_sets(
    sets: TrackSets, observation: FloatArray, observing: FloatArray, noise: FloatArray
) -> TrackSets:
    """Filter set i with observation i, equations (13) to (15).

    Parameters
    ----------
    sets
        N predicted track sets.
    observation
        z (N, r).
    observing
        H (r, n) for all or (N, r, n).
    noise
        R (r, r) for all or (N, r, r), positive definite.

    Returns
    -------
    TrackSets
        c + W (z - H c), (I - W H) P and (I - W H) K with the Kalman gain W.
    """
    observing = np.broadcast_to(observing, (len(sets), *np.shape(observing)[-2:]))
    crossed = observing @ sets.covariance
    innovation = crossed @ observing.transpose(0, 2, 1) + noise
    gain = np.linalg.solve(innovation, crossed).transpose(0, 2, 1)
    residual = observation[:, :, None] - observing @ sets.centroid[:, :, None]
    covariance = sets.covariance - gain @ crossed
    return TrackSets(
        sets.centroid + (gain @ residual)[:, :, 0],
        (covariance + covariance.transpose(0, 2, 1)) / 2.0,
        sets.matrix - gain @ (observing @ sets.matrix),
    )


def squared_distances(residual: FloatArray, spread: FloatArray, noise: FloatArray) -> FloatArray:
    """Squared distance, in standard deviations, from the nearest member of a set.

    Parameters
    ----------
    residual
        (M, d): a point minus the centre of the set.
    spread
        (M, d, k): the set is {centre + spread u : |u| <= 1}.
    noise
        (M, d, d): covariance about each member, positive definite.

    Returns
    -------
    (M,) min over |u| <= 1 of (residual - spread u)' noise^-1 (residual - spread u); 0 inside.

    Notes
    -----
    In the axes in which noise is the identity and the spread a diagonal of half axes s_i, the
    minimum has u_i = s_i w_i / (s_i^2 + mu) with the mu >= 0 that makes |u| = 1; it is found by
    bisection, and mu = 0 where the point lies in the set.
    """
    if not len(residual):
        return np.zeros(0)
    root = np.linalg.cholesky(noise)
    point = np.linalg.solve(root, residual[:, :, None])[:, :, 0]
    axes = np.linalg.solve(root, spread)
    squares, turn = np.linalg.eigh(axes @ axes.transpose(0, 2, 1))
    # Axes that are nothing but rounding are none.
    squares = np.where(squares > 1e-14 * squares[:, -1:], squares, 0.0)
    along = (turn.transpose(0, 2, 1) @ point[:, :, None])[:, :, 0]
    half = np.sqrt(squares)
    low = np.zeros(len(point))
    high = np.sqrt(np.sum((half * along) ** 2, axis=1))
    safe = np.where(squares > 0.0, half, 1.0)
    inside = np.sum(np.where(squares > 0.0, along / safe, 0.0) ** 2, axis=1) <= 1.0
    for _ in range(100):
        middle = (low + high) / 2.0
        shift = np.maximum(squares + middle[:, None], np.finfo(float).tiny)
        outside = np.sum((half * along / shift) ** 2, axis=1) > 1.0
        low, high = np.where(outside, middle, low), np.where(outside, high, middle)
    middle = np.where(inside, 0.0, (low + high) / 2.0)
    # Where there is no extent along an axis nothing can be taken off.
    divisor = np.where(squares > 0.0, squares + middle[:, None], 1.0)
    left = np.where(squares > 0.0, middle[:, None] / divisor, 1.0)
    return np.sum((along * left) ** 2, axis=1)
