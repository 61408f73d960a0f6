"""Integrals of covering functions by other means: dense quadrature, or scipy's, chord by chord."""

from __future__ import annotations

import numpy as np
from scipy.integrate import quad
from scipy.special import log_ndtr, ndtr


def pieces(mean, deviation, knots):
    """Edges of pieces that cover 12 standard deviations either way and break at the knots."""
    edges = [mean + k * deviation for k in (-12, -8, -5, -3, -1, 0, 1, 3, 5, 8, 12)]
    edges += [knot for knot in np.ravel(knots) if edges[0] < knot < edges[-1]]
    return np.array(sorted(set(edges)))


def scalar_integral(function, mean, variance, knots=()):
    """Integral of function(z) N(z; mean, variance) dz, 4 times 40 nodes in every piece.

    ``function`` takes arrays and is smooth between the knots.
    """
    deviation = np.sqrt(variance)
    edges = pieces(mean, deviation, knots)
    edges = np.append((edges[:-1, None] + np.diff(edges)[:, None] * np.arange(4) / 4), edges[-1])
    x, w = np.polynomial.legendre.leggauss(40)
    half = 0.5 * np.diff(edges)[:, None]
    z = edges[:-1, None] + half * (1.0 + x)
    density = np.exp(-0.5 * ((z - mean) / deviation) ** 2) / np.sqrt(2.0 * np.pi) / deviation
    return float((half * w * density * function(z)).sum())


def plane_integral(slices, mean, covariance, knots=()):
    """Probability of a plane region by integration over x of its chords.

    ``slices(x)`` gives the intervals (low, high) of y inside at x.
    """
    sx = np.sqrt(covariance[0, 0])
    slope = covariance[0, 1] / covariance[0, 0]
    sy = np.sqrt(covariance[1, 1] - slope * covariance[0, 1])

    def chord(x):
        centre = mean[1] + slope * (x - mean[0])
        return sum(interval_probability((a - centre) / sy, (b - centre) / sy) for a, b in slices(x))

    def weighted(x):
        u = (x - mean[0]) / sx
        return chord(x) * np.exp(-0.5 * u * u) / np.sqrt(2.0 * np.pi) / sx

    edges = pieces(mean[0], sx, knots)
    return sum(
        quad(weighted, low, high, epsabs=1e-15, epsrel=1e-13, limit=200)[0]
        for low, high in zip(edges[:-1], edges[1:], strict=True)
    )


def interval_probability(a, b):
    """Phi(b) - Phi(a) without cancellation in the tails."""
    if a > 0.0:
        a, b = -b, -a
    return float(np.exp(log_ndtr(b)) - np.exp(log_ndtr(a))) if b < 0.0 else float(ndtr(b) - ndtr(a))


def polygon_slices(vertices):
    """Chords of a polygon (V, 2)."""

    def slices(x):
        cuts = []
        for (x1, y1), (x2, y2) in zip(vertices, np.roll(vertices, -1, axis=0), strict=True):
            if (x1 <= x) != (x2 <= x):
                cuts.append(y1 + (y2 - y1) * (x - x1) / (x2 - x1))
        cuts.sort()
        return list(zip(cuts[::2], cuts[1::2], strict=True))

    return slices


def sector_slices(apex, first, opening):
    """Chords of a bearing sector that is narrower than pi."""
    directions = [np.array([np.cos(b), np.sin(b)]) for b in (first, first + opening)]

    def slices(x):
        low, high = -np.inf, np.inf
        for sign, (dx, dy) in zip((1.0, -1.0), directions, strict=True):
            # sign * cross(direction, (x, y) - apex) >= 0.
            bound = apex[1] + dy * (x - apex[0]) / dx
            if sign * dx > 0.0:
                low = max(low, bound)
            else:
                high = min(high, bound)
        return [(low, high)] if low < high else []

    return slices


def random_covariance(random, d, spread=3.0):
    """Positive definite (d, d) with standard deviations over about ``spread`` either way."""
    turn = np.linalg.qr(random.normal(size=(d, d)))[0]
    deviations = spread ** random.uniform(-1.0, 1.0, d)
    return turn @ np.diag(deviations**2) @ turn.T


def star_polygon(random, corners, radius=3.0):
    """A polygon without crossings, not convex as a rule."""
    gaps = random.dirichlet(np.full(corners, 3.0)) * 2.0 * np.pi
    bearing = np.cumsum(gaps) + random.uniform(0.0, 2.0 * np.pi)
    distance = radius * random.uniform(0.3, 1.5, corners)
    return distance[:, None] * np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)
