"""Small batches of linear algebra on Gaussian densities."""

from __future__ import annotations

import numpy as np

from gda_tracker.vocabulary.arrays import FloatArray


def whiten(covariance: FloatArray, *differences: FloatArray) -> tuple[list[FloatArray], FloatArray]:
    """Solve L w = difference for the Cholesky factor L of a covariance.

    Parameters
    ----------
    covariance
        (..., d, d), symmetric and positive definite.
    differences
        (..., d) each, broadcast against it.

    Returns
    -------
    list, array
        w (..., d) of each difference, whose squared length is the squared Mahalanobis distance, and
        the log determinant (...) of the covariance.

    Raises
    ------
    ValueError
        If a covariance is not positive definite.
    """
    factor = cholesky(covariance)
    d = covariance.shape[-1]
    solved = []
    for difference in differences:
        shape = np.broadcast_shapes(factor.shape[:-1], difference.shape)
        whitened = np.empty(shape)
        for row in range(d):
            known = (factor[..., row, :row] * whitened[..., :row]).sum(axis=-1)
            whitened[..., row] = (difference[..., row] - known) / factor[..., row, row]
        solved.append(whitened)
    diagonal = np.diagonal(factor, axis1=-2, axis2=-1)
    return solved, 2.0 * np.log(diagonal).sum(axis=-1)


def cholesky(covariance: FloatArray) -> FloatArray:
    """Lower Cholesky factors (..., d, d); ValueError if a matrix is not positive definite."""
    try:
        return np.asarray(np.linalg.cholesky(covariance))
    except np.linalg.LinAlgError as error:
        raise ValueError(
            f"covariance of shape {covariance.shape} is singular or indefinite: allowed are "
            "positive definite matrices"
        ) from error


def check_covariances(name: str, matrices: FloatArray) -> None:
    """Raise ValueError unless matrices (..., d, d) are finite, symmetric, positive definite."""
    if not np.isfinite(matrices).all():
        raise ValueError(f"{name} has a value that is not finite: allowed are finite numbers")
    turned = np.swapaxes(matrices, -1, -2)
    if not np.allclose(matrices, turned, rtol=1e-9, atol=0.0):
        raise ValueError(f"{name} is not symmetric: allowed are symmetric matrices")
    try:
        cholesky(matrices)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from error
