"""Solves a problem of association: enumerated where that is possible, sampled beyond.

>>> from gda_tracker.association.xmap.problem import example, read_problem
>>> problem = read_problem(example("ferry_6_1"))
>>> solution = solve(problem.model, problem.data)
>>> len(solution.probability), round(float(solution.probability[0]), 6)
(778, 0.452373)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gda_tracker.association.xmap.gibbs import sample_chains
from gda_tracker.association.xmap.json_values import ProblemError
from gda_tracker.association.xmap.model import SensorData, SensorModel
from gda_tracker.association.xmap.neighbours import explore
from gda_tracker.association.xmap.partitions import association_count, enumerate_associations
from gda_tracker.association.xmap.posterior import BiasPosterior, bias_posterior
from gda_tracker.association.xmap.scoring import log_weights, probabilities, structure_of
from gda_tracker.association.xmap.starts import drawn_starts, fitted_associations
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray

AUTO = "auto"
ENUMERATION = "enumeration"
GIBBS = "gibbs"
METHODS = (AUTO, ENUMERATION, GIBBS)

MAX_ENUMERATED = 1_000_000
"""Above so many associations ``auto`` samples."""

MAX_MEASUREMENTS = 1000


@dataclass(frozen=True)
class Sampling:
    """How to sample.

    Attributes
    ----------
    sweeps
        Times that each chain draws every sensor anew, at most.
    chains
        Number of chains, even: each half checks the other.
    seed
        Of the random numbers.
    time_limit_s
        No sweep begins after it.
    """

    sweeps: int = 60
    chains: int = 4
    seed: int = 0
    time_limit_s: float = np.inf


@dataclass(frozen=True)
class Solution:
    """Associations, most probable first, and what follows from them.

    Attributes
    ----------
    labels : (A, M)
        Measurements of the same object have the same label.
    probability : (A,)
        Sums to ``covered``.
    pairs : (M, M)
        Chance that two measurements come from the same object; zero within a sensor.
    bias
        Posterior of the biases.
    covered
        Share of the probability that these associations have: 1 where all were enumerated,
        estimated where they were sampled.
    method
        ``enumeration`` or ``gibbs``.
    """

    labels: IntArray
    probability: FloatArray
    pairs: FloatArray
    bias: BiasPosterior
    covered: float
    method: str


def solve(
    model: SensorModel,
    data: SensorData,
    method: str = AUTO,
    sampling: Sampling | None = None,
) -> Solution:
    """Find the probabilities of the associations of one scene.

    Raises
    ------
    ProblemError
        If the problem is too large for the method, or no association is possible.
    """
    if method not in METHODS:
        raise ProblemError(f"method = {method!r}: allowed are {', '.join(METHODS)}")
    if sum(model.sizes) > MAX_MEASUREMENTS:
        raise ProblemError(
            f"{sum(model.sizes)} measurements: allowed are {MAX_MEASUREMENTS} of all sensors"
        )
    count = association_count(model.sizes)
    if method == ENUMERATION and count > MAX_ENUMERATED:
        raise ProblemError(
            f"method = {ENUMERATION!r}: {float(count):.3g} associations; allowed are "
            f"{MAX_ENUMERATED}"
        )
    try:
        if method == ENUMERATION or (method == AUTO and count <= MAX_ENUMERATED):
            return _enumerated(model, data)
        return _sampled(model, data, sampling or Sampling())
    except ProblemError:
        raise
    except ValueError as error:
        raise ProblemError(str(error)) from None


def pair_probabilities(labels: IntArray, probability: FloatArray) -> FloatArray:
    """(M, M) chance that two measurements share an object, summed over associations (A, M)."""
    n = labels.shape[1]
    pairs = np.zeros((n, n))
    for i in range(n):
        pairs[i, i + 1 :] = probability @ (labels[:, i + 1 :] == labels[:, i, None])
    return pairs + pairs.T


def _enumerated(model: SensorModel, data: SensorData) -> Solution:
    labels = enumerate_associations(model.sizes)
    share = probabilities(log_weights(model, data, structure_of(model, labels)))[:, 0]
    order = np.argsort(-share, kind="stable")
    labels, share = labels[order], share[order]
    pairs = pair_probabilities(labels, share)
    return Solution(
        labels, share, pairs, bias_posterior(model, data, labels, share), 1.0, ENUMERATION
    )


def _sampled(model: SensorModel, data: SensorData, sampling: Sampling) -> Solution:
    rng = np.random.default_rng([sampling.seed])
    candidates = fitted_associations(model, data, rng)
    weight = log_weights(model, data, structure_of(model, candidates))[:, 0]
    probabilities(weight[:, None])  # refuses a scene in which nothing is possible
    starts = drawn_starts(candidates, weight, sampling.chains, rng)
    samples = sample_chains(
        model, data, starts, sampling.sweeps, sampling.seed, sampling.time_limit_s
    )
    # Each half of the chains is judged by what the other half found.
    halves = [samples.chain % 2 == k for k in (0, 1)]
    fresh = np.ones(len(samples.labels), dtype=np.bool_)
    explored = []
    for mine, others in zip(halves, reversed(halves), strict=True):
        found, weight = explore(model, data, np.concatenate([samples.labels[mine], candidates]))
        fresh[others] = ~is_among(samples.labels[others], found)
        explored.append((found, weight))
    together = np.concatenate([found for found, _ in explored])
    labels, first = np.unique(together, axis=0, return_index=True)
    weight = np.concatenate([weights for _, weights in explored])[first]
    share = probabilities(weight[:, None])[:, 0]
    covered = 1.0 - float(fresh.mean())
    # What was found is known exactly; the rest of the mass is like the samples that were new.
    pairs = pair_probabilities(labels, share)
    if fresh.any():
        new = samples.labels[fresh]
        beyond = pair_probabilities(new, np.full(len(new), 1.0 / len(new)))
        pairs = covered * pairs + (1.0 - covered) * beyond
    order = np.argsort(-share, kind="stable")
    labels, share = labels[order], share[order]
    bias = bias_posterior(model, data, labels, share)
    return Solution(labels, covered * share, pairs, bias, covered, GIBBS)


def is_among(labels: IntArray, known: IntArray) -> BoolArray:
    """(S,) whether rows of labels (S, M) are among the known ones (K, M)."""
    _, number = np.unique(np.concatenate([known, labels]), axis=0, return_inverse=True)
    number = number.reshape(-1)
    present = np.zeros(number.max() + 1, dtype=np.bool_)
    present[number[: len(known)]] = True
    return np.asarray(present[number[len(known) :]])
