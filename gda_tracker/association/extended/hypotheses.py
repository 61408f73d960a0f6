"""Which detections are of which extended object: partitions, and cells given to objects.

The weight of a hypothesis, up to a constant of the scan, with cells C of n_C detections each:

- object i gives cell C: P_D n_C! p(n_C | i) p(z_C | n_C, i), with the object's rate of detections
  and its predicted kinematics and extent;
- object i gives no detection: 1 - P_D + P_D p(0 | i);
- nobody known gives cell C: rho_F^n_C (false alarms, one by one) + (rho_B + rho_G) n_C!
  p(n_C | new) p(z_C | n_C, new): a new object, or a ghost, alike but gone with the next scan.

These are densities of sets of detections, so that partitions into few and many cells compare.
(Granstroem, Lundquist and Orguner 2012; Koch 2014, section 2.3.3, has the case of one detection.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln

from gda_tracker.association.best_hypothesis import best_hypothesis
from gda_tracker.kinematics.extended.detection_rate import (
    log_count_probability,
    log_unseen_probability,
)
from gda_tracker.kinematics.extended.random_matrix import (
    Cells,
    ExtendedStates,
    cells_of,
    feldmann_log_likelihood,
    log_scatter_likelihood,
)
from gda_tracker.vocabulary.arrays import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class ExtendedSensor:
    """What the sensor and new objects are like.

    ``clutter_density`` rho_F, ``birth_density`` rho_B and ``ghost_density`` rho_G [1/m2] are all of
    one scan: single false alarms, new objects, and false ones of several detections (echoes by way
    of walls, leaves in the wind), without which the first scan alone would convince. ``spread`` is
    that of :mod:`gda_tracker.kinematics.extended.random_matrix`. A new object has detections at a
    Gamma rate (``birth_rate_shape``, ``birth_rate_rate``) and an inverse Wishart extent, a circle
    of the radius ``birth_radius_m`` on average, of the certainty ``birth_weight``.
    """

    detection_probability: float = 0.98
    clutter_density: float = 1e-3
    birth_density: float = 1e-3
    ghost_density: float = 0.0
    spread: float = 0.25
    birth_rate_shape: float = 2.0
    birth_rate_rate: float = 0.2
    birth_radius_m: float = 0.5
    birth_weight: float = 4.0

    def __post_init__(self) -> None:
        if not 0.0 < self.detection_probability < 1.0:
            raise ValueError(
                f"detection_probability = {self.detection_probability}: allowed is 0 < P_D < 1"
            )
        for name in (
            "clutter_density",
            "birth_density",
            "spread",
            "birth_rate_shape",
            "birth_rate_rate",
            "birth_radius_m",
        ):
            value = getattr(self, name)
            if not 0.0 < value < np.inf:
                raise ValueError(f"{name} = {value}: allowed are numbers > 0")
        if not 0.0 <= self.ghost_density < np.inf:
            raise ValueError(f"ghost_density = {self.ghost_density}: allowed are numbers >= 0")
        if not 2.0 < self.birth_weight < np.inf:
            raise ValueError(f"birth_weight = {self.birth_weight}: allowed are numbers > 2")


@dataclass(slots=True)
class Explanation:
    """One hypothesis: a partition and what its cells are.

    ``log_weight`` is that of the whole; ``cell_of`` (N,) is the cell of each object, -1 for none;
    ``log_false`` and ``log_new`` (C,) are the log weights of a cell as false alarms and as a new
    object; ``log_pair`` (N, C) those of the pairs, -inf outside the gate. ``log_cell`` (C,) is what
    a cell adds to the weight of a hypothesis in which no object gives detections.
    """

    label: IntArray
    cells: Cells
    log_weight: float
    cell_of: IntArray
    log_false: FloatArray
    log_new: FloatArray
    log_pair: FloatArray
    log_cell: FloatArray


def explain(
    states: ExtendedStates,
    rate_shape: FloatArray,
    rate_rate: FloatArray,
    positions: FloatArray,
    noise: FloatArray,
    partitions: IntArray,
    sensor: ExtendedSensor,
    gate: float = 25.0,
) -> tuple[list[Explanation], FloatArray]:
    """The best hypothesis of each partition, and their probabilities.

    Parameters
    ----------
    states, rate_shape, rate_rate
        Predicted objects (N) and their Gamma rates (N,).
    positions, noise
        (n, d) detections [m] and (n, d, d) covariances of their noise [m2].
    partitions
        (K, n) as :func:`gda_tracker.kinematics.extended.partitions.distance_partitions` has them.
    gate
        Largest squared Mahalanobis distance between a cell's centroid and an object, by the
        covariance of a single detection.

    Returns
    -------
    explanations, probability
        K of each, the most probable first; the probabilities are among these K hypotheses.
    """
    found = [
        explain_partition(states, rate_shape, rate_rate, positions, noise, label, sensor, gate)
        for label in partitions
    ]
    log_weight = np.array([one.log_weight for one in found])
    order = np.argsort(-log_weight, kind="stable")
    probability = np.exp(log_weight[order] - log_weight[order[0]])
    return [found[k] for k in order], probability / probability.sum()


def explain_partition(
    states: ExtendedStates,
    rate_shape: FloatArray,
    rate_rate: FloatArray,
    positions: FloatArray,
    noise: FloatArray,
    label: IntArray,
    sensor: ExtendedSensor,
    gate: float = 25.0,
    relative_density: FloatArray | None = None,
) -> Explanation:
    """The best hypothesis of one partition (n,); the rest as for :func:`explain`.

    ``relative_density`` (n,) scales the sensor's densities (false alarms, new objects, ghosts) at
    each detection; without it they are the same everywhere.
    """
    cells = cells_of(positions, label, noise)
    objects, number = len(states), len(cells.count)
    log_new = new_object_log_weight(cells, sensor)
    log_false = cells.count * np.log(sensor.clutter_density)
    if relative_density is not None:
        log_scale = np.bincount(label, np.log(relative_density), minlength=number)
        log_false = log_false + log_scale
        log_new = log_new + log_scale / cells.count
    if sensor.ghost_density > 0.0:
        log_ghost = log_new + np.log(sensor.ghost_density / sensor.birth_density)
        log_false = np.logaddexp(log_false, log_ghost)
    log_pair = np.full((objects, number), -np.inf)
    track, cell = _near(states, cells, sensor.spread, gate)
    if len(track):
        own = cells.select(cell)
        log_pair[track, cell] = (
            np.log(sensor.detection_probability)
            + _log_set(rate_shape[track], rate_rate[track], own.count)
            + feldmann_log_likelihood(states.select(track), own, sensor.spread)
        )
    log_idle = log_unseen_probability(rate_shape, rate_rate, sensor.detection_probability)
    log_alone = np.logaddexp(log_false, log_new)
    cell_of = np.full(objects, -1, dtype=np.int64)
    # Only what lies in a gate has anything to decide.
    near, gated = np.unique(track), np.unique(cell)
    chosen = best_hypothesis(log_pair[np.ix_(near, gated)], log_idle[near], log_alone[gated])
    assert chosen is not None  # idle weights are positive
    cell_of[near[chosen >= 0]] = gated[chosen[chosen >= 0]]
    rows = np.flatnonzero(cell_of >= 0)
    taken = cell_of[rows]
    log_cell = log_alone
    log_cell[taken] = log_pair[rows, taken] - log_idle[rows]
    weight = float(log_cell.sum() + log_idle.sum())
    return Explanation(label, cells, weight, cell_of, log_false, log_new, log_pair, log_cell)


def new_object_log_weight(cells: Cells, sensor: ExtendedSensor) -> FloatArray:
    """Log weight (C,) of each cell as all detections of a new object."""
    number, d = cells.centroid.shape
    log_shape = log_scatter_likelihood(
        np.broadcast_to(sensor.birth_radius_m**2 * np.eye(d), (number, d, d)),
        np.full(number, sensor.birth_weight),
        cells,
        sensor.spread,
    )
    shape = np.full(number, sensor.birth_rate_shape)
    log_count = _log_set(shape, np.full(number, sensor.birth_rate_rate), cells.count)
    found: FloatArray = np.log(sensor.birth_density) + log_count + log_shape
    return found


def _log_set(shape: FloatArray, rate: FloatArray, count: IntArray) -> FloatArray:
    """Log n! p(n): from the density of n numbered detections to that of their set."""
    found: FloatArray = log_count_probability(shape, rate, count) + gammaln(count + 1.0)
    return found


def _near(
    states: ExtendedStates, cells: Cells, spread: float, gate: float
) -> tuple[IntArray, IntArray]:
    """Objects and cells in each other's gate."""
    d = cells.centroid.shape[1]
    total = states.covariance[:, :d, :d] + spread * states.extent
    squared = np.zeros((len(states), len(cells.count)))
    for axis in range(d):
        squared += (cells.centroid[None, :, axis] - states.mean[:, None, axis]) ** 2
    # No variance exceeds the trace: what is farther than that allows is outside.
    widest = np.trace(total, axis1=1, axis2=2)[:, None] + np.trace(cells.noise, axis1=1, axis2=2)
    track, cell = np.nonzero(squared <= gate * widest)
    gap = cells.centroid[cell] - states.mean[track, :d]
    solved = np.linalg.solve(total[track] + cells.noise[cell], gap[:, :, None])[:, :, 0]
    inside = (gap * solved).sum(axis=1) <= gate
    return track[inside], cell[inside]
