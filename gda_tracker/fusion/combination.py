"""Fused states of the tracks of one target (Koch 2014, 2.27-2.28; covariance intersection).

All functions take G targets with up to S tracks each: states (G, S, 4), covariances
(G, S, 4, 4) and a mask (G, S) of the tracks that are there.
"""

from __future__ import annotations

import numpy as np

from gda_tracker.vocabulary.arrays import BoolArray, FloatArray


def fuse_independent(
    mean: FloatArray, covariance: FloatArray, there: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Fuse tracks whose errors are independent: R^-1 = sum R_s^-1, R^-1 z = sum R_s^-1 z_s.

    The sensor fusion equation (Koch 2014, 2.27-2.28).
    """
    return _weighted(mean, covariance, there, there.astype(np.float64))


def covariance_intersection(
    mean: FloatArray, covariance: FloatArray, there: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Fuse tracks whose errors may be correlated in any way; the covariance is never too small.

    P^-1 = sum w_s P_s^-1 with weights that sum to one (Julier and Uhlmann 1997), in closed form as
    in Fraenken and Huepper 2005, "Improved fast covariance intersection for distributed data
    fusion": the order of the tracks does not matter.
    """
    inverse = np.where(there[..., None, None], np.linalg.inv(covariance), 0.0)
    total = inverse.sum(axis=1)
    whole = np.linalg.det(total)
    own = np.where(there, np.linalg.det(inverse), 0.0)
    number = there.sum(axis=1)
    # Determinants of singular differences are rounding: one track alone leaves nothing.
    rest = np.where(there, np.linalg.det(total[:, None] - inverse), 0.0)
    rest = np.where(number[:, None] > 1, rest, 0.0)
    gain = np.where(there, whole[:, None] - rest + own, 0.0)
    return _weighted(mean, covariance, there, gain / gain.sum(axis=1, keepdims=True))


def _weighted(
    mean: FloatArray, covariance: FloatArray, there: BoolArray, weight: FloatArray
) -> tuple[FloatArray, FloatArray]:
    inverse = np.where(there[..., None, None], np.linalg.inv(covariance), 0.0)
    inverse = inverse * weight[..., None, None]
    fused = np.linalg.inv(inverse.sum(axis=1))
    fused = 0.5 * (fused + np.swapaxes(fused, 1, 2))
    known = np.where(there[..., None], mean, 0.0)
    vector = np.einsum("gsij,gsj->gi", inverse, known)
    return np.einsum("gij,gj->gi", fused, vector), fused
