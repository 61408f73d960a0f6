"""Statements made of statements: fuzzy Dempster-Shafer, inference rules, lists, projections."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import logsumexp

from gda_tracker.attributes.generalised_measurements.conjunction import minimum
from gda_tracker.attributes.generalised_measurements.covering import (
    CoveringFunction,
    frozen_finite,
)
from gda_tracker.attributes.generalised_measurements.expectations import numerical_expectation
from gda_tracker.attributes.generalised_measurements.grades import mixture_grade, rule_grade
from gda_tracker.attributes.generalised_measurements.quadrature import ABSOLUTE_TOLERANCE
from gda_tracker.vocabulary.arrays import FloatArray

SUM_TOLERANCE = 1e-9
"""How far the weights of a statement may be from a sum of one."""


@dataclass(frozen=True, eq=False)
class FuzzyDempsterShafer(CoveringFunction):
    """M basic mass assignments on fuzzy sets: mu(z) = sum_l w_l g_l(z) (Mahler 2011, (32), (80)).

    Parameters
    ----------
    weights
        (M, L) not negative, each row with the sum 1.
    focal
        L focal sets of each statement, as L times M functions. Statements with fewer focal sets
        have weights of zero.

    Examples
    --------
    "By the buoy, I am 70 % sure":

    >>> from gda_tracker.attributes.generalised_measurements.fuzzy import Everything, GaussianShaped
    >>> buoy = GaussianShaped([[100.0]], [[[400.0]]])
    >>> statement = FuzzyDempsterShafer([[0.7, 0.3]], (buoy, Everything(1, 1)))
    >>> statement([[100.0], [1000.0]]).tolist()
    [[1.0], [0.3]]
    """

    weights: FloatArray
    focal: tuple[CoveringFunction, ...]

    def __post_init__(self) -> None:
        focal = tuple(self.focal)
        _check_alike("focal", focal)
        weights = frozen_finite("weights", self.weights, len(focal[0]), len(focal))
        if (weights < 0.0).any() or (np.abs(weights.sum(axis=1) - 1.0) > SUM_TOLERANCE).any():
            raise ValueError("weights: allowed are numbers >= 0 with the sum 1 in each row")
        object.__setattr__(self, "weights", weights)
        object.__setattr__(self, "focal", focal)

    @property
    def dimension(self) -> int:  # noqa: D102
        return self.focal[0].dimension

    def __len__(self) -> int:
        return len(self.weights)

    def grade(self, points: FloatArray) -> FloatArray:  # noqa: D102
        return mixture_grade(
            self.weights, np.stack([focal.grade(points) for focal in self.focal], axis=-1)
        )

    def log_expectation(self, mean: FloatArray, covariance: FloatArray) -> FloatArray:
        """Weighted sum over the focal sets: (78), (81)."""
        logs = np.stack([focal.log_expectation(mean, covariance) for focal in self.focal], axis=-1)
        return np.asarray(logsumexp(logs, axis=-1, b=self.weights))

    def average(self, low: FloatArray, high: FloatArray) -> FloatArray:  # noqa: D102
        averages = np.stack([focal.average(low, high) for focal in self.focal], axis=-1)
        return mixture_grade(self.weights, averages)


@dataclass(frozen=True, eq=False)
class Rule(CoveringFunction):
    """M inference rules g => g': min(g, g')(z) + (1 - g(z))/2.

    The second term of (33) in Mahler (2011) is printed with g'; a violated crisp rule would then be
    half true. With g it gives 0, a satisfied one 1, one that does not apply 1/2.

    A rule on a part of the state is the projection of a rule, not a rule of projections: its
    numerical expectations then stay in one or two dimensions.

    Parameters
    ----------
    antecedent, consequent
        M functions each, of one dimension d. The expectation of the minimum is closed where
        :func:`~gda_tracker.attributes.generalised_measurements.conjunction.minimum` knows it, else
        numerical.
    tolerance
        Absolute accuracy of a numerical expectation.
    """

    antecedent: CoveringFunction
    consequent: CoveringFunction
    tolerance: float = ABSOLUTE_TOLERANCE
    _both: CoveringFunction | None = field(init=False, repr=False)

    def __post_init__(self) -> None:
        _check_alike("antecedent, consequent", (self.antecedent, self.consequent))
        object.__setattr__(self, "_both", minimum(self.antecedent, self.consequent))

    @property
    def dimension(self) -> int:  # noqa: D102
        return self.antecedent.dimension

    def __len__(self) -> int:
        return len(self.antecedent)

    def grade(self, points: FloatArray) -> FloatArray:  # noqa: D102
        return rule_grade(self.antecedent.grade(points), self.consequent.grade(points))

    def log_expectation(self, mean: FloatArray, covariance: FloatArray) -> FloatArray:  # noqa: D102
        if self._both is not None:
            both = self._both.expectation(mean, covariance)
        else:
            both = numerical_expectation(self._least, len(self), mean, covariance, self.tolerance)
        applies = self.antecedent.expectation(mean, covariance)
        with np.errstate(divide="ignore"):
            return np.log(both + 0.5 * np.maximum(1.0 - applies, 0.0))

    def average(self, low: FloatArray, high: FloatArray) -> FloatArray:  # noqa: D102
        if self._both is None:
            return super().average(low, high)
        return self._both.average(low, high) + 0.5 * (1.0 - self.antecedent.average(low, high))

    def _least(self, points: FloatArray) -> FloatArray:
        return np.minimum(self.antecedent.grade(points), self.consequent.grade(points))


@dataclass(frozen=True, eq=False)
class Projection(CoveringFunction):
    """M statements on A z: mu(z) = g(A z).

    With it statements on different quantities stand on one space, such as the state of a track.

    Parameters
    ----------
    statement
        M functions of dimension k.
    matrix
        (k, d) A, of rank k.
    """

    statement: CoveringFunction
    matrix: FloatArray

    def __post_init__(self) -> None:
        matrix = frozen_finite("matrix", self.matrix, self.statement.dimension, None)
        if np.linalg.matrix_rank(matrix) < len(matrix):
            raise ValueError(f"matrix = {matrix.tolist()}: allowed are independent rows")
        object.__setattr__(self, "matrix", matrix)

    @property
    def dimension(self) -> int:  # noqa: D102
        return self.matrix.shape[1]

    def __len__(self) -> int:
        return len(self.statement)

    def grade(self, points: FloatArray) -> FloatArray:  # noqa: D102
        return self.statement.grade(points @ self.matrix.T)

    def log_expectation(self, mean: FloatArray, covariance: FloatArray) -> FloatArray:  # noqa: D102
        return self.statement.log_expectation(
            mean @ self.matrix.T, self.matrix @ covariance @ self.matrix.T
        )

    def average(self, low: FloatArray, high: FloatArray) -> FloatArray:  # noqa: D102
        low, high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
        # One axis per row, scaled: the image of the box is a box, evenly filled.
        chosen = np.count_nonzero(self.matrix, axis=1)
        axes = np.abs(self.matrix).argmax(axis=1)
        if (chosen == 1).all() and len(np.unique(axes)) == len(axes):
            scale = self.matrix[np.arange(len(axes)), axes]
            ends = np.sort(np.stack([low[axes] * scale, high[axes] * scale]), axis=0)
            return self.statement.average(ends[0], ends[1])
        return super().average(low, high)


@dataclass(frozen=True, eq=False)
class Statements(CoveringFunction):
    """Statements of different kinds, one after another, on one measurement space.

    Parameters
    ----------
    parts
        Functions of one dimension d; M is the sum of their numbers.
    """

    parts: tuple[CoveringFunction, ...]

    def __post_init__(self) -> None:
        parts = tuple(self.parts)
        if not parts or len({part.dimension for part in parts}) > 1:
            raise ValueError("parts: allowed are one or more statements of one dimension")
        object.__setattr__(self, "parts", parts)

    @property
    def dimension(self) -> int:  # noqa: D102
        return self.parts[0].dimension

    def __len__(self) -> int:
        return sum(len(part) for part in self.parts)

    def grade(self, points: FloatArray) -> FloatArray:  # noqa: D102
        return _joined(
            [
                part.grade(points if points.shape[-2] == 1 else points[..., rows, :])
                for part, rows in self._rows()
            ]
        )

    def log_expectation(self, mean: FloatArray, covariance: FloatArray) -> FloatArray:  # noqa: D102
        return _joined(
            [
                part.log_expectation(
                    mean if mean.shape[-2] == 1 else mean[..., rows, :],
                    covariance if covariance.shape[-3] == 1 else covariance[..., rows, :, :],
                )
                for part, rows in self._rows()
            ]
        )

    def average(self, low: FloatArray, high: FloatArray) -> FloatArray:  # noqa: D102
        return np.concatenate([part.average(low, high) for part in self.parts])

    def _rows(self) -> list[tuple[CoveringFunction, slice]]:
        ends = np.cumsum([len(part) for part in self.parts])
        return [
            (part, slice(end - len(part), end)) for part, end in zip(self.parts, ends, strict=True)
        ]


def _joined(parts: Sequence[FloatArray]) -> FloatArray:
    """Arrays (..., M_k) side by side: (..., sum of M_k)."""
    before = np.broadcast_shapes(*(part.shape[:-1] for part in parts))
    return np.concatenate(
        [np.broadcast_to(part, (*before, part.shape[-1])) for part in parts], axis=-1
    )


def _check_alike(name: str, functions: Sequence[CoveringFunction]) -> None:
    kinds = {(len(function), function.dimension) for function in functions}
    if len(kinds) != 1:
        raise ValueError(
            f"{name} (number, dimension): {sorted(kinds)}: allowed is one number and one dimension"
        )
