"""The combinatorial factor: how many objects and false alarms an association needs.

(Ferry 2010, Appendices A and B.) gamma0(n) for the priors on the number of objects, and their sum
over the ways in which single measurements may be false alarms (A.8). Constants that are common to
all associations are left out.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import gammaln

from gda_tracker.association.xmap.model import DIFFUSE, POISSON, CountPrior, SensorModel
from gda_tracker.vocabulary.arrays import FloatArray, IntArray


def log_gamma0(prior: CountPrior, undetected: float, most: int) -> FloatArray:
    """Log gamma0(n) for n = 0 to ``most`` objects that were seen (B.2 and B.7 to B.10).

    ``undetected`` is q. For the log-diffuse prior, proportional to 1/n for n >= 1, no object seen
    is the sum of q^n / n.
    """
    n = np.arange(most + 1.0)
    if prior.kind == POISSON:
        assert prior.mean is not None
        return np.asarray(n * math.log(prior.mean))
    log_seen = math.log1p(-undetected)
    if prior.kind == DIFFUSE:
        return np.asarray(gammaln(n + 1.0) - (n + 1.0) * log_seen)
    with np.errstate(divide="ignore"):
        none = np.log(np.array([-log_seen]))
    return np.concatenate([none, gammaln(n[1:]) - n[1:] * log_seen])


def log_false_alarm_weight(model: SensorModel) -> FloatArray:
    """(r,) log of nu_FA^s / p^s: a false alarm against an object that one sensor saw (B.15)."""
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(model.expected_false_alarms) - np.log(model.seen_by_one))


def log_count_factor(model: SensorModel, shared: IntArray, single: IntArray) -> FloatArray:
    """Log gamma(n_D^+, n_1) (Ferry 2010, A.8; with a Poisson prior it is B.16), as (A,).

    Parameters
    ----------
    shared : (A,)
        Number of clusters with two or more measurements.
    single : (A, r)
        Number of measurements of each sensor that stand alone.
    """
    key = np.column_stack([shared, single])
    unique, place = np.unique(key, axis=0, return_inverse=True)
    gamma0 = log_gamma0(model.count_prior, model.undetected, sum(model.sizes))
    weight = log_false_alarm_weight(model)
    # Coefficients of the product over sensors of (1 + weight x)^single: k false alarms.
    polynomial = np.zeros((len(unique), 1))
    for sensor, size in enumerate(model.sizes):
        if weight[sensor] == -np.inf:
            continue
        mine = unique[:, sensor + 1].astype(np.float64)
        grown = np.full((len(unique), polynomial.shape[1] + size), -np.inf)
        for k in range(size + 1):
            with np.errstate(invalid="ignore"):
                ways = gammaln(mine + 1.0) - gammaln(k + 1.0) - gammaln(mine - k + 1.0)
            ways = np.where(k <= mine, ways + k * weight[sensor], -np.inf)
            part = grown[:, k : k + polynomial.shape[1]]
            np.logaddexp(part, polynomial + ways[:, None], out=part)
        polynomial = grown
    false_alarms = np.arange(polynomial.shape[1])
    objects = unique.sum(axis=1)[:, None] - false_alarms
    with np.errstate(invalid="ignore"):
        terms = np.where(objects >= 0, polynomial + gamma0[np.maximum(objects, 0)], -np.inf)
    return np.asarray(np.logaddexp.reduce(terms, axis=1)[place.reshape(-1)])


def cluster_counts(labels: IntArray, sizes: tuple[int, ...]) -> tuple[IntArray, IntArray]:
    """Count shared clusters (A,) and single measurements per sensor (A, r) of labels (A, M)."""
    rows = np.arange(len(labels))[:, None]
    members = np.zeros(labels.shape, dtype=np.int64)
    np.add.at(members, (rows, labels), 1)
    alone = members[rows, labels] == 1
    starts = np.cumsum([0, *sizes[:-1]])
    single = np.stack(
        [alone[:, b : b + n].sum(axis=1) for b, n in zip(starts.tolist(), sizes, strict=True)],
        axis=1,
    )
    return (members > 1).sum(axis=1), single
