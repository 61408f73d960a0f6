"""Fuzzy statements of a Gaussian shape, no statement at all, and any other covering function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gda_tracker.attributes.generalised_measurements.covering import (
    CoveringFunction,
    frozen_finite,
)
from gda_tracker.attributes.generalised_measurements.expectations import numerical_expectation
from gda_tracker.attributes.generalised_measurements.gaussians import (
    check_covariances,
    whiten,
)
from gda_tracker.attributes.generalised_measurements.quadrature import ABSOLUTE_TOLERANCE
from gda_tracker.attributes.generalised_measurements.regions import Box
from gda_tracker.attributes.generalised_measurements.scalars import interval
from gda_tracker.vocabulary.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class GaussianShaped(CoveringFunction):
    """M fuzzy memberships exp(-(z - c)' C^-1 (z - c) / 2) (Mahler 2011, (40), (58), (61)).

    Parameters
    ----------
    centre
        (M, d) c, where the membership is 1.
    shape
        (M, d, d) C, positive definite.

    Examples
    --------
    >>> near_the_buoy = GaussianShaped([[100.0, 0.0]], [[[400.0, 0.0], [0.0, 400.0]]])
    >>> near_the_buoy([[100.0, 0.0], [120.0, 0.0]]).round(4).tolist()
    [[1.0], [0.6065]]
    """

    centre: FloatArray
    shape: FloatArray

    def __post_init__(self) -> None:
        centre = frozen_finite("centre", self.centre, None, None)
        d = centre.shape[1]
        shape = frozen_finite("shape", self.shape, len(centre), d, d)
        check_covariances("shape", shape)
        object.__setattr__(self, "centre", centre)
        object.__setattr__(self, "shape", shape)

    @property
    def dimension(self) -> int:  # noqa: D102
        return self.centre.shape[1]

    def __len__(self) -> int:
        return len(self.centre)

    def grade(self, points: FloatArray) -> FloatArray:  # noqa: D102
        (whitened,), _ = whiten(self.shape, points - self.centre)
        return np.exp(-0.5 * (whitened * whitened).sum(axis=-1))

    def log_expectation(self, mean: FloatArray, covariance: FloatArray) -> FloatArray:
        """Closed form: sqrt(det 2 pi C) N(c; mean, C + covariance), (41), (60), (73).

        The covariance may be singular, even zero.
        """
        (whitened,), log_det = whiten(self.shape + covariance, self.centre - mean)
        _, log_det_shape = whiten(self.shape)
        return 0.5 * (log_det_shape - log_det - (whitened * whitened).sum(axis=-1))

    def average(self, low: FloatArray, high: FloatArray) -> FloatArray:
        """Closed form in one and two dimensions: the density's share in the box, scaled back."""
        low, high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
        if self.dimension > 2:
            return super().average(low, high)
        region: CoveringFunction = (
            interval(low, high) if self.dimension == 1 else Box(low[None], high[None])
        )
        # The density is one per function, the region one for all.
        inside = region.expectation(self.centre[:, None], self.shape[:, None])[:, 0]
        _, log_det = whiten(2.0 * np.pi * self.shape)
        return inside * np.exp(0.5 * log_det) / float(np.prod(high - low))


@dataclass(frozen=True)
class Everything(CoveringFunction):
    """M statements that say nothing: mu = 1, the vacuous measurement.

    Parameters
    ----------
    count
        M.
    n_dimensions
        d.
    """

    count: int
    n_dimensions: int

    @property
    def dimension(self) -> int:  # noqa: D102
        return self.n_dimensions

    def __len__(self) -> int:
        return self.count

    def grade(self, points: FloatArray) -> FloatArray:  # noqa: D102
        return np.ones(np.broadcast_shapes(points.shape[:-1], (self.count,)))

    def log_expectation(self, mean: FloatArray, covariance: FloatArray) -> FloatArray:  # noqa: D102
        before = np.broadcast_shapes(mean.shape[:-1], covariance.shape[:-2])
        return np.zeros(np.broadcast_shapes(before, (self.count,)))

    def average(self, low: FloatArray, high: FloatArray) -> FloatArray:  # noqa: D102
        return np.ones(self.count)


@dataclass(frozen=True, eq=False)
class Membership(CoveringFunction):
    """M memberships given by any function, in one or two dimensions; integrals are numerical.

    Parameters
    ----------
    function
        Maps points (..., M or 1, d) to memberships (..., M) from 0 to 1.
    count, n_dimensions
        M and d.
    tolerance
        Absolute accuracy of an expectation. Features much narrower than the density they are
        averaged over, below its standard deviation, may be overlooked.
    """

    function: Callable[[FloatArray], FloatArray]
    count: int
    n_dimensions: int
    tolerance: float = ABSOLUTE_TOLERANCE

    @property
    def dimension(self) -> int:  # noqa: D102
        return self.n_dimensions

    def __len__(self) -> int:
        return self.count

    def grade(self, points: FloatArray) -> FloatArray:  # noqa: D102
        grades = np.asarray(self.function(points), dtype=np.float64)
        if not ((grades >= 0.0) & (grades <= 1.0)).all():
            raise ValueError("membership: allowed are values from 0 to 1")
        return grades

    def log_expectation(self, mean: FloatArray, covariance: FloatArray) -> FloatArray:
        """As in the base class; numerical, with the accuracy of ``tolerance``."""
        value = numerical_expectation(self.grade, self.count, mean, covariance, self.tolerance)
        with np.errstate(divide="ignore"):
            return np.log(value)
