"""Random matrices: kinematics and extent of extended objects or groups, N at a time.

An object's detections scatter about its centroid with the covariance ``spread`` X + R: X [m2] is
the extent, a symmetric positive definite matrix to be estimated; the ellipse y' X^-1 y = 1 is the
object's outline. Scatterers all over an ellipse in the plane make ``spread`` 1/4, with ``spread`` 1
the extent is the covariance of the scatterers itself (Koch 2014, (2.50)). R is the sensor's noise.

Two filters, told apart by how the centroid's error is taken to depend on the extent:

- :func:`koch_update` (Koch, "Bayesian approach to extended object and cluster tracking using random
  matrices", 2008; Koch 2014, (2.50)-(2.54)): in proportion, P~ (x) X, and no noise of the sensor.
  The update is then exact, and so is the likelihood.
- :func:`feldmann_update` (Feldmann, Fraenken and Koch, "Tracking of extended objects and group
  targets using random matrices", 2011): independent of it, any motion model, with noise of the
  sensor; an approximation, which is the one to use where noise and extent are of one size.

The density of the extent is inverse Wishart with mean ``extent`` and ``weight`` a = nu - d - 1,
which counts detections: nu degrees of freedom and scale a X. Its variance is finite for a > 2, and
forgetting leads there: a -> 2 + (a - 2) exp(-dt / memory).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln

from gda_tracker.kinematics.extended.ellipses import symmetric_power
from gda_tracker.vocabulary.arrays import FloatArray, IntArray

LEAST_WEIGHT = 2.0
LOG_2PI = math.log(2.0 * math.pi)


@dataclass(slots=True)
class ExtendedStates:
    """What is known of N objects.

    ``mean`` (N, s) holds d positions, then d velocities, and so forth. ``covariance`` is (N, s, s)
    for Feldmann's filter, (N, s/d, s/d) for Koch's, where that of the state is it (x) X.
    ``extent`` (N, d, d) is the expected extent [m2], ``weight`` (N,) > 2 its certainty.
    """

    mean: FloatArray
    covariance: FloatArray
    extent: FloatArray
    weight: FloatArray

    def __len__(self) -> int:
        return len(self.mean)

    def select(self, rows: IntArray) -> ExtendedStates:
        """The objects ``rows``."""
        return ExtendedStates(
            self.mean[rows], self.covariance[rows], self.extent[rows], self.weight[rows]
        )


@dataclass(slots=True)
class Cells:
    """One set of detections for each of N objects.

    ``count`` (N,) n, ``centroid`` (N, d) and ``scatter`` (N, d, d), the sum of the outer products
    of the deviations from the centroid (Koch 2014, (2.52)-(2.53)); ``noise`` (N, d, d) is the mean
    of the detections' noise covariances, zero for a perfect sensor.
    """

    count: IntArray
    centroid: FloatArray
    scatter: FloatArray
    noise: FloatArray

    def select(self, rows: IntArray) -> Cells:
        """The cells ``rows``."""
        return Cells(self.count[rows], self.centroid[rows], self.scatter[rows], self.noise[rows])


def cells_of(
    positions: FloatArray, label: IntArray, noise: FloatArray | None = None, cells: int = 0
) -> Cells:
    """Count, centroid and scatter of the detections of each label.

    Parameters
    ----------
    positions
        (n, d) [m].
    label
        (n,) cell of each, 0 to K - 1; negative: in none.
    noise
        (n, d, d) covariances of the positions' noise [m2].
    cells
        K where the last cells may be empty, else from the labels.

    Raises
    ------
    ValueError
        If a position is not finite, or a cell is empty.
    """
    if not np.isfinite(positions).all():
        raise ValueError("positions: allowed are finite numbers")
    inside = label >= 0
    at, label = positions[inside], label[inside]
    number = max(cells, int(label.max(initial=-1)) + 1)
    count = np.bincount(label, minlength=number)
    if (count == 0).any():
        raise ValueError(f"cell {int(np.argmin(count))} has no detection")
    d = positions.shape[1]
    centroid = np.zeros((number, d))
    np.add.at(centroid, label, at)
    centroid /= count[:, None]
    gap = at - centroid[label]
    scatter = np.zeros((number, d, d))
    np.add.at(scatter, label, gap[:, :, None] * gap[:, None, :])
    mean_noise = np.zeros((number, d, d))
    if noise is not None:
        np.add.at(mean_noise, label, noise[inside])
        mean_noise /= count[:, None, None]
    return Cells(count.astype(np.int64), centroid, scatter, mean_noise)


def predict(
    states: ExtendedStates,
    transition: FloatArray,
    process_noise: FloatArray,
    dt_s: float,
    memory_s: float,
    turn: FloatArray | None = None,
) -> ExtendedStates:
    """Predict kinematics and extent; of both filters.

    Parameters
    ----------
    transition, process_noise
        F and Q (s, s) for Feldmann's filter. For Koch's (s/d, s/d) those of one coordinate, Q then
        in multiples of the extent, so that Q~ (x) X is the process noise.
    dt_s, memory_s
        Time step and the time in which the extent's certainty falls by e [s].
    turn
        (N, d, d) or (d, d) matrices M by which the extent changes, X -> M X M', such as the
        rotation of an object that turns; ``None``: none.
    """
    full = states.mean.shape[1]
    blocks = full // transition.shape[0]
    matrix = transition if blocks == 1 else np.kron(transition, np.eye(blocks))
    extent = states.extent
    if turn is not None:
        extent = turn @ extent @ np.swapaxes(turn, -1, -2)
    kept = math.exp(-dt_s / memory_s)
    return ExtendedStates(
        states.mean @ matrix.T,
        transition @ states.covariance @ transition.T + process_noise,
        extent,
        LEAST_WEIGHT + (states.weight - LEAST_WEIGHT) * kept,
    )


def koch_update(
    states: ExtendedStates, cells: Cells, spread: float = 1.0
) -> tuple[ExtendedStates, FloatArray]:
    """Exact update of N objects, each by the detections of its cell; the sensor has no noise.

    Returns
    -------
    states, log_likelihood
        ``log_likelihood`` (N,) is log p(z_1 .. z_n | n, past), which integrates to one over the n
        positions: exact (log of 1/m^(n d)).

    Notes
    -----
    With p = P~_11 and nu = a + d + 1: S = p + spread / n, W = P~ H~' / S, x + (W (x) I) v,
    P~ - W S W', scale + N + Z / spread with N = v v' / S, nu + n.
    """
    n, d = cells.count.astype(np.float64), cells.centroid.shape[1]
    variance = states.covariance[:, 0, 0]
    innovation = variance + spread / n
    gain = states.covariance[:, :, 0] / innovation[:, None]
    residual = cells.centroid - states.mean[:, :d]
    mean = states.mean + (gain[:, :, None] * residual[:, None, :]).reshape(states.mean.shape)
    covariance = states.covariance - innovation[:, None, None] * gain[:, :, None] * gain[:, None, :]
    pull = residual[:, :, None] * residual[:, None, :] / innovation[:, None, None]
    scale = states.weight[:, None, None] * states.extent
    new_scale = scale + pull + cells.scatter / spread
    weight = states.weight + n
    log_likelihood = (
        _log_wishart_evidence(scale, new_scale, states.weight + d + 1.0, n)
        - 0.5 * n * d * math.log(spread)
        - 0.5 * d * np.log1p(n * variance / spread)
    )
    return (
        ExtendedStates(mean, covariance, _symmetric(new_scale / weight[:, None, None]), weight),
        log_likelihood,
    )


def feldmann_update(
    states: ExtendedStates, cells: Cells, spread: float = 0.25
) -> tuple[ExtendedStates, FloatArray]:
    """Update of N objects, each by the detections of its cell, with the sensor's noise.

    Returns
    -------
    states, log_likelihood
        ``log_likelihood`` (N,) as :func:`feldmann_log_likelihood` has it.

    Notes
    -----
    Y = spread X + R, S = H P H' + Y / n; the outer product of the innovation is scaled from S to X,
    the scatter from Y to X, by symmetric roots; a + n.
    """
    n, d = cells.count.astype(np.float64), cells.centroid.shape[1]
    detection = spread * states.extent + cells.noise
    innovation = states.covariance[:, :d, :d] + detection / n[:, None, None]
    gain = states.covariance[:, :, :d] @ np.linalg.inv(innovation)
    residual = cells.centroid - states.mean[:, :d]
    mean = states.mean + (gain @ residual[:, :, None])[:, :, 0]
    covariance = states.covariance - gain @ innovation @ gain.transpose(0, 2, 1)
    root = symmetric_power(states.extent, 0.5)
    seen = (root @ symmetric_power(innovation, -0.5) @ residual[:, :, None])[:, :, 0]
    scaling = root @ symmetric_power(detection, -0.5)
    weight = states.weight + n
    extent = (
        states.weight[:, None, None] * states.extent
        + seen[:, :, None] * seen[:, None, :]
        + scaling @ cells.scatter @ scaling.transpose(0, 2, 1)
    ) / weight[:, None, None]
    updated = ExtendedStates(mean, _symmetric(covariance), _symmetric(extent), weight)
    return updated, feldmann_log_likelihood(states, cells, spread)


def feldmann_log_likelihood(
    states: ExtendedStates, cells: Cells, spread: float = 0.25
) -> FloatArray:
    """Log p(z_1 .. z_n | n, past) (N,), which integrates to one over the n positions.

    The centroid is Gaussian with the covariance H P H' + Y / n. The scatter is Wishart about
    Y = spread X + R (Koch 2014, (2.54)), averaged over Y, whose density is taken as inverse Wishart
    with its own mean and, to first order, its own variance: exact for R = 0.
    """
    n, d = cells.count.astype(np.float64), cells.centroid.shape[1]
    detection = spread * states.extent + cells.noise
    innovation = states.covariance[:, :d, :d] + detection / n[:, None, None]
    residual = cells.centroid - states.mean[:, :d]
    pull = np.linalg.solve(innovation, residual[:, :, None])[:, :, 0]
    log_centroid = -0.5 * (
        d * LOG_2PI + np.linalg.slogdet(innovation)[1] + np.sum(residual * pull, axis=1)
    )
    return log_centroid + log_scatter_likelihood(states.extent, states.weight, cells, spread)


def log_scatter_likelihood(
    extent: FloatArray, weight: FloatArray, cells: Cells, spread: float = 0.25
) -> FloatArray:
    """Log density (N,) of a cell's detections about their centroid, for an uncertain extent.

    What is left of p(z_1 .. z_n | n) without the density of the centroid, in 1/m^((n - 1) d):
    0 for one detection. See :func:`feldmann_log_likelihood`.
    """
    n, d = cells.count.astype(np.float64), cells.centroid.shape[1]
    detection = spread * extent + cells.noise
    ratio = _size(detection) / _size(spread * extent)
    freedom = LEAST_WEIGHT + (weight - LEAST_WEIGHT) * ratio
    scale = freedom[:, None, None] * detection
    evidence = _log_wishart_evidence(scale, scale + cells.scatter, freedom + d + 1.0, n - 1.0)
    # From n - 1 orthonormal differences to the positions: the n-th is root n times the centroid.
    return evidence - 0.5 * d * np.log(n)


def _log_wishart_evidence(
    scale: FloatArray, new_scale: FloatArray, freedom: FloatArray, n: FloatArray
) -> FloatArray:
    """Log of the integral of prod N(y_j; 0, X) over an inverse Wishart X, n vectors y_j."""
    d = scale.shape[-1]
    before, after = (np.linalg.slogdet(one)[1] for one in (scale, new_scale))
    # The multivariate gamma functions; their powers of pi cancel.
    steps = 0.5 * np.arange(d)
    top, bottom = (
        gammaln(0.5 * one[:, None] - steps).sum(axis=1) for one in (freedom + n, freedom)
    )
    found: FloatArray = (
        0.5 * freedom * before
        - 0.5 * (freedom + n) * after
        + top
        - bottom
        - 0.5 * n * d * math.log(math.pi)
    )
    return found


def _size(matrix: FloatArray) -> FloatArray:
    """What the variance of an inverse Wishart matrix is in proportion to, for a large weight."""
    trace = np.trace(matrix, axis1=-2, axis2=-1)
    return trace**2 + np.sum(matrix * np.swapaxes(matrix, -1, -2), axis=(-2, -1))


def _symmetric(matrix: FloatArray) -> FloatArray:
    return 0.5 * (matrix + np.swapaxes(matrix, -1, -2))
