"""Sequential likelihood ratio tests of bounded quantities, for many tracks at once.

Koch (2014), section 1.3.6: "the pattern is obeyed" (h0) against "it is not" (h1), decided for given
errors of the first and second kind and begun anew after each decision. The quantities tested here
are bounded, not distributed: a ship keeps to its lane wherever in the lane it is, and for long at
the same place. So a hypothesis is a set, q <= a under h0 and q >= b under h1, and q may do what it
likes inside. The ratio is taken between the two bounds,

    log LR += log N(y; b, s^2) - log N(y; a, s^2) = (b - a) / s^2 (y - (a + b) / 2),

for an estimate y of q with error s. For any q <= a the mean of the factor is at most 1, so LR is a
supermartingale under h0, and P(LR ever >= B) <= 1 / B whatever the path of q; likewise 1 / LR
under h1 with A. Wald's bounds (Koch 2014, (4.3)) hold for the sets, and come nearest to equality
for an object that stays at its bound.

A quantity with several sides (left and right of a lane, the directions from a plan) has one such
ratio each. The mean of supermartingales is one: h1 is accepted where the *mean* ratio reaches B; h0
where *every* ratio has fallen to A, so that the side on which h1 holds bounds the chance of a miss.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import i0e

from gda_tracker.tracking.extraction import SequentialTest
from gda_tracker.vocabulary.arrays import FloatArray, IntArray

H0, OPEN, H1 = -1, 0, 1
# Directions in which a departure is looked for; one between two of them is seen shortened by this.
DIRECTION_COUNT = 12
DIRECTION_LOSS = math.cos(math.pi / DIRECTION_COUNT)
_ANGLES = 2.0 * np.pi * np.arange(DIRECTION_COUNT) / DIRECTION_COUNT
DIRECTIONS = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=-1)


def bound_increments(
    value: FloatArray, variance: FloatArray, usual: FloatArray | float, unusual: FloatArray | float
) -> FloatArray:
    """Add of one estimate to the log ratio of q >= ``unusual`` (h1) against q <= ``usual`` (h0).

    Parameters
    ----------
    value, variance
        Estimates of q and the variances of their errors (any shape).
    usual, unusual
        The bounds a < b, in the unit of ``value``.

    Examples
    --------
    >>> float(bound_increments(np.array(3.0), np.array(4.0), 0.0, 2.0))
    1.0
    """
    increment: FloatArray = (
        (np.asarray(unusual) - usual) / variance * (value - (np.asarray(usual) + unusual) / 2.0)
    )
    return increment


def departure_increments(
    departure: FloatArray, covariance: FloatArray, usual: FloatArray | float, unusual: FloatArray
) -> FloatArray:
    """Log ratios (N, D) of a plane vector longer than ``unusual`` against shorter than ``usual``.

    One ratio for each of :data:`DIRECTIONS`. A vector no longer than ``usual`` is so in every
    direction; one of length ``unusual`` is at least :data:`DIRECTION_LOSS` of it in one of them.

    Parameters
    ----------
    departure, covariance
        (N, 2) estimated vectors and (N, 2, 2) covariances of their errors.
    usual, unusual
        (N,) lengths, or one for all.
    """
    n = len(departure)
    variance = np.einsum("di,nij,dj->nd", DIRECTIONS, covariance, DIRECTIONS)
    low = np.broadcast_to(np.asarray(usual, dtype=np.float64), (n,))[:, None]
    high = np.broadcast_to(np.asarray(unusual, dtype=np.float64), (n,))[:, None]
    return bound_increments(departure @ DIRECTIONS.T, variance, low, high * DIRECTION_LOSS)


def stopped_increments(
    velocity: FloatArray, covariance: FloatArray, stopped: float, moving: float
) -> FloatArray:
    """Log ratio (N, 1) of a speed <= ``stopped`` (h1) against one >= ``moving`` (h0).

    T = v' P^-1 v has a non-central chi-square distribution of two degrees of freedom. A speed
    <= ``stopped`` makes its parameter at most stopped^2 / (least eigenvalue of P), one >=
    ``moving`` at least moving^2 / (largest eigenvalue); its likelihood ratio rises with T, so the
    ratio of these two bounds serves both sets. Where they do not part (a covariance too large or
    too long) a state tells nothing: 0.

    Parameters
    ----------
    velocity, covariance
        (N, 2) [m/s] and (N, 2, 2).
    stopped, moving
        Speeds [m/s], stopped < moving.
    """
    eigenvalues: FloatArray = np.asarray(np.linalg.eigvalsh(covariance), dtype=np.float64)
    largest = eigenvalues[:, 1]
    # Rounding may leave nothing of the smaller one; too small is too careful.
    slow: FloatArray = stopped**2 / np.maximum(eigenvalues[:, 0], 1e-15 * largest)
    fast: FloatArray = moving**2 / largest
    statistic = np.einsum(
        "ni,ni->n", velocity, np.linalg.solve(covariance, velocity[..., None])[..., 0]
    )

    def log_density(parameter: FloatArray) -> FloatArray:
        # up to what depends on T alone; log I0(z) = log i0e(z) + z does not overflow
        z = np.sqrt(parameter * statistic)
        density: FloatArray = np.log(i0e(z)) + z - parameter / 2.0
        return density

    ratio = np.where(slow < fast, log_density(slow) - log_density(fast), 0.0)
    return ratio[:, None]


@dataclass(frozen=True, slots=True)
class Decisions:
    """What tests came to, of the rows that took a sample.

    ``verdict`` (n,) is ``H0``, ``OPEN`` or ``H1``; ``log_ratio`` (n,) the log of the mean ratio for
    H1 and of the largest for H0; ``side`` (n,) the index of the largest ratio; ``samples`` (n,) and
    ``began_ns`` (n,) of the test.
    """

    verdict: IntArray
    log_ratio: FloatArray
    side: IntArray
    samples: IntArray
    began_ns: IntArray


def test_columns(sides: int, *more: tuple[Any, ...]) -> np.dtype[Any]:
    """Return the columns of tests with so many sides, one row for each track, and further ones."""
    return np.dtype(
        [
            ("track_id", np.int64),
            ("log_ratio", np.float64, (sides,)),
            ("samples", np.int64),
            ("began_ns", np.int64),
            ("status", np.int64),
            *more,
        ]
    )


def aligned(rows: NDArray[Any], track_id: IntArray, default: NDArray[Any]) -> NDArray[Any]:
    """Return one row for each of ``track_id``: the one there was, else ``default``.

    Parameters
    ----------
    rows
        Structured rows with distinct ``track_id``.
    track_id
        (N,) distinct, rising.
    default
        One structured value.
    """
    found = np.repeat(default.reshape(1), len(track_id))
    found["track_id"] = track_id
    _, old, new = np.intersect1d(
        rows["track_id"], track_id, assume_unique=True, return_indices=True
    )
    found[new] = rows[old]
    return found


def advance(
    rows: NDArray[Any], which: IntArray, increments: FloatArray, stamp_ns: int, test: SequentialTest
) -> Decisions:
    """Add a sample to some tests and decide; those that decide begin anew.

    Parameters
    ----------
    rows
        Rows of :func:`test_columns`; changed. ``status`` takes the verdict.
    which, increments
        (n,) rows that have a sample, and (n, sides) what it adds to their log ratios.
    stamp_ns
        Time of the sample.
    test
        The thresholds.
    """
    began = np.where(rows["samples"][which] == 0, stamp_ns, rows["began_ns"][which])
    samples = rows["samples"][which] + 1
    ratios = rows["log_ratio"][which] + increments
    largest = ratios.max(axis=-1, initial=-np.inf)
    with np.errstate(under="ignore"):
        mean = largest + np.log(np.exp(ratios - largest[:, None]).mean(axis=-1))
    verdict = np.where(
        mean >= test.log_accept, H1, np.where(largest <= test.log_reject, H0, OPEN)
    ).astype(np.int64)
    open_ = verdict == OPEN
    rows["log_ratio"][which] = np.where(open_[:, None], ratios, 0.0)
    rows["samples"][which] = np.where(open_, samples, 0)
    rows["began_ns"][which] = began
    rows["status"][which] = np.where(open_, rows["status"][which], verdict)
    return Decisions(
        verdict,
        np.where(verdict == H1, mean, largest),
        np.argmax(ratios, axis=-1).astype(np.int64),
        samples,
        began,
    )
