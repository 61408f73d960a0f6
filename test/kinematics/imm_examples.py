"""Random models and states for the tests of IMM, and a linear Gaussian measurement."""

from __future__ import annotations

import numpy as np

H = np.eye(2, 4)
R = np.array([[40.0, 12.0], [12.0, 90.0]])


def random_models(rng, count, size=4):
    """F, Q (M, s, s) near the identity, full Q; switching (M, M) with columns that sum to one."""
    transition = np.eye(size) + 0.2 * rng.normal(size=(count, size, size))
    root = rng.normal(size=(count, size, size))
    noise = root @ root.transpose(0, 2, 1) * rng.uniform(0.5, 20.0, (count, 1, 1))
    return transition, noise, rng.dirichlet(np.ones(count), count).T


def random_mixture(rng, hypotheses, count, size=4):
    """Weight (H, M), mean (H, M, s), covariance (H, M, s, s)."""
    root = rng.normal(size=(hypotheses, count, size, size)) * 4.0
    return (
        rng.dirichlet(np.ones(count), hypotheses),
        rng.normal(0, 10, (hypotheses, count, size)),
        root @ np.swapaxes(root, -1, -2) + np.eye(size),
    )


def kalman_update(mean, covariance, z, h=H, r=R):
    """Kalman update of states (..., s) with z (..., d), and log N(z; H x, S) (...)."""
    s = h @ covariance @ h.T + r
    gain = covariance @ h.T @ np.linalg.inv(s)
    residual = z - mean @ h.T
    squared = np.sum(residual * np.linalg.solve(s, residual[..., None])[..., 0], axis=-1)
    log_likelihood = -0.5 * squared - 0.5 * np.linalg.slogdet(2 * np.pi * s)[1]
    new = mean + (gain @ residual[..., None])[..., 0]
    return new, covariance - gain @ s @ np.swapaxes(gain, -1, -2), log_likelihood


def loop_moments(weight, mean, covariance):
    """Moments of one mixture by plain sums."""
    centre = sum(w * m for w, m in zip(weight, mean, strict=True))
    spread = sum(
        w * (c + np.outer(m - centre, m - centre))
        for w, m, c in zip(weight, mean, covariance, strict=True)
    )
    return centre, spread
