"""Search beyond enumeration: blocked Gibbs sampling of associations, biases and centre.

Given the association the relative biases and the centre are Gaussian (4.20); given these the
clusters are independent, and a block of one sensor's measurements is drawn anew, exactly, by
``matching_sampler``. Single measurements carry a label, object or false alarm, so that any prior on
the number of objects weighs what is left (A.6). The samples only find associations: each one that
was visited is scored exactly afterwards.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from gda_tracker.association.xmap.matching_sampler import (
    draw_conditional_bernoulli,
    draw_matching,
)
from gda_tracker.association.xmap.model import SensorData, SensorModel
from gda_tracker.association.xmap.object_count import (
    log_false_alarm_weight,
    log_gamma0,
)
from gda_tracker.association.xmap.object_density import log_object_density
from gda_tracker.association.xmap.partitions import canonical
from gda_tracker.association.xmap.positions import (
    bias_layout,
    centred,
    cluster_terms,
    inverses,
)
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray

BLOCK = 7
"""Measurements of a sensor that are drawn together: 2^7 subsets."""

LARGEST_DENSITY_TABLE = 100_000
"""Up to so many clusters P^J is worked out for all of them beforehand."""


@dataclass(frozen=True)
class Visited:
    """Associations that chains of samples visited.

    Attributes
    ----------
    labels : (S, M)
        Of each sample, canonical.
    chain : (S,)
        Which chain it belongs to.
    """

    labels: IntArray
    chain: IntArray


class Sampler:
    """Draws associations of one scene from their exact probability, one after the other."""

    def __init__(self, model: SensorModel, data: SensorData) -> None:
        self._model = model
        self._data = data.batched()
        self._layout = bias_layout(
            model.bias_covariances, model.sizes, self._data.positions.shape[2]
        )
        self._sensor_of = model.sensor_of
        self._variable_of = self._layout.variable[self._sensor_of]
        shifted, _ = centred(self._data.positions, self._sensor_of, model.bias_covariances)
        self._positions = shifted[:, 0]
        self._covariances = self._data.covariances[:, 0]
        self._precisions = inverses(self._covariances)
        self._gamma0 = log_gamma0(model.count_prior, model.undetected, sum(model.sizes))
        self._false_alarm = log_false_alarm_weight(model)
        self._densities = self._density_table()

    def _density_table(self) -> FloatArray | None:
        sizes = np.array(self._model.sizes) + 1
        self._stride = np.cumprod([1, *sizes[:-1].tolist()])
        if np.prod(sizes.astype(np.float64)) > LARGEST_DENSITY_TABLE:
            return None
        members = np.arange(np.prod(sizes))[:, None] // self._stride % sizes - 1
        return log_object_density(self._model, self._data, members)[:, 0]

    def _density(self, members: IntArray) -> FloatArray:
        """Log P^J alpha (C,) of clusters (C, r)."""
        if self._densities is not None:
            return np.asarray(self._densities[(members + 1) @ self._stride])
        return log_object_density(self._model, self._data, members)[:, 0]

    def draw_biases(
        self, labels: IntArray, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Draw the centre (d,) and what to add to each position (M, d), given the association."""
        dimension = self._positions.shape[1]
        terms = cluster_terms(
            (np.arange(labels.max() + 1)[:, None] == labels).astype(np.float64),
            self._precisions[:, None],
            self._positions[:, None],
            self._variable_of,
            self._model.prior_covariance,
        )
        size = len(terms.matrix)
        matrix = np.zeros((size, size))
        for k, row in enumerate(terms.matrix):
            matrix[k, k:] = row.sum(axis=1)[:, 0]
        matrix[dimension:, dimension:] += self._layout.prior_precision
        factor = scipy.linalg.cholesky(matrix)  # upper: matrix = factor' factor
        half = scipy.linalg.solve_triangular(factor, terms.vector.sum(axis=1)[:, 0], trans="T")
        drawn = scipy.linalg.solve_triangular(factor, half + rng.standard_normal(size))
        centre = self._model.prior_covariance @ drawn[:dimension]
        relative = np.vstack([drawn[dimension:].reshape(-1, dimension), np.zeros(dimension)])
        return centre, relative[self._variable_of]

    def draw_false_alarms(self, labels: IntArray, rng: np.random.Generator) -> BoolArray:
        """Draw which measurements (M,) are false alarms, given the association."""
        flags = np.zeros(len(labels), dtype=np.bool_)
        alone = (np.bincount(labels)[labels] == 1) & np.isfinite(self._false_alarm[self._sensor_of])
        candidates = alone.nonzero()[0]
        objects = int(labels.max()) + 1
        by_number = self._gamma0[objects - np.arange(len(candidates) + 1)]
        odds = self._false_alarm[self._sensor_of[candidates]]
        flags[candidates] = draw_conditional_bernoulli(odds, by_number, rng)
        return flags

    def update(
        self,
        labels: IntArray,
        block: IntArray,
        biases: tuple[FloatArray, FloatArray],
        false_alarms: BoolArray,
        rng: np.random.Generator,
    ) -> tuple[IntArray, BoolArray]:
        """Draw anew where the measurements of a block, all of one sensor, belong."""
        sensor = int(self._sensor_of[block[0]])
        kept = np.ones(len(labels), dtype=np.bool_)
        kept[block] = False
        real = np.unique(labels[kept & ~false_alarms])
        members = np.full((len(real), len(self._model.sizes)), -1)
        place = np.searchsorted(real, labels)
        first = self._model.first
        mine = (kept & ~false_alarms).nonzero()[0]
        members[place[mine], self._sensor_of[mine]] = mine - first[self._sensor_of[mine]]
        weight = self._pair_weights(members, mine, place[mine], block, biases)
        # What is left is a new object or a false alarm: sum over how many are.
        size = len(block)
        odds = float(self._false_alarm[sensor])
        by_matched = np.array(
            [self._log_left(len(real), size - matched, odds) for matched in range(size + 1)]
        )
        partner = draw_matching(weight, by_matched, rng)
        labels, false_alarms = labels.copy(), false_alarms.copy()
        matched = partner >= 0
        labels[block[matched]] = real[partner[matched]]
        left = block[~matched]
        labels[left] = len(labels) + np.arange(len(left))
        false_alarms[block] = False
        by_number = self._gamma0[len(real) + len(left) - np.arange(len(left) + 1)]
        false_alarms[left] = draw_conditional_bernoulli(np.full(len(left), odds), by_number, rng)
        # Small numbers again: labels are used as indices.
        return np.unique(labels, return_inverse=True)[1].reshape(-1), false_alarms

    def _log_left(self, objects: int, left: int, odds: float) -> float:
        """Log of the sum over f false alarms of C(left, f) odds^f gamma0(objects + left - f)."""
        if odds == -np.inf:
            return float(self._gamma0[objects + left])
        f = np.arange(left + 1)
        ways = np.cumsum(np.log(np.append(1.0, (left - f[:-1]) / f[1:])))
        return float(np.logaddexp.reduce(ways + f * odds + self._gamma0[objects + left - f]))

    def _pair_weights(
        self,
        members: IntArray,
        measurement: IntArray,
        place: IntArray,
        block: IntArray,
        biases: tuple[FloatArray, FloatArray],
    ) -> FloatArray:
        """Log P^(alpha + (s, i)) / (P^alpha P^(s, i)) (K, m), given biases and centre."""
        centre, bias = biases
        prior = self._model.prior_covariance
        n_objects, dimension = len(members), len(centre)
        sensor = int(self._sensor_of[block[0]])
        # The state of an object given its measurements: W_alpha and mu_alpha (4.6).
        precision = np.tile(np.linalg.inv(prior), (n_objects, 1, 1))
        information = np.zeros((n_objects, dimension))
        np.add.at(precision, place, self._precisions[measurement])
        offset = self._positions[measurement] + bias[measurement] - centre
        np.add.at(
            information, place, np.einsum("mij,mj->mi", self._precisions[measurement], offset)
        )
        spread = np.linalg.inv(precision)
        mean = np.einsum("kij,kj->ki", spread, information)
        value = self._positions[block] + bias[block] - centre
        joined = _log_normal(value - mean[:, None], spread[:, None] + self._covariances[block])
        alone = _log_normal(value, prior + self._covariances[block])
        index = block - self._model.first[sensor]
        grown = np.repeat(members, len(block), axis=0)
        single = np.full((len(block), members.shape[1]), -1)
        single[:, sensor] = index
        # An object that has a measurement of this sensor outside the block takes no other.
        free = members[:, sensor] < 0
        grown[:, sensor] = np.tile(index, n_objects)
        gain = self._density(grown).reshape(n_objects, len(block))
        gain = gain - self._density(members)[:, None] - self._density(single)
        return np.where(free[:, None], joined - alone + gain, -np.inf)


def _log_normal(difference: FloatArray, covariance: FloatArray) -> FloatArray:
    """Log N(difference; 0, covariance) up to the powers of 2 pi."""
    solved = np.linalg.solve(covariance, difference[..., None])[..., 0]
    return np.asarray(
        -0.5 * ((difference * solved).sum(axis=-1) + np.linalg.slogdet(covariance)[1])
    )


def sample_chains(
    model: SensorModel,
    data: SensorData,
    starts: IntArray,
    sweeps: int,
    seed: int,
    time_limit_s: float = np.inf,
) -> Visited:
    """Run a chain from each start (K, M); one sample after each update of a sensor.

    The chains take turns, so a time limit leaves them equally long. The first tenth of each chain
    finds associations, but is not a sample of their probability.
    """
    sampler = Sampler(model, data)
    streams = [np.random.default_rng([seed, k]) for k in range(len(starts))]
    states = [start.copy() for start in starts]
    found: list[IntArray] = []
    chain: list[int] = []
    end = time.monotonic() + time_limit_s
    groups = [
        first + np.arange(size)
        for first, size in zip(model.first.tolist(), model.sizes, strict=True)
        if size
    ]
    for _ in range(sweeps):
        for k, rng in enumerate(streams):
            labels = states[k]
            for group in groups:
                biases = sampler.draw_biases(labels, rng)
                false_alarms = sampler.draw_false_alarms(labels, rng)
                for block in np.array_split(rng.permutation(group), -(-len(group) // BLOCK)):
                    labels, false_alarms = sampler.update(
                        labels, np.sort(block), biases, false_alarms, rng
                    )
                found.append(labels)
                chain.append(k)
            states[k] = labels
        if time.monotonic() > end:
            break
    return Visited(canonical(np.stack(found)), np.array(chain))
