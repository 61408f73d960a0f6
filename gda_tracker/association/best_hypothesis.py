"""The most probable joint hypothesis of tracks and measurements, as an assignment problem."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from gda_tracker.vocabulary.arrays import FloatArray, IntArray


def best_hypothesis(
    log_weight: FloatArray, log_idle_track: FloatArray, log_idle_measurement: FloatArray
) -> IntArray | None:
    """Most probable joint hypothesis of one cluster.

    The log weight of a hypothesis is the sum of ``log_weight`` over its pairs, ``log_idle_track``
    over its idle tracks and ``log_idle_measurement`` over its unassigned measurements. The square
    assignment problem [[W, diag(r)], [diag(c), 0]] has it as optimum; zero weights (-inf) are
    allowed.

    Parameters
    ----------
    log_weight : (n, m)
    log_idle_track : (n,)
    log_idle_measurement : (m,)

    Returns
    -------
    (n,) measurement of each track, -1 for none; ``None`` if every hypothesis has weight zero.
    """
    n, m = log_weight.shape
    value = np.full((n + m, n + m), -np.inf)
    value[:n, :m] = log_weight
    diagonals = value.reshape(-1)
    diagonals[m : n * (n + m) : n + m + 1] = log_idle_track
    diagonals[n * (n + m) :: n + m + 1][:m] = log_idle_measurement
    value[n:, m:] = 0.0
    try:
        _, column = linear_sum_assignment(value, maximize=True)
    except ValueError as error:
        if "infeasible" in str(error):
            return None
        raise
    return np.where(column[:n] < m, column[:n], -1)
