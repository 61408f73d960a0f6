"""Independent computations: Theorem 4.2, marginal covariances, literal sums, quadrature."""

from __future__ import annotations

import itertools
import math

import numpy as np
from scipy.stats import norm

from gda_tracker.association.xmap.model import (
    CountPrior,
    ObjectTypes,
    SensorData,
    SensorModel,
)


def one_type(detection):
    detection = np.asarray(detection, dtype=float)[:, None]
    return ObjectTypes(np.ones(1), detection, tuple(np.ones((1, 1)) for _ in detection))


def random_covariance(rng, dimension, scale):
    root = rng.normal(size=(dimension, dimension + 2)) * scale
    return root @ root.T / (dimension + 2)


def random_scene(rng, sizes, biases, dimension=2, spread=4.0, prior=None, false_alarms=None):
    """A model without types or features, and data in which sensors see the same objects."""
    r, total = len(sizes), sum(sizes)
    objects = rng.normal(size=(max(sizes) + 1, dimension)) * spread
    positions, covariances = [], []
    for size in sizes:
        bias = rng.normal(size=dimension) * 3.0
        for j in rng.permutation(len(objects))[:size]:
            covariance = random_covariance(rng, dimension, rng.uniform(0.3, 3.0))
            covariances.append(covariance)
            noise = rng.multivariate_normal(np.zeros(dimension), covariance)
            positions.append(objects[j] - bias + noise)
    model = SensorModel(
        sizes=tuple(sizes),
        prior_covariance=random_covariance(rng, dimension, spread),
        bias_covariances=tuple(biases),
        types=one_type(rng.uniform(0.5, 0.95, size=r)),
        count_prior=prior or CountPrior("log_diffuse"),
        expected_false_alarms=np.zeros(r) if false_alarms is None else np.asarray(false_alarms),
    )
    data = SensorData(np.stack(positions), np.stack(covariances), np.zeros(total, dtype=np.int64))
    return model, data


def theorem_4_2(model, data, labels):
    """kappa([a]) + sum of kappa_alpha by (4.9)-(4.19), block by block; biases all finite."""
    sensor, r = model.sensor_of, len(model.sizes)
    d = data.positions.shape[1]
    prior = np.linalg.inv(model.prior_covariance)
    inverse = np.linalg.inv(data.covariances)
    u, b = np.zeros(((r + 1) * d,) * 2), np.zeros((r + 1) * d)

    def at(k):
        return slice(k * d, (k + 1) * d)

    for s in range(r):
        u[at(s), at(s)] += np.linalg.inv(model.bias_covariances[s])
        u[at(s), at(s)] += inverse[sensor == s].sum(axis=0)
    cost = 0.0
    for label in np.unique(labels):
        mine = (labels == label).nonzero()[0]
        w = np.linalg.inv(prior + inverse[mine].sum(axis=0))
        m = w @ sum(inverse[i] @ data.positions[i] for i in mine)
        cost += np.linalg.slogdet(model.prior_covariance @ np.linalg.inv(w))[1]
        cost -= m @ np.linalg.inv(w) @ m
        u[at(r), at(r)] += prior - prior @ w @ prior
        b[at(r)] += prior @ m
        for i in mine:
            s = sensor[i]
            b[at(s)] -= inverse[i] @ (data.positions[i] - m)
            u[at(s), at(r)] -= inverse[i] @ w @ prior
            u[at(r), at(s)] -= prior @ w @ inverse[i]
            for j in mine:
                u[at(s), at(sensor[j])] -= inverse[i] @ w @ inverse[j]
    return cost + np.linalg.slogdet(u)[1] - b @ np.linalg.solve(u, b)


def marginal_cost(model, data, labels):
    """-2 log likelihood of all positions from their joint covariance, without diffuse effects.

    The centre and the diffuse biases are fixed effects with columns X; the density is that of the
    contrasts orthogonal to X (restricted likelihood).
    """
    sensor, total = model.sensor_of, len(labels)
    d = data.positions.shape[1]
    covariance = np.zeros((total, d, total, d))
    for i, j in itertools.product(range(total), repeat=2):
        if labels[i] == labels[j]:
            covariance[i, :, j] += model.prior_covariance
        bias = model.bias_covariances[sensor[i]]
        if sensor[i] == sensor[j] and bias is not None:
            covariance[i, :, j] += bias
        if i == j:
            covariance[i, :, j] += data.covariances[i]
    columns = [np.ones(total)]
    columns += [
        (sensor == s).astype(float) for s, b in enumerate(model.bias_covariances) if b is None
    ]
    effects = np.kron(np.stack(columns, axis=1), np.eye(d))
    left, size, _ = np.linalg.svd(effects)
    contrasts = left[:, int((size > 1e-9).sum()) :]
    reduced = contrasts.T @ covariance.reshape(total * d, total * d) @ contrasts
    value = contrasts.T @ data.positions.reshape(-1)
    return np.linalg.slogdet(reduced)[1] + value @ np.linalg.solve(reduced, value)


def literal_a8(model, shared, single):
    """gamma(n_D^+, n_1) by the sum (A.8) as it stands, with gamma0 from the sum (2.9)."""
    q, p = model.undetected, model.seen_by_one
    total = 0.0
    for alarms in itertools.product(*(range(n + 1) for n in single)):
        term = literal_gamma0(model.count_prior, q, shared + sum(single) - sum(alarms))
        for s, k in enumerate(alarms):
            rate = model.expected_false_alarms[s]
            probability = math.exp(-rate) * rate**k / math.factorial(k)
            term *= math.comb(single[s], k) * math.factorial(k) * probability * p[s] ** -k
        total += term
    return total


def literal_gamma0(prior, q, seen, terms=400):
    """(2.9), the sum over the number of objects."""
    total = 0.0
    for n in range(seen, terms):
        if prior.kind == "poisson":
            log_share = -prior.mean + n * math.log(prior.mean) - math.lgamma(n + 1)
        elif prior.kind == "diffuse":
            log_share = 0.0
        elif n == 0:
            continue
        else:
            log_share = -math.log(n)
        log_ways = math.lgamma(n + 1) - math.lgamma(n - seen + 1)
        total += math.exp(log_share + log_ways + (n - seen) * math.log(q))
    return total


def quadrature_feature(model, sensors, values, kind, points=20001):
    """P^alpha(w | t) (5.16) by quadrature over the feature's state y."""
    if model.kind == "von_mises":
        y = np.linspace(0.0, 2.0 * np.pi, points)[:-1]
        prior = np.full(len(y), 1.0 / (2.0 * np.pi))

        def valid(s, w):
            kappa = model.std[s, kind] ** -2
            jump = model.jump_probability[s, kind]
            scale = 2.0 * np.pi * np.i0(kappa)
            kept = np.exp(kappa * np.cos(w - y)) / scale
            return (1 - jump) * kept + jump * np.exp(kappa * np.cos(w - np.pi - y)) / scale

    else:
        middle, width = model.prior_mean[kind], model.prior_std[kind]
        y = np.linspace(middle - 12 * width, middle + 12 * width, points)
        prior = norm.pdf(y, middle, width)

        def valid(s, w):
            return norm.pdf(w, y, model.std[s, kind])

    step = y[1] - y[0]
    exists = model.exists[kind]
    present, absent = prior * step * exists, 1.0 - exists
    for s, w in zip(sensors, values, strict=True):
        a = model.obeys_model[s, kind]
        yes, no = model.declared_if_present[s, kind], model.declared_if_absent[s, kind]
        if np.isnan(w):
            here = np.full(len(y), model.missing_if_present[s, kind])
            gone = model.missing_if_absent[s, kind]
        else:
            all_values = (prior * step * valid(s, w)).sum()  # (5.32), (5.33)
            here, gone = yes * valid(s, w), no * all_values
        noise = (prior * step * here).sum() * exists + (1.0 - exists) * gone  # (5.20), (5.21)
        present = present * (a * here + (1 - a) * noise)
        absent = absent * (a * gone + (1 - a) * noise)
    return present.sum() + absent
