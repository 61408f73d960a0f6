"""Extremes of a history of motion: the greatest and least speed and the greatest acceleration.

What a class can do is told by the extremes of what an object did: a trapezoid is a convex fuzzy
set, so the least grade of all speeds of a history is that of the greatest or of the least of them.
Each extreme is one number, however many scans it stood for. So it counts once: the estimates of
consecutive scans share most of their errors, and a product over scans would count these errors
again and again.

An extreme of noisy numbers is the more extreme the more of them there are. So they are compared by
what they surely are, ``SURE`` standard deviations on the safe side: the state that is taken for the
greatest speed is the one with the greatest (speed - SURE std), and an uncertain one cannot win by
its error alone.
"""

from __future__ import annotations

import numpy as np

from gda_tracker.vocabulary.arrays import BoolArray, FloatArray

GREATEST_SPEED, LEAST_SPEED, GREATEST_ACCELERATION = 0, 1, 2
EXTREMES = 3
SURE = 2.0
# The least of the speeds is the greatest of their negatives.
_SIGN = np.array([1.0, -1.0, 1.0])
_LEAST_VARIANCE = 1e-12


def no_extremes(count: int) -> FloatArray:
    """(H, 3, 2) extremes of histories of which nothing is known: NaN."""
    return np.full((count, EXTREMES, 2), np.nan)


def size_of(vector: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Size of uncertain vectors and its standard deviation.

    Parameters
    ----------
    vector, covariance
        (..., d), (..., d, d).

    Returns
    -------
    size, std
        (...). The variance across the direction lengthens an estimate, by sigma^2 / (2 size); it is
        taken out. Near zero there is no direction: the deviation is then the mean one.
    """
    squared = (vector * vector).sum(axis=-1)
    trace = np.trace(covariance, axis1=-2, axis2=-1)
    quadratic = np.einsum("...i,...ij,...j->...", vector, covariance, vector)
    moving = squared > trace
    along = np.where(moving, quadratic / np.where(moving, squared, 1.0), trace / vector.shape[-1])
    size = np.sqrt(np.maximum(squared - (trace - along), 0.0))
    return size, np.sqrt(np.maximum(along, _LEAST_VARIANCE))


def accelerations(
    time_s: FloatArray, velocity: FloatArray, covariance: FloatArray, span_s: float
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Mean accelerations between states at least ``span_s`` apart.

    Parameters
    ----------
    time_s
        (T,) rising.
    velocity, covariance
        (T, H, d) [m/s], (T, H, d, d), NaN before a history begins.
    span_s
        Each state is compared with the last one so much earlier.

    Returns
    -------
    size, std
        (A, H) [m/s2]. The errors of the two states are taken as independent; neighbouring
        retrodicted velocities have errors alike, so that the true deviation is smaller.
    from_first
        (A,) whether the earlier state is the first of the history.
    """
    later = np.arange(len(time_s))
    # Half a nanosecond for what differences of stamps lose.
    earlier = np.searchsorted(time_s, time_s - span_s + 5e-10, side="right") - 1
    some = (earlier >= 0) & (earlier < later)
    later, earlier = later[some], earlier[some]
    dt = (time_s[later] - time_s[earlier])[:, None, None]
    size, std = size_of(
        (velocity[later] - velocity[earlier]) / dt,
        (covariance[later] + covariance[earlier]) / dt[..., None] ** 2,
    )
    return size, std, earlier == 0


def extremes_of(
    speed: tuple[FloatArray, FloatArray], acceleration: tuple[FloatArray, FloatArray]
) -> FloatArray:
    """Extremes (H, 3, 2), values and standard deviations, of sizes and deviations (T, H), (A, H).

    NaN is no state; where there is none, the extreme is NaN.
    """
    count = speed[0].shape[1]
    found = no_extremes(count)
    for place, (size, std) in (
        (GREATEST_SPEED, speed),
        (LEAST_SPEED, speed),
        (GREATEST_ACCELERATION, acceleration),
    ):
        if not len(size):
            continue
        row = np.argmax(_sure(place, size, std), axis=0)
        found[:, place, 0] = np.take_along_axis(size, row[None], axis=0)[0]
        found[:, place, 1] = np.take_along_axis(std, row[None], axis=0)[0]
    return found


def more_extreme(one: FloatArray, other: FloatArray) -> FloatArray:
    """Extremes (H, 3, 2) of histories that consist of two parts.

    It does not matter how often and in what order parts are joined, or whether they overlap.
    """
    place = np.arange(EXTREMES)
    first = _sure(place, one[..., 0], one[..., 1])
    second = _sure(place, other[..., 0], other[..., 1])
    return np.where((second > first)[..., None], other, one)


def _sure(place: int | np.ndarray, size: FloatArray, std: FloatArray) -> FloatArray:
    """How extreme something surely is; nothing at all where it is not known."""
    sure = _SIGN[place] * size - SURE * std
    return np.where(np.isnan(sure), -np.inf, sure)
