"""Targets too close to be resolved: one detection for a group, by exact enumeration.

Two targets are not resolved with the probability P_u(d) = exp(-d' R_u^-1 d / 2) of their distance d
(Koch 2014, section 2.3.3; Koch and van Keuk, "Multiple hypothesis track maintenance with possibly
unresolved measurements", 1997). For three, each pair is linked with its own P_u, independently, and
what hangs together is one group. A group gives one detection at most, at the mean of its members.

A joint state x = (x_1, .., x_n) of n <= 3 targets then has a likelihood that is a sum of Gaussians
in x: P_u is one itself, a fictitious measurement "distance 0" with covariance R_u, and 1 - P_u a
difference of two, which brings negative weights. For two targets it is

    rho^2 [P_u (1 - P_Du) + (1 - P_u)(1 - P_D)^2]
    + rho sum_j [P_u P_Du N(z_j; H_g x, R_g)
                 + (1 - P_u) P_D (1 - P_D) (N(z_j; H x_1, R) + N(z_j; H x_2, R))]
    + (1 - P_u) P_D^2 sum_{i != j} N(z_i; H x_1, R) N(z_j; H x_2, R)

times rho^(m - 2). Terms of one interpretation of the detections sum to something positive, so that
:func:`interpretations` matches the moments of each and leaves positive weights only.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray

MAX_TARGETS = 3
LEAST_UNRESOLVED = 0.01
"""In the ring groups less probable are taken as resolved."""
# An interpretation whose terms cancel to less than this share of their sizes has no weight.
LEAST_REST = 1e-7


def resolution_covariance(half_distances: FloatArray) -> FloatArray:
    """R_u (d, d) with P_u = 1/2 at these distances along the axes, as range and azimuth."""
    return np.diag(np.asarray(half_distances, dtype=np.float64) ** 2 / (2.0 * math.log(2.0)))


def unresolved_probability(distance: FloatArray, resolution: FloatArray) -> FloatArray:
    """P_u (...) of distances (..., d), with the resolution's matrix R_u (d, d)."""
    pull = np.linalg.solve(resolution, distance[..., None])[..., 0]
    return np.exp(-0.5 * np.sum(distance * pull, axis=-1))


def expected_unresolved_probability(
    distance: FloatArray, covariance: FloatArray, resolution: FloatArray
) -> FloatArray:
    """Mean (...) of P_u over Gaussian distances: |2 pi R_u|^1/2 N(d; 0, covariance + R_u)."""
    total = covariance + resolution
    ratio = np.linalg.det(resolution) / np.linalg.det(total)
    return np.sqrt(ratio) * unresolved_probability(distance, total)


@dataclass(frozen=True, slots=True)
class ResolutionSensor:
    """What the sensor does with n targets and its own false alarms.

    ``observation`` H (d, s) takes the state of one target to a detection with the covariance
    ``noise`` R (d, d); a group's detection has ``group_noise`` R_g and is there with the
    probability ``group_detection_probability`` P_Du. ``clutter_density`` rho is in one over the
    unit of the measurement. ``resolution`` R_u (d, d); ``None``: all targets are resolved.
    """

    observation: FloatArray
    noise: FloatArray
    group_noise: FloatArray
    detection_probability: float
    group_detection_probability: float
    clutter_density: float
    resolution: FloatArray | None = None

    def __post_init__(self) -> None:
        for name in ("detection_probability", "group_detection_probability"):
            value = getattr(self, name)
            if not 0.0 < value < 1.0:
                raise ValueError(f"{name} = {value}: allowed are numbers > 0 and < 1")
        if not 0.0 < self.clutter_density < np.inf:
            raise ValueError(f"clutter_density = {self.clutter_density}: allowed are numbers > 0")


@dataclass(slots=True)
class Terms:
    """T signed Gaussian terms of the product of likelihood and K prior Gaussians.

    ``prior`` (T,) index of the prior component, ``interpretation`` (T,) index into
    :attr:`Structure.groups`, ``sign`` (T,), ``log_weight`` (T,) of the absolute weight, ``mean``
    (T, D) and ``covariance`` (T, D, D).
    """

    prior: IntArray
    interpretation: IntArray
    sign: FloatArray
    log_weight: FloatArray
    mean: FloatArray
    covariance: FloatArray


@dataclass(slots=True)
class Interpretations:
    """Positive Gaussian components, one for each prior component and reading of the detections.

    ``prior`` (I,), ``log_weight`` (I,), ``mean`` (I, D), ``covariance`` (I, D, D); ``resolved``
    (I,) tells that all targets are single. The weights sum to the likelihood of the scan.
    """

    prior: IntArray
    log_weight: FloatArray
    mean: FloatArray
    covariance: FloatArray
    resolved: BoolArray


@dataclass(frozen=True, slots=True)
class Structure:
    """Who may be one group and which detection may be whose, for n targets and m detections.

    ``groups`` (I,) of the interpretations: the group's members and its detection, -1 for none. Of
    the terms: ``interpretation`` (T,), ``coefficient`` (T,), ``edges`` (T, E) the fictitious
    measurements, ``used`` (T, G, m) and ``missed`` (T, G) what happens to the subsets of targets.
    """

    subsets: tuple[tuple[int, ...], ...]
    pairs: tuple[tuple[int, int], ...]
    groups: tuple[tuple[tuple[tuple[int, ...], int], ...], ...]
    interpretation: IntArray
    coefficient: FloatArray
    edges: FloatArray
    used: FloatArray
    missed: FloatArray


@lru_cache(maxsize=64)
def structure(n: int, m: int, limited: bool) -> Structure:
    """The enumeration; ``limited``: whether groups of several targets are possible at all.

    Raises
    ------
    ValueError
        If n is not 1 to 3.
    """
    if not 1 <= n <= MAX_TARGETS:
        raise ValueError(f"{n} targets: allowed are 1 to {MAX_TARGETS} in one cluster")
    subsets = tuple(
        members
        for size in range(1, n + 1)
        for members in itertools.combinations(range(n), size)
        if limited or size == 1
    )
    pairs = tuple(itertools.combinations(range(n), 2)) if limited else ()
    groups: list[tuple[tuple[tuple[int, ...], int], ...]] = []
    rows = []
    for parts, coefficients in resolution_hypotheses(n, limited).items():
        for choice in itertools.product(range(-1, m), repeat=len(parts)):
            taken = [j for j in choice if j >= 0]
            if len(set(taken)) < len(taken):
                continue
            used, missed = np.zeros((len(subsets), m)), np.zeros(len(subsets))
            for part, j in zip(parts, choice, strict=True):
                if j < 0:
                    missed[subsets.index(part)] = 1.0
                else:
                    used[subsets.index(part), j] = 1.0
            for edges, coefficient in coefficients.items():
                present = np.array([float(pair in edges) for pair in pairs])
                rows.append((len(groups), coefficient, present, used, missed))
            groups.append(tuple(zip(parts, choice, strict=True)))
    interpretation, coefficient, edges, used, missed = zip(*rows, strict=True)
    return Structure(
        subsets,
        pairs,
        tuple(groups),
        np.array(interpretation),
        np.array(coefficient, dtype=np.float64),
        np.array(edges).reshape(len(rows), len(pairs)),
        np.array(used),
        np.array(missed),
    )


def resolution_hypotheses(
    n: int, limited: bool = True
) -> dict[tuple[tuple[int, ...], ...], dict[frozenset[tuple[int, int]], float]]:
    """Probability of each grouping of n targets as a polynomial in the pairs' P_u.

    Returns
    -------
    dict
        By groups: coefficients by sets of pairs, whose P_u are multiplied. The polynomials sum to
        one. For two targets: ((0, 1),): P_u, and ((0,), (1,)): 1 - P_u.
    """
    pairs = list(itertools.combinations(range(n), 2)) if limited else []
    found: dict[tuple[tuple[int, ...], ...], dict[frozenset[tuple[int, int]], float]] = {}
    for linked in itertools.product((False, True), repeat=len(pairs)):
        graph = [pair for pair, is_linked in zip(pairs, linked, strict=True) if is_linked]
        rest = [pair for pair in pairs if pair not in graph]
        polynomial = found.setdefault(_components(n, graph), {})
        # prod P_u over the links times prod (1 - P_u) over the others, multiplied out.
        for size in range(len(rest) + 1):
            for more in itertools.combinations(rest, size):
                edges = frozenset([*graph, *more])
                polynomial[edges] = polynomial.get(edges, 0.0) + (-1.0) ** size
    return {
        parts: {edges: c for edges, c in polynomial.items() if c != 0.0}
        for parts, polynomial in found.items()
    }


def _components(n: int, graph: list[tuple[int, int]]) -> tuple[tuple[int, ...], ...]:
    part = list(range(n))
    for a, b in graph:
        old, new = max(part[a], part[b]), min(part[a], part[b])
        part = [new if one == old else one for one in part]
    return tuple(tuple(i for i in range(n) if part[i] == name) for name in sorted(set(part)))


def terms(
    mean: FloatArray, covariance: FloatArray, detections: FloatArray, sensor: ResolutionSensor
) -> Terms:
    """All signed terms of the product of K joint Gaussians with the likelihood of one scan.

    Parameters
    ----------
    mean, covariance
        (K, D), (K, D, D) of joint states, D = n s: the states of n targets, one after the other.
    detections
        (m, d).

    Raises
    ------
    ValueError
        If there are more than three targets, or a detection is not finite.
    """
    d, s = sensor.observation.shape
    count, size = mean.shape
    n, rest = divmod(size, s)
    if rest:
        raise ValueError(f"joint states of {size} numbers: allowed are multiples of {s}")
    if not np.isfinite(detections).all():
        raise ValueError("detections: allowed are finite numbers")
    m = len(detections)
    plan = structure(n, m, sensor.resolution is not None)
    single = np.zeros((n, d, size))
    for i in range(n):
        single[i, :, i * s : (i + 1) * s] = sensor.observation
    at = np.array([single[list(group)].mean(axis=0) for group in plan.subsets])  # (G, d, D)
    alone = np.array([len(group) == 1 for group in plan.subsets])
    noise = np.where(alone[:, None, None], sensor.noise, sensor.group_noise)
    inverse = np.linalg.inv(noise)
    seen = np.where(alone, sensor.detection_probability, sensor.group_detection_probability)  # (G,)
    weighted = at.transpose(0, 2, 1) @ inverse  # (G, D, d)
    residual = detections[None, None] - (at[None] @ mean[:, None, :, None])[..., 0][:, :, None]
    of_group = weighted @ at  # (G, D, D)
    pull = np.einsum("gxd,kgjd->kgjx", weighted, residual)
    square = np.einsum("kgjd,gde,kgje->kgj", residual, inverse, residual)
    log_seen = np.log(seen) - 0.5 * np.linalg.slogdet(2.0 * np.pi * noise)[1]
    number = plan.used.sum(axis=(1, 2))
    log_constant = (
        np.log(np.abs(plan.coefficient))
        + plan.used.sum(axis=2) @ log_seen
        + plan.missed @ np.log1p(-seen)
        + (m - number) * math.log(sensor.clutter_density)
    )
    precision = np.linalg.inv(covariance)[:, None] + np.einsum(
        "tg,gxy->txy", plan.used.sum(axis=2), of_group
    )
    vector = np.einsum("tgj,kgjx->ktx", plan.used, pull)
    cost = np.einsum("tgj,kgj->kt", plan.used, square)
    if plan.pairs:
        assert sensor.resolution is not None
        gap = np.array([single[a] - single[b] for a, b in plan.pairs])  # (E, d, D)
        link = gap.transpose(0, 2, 1) @ np.linalg.inv(sensor.resolution)
        precision = precision + np.einsum("te,exy->txy", plan.edges, link @ gap)
        apart = (gap[None] @ mean[:, None, :, None])[..., 0]  # (K, E, d)
        vector = vector - np.einsum("te,exd,ked->ktx", plan.edges, link, apart)
        inner = np.linalg.solve(sensor.resolution, apart[..., None])[..., 0]
        cost = cost + np.sum(apart * inner, axis=2) @ plan.edges.T
    posterior = np.linalg.inv(precision)
    shift = (posterior @ vector[..., None])[..., 0]
    log_ratio = np.linalg.slogdet(covariance)[1][:, None] + np.linalg.slogdet(precision)[1]
    log_weight = log_constant - 0.5 * (log_ratio + cost - np.sum(shift * vector, axis=2))
    many = len(plan.coefficient)
    return Terms(
        np.repeat(np.arange(count), many),
        np.tile(plan.interpretation, count),
        np.tile(np.sign(plan.coefficient), count),
        log_weight.reshape(-1),
        (mean[:, None] + shift).reshape(-1, size),
        0.5 * (posterior + np.swapaxes(posterior, -1, -2)).reshape(-1, size, size),
    )


def interpretations(
    log_weight: FloatArray,
    mean: FloatArray,
    covariance: FloatArray,
    detections: FloatArray,
    sensor: ResolutionSensor,
) -> Interpretations:
    """Update K weighted joint Gaussians; each reading of the detections by its exact moments.

    Parameters
    ----------
    log_weight, mean, covariance
        (K,), (K, D), (K, D, D) of the predicted joint density.
    detections
        (m, d).
    """
    found = terms(mean, covariance, detections, sensor)
    plan = structure(
        mean.shape[1] // sensor.observation.shape[1], len(detections), sensor.resolution is not None
    )
    readings, size = len(plan.groups), mean.shape[1]
    index = found.prior * readings + found.interpretation
    log_term = found.log_weight + log_weight[found.prior]
    total = len(log_weight) * readings
    peak = np.full(total, -np.inf)
    np.maximum.at(peak, index, log_term)
    signed = found.sign * np.exp(log_term - peak[index])
    rest = np.bincount(index, signed, total)
    kept = np.flatnonzero(rest > LEAST_REST)
    row = np.full(total, -1)
    row[kept] = np.arange(len(kept))
    inside = row[index] >= 0
    group, share = row[index[inside]], (signed / np.where(rest > 0.0, rest, 1.0)[index])[inside]
    centre = np.zeros((len(kept), size))
    np.add.at(centre, group, share[:, None] * found.mean[inside])
    gap = found.mean[inside] - centre[group]
    spread = np.zeros((len(kept), size, size))
    each = found.covariance[inside] + gap[:, :, None] * gap[:, None, :]
    np.add.at(spread, group, share[:, None, None] * each)
    single = np.array([all(len(members) == 1 for members, _ in one) for one in plan.groups])
    return Interpretations(
        kept // readings,
        peak[kept] + np.log(rest[kept]),
        centre,
        spread,
        single[kept % readings],
    )
