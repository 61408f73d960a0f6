"""Random track sets, and the association ratio computed as the paper writes it."""

from __future__ import annotations

import numpy as np

from gda_tracker.kinematics.set_valued.filter import TrackSets


def random_sets(rng, count, n=4, k=4, spread=4.0, size=2.0):
    """Return sets with full covariances; K of any rank up to k."""
    factor = rng.standard_normal((count, n, n))
    covariance = factor @ factor.transpose(0, 2, 1) * rng.uniform(0.1, 3.0, (count, 1, 1))
    return TrackSets(
        spread * rng.standard_normal((count, n)),
        covariance + 0.05 * np.eye(n),
        rng.standard_normal((count, n, k)) * rng.uniform(0.0, size, (count, 1, 1)),
    )


def distance_integral_by_grid(half_width, points=400):
    """Integral of |zeta| over the box, by the midpoint rule in one corner of it."""
    middle = (np.arange(points) + 0.5) / points
    axes = np.meshgrid(*[w * middle for w in half_width], indexing="ij")
    return np.sqrt(sum(a * a for a in axes)).mean() * np.prod(2.0 * half_width)


def literal_log_ratios(sets, row, x, z, h, rho, theta, integral):
    """Equation (24) with the errata mended, member by member: the largest log q - log m.

    ``x`` (L, n) members of the set, r = len(z). No use is made of what the library knows: the gain,
    the filtered covariance and its inverse stand there as in the paper. Returns the values in
    measurement and in state space, minus infinite where no member is in the region.
    """
    v = x @ h.T - z
    v = v[(np.abs(v) <= theta * rho).all(axis=1)]
    if not len(v):
        return -np.inf, -np.inf
    p = sets.covariance[row]
    gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + np.diag(rho**2))
    after = (np.eye(len(p)) - gain @ h) @ p
    shift = v @ gain.T
    exponent = np.sum((shift @ np.linalg.inv(after)) * shift, axis=1)
    with np.errstate(divide="ignore"):
        log_m = np.log(np.linalg.norm(v, axis=1)) - np.log(integral)
    highest = (-0.5 * exponent - log_m).max()
    return tuple(
        highest - 0.5 * np.linalg.slogdet(2.0 * np.pi * normaliser)[1]
        for normaliser in (h @ after @ h.T, after)
    )


def members_by_projection(sets, row, h, count, rng):
    """``count`` members of a set whose predicted observations fill the projected set evenly.

    Half of them lie on its boundary.
    """
    r = len(h)
    w = rng.standard_normal((count, r))
    if r == 2:
        angle = 2.0 * np.pi * np.arange(count) / count
        w = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    elif r == 1:
        w = np.linspace(-1.0, 1.0, count)[:, None]
    if r > 1:
        w /= np.linalg.norm(w, axis=1, keepdims=True)
        w[::2] *= rng.uniform(0.0, 1.0, (len(w[::2]), 1)) ** (1.0 / r)
    spread = h @ sets.matrix[row]
    values, axes = np.linalg.eigh(spread @ spread.T)
    # The shortest u with H K u = (H K K' H')^(1/2) w, which is as long as w.
    u = w @ ((axes / np.sqrt(values)) @ axes.T @ spread)
    assert np.linalg.norm(u, axis=1).max() <= 1.0 + 1e-9
    return sets.centroid[row] + u @ sets.matrix[row].T
