"""Statements on a scalar: intervals, quantised values, fuzzy numbers (Mahler 2011, (29), (31))."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gda_tracker.attributes.generalised_measurements.covering import (
    CoveringFunction,
    frozen,
    frozen_finite,
)
from gda_tracker.attributes.generalised_measurements.piecewise import log_normal_integral
from gda_tracker.vocabulary.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class PiecewiseLinear(CoveringFunction):
    """M piecewise linear covering functions of a scalar (d = 1).

    Parameters
    ----------
    knots
        (M, K) nondecreasing and finite; two equal ones make a jump.
    grades
        (M, K) mu at the knots, from 0 to 1. Before the first knot and after the last mu is
        constant. At a jump mu has the larger value, as a closed random set demands.

    Examples
    --------
    "About 10": certainly from 9 to 11, not below 7, nor above 13.

    >>> about_ten = trapezoid([[7.0, 9.0, 11.0, 13.0]])
    >>> about_ten([[8.0], [10.0], [13.5]]).tolist()
    [[0.5], [1.0], [0.0]]
    """

    knots: FloatArray
    grades: FloatArray

    def __post_init__(self) -> None:
        knots = frozen_finite("knots", self.knots, None, None)
        grades = frozen("grades", self.grades, *knots.shape)
        if not knots.shape[1] or (np.diff(knots) < 0.0).any():
            raise ValueError("knots: allowed are one or more per function, nondecreasing")
        if not ((grades >= 0.0) & (grades <= 1.0)).all():
            raise ValueError("grades: allowed are numbers from 0 to 1")
        object.__setattr__(self, "knots", knots)
        object.__setattr__(self, "grades", grades)

    @property
    def dimension(self) -> int:  # noqa: D102
        return 1

    def __len__(self) -> int:
        return len(self.knots)

    def grade(self, points: FloatArray) -> FloatArray:  # noqa: D102
        z = points[..., 0, None]
        knots, grades = self.knots, self.grades
        outside = np.maximum(
            np.where(z[..., 0] <= knots[:, 0], grades[:, 0], 0.0),
            np.where(z[..., 0] >= knots[:, -1], grades[:, -1], 0.0),
        )
        start, end = knots[:, :-1], knots[:, 1:]
        width = end - start
        share = np.where(width > 0.0, (z - start) / np.where(width > 0.0, width, 1.0), 0.0)
        linear = grades[:, :-1] + share * np.diff(grades)
        piece = np.where(width > 0.0, linear, np.maximum(grades[:, :-1], grades[:, 1:]))
        inside = np.where((z >= start) & (z <= end), piece, 0.0)
        return np.maximum(outside, inside.max(axis=-1, initial=0.0))

    def log_expectation(self, mean: FloatArray, covariance: FloatArray) -> FloatArray:  # noqa: D102
        variance = covariance[..., 0, 0]
        if not (variance > 0.0).all():
            raise ValueError(f"variance {variance.min()}: allowed are numbers > 0")
        u = (self.knots - mean) / np.sqrt(variance)[..., None]
        return log_normal_integral(u, self.grades)

    def average(self, low: FloatArray, high: FloatArray) -> FloatArray:  # noqa: D102
        first, last = float(low[0]), float(high[0])
        column = np.ones((len(self), 1))
        inside = np.clip(self.knots, first, last)
        knots = np.concatenate([first * column, inside, last * column], axis=1)
        before, after = self._limits(knots)
        area = 0.5 * ((before + after) * np.diff(knots)).sum(axis=1)
        return area / (last - first)

    def _limits(self, knots: FloatArray) -> tuple[FloatArray, FloatArray]:
        """One-sided values (M, N - 1) at both ends of the gaps between points (M, N).

        No knot lies inside a gap.
        """
        start, width = knots[:, :-1], np.diff(knots)
        quarter, later = (
            np.stack([self.grade(column[:, None]) for column in (start + share * width).T], axis=1)
            for share in (0.25, 0.75)
        )
        slope = later - quarter
        return (
            np.clip(quarter - 0.5 * slope, 0.0, 1.0),
            np.clip(later + 0.5 * slope, 0.0, 1.0),
        )

    def minimum(self, other: PiecewiseLinear) -> PiecewiseLinear:
        """Pointwise minimum with M other functions: the conjunction of fuzzy sets."""
        if len(self) != len(other):
            raise ValueError(f"{len(self)} and {len(other)} functions: allowed are equal numbers")
        knots = np.sort(np.concatenate([self.knots, other.knots], axis=1), axis=1)
        mine, others = self._limits(knots), other._limits(knots)
        # Where one overtakes the other inside a gap the minimum has a knot of its own.
        lead_start, lead_end = mine[0] - others[0], mine[1] - others[1]
        crosses = lead_start * lead_end < 0.0
        share = np.where(crosses, lead_start / np.where(crosses, lead_start - lead_end, 1.0), 0.0)
        crossing = knots[:, :-1] + share * np.diff(knots)
        at_crossing = np.where(
            crosses, mine[0] + share * (mine[1] - mine[0]), np.minimum(mine[0], others[0])
        )
        first = np.minimum(self.grades[:, :1], other.grades[:, :1])
        last = np.minimum(self.grades[:, -1:], other.grades[:, -1:])
        gaps = [knots[:, :-1], crossing, knots[:, 1:]]
        values = [np.minimum(mine[0], others[0]), at_crossing, np.minimum(mine[1], others[1])]
        inner_knots = np.stack(gaps, axis=-1).reshape(len(knots), -1)
        inner = np.stack(values, axis=-1).reshape(len(knots), -1)
        return PiecewiseLinear(
            np.concatenate([knots[:, :1], inner_knots, knots[:, -1:]], axis=1),
            np.concatenate([first, inner, last], axis=1),
        )


def trapezoid(corners: ArrayLike) -> PiecewiseLinear:
    """Fuzzy numbers that rise from corner 0 to 1, are certain to corner 2, and fall to corner 3.

    Parameters
    ----------
    corners
        (M, 4) nondecreasing. Two equal corners make a jump. The first two may be -inf, the last two
        +inf: a shoulder, "at least" or "at most".
    """
    corner = frozen("corners", corners, None, 4)
    below, above = np.isneginf(corner[:, :2]), np.isposinf(corner[:, 2:])
    if (below[:, 0] != below[:, 1]).any() or (above[:, 0] != above[:, 1]).any():
        raise ValueError("corners: allowed is an infinite shoulder, or finite corners on a side")
    if np.isinf(corner[:, :2]).sum() > below.sum() or np.isinf(corner[:, 2:]).sum() > above.sum():
        raise ValueError("corners: allowed are -inf on the left and +inf on the right")
    grades = np.tile([0.0, 1.0, 1.0, 0.0], (len(corner), 1))
    grades[below[:, 0], 0] = 1.0
    grades[above[:, 0], 3] = 1.0
    # An infinite shoulder has its knots at the other one, where nothing changes.
    knots = corner.copy()
    knots[below[:, 0], :2] = corner[below[:, 0], 2:3]
    knots[above[:, 0], 2:] = knots[above[:, 0], 1:2]
    knots[below[:, 0] & above[:, 0]] = 0.0
    return PiecewiseLinear(knots, grades)


def triangle(low: ArrayLike, peak: ArrayLike, high: ArrayLike) -> PiecewiseLinear:
    """Fuzzy numbers (M,): certain at the peak, impossible below ``low`` and above ``high``."""
    return trapezoid(np.stack([low, peak, peak, high], axis=-1))


def interval(low: ArrayLike, high: ArrayLike) -> PiecewiseLinear:
    """Imprecise values: somewhere from ``low`` (M,) to ``high`` (M,), which may be infinite."""
    return trapezoid(np.stack([low, low, high, high], axis=-1))


def quantised(value: ArrayLike, edges: ArrayLike) -> PiecewiseLinear:
    """Quantised values: all that is known is the cell that a value fell into.

    Parameters
    ----------
    value
        (M,) values.
    edges
        (E,) increasing edges of the cells; the outer two cells reach to infinity. A value on an
        edge belongs to the upper cell.
    """
    border = frozen_finite("edges", edges, None)
    if not len(border) or (np.diff(border) <= 0.0).any():
        raise ValueError(f"edges = {border.tolist()}: allowed are one or more, increasing")
    cell = np.searchsorted(border, frozen("value", value, None), side="right")
    wide = np.concatenate([[-np.inf], border, [np.inf]])
    return interval(wide[cell], wide[cell + 1])
