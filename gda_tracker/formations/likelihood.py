"""Likelihood ratios of 1..N objects in a cluster against false detections alone, of one scan.

A cluster of n objects gives k detections with the probability q_n(k) (thinned by P_D and by the
resolution, :mod:`gda_tracker.formations.resolution`), each an independent draw from the density
f(z) of the cluster; false detections are Poisson with the density rho. Which detection is of an
object is not known: the likelihood of a scan is the sum over all subsets I of them,

    p(Z | n) / p(Z | 0) = sum over I of |I|! q_n(|I|) prod over I of f(z_i) / rho(z_i)
                        = sum_k k! q_n(k) e_k(f(z_1) / rho(z_1), .., f(z_m) / rho(z_m)),

with e_k the elementary symmetric polynomials: the permanents of all assignments of n equal objects,
without listing one. For uniform f this is the likelihood of the mere number of detections, a
binomial and a Poisson variable added. The product over the scans is LR_n(k) of Koch (2014, (4.10)).
"""

from __future__ import annotations

import numpy as np
from scipy.special import gammaln

from gda_tracker.vocabulary.arrays import FloatArray


def log_symmetric_polynomials(log_value: FloatArray, most: int) -> FloatArray:
    """Logs (B, N + 1) of the elementary symmetric polynomials e_0 .. e_N of m values each.

    Parameters
    ----------
    log_value
        (B, m); -inf for none.
    most
        N.

    Examples
    --------
    >>> np.exp(log_symmetric_polynomials(np.log([[1.0, 2.0, 3.0]]), 3)).round(9)
    array([[ 1.,  6., 11.,  6.]])
    """
    largest = np.max(log_value, axis=1, initial=-np.inf)
    scale = np.where(np.isfinite(largest), largest, 0.0)
    value = np.exp(log_value - scale[:, None])
    found = np.zeros((len(log_value), most + 1))
    found[:, 0] = 1.0
    for column in range(value.shape[1]):
        # The right side is whole before it is added: each value is used once at most.
        found[:, 1:] += value[:, column, None] * found[:, :-1]
    with np.errstate(divide="ignore"):
        return np.log(found) + scale[:, None] * np.arange(most + 1)


def log_number_ratios(counts: FloatArray, log_ratio: FloatArray) -> FloatArray:
    """Log ratios (B, N) of n = 1..N objects against none, of one scan.

    Parameters
    ----------
    counts
        (B, N + 1, N + 1) q_n(k) by [n, k], from ``detection_counts``.
    log_ratio
        (B, m) log f(z_j) / rho(z_j) of the detections of each cluster, -inf for those of others.
    """
    most = counts.shape[1] - 1
    polynomials = log_symmetric_polynomials(log_ratio, most) + gammaln(np.arange(most + 1) + 1.0)
    largest = polynomials.max(axis=1)
    terms = np.exp(polynomials - largest[:, None])
    with np.errstate(divide="ignore"):
        ratios: FloatArray = (
            np.log(np.einsum("bnk,bk->bn", counts[:, 1:], terms)) + largest[:, None]
        )
    return ratios


def cluster_log_ratio(log_ratio: FloatArray) -> FloatArray:
    """Log (B,) of LR = 1/N sum_n LR_n: any number of objects against none (Koch 2014, (4.11))."""
    largest = log_ratio.max(axis=1)
    shift = np.where(np.isfinite(largest), largest, 0.0)
    with np.errstate(divide="ignore"):
        ratio: FloatArray = np.log(np.exp(log_ratio - shift[:, None]).mean(axis=1)) + shift
    return ratio


def cardinality(log_ratio: FloatArray) -> FloatArray:
    """c(n) (B, N): normalised ratios, the probability of n objects (Koch 2014, (4.12)).

    Equal for all n where every ratio is zero.
    """
    largest = log_ratio.max(axis=1)
    dead = np.isneginf(largest)
    safe = np.where(dead[:, None], 0.0, log_ratio)
    weight = np.exp(safe - safe.max(axis=1, keepdims=True))
    share: FloatArray = weight / weight.sum(axis=1, keepdims=True)
    return share


def expected_number(probability: FloatArray) -> FloatArray:
    """Return n-bar = sum_n n c(n) (...), of c (..., N) (Koch 2014, (4.13))."""
    number: FloatArray = probability @ np.arange(1, probability.shape[-1] + 1, dtype=np.float64)
    return number
