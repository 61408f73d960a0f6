"""The exact log weight of associations: positions, types and features, numbers of objects."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gda_tracker.association.xmap.model import SensorData, SensorModel
from gda_tracker.association.xmap.object_count import cluster_counts, log_count_factor
from gda_tracker.association.xmap.object_density import log_object_density
from gda_tracker.association.xmap.partitions import Clusters, clusters_of
from gda_tracker.association.xmap.positions import (
    BiasLayout,
    ClusterTerms,
    association_costs,
    bias_layout,
    centred,
    cluster_terms,
    inverses,
)
from gda_tracker.vocabulary.arrays import FloatArray, IntArray


class Structure(NamedTuple):
    """What depends on the associations and the model, not on the data.

    Attributes
    ----------
    clusters
        Different clusters and which association has which.
    log_count : (A,)
        log gamma(n_D^+, n_1).
    """

    clusters: Clusters
    log_count: FloatArray


def structure_of(model: SensorModel, labels: IntArray) -> Structure:
    """Work out what all scenes with these associations (A, M) share."""
    return Structure(
        clusters_of(labels, model.sizes),
        log_count_factor(model, *cluster_counts(labels, model.sizes)),
    )


class PositionTerms(NamedTuple):
    """Cluster terms of centred positions."""

    terms: ClusterTerms
    layout: BiasLayout
    shift: FloatArray


def position_terms(
    model: SensorModel, data: SensorData, clusters: Clusters, centre: bool = True
) -> PositionTerms:
    """Work out the cluster terms of scenes; ``centre`` shifts positions to keep digits."""
    data = data.batched()
    layout = bias_layout(model.bias_covariances, model.sizes, data.positions.shape[2])
    positions = data.positions
    shift = np.zeros((len(model.sizes), *positions.shape[1:]))
    if centre:
        positions, shift = centred(positions, model.sensor_of, model.bias_covariances)
    terms = cluster_terms(
        clusters.flags(model.sizes),
        inverses(data.covariances),
        positions,
        layout.variable[model.sensor_of],
        model.prior_covariance,
    )
    return PositionTerms(terms, layout, shift)


def log_weights(model: SensorModel, data: SensorData, structure: Structure) -> FloatArray:
    """Log of Pr([a] | z) (A, B) up to what is common to all associations (Ferry 2010, 3.25, A.9).

    Every term is exact; -inf is an association that the model rules out.
    """
    terms, layout, _ = position_terms(model, data, structure.clusters)
    incidence = structure.clusters.incidence
    weight = association_costs(incidence, terms, layout)
    weight *= -0.5
    weight += structure.log_count[:, None]
    density = log_object_density(model, data, structure.clusters.members)
    # A product with a zero of the incidence must not make NaN of an impossible cluster.
    impossible = np.isneginf(density)
    if impossible.any():
        weight[(incidence @ impossible.astype(np.float64)) > 0.0] = -np.inf
        density = np.where(impossible, 0.0, density)
    weight += incidence @ density
    return weight


def probabilities(weight: FloatArray) -> FloatArray:
    """Normalise log weights (A, B) over the associations.

    Raises
    ------
    ValueError
        If no association is possible.
    """
    largest = weight.max(axis=0)
    if not np.isfinite(largest).all():
        raise ValueError(
            "no association is possible: a measurement has a type call or feature that the model "
            "gives probability zero"
        )
    share = np.exp(weight - largest)
    share /= share.sum(axis=0)
    return np.asarray(share)
