"""Scaling of joint weights, so that no sum over hypotheses overflows or underflows.

The weights of a cluster stand in a bordered array of log weights, (steps + 1, elements + 1): pairs,
a last column for idle steps, a last row for idle elements. Adding a potential to a row, or to a
column, multiplies every joint hypothesis by the same factor.
"""

from __future__ import annotations

import numpy as np

from gda_tracker.association.best_hypothesis import best_hypothesis
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray

LOG_SMALLEST = -650.0
"""A product above exp of this is a normal double, with room for the factor 1e17 of a sum."""

LOG_ZERO = -1e9
"""Stands in for the largest log weight of a row that has weight zero only."""

# Potentials are multiples of 2^-20: adding one to a log weight below 2^32 is then exact wherever
# the result is smaller than the log weight, so that scaling costs no accuracy however large the
# weights are.
GRID = 2.0**20


def scale(bordered: FloatArray) -> FloatArray:
    """Scale B clusters in place and return the log factors (B,) that were taken out.

    After it no partial product of weights overflows, and either none that is not zero underflows,
    or the heaviest joint hypothesis weighs 1 and no weight is larger: the potentials are then the
    dual variables of the linear assignment problem, and what underflows is beyond any double. (All
    within 1e-6 in the logarithm.)

    Parameters
    ----------
    bordered : (B, steps + 1, elements + 1)
        Log weights; the corner has no meaning and must be 0. Clusters with NaN or +inf are
        overwritten by weights of zero.
    """
    steps, elements = bordered.shape[1] - 1, bordered.shape[2] - 1
    taken = np.zeros(len(bordered))
    # A joint hypothesis has at most steps + elements factors.
    largest = np.abs(bordered).max(where=bordered != -np.inf, initial=0.0)
    if (steps + elements) * largest <= -LOG_SMALLEST:
        return taken
    if not largest < np.inf:
        numbers = (bordered < np.inf).all(axis=(1, 2))  # False for NaN
        bordered[~numbers] = -np.inf
        bordered[:, steps, elements] = 0.0
    taken += _scale_by_maxima(bordered)
    # No factor exceeds 1 now; a hypothesis has one of each row and, at worst, all of the border.
    finite = np.where(bordered > -np.inf, bordered, 0.0)
    bound = finite[:, :steps].min(axis=2).sum(axis=1) + finite[:, steps].sum(axis=1)
    for cluster in (bound < LOG_SMALLEST).nonzero()[0]:
        potentials = dual_potentials(bordered[cluster])
        if potentials is None:
            continue
        taken[cluster] += _add_potentials(bordered[cluster], *potentials)
    return taken


def scale_by_duals(bordered: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Scale B clusters in place so that the heaviest joint hypothesis weighs 1, no weight more.

    As :func:`scale`, but whatever the weights are: sums over a part of a large cluster then stay
    near 1, too.

    Returns
    -------
    taken : (B,)
        Log factors that were taken out.
    feasible : (B,)
        False where no joint hypothesis has weight, for weights that are NaN or +inf as well. All
        weights are zero there.
    """
    steps, elements = bordered.shape[1] - 1, bordered.shape[2] - 1
    feasible: BoolArray = np.logical_and.reduce(bordered < np.inf, axis=(1, 2))  # not for NaN
    bordered[~feasible] = -np.inf
    taken = _scale_by_maxima(bordered)
    for cluster in feasible.nonzero()[0]:
        potentials = dual_potentials(bordered[cluster])
        if potentials is None:
            feasible[cluster] = False
            bordered[cluster] = -np.inf
            continue
        taken[cluster] += _add_potentials(bordered[cluster], *potentials)
    bordered[:, steps, elements] = 0.0
    return taken, feasible


def dual_potentials(bordered: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Dual variables of the linear assignment problem of one cluster.

    Returns a (steps,) and b (elements,) with log w_ij + a_i + b_j <= 0, log r_i + a_i <= 0 and
    log c_j + b_j <= 0, with equality on the heaviest joint hypothesis, or ``None`` if every
    hypothesis has weight zero. By complementary slackness an idle row or column fixes its own
    potential and a pair leaves one unknown; what remains are difference constraints, solved by
    shortest paths (Bellman-Ford), all edges of a round at once.
    """
    weight, idle_row, idle_column = bordered[:-1, :-1], bordered[:-1, -1], bordered[-1, :-1]
    assigned = best_hypothesis(weight, idle_row, idle_column)
    if assigned is None:
        return None
    row = (assigned >= 0).nonzero()[0]
    column = assigned[row]
    alone_row = (assigned < 0).nonzero()[0]
    alone_column = np.setdiff1d(np.arange(weight.shape[1]), column)
    gain = weight[row, column]

    # Unknown x_p = -a of the row of pair p; its column has -b = gain_p - x_p. Node 0 is the
    # reference. length[u, v] bounds x_v - x_u from above.
    length = np.full((len(row) + 1, len(row) + 1), np.inf)
    length[1:, 1:] = gain - weight[np.ix_(row, column)]
    against_columns = weight[np.ix_(row, alone_column)] - idle_column[alone_column]
    length[1:, 0] = -np.maximum(idle_row[row], against_columns.max(axis=1, initial=-np.inf))
    against_rows = idle_row[alone_row, None] - weight[np.ix_(alone_row, column)]
    length[0, 1:] = gain + np.minimum(
        -idle_column[column], against_rows.min(axis=0, initial=np.inf)
    )
    unknown = np.zeros(len(row) + 1)
    for _ in range(len(unknown)):
        relaxed = np.minimum(unknown, (unknown[:, None] + length).min(axis=0))
        if (relaxed == unknown).all():
            break
        unknown = relaxed
    row_potential, column_potential = -idle_row, -idle_column
    row_potential[row] = unknown[0] - unknown[1:]
    column_potential[column] = -gain - row_potential[row]
    return row_potential, column_potential


def _scale_by_maxima(bordered: FloatArray) -> FloatArray:
    """Divide every row, then every column, by its largest weight; log factors (B,) taken out."""
    rows = _on_grid(bordered[:, :-1].max(axis=2, initial=LOG_ZERO))
    bordered[:, :-1] -= rows[:, :, None]
    columns = _on_grid(bordered[:, :, :-1].max(axis=1, initial=LOG_ZERO))
    bordered[:, :, :-1] -= columns[:, None, :]
    taken: FloatArray = rows.sum(axis=1) + columns.sum(axis=1)
    return taken


def _add_potentials(bordered: FloatArray, row: FloatArray, column: FloatArray) -> float:
    """Add potentials to one cluster in place; the log factor taken out."""
    row, column = _on_grid(row), _on_grid(column)
    bordered[:-1] += row[:, None]
    bordered[:, :-1] += column
    return -float(row.sum() + column.sum())


def _on_grid(values: FloatArray) -> FloatArray:
    """Round to multiples of 1 / ``GRID``."""
    rounded: FloatArray = np.rint(values * GRID)
    rounded /= GRID
    return rounded
