"""How many detections n objects can give at most, where some are too close to be told apart.

Two objects at a distance d are not resolved with the probability P_u(d) = exp(-d' R_u^-1 d / 2)
(Koch 2014, section 2.3.3; :mod:`gda_tracker.association.unresolved`); each pair is linked
independently, and what hangs together is one group, which gives one detection at most. Where the
objects are is not known here, only how far they spread: positions are independent draws from
N(c, X). The product of P_u over the links G then has a closed mean,

    E prod_G exp(-d_e' R_u^-1 d_e / 2) = prod_a prod_i (1 + tau_a mu_i)^(-1/2),

mu_i the eigenvalues of the Laplacian of G, tau_a those of R_u^-1 X. The probability that exactly
the links G are there follows by inclusion and exclusion over the graphs that contain G, and the sum
over all graphs with g components is the probability of g groups: exact, for up to six objects.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import combinations

import numpy as np
from scipy.special import comb

from gda_tracker.vocabulary.arrays import FloatArray

MOST_OBJECTS = 6
"""Six objects have 15 pairs and 32768 graphs; seven would have two million."""


@lru_cache(maxsize=MOST_OBJECTS)
def _graphs(n: int) -> tuple[FloatArray, FloatArray]:
    """Distinct Laplacian spectra (K, n) of graphs of n nodes, and coefficients (n, K) by groups.

    P(g groups) = sum_k coefficients[g - 1, k] E prod over the links of a graph with spectrum k.
    """
    pairs = list(combinations(range(n), 2))
    count = 1 << len(pairs)
    present = (np.arange(count)[:, None] >> np.arange(len(pairs))) & 1
    laplacian = np.zeros((count, n, n))
    for bit, (a, b) in enumerate(pairs):
        edge = present[:, bit].astype(np.float64)
        laplacian[:, a, a] += edge
        laplacian[:, b, b] += edge
        laplacian[:, a, b] -= edge
        laplacian[:, b, a] -= edge
    spectrum = np.maximum(np.linalg.eigvalsh(laplacian), 0.0)
    # A graph has as many components as its Laplacian has eigenvalues of zero.
    groups = (spectrum < 1e-9).sum(axis=1)
    exactly = (groups[None, :] == np.arange(1, n + 1)[:, None]).astype(np.float64)
    # P(exactly G) = sum over G' that contain G of (-1)^|G' - G| mean(G'), transposed, bit by bit.
    for bit in range(len(pairs)):
        shaped = exactly.reshape(n, -1, 2, 1 << bit)
        shaped[:, :, 1] -= shaped[:, :, 0]
    distinct, index = np.unique(np.round(spectrum, 9), axis=0, return_inverse=True)
    index = index.reshape(-1)
    coefficients = np.stack([np.bincount(index, row, len(distinct)) for row in exactly])
    return distinct.astype(np.float64), np.asarray(coefficients, dtype=np.float64)


def group_probabilities(ratio: FloatArray, most: int) -> FloatArray:
    """Probability (B, N + 1, N + 1) that n objects form g groups, by [n, g].

    Parameters
    ----------
    ratio
        (B, 2) eigenvalues of R_u^-1 X; infinite where all objects are resolved.
    most
        N, at most :data:`MOST_OBJECTS` unless all ratios are infinite.

    Raises
    ------
    ValueError
        For more objects, or a negative ratio.

    Examples
    --------
    Two objects with X = R_u: P_u = 1 / (1 + 2).

    >>> group_probabilities(np.ones((1, 2)), 2)[0, 2].round(3)
    array([0.   , 0.333, 0.667])
    """
    found = np.zeros((len(ratio), most + 1, most + 1))
    numbers = np.arange(most + 1)
    found[:, numbers, numbers] = 1.0
    limited = np.isfinite(ratio).all(axis=1)
    if not limited.any():
        return found
    if most > MOST_OBJECTS:
        raise ValueError(f"{most} objects with a limited resolution: allowed are {MOST_OBJECTS}")
    if (ratio < 0.0).any():
        raise ValueError("ratio: allowed are numbers >= 0")
    for n in range(2, most + 1):
        spectra, coefficients = _graphs(n)
        scaled = ratio[limited, :, None, None] * spectra
        mean = np.exp(-0.5 * np.log1p(scaled).sum(axis=(1, 3)))  # (b, K)
        probability = np.maximum(mean @ coefficients.T, 0.0)
        found[limited, n, 1 : n + 1] = probability / probability.sum(axis=1, keepdims=True)
    return found


def detection_counts(detection_probability: FloatArray, groups: FloatArray) -> FloatArray:
    """Probability (B, N + 1, N + 1) that n objects give k detections, by [n, k].

    Parameters
    ----------
    detection_probability
        (B,) P_D of a group, of one object or more.
    groups
        (B, N + 1, N + 1) from :func:`group_probabilities`.
    """
    most = groups.shape[1] - 1
    g, k = np.meshgrid(np.arange(most + 1), np.arange(most + 1), indexing="ij")
    seen = detection_probability[:, None, None]
    with np.errstate(invalid="ignore"):
        missed = (1.0 - seen) ** np.maximum(g - k, 0)
    thinned = np.where(k <= g, comb(g, k) * seen**k * missed, 0.0)
    counts: FloatArray = groups @ thinned
    return counts
