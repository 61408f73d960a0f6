"""Checked numerical integration, for covering functions without a closed form.

Boxes are halved along every axis until the difference between a box and its halves says that the
wanted accuracy is reached; all integrals of a batch together. The rule is that of Gauss and
Lobatto: with nodes at the ends of a box no kink hides between an end and the next node. Kinks are
no trouble; a jump is cheap in one dimension and dear in two, where the limit on evaluations may end
it, with an error.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from typing import TypeAlias

import numpy as np

from gda_tracker.attributes.generalised_measurements.gaussians import cholesky
from gda_tracker.vocabulary.arrays import FloatArray, IntArray

Integrand: TypeAlias = Callable[[FloatArray, IntArray], FloatArray]
"""Values (B, q) at points (B, q, d); row b belongs to the integral of the given index (B,)."""

MAX_DIMENSION = 2

ABSOLUTE_TOLERANCE = 1e-10
"""Wanted bound on the absolute error of an expectation."""

MAX_POINTS = 20_000_000
"""Evaluations of one call before it gives up."""

NODES = 7
"""Nodes per axis of a box, its ends among them."""

FIRST_BOXES = 16
"""Boxes per axis at the start: features much narrower than a box of it may be overlooked."""

REACH = 9.0
"""Standard deviations to which a Gaussian is integrated; beyond lies less than 1e-18."""

CHUNK_POINTS = 200_000
"""Evaluations at once."""


def _lobatto(count: int) -> tuple[FloatArray, FloatArray]:
    """Nodes and weights of Gauss and Lobatto on 0..1."""
    basis = np.polynomial.legendre.Legendre.basis(count - 1)
    nodes = np.concatenate([[-1.0], np.sort(basis.deriv().roots().real), [1.0]])
    weights = 2.0 / (count * (count - 1) * basis(nodes) ** 2)
    return 0.5 * (1.0 + nodes), 0.5 * weights


_X, _W = _lobatto(NODES)


class QuadratureError(ArithmeticError):
    """An integral did not reach the wanted accuracy within the limit on evaluations."""


def gaussian_expectation(
    function: Integrand,
    mean: FloatArray,
    covariance: FloatArray,
    tolerance: float = ABSOLUTE_TOLERANCE,
) -> FloatArray:
    """Integrals (B,) of function(z) N(z; mean, covariance) dz.

    Parameters
    ----------
    function
        Values from 0 to 1 at points (B', q, d) of the integrals of index (B',): (B', q).
    mean, covariance
        (B, d), (B, d, d), d at most ``MAX_DIMENSION``.
    tolerance
        Bound on the estimated absolute error.

    Raises
    ------
    QuadratureError
        If it is not reached.
    ValueError
        For more dimensions, or a covariance that is not positive definite.
    """
    batch, d = mean.shape
    factor = cholesky(covariance)
    normaliser = (2.0 * np.pi) ** (-0.5 * d)

    def weighted(points: FloatArray, which: IntArray) -> FloatArray:
        place = mean[which, None] + np.einsum("bij,bqj->bqi", factor[which], points)
        squared = (points * points).sum(axis=-1)
        return normaliser * np.exp(-0.5 * squared) * function(place, which)

    reach = np.full(d, REACH)
    return integrate(weighted, batch, -reach, reach, tolerance)


def average_over_box(
    function: Integrand,
    batch: int,
    low: FloatArray,
    high: FloatArray,
    tolerance: float = ABSOLUTE_TOLERANCE,
) -> FloatArray:
    """Averages (B,) of functions over the box from ``low`` (d,) to ``high`` (d,)."""
    low, high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    unit = np.zeros_like(low)
    return integrate(
        lambda points, which: function(low + points * (high - low), which),
        batch,
        unit,
        unit + 1.0,
        tolerance,
    )


def integrate(
    function: Integrand, batch: int, low: FloatArray, high: FloatArray, tolerance: float
) -> FloatArray:
    """Integrals (B,) of functions over one box from ``low`` (d,) to ``high`` (d,).

    Errors as in :func:`gaussian_expectation`.
    """
    d = len(low)
    if not 1 <= d <= MAX_DIMENSION:
        raise ValueError(f"dimension of an integral = {d}: allowed are 1 to {MAX_DIMENSION}")
    width = (high - low) / FIRST_BOXES
    corner = np.array(list(product(range(FIRST_BOXES), repeat=d)), dtype=np.float64)
    start = np.tile(low + corner * width, (batch, 1))
    which = np.repeat(np.arange(batch), len(corner))
    halves = np.array(list(product((0.0, 0.5), repeat=d)))

    total, used_error = np.zeros(batch), np.zeros(batch)
    points_left = MAX_POINTS - len(which) * NODES**d
    value = _boxes(function, start, width, which)
    while len(which):
        points_left -= len(which) * len(halves) * NODES**d
        if points_left < 0:
            open_error = np.bincount(which, np.abs(value), batch) + used_error
            raise QuadratureError(
                f"integral {int(np.argmax(open_error))} of {batch} has not reached the absolute "
                f"tolerance {tolerance:g} after {MAX_POINTS} evaluations; a looser tolerance or a "
                "smoother covering function is needed"
            )
        width = 0.5 * width
        child_start = (start[:, None] + 2.0 * halves * width).reshape(-1, d)
        child_which = np.repeat(which, len(halves))
        child = _boxes(function, child_start, width, child_which).reshape(-1, len(halves))
        better = child.sum(axis=1)
        error = np.abs(better - value)
        boxes = np.bincount(which, minlength=batch)
        allowed = 0.5 * (tolerance - used_error)[which] / boxes[which]
        done = error <= allowed
        total += np.bincount(which[done], better[done], batch)
        used_error += np.bincount(which[done], error[done], batch)
        again = np.repeat(~done, len(halves))
        start, which, value = child_start[again], child_which[again], child.reshape(-1)[again]
    return total


def _boxes(
    function: Integrand, start: FloatArray, width: FloatArray, which: IntArray
) -> FloatArray:
    """Gauss and Lobatto over boxes of one width (d,) that start at (B, d): (B,)."""
    d = len(width)
    nodes = np.stack(np.meshgrid(*[_X] * d, indexing="ij"), axis=-1).reshape(-1, d)
    weights = np.ones(1)
    for _ in range(d):
        weights = np.outer(weights, _W).reshape(-1)
    volume = float(np.prod(width))
    value = np.empty(len(start))
    step = max(1, CHUNK_POINTS // len(nodes))
    for first in range(0, len(start), step):
        rows = slice(first, first + step)
        points = start[rows, None] + nodes * width
        value[rows] = function(points, which[rows]) @ weights * volume
    return value
