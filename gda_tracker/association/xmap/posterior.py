"""The biases after the data: a mixture over associations, by mean and covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse

from gda_tracker.association.xmap.model import SensorData, SensorModel
from gda_tracker.association.xmap.partitions import clusters_of
from gda_tracker.association.xmap.positions import (
    BiasLayout,
    ClusterTerms,
    association_sums,
    eliminate_one,
    inverses,
)
from gda_tracker.association.xmap.scoring import position_terms
from gda_tracker.vocabulary.arrays import FloatArray, IntArray

NEGLIGIBLE = 1e-13
"""Mass of associations that the mixture may leave out, the least probable ones."""

CHUNK = 4096


@dataclass(frozen=True)
class BiasPosterior:
    """Biases: what is to be added to a sensor's positions (Ferry 2010, 4.3).

    Attributes
    ----------
    reference
        Sensor to which the relative biases are.
    relative_mean : (r, d), relative_covariance : (r, d, d)
        Bias of each sensor less that of the reference; zero for the reference.
    mean : (r, d) or None, covariance : (r, d, d) or None
        Biases themselves; ``None`` where all priors are diffuse, as a common shift is unknown then.

    NaN for a sensor without measurements.
    """

    reference: int
    relative_mean: FloatArray
    relative_covariance: FloatArray
    mean: FloatArray | None
    covariance: FloatArray | None


def bias_posterior(
    model: SensorModel, data: SensorData, labels: IntArray, probability: FloatArray
) -> BiasPosterior:
    """Mean and covariance of the biases over associations (A, M), most probable first."""
    kept = int(np.searchsorted(np.cumsum(probability), probability.sum() * (1.0 - NEGLIGIBLE))) + 1
    labels, share = labels[:kept], probability[:kept] / probability[:kept].sum()
    clusters = clusters_of(labels, model.sizes)
    terms, layout, shift = position_terms(model, data, clusters)
    n_sensors, dimension = len(model.sizes), len(model.prior_covariance)
    unknowns = len(layout.prior_precision)
    first = np.zeros(unknowns)
    second = np.zeros((unknowns, unknowns))
    for begin in range(0, kept if unknowns else 0, CHUNK):
        part = slice(begin, begin + CHUNK)
        centre, width = _gaussians(clusters.incidence[part], terms, layout, dimension)
        first += share[part] @ centre
        second += np.einsum("a,aij->ij", share[part], width)
        second += np.einsum("a,ai,aj->ij", share[part], centre, centre)
    # Rows of the absolute and of the relative biases in terms of the unknown ones.
    groups = unknowns // dimension
    chosen = np.zeros((n_sensors, groups, dimension, dimension))
    known = (layout.variable >= 0).nonzero()[0]
    chosen[known, layout.variable[known]] = np.eye(dimension)
    spread = second - np.outer(first, first)
    # Positions were shifted; the biases of the shifted ones are larger by that.
    moved = shift[:, 0] - shift[layout.reference, 0]

    def moments(weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        rows = np.moveaxis(weights, 1, 2).reshape(n_sensors, dimension, unknowns)
        return rows @ first, rows @ spread @ np.swapaxes(rows, 1, 2)

    relative_mean, relative_covariance = moments(chosen)
    relative_mean = relative_mean - moved
    mean: FloatArray | None = None
    covariance: FloatArray | None = None
    if layout.transfer is not None and layout.spread is not None:
        mean, covariance = moments(layout.transfer)
        mean, covariance = mean - moved, covariance + layout.spread
    for values in (relative_mean, relative_covariance, mean, covariance):
        if values is not None:
            values[np.array(model.sizes) == 0] = np.nan
    return BiasPosterior(layout.reference, relative_mean, relative_covariance, mean, covariance)


def _gaussians(
    incidence: scipy.sparse.csr_matrix, terms: ClusterTerms, layout: BiasLayout, dimension: int
) -> tuple[FloatArray, FloatArray]:
    """W*_-^-1 b*_- (A, n) and W*_-^-1 (A, n, n) of each association."""
    rows, vector = association_sums(incidence, terms, layout)
    ignored = np.zeros(vector.shape[1:])
    for k in range(dimension):
        eliminate_one(rows, vector, k, ignored)
    size = len(rows) - dimension
    precision = np.zeros((vector.shape[1], size, size))
    for k in range(size):
        precision[:, k, k:] = rows[dimension + k][:, :, 0].T
        precision[:, k:, k] = precision[:, k, k:]
    covariance = inverses(precision)
    return np.einsum("aij,aj->ai", covariance, vector[dimension:, :, 0].T), covariance
