"""One-point covering functions of generalised measurements (Mahler 2011, (28), (37))."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike

from gda_tracker.attributes.generalised_measurements.expectations import own_grades
from gda_tracker.attributes.generalised_measurements.quadrature import average_over_box
from gda_tracker.vocabulary.arrays import FloatArray


class CoveringFunction(ABC):
    """M one-point covering functions mu(z) = Pr(z in Theta) on a measurement space of dimension d.

    A generalised measurement Theta is a random closed subset of the measurement space; its mu, with
    values from 0 to 1, is all that a likelihood needs. Its likelihood is mu(eta(x)) (29), (31),
    (32) where it is deterministic; with additive Gaussian noise (36), and after averaging over a
    Gaussian track (46), it is the expectation of mu under a Gaussian density of the measurement
    space. So two methods say all: :meth:`grade` and :meth:`log_expectation`.

    Arrays of points or densities broadcast against the M functions: their shape before the
    dimensions of the measurement space ends in M or 1.
    """

    @property
    @abstractmethod
    def dimension(self) -> int:
        """Dimension d of the measurement space."""

    @abstractmethod
    def __len__(self) -> int:
        """Number M of functions."""

    @abstractmethod
    def grade(self, points: FloatArray) -> FloatArray:
        """Return mu (..., M) at points (..., M or 1, d)."""

    @abstractmethod
    def log_expectation(self, mean: FloatArray, covariance: FloatArray) -> FloatArray:
        """Log of the integral of mu(z) N(z; mean, covariance) dz.

        Parameters
        ----------
        mean
            (..., M or 1, d).
        covariance
            (..., M or 1, d, d), positive definite.

        Returns
        -------
        array
            (..., M); -inf where the integral is zero.
        """

    def __call__(self, points: ArrayLike) -> FloatArray:
        """Return mu (..., M) of all M functions at points (..., d)."""
        array = np.asarray(points, dtype=np.float64)
        if array.ndim == 0 or array.shape[-1] != self.dimension:
            raise ValueError(
                f"points have the shape {array.shape}: allowed is (..., {self.dimension})"
            )
        return self.grade(array[..., None, :])

    def expectation(self, mean: FloatArray, covariance: FloatArray) -> FloatArray:
        """Integral of mu(z) N(z; mean, covariance) dz; as :meth:`log_expectation`."""
        return np.exp(self.log_expectation(mean, covariance))

    def average(self, low: FloatArray, high: FloatArray) -> FloatArray:
        """Averages (M,) of mu over the box from ``low`` (d,) to ``high`` (d,), finite.

        It is the clutter likelihood c(Theta) (47) of false alarms spread evenly over the box.
        """
        return average_over_box(
            lambda points, which: own_grades(self.grade, points, which, len(self)),
            len(self),
            low,
            high,
        )


def frozen(name: str, values: ArrayLike, *shape: int | None) -> FloatArray:
    """Copy of an array that cannot be written to.

    Parameters
    ----------
    name
        For the error.
    values
        Array.
    shape
        Its sizes, None for any.

    Raises
    ------
    ValueError
        If it has another shape or holds NaN.
    """
    array = np.array(values, dtype=np.float64)
    wanted = ", ".join("any" if size is None else str(size) for size in shape)
    fits = array.ndim == len(shape) and all(
        size in (None, actual) for size, actual in zip(shape, array.shape, strict=True)
    )
    if not fits:
        raise ValueError(f"{name} has the shape {array.shape}: allowed is ({wanted})")
    if np.isnan(array).any():
        raise ValueError(f"{name} holds NaN: allowed are numbers")
    array.flags.writeable = False
    return array


def frozen_finite(name: str, values: ArrayLike, *shape: int | None) -> FloatArray:
    """Like :func:`frozen`, and ValueError if a value is infinite."""
    array = frozen(name, values, *shape)
    if not np.isfinite(array).all():
        raise ValueError(f"{name} holds an infinite value: allowed are finite numbers")
    return array
