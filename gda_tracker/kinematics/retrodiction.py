"""Retrodiction: what later scans say about earlier states (Rauch, Tung and Striebel).

Fixed interval, fixed lag and times between two scans for Kalman filters, and the weights of
multiple hypotheses; :mod:`gda_tracker.kinematics.imm_retrodiction` has interacting multiple models.
Leading dimensions, written ``...``, are batched.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gda_tracker.vocabulary.arrays import FloatArray, IntArray


def retrodict(
    mean: FloatArray,
    covariance: FloatArray,
    later_mean: FloatArray,
    later_covariance: FloatArray,
    transition: FloatArray,
    noise: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """One step back.

    Parameters
    ----------
    mean, covariance
        (..., s), (..., s, s) filtered at time l.
    later_mean, later_covariance
        (..., s), (..., s, s) retrodicted at time l + 1.
    transition, noise
        F and Q (..., s, s) from l to l + 1.

    Returns
    -------
    mean, covariance
        Retrodicted at time l: with W = P F' P_pred^-1, x + W (x_later - x_pred) and
        P + W (P_later - P_pred) W' (Koch 2014, (3.70), (3.73), (3.74)).
    """
    moved = (transition @ mean[..., None])[..., 0]
    crossed = transition @ covariance
    spread = crossed @ np.swapaxes(transition, -1, -2) + noise
    return step_back(
        mean,
        covariance,
        moved,
        spread,
        retrodiction_gain(crossed, spread),
        later_mean,
        later_covariance,
    )


def retrodiction_gain(crossed: FloatArray, spread: FloatArray) -> FloatArray:
    """W = P F' S^-1 from F P and S."""
    return np.swapaxes(np.linalg.solve(spread, crossed), -1, -2)


def step_back(
    mean: FloatArray,
    covariance: FloatArray,
    moved: FloatArray,
    spread: FloatArray,
    gain: FloatArray,
    later_mean: FloatArray,
    later_covariance: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Retrodicted moments x + W (x_later - x_pred), P + W (P_later - P_pred) W'."""
    back = mean + (gain @ (later_mean - moved)[..., None])[..., 0]
    reduced = covariance + gain @ (later_covariance - spread) @ np.swapaxes(gain, -1, -2)
    return back, 0.5 * (reduced + np.swapaxes(reduced, -1, -2))


def fixed_interval(
    mean: FloatArray, covariance: FloatArray, transition: FloatArray, noise: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """All states of K scans given all K scans.

    Parameters
    ----------
    mean, covariance
        (K, ..., s), (K, ..., s, s) filtered.
    transition, noise
        (K - 1, ..., s, s); entry l leads from scan l to scan l + 1.

    Returns
    -------
    mean, covariance
        (K, ..., s), (K, ..., s, s).
    """
    back, spread = mean.copy(), covariance.copy()
    for step in range(len(mean) - 2, -1, -1):
        back[step], spread[step] = retrodict(
            mean[step],
            covariance[step],
            back[step + 1],
            spread[step + 1],
            transition[step],
            noise[step],
        )
    return back, spread


def fixed_lag(
    mean: FloatArray, covariance: FloatArray, transition: FloatArray, noise: FloatArray, lag: int
) -> tuple[FloatArray, FloatArray]:
    """Every state given the scans up to ``lag`` >= 0 later, all of them side by side.

    Parameters
    ----------
    mean, covariance, transition, noise
        As in :func:`fixed_interval`.
    lag
        Scans after its own that a state waits for; the last ones make do with what there is.

    Returns
    -------
    mean, covariance
        (K, ..., s), (K, ..., s, s); row l is x_{l | min(l + lag, K - 1)}.
    """
    if lag < 0:
        raise ValueError(f"lag = {lag}: allowed is an integer >= 0")
    last = len(mean) - 1
    back, spread = mean.copy(), covariance.copy()
    # After ``done`` steps ``found_*[l]`` is the state at l given the scans up to l + done.
    found_mean, found_covariance = mean, covariance
    for done in range(1, min(lag, last) + 1):
        count = len(mean) - done
        found_mean, found_covariance = retrodict(
            mean[:count],
            covariance[:count],
            found_mean[1:],
            found_covariance[1:],
            transition[:count],
            noise[:count],
        )
        back[:count], spread[:count] = found_mean, found_covariance
    return back, spread


def between(
    mean: FloatArray,
    covariance: FloatArray,
    later_mean: FloatArray,
    later_covariance: FloatArray,
    first: tuple[FloatArray, FloatArray],
    second: tuple[FloatArray, FloatArray],
) -> tuple[FloatArray, FloatArray]:
    """Retrodict to a time between two scans.

    Parameters
    ----------
    mean, covariance
        (..., s), (..., s, s) filtered at the scan before that time.
    later_mean, later_covariance
        Retrodicted at the scan after it, with the prediction made in the same two steps.
    first, second
        F and Q from the earlier scan to the time, and from the time to the later scan. A model
        whose steps compose (white noise in continuous time, Singer) gives what retrodiction of
        the whole step gives at the scans; with others the prediction of the later scan is the
        one made in two steps.

    Returns
    -------
    mean, covariance
        (..., s), (..., s, s) at that time (Koch 2014, (3.79)-(3.86)).
    """
    moved = (first[0] @ mean[..., None])[..., 0]
    spread = first[0] @ covariance @ np.swapaxes(first[0], -1, -2) + first[1]
    return retrodict(moved, spread, later_mean, later_covariance, *second)


def retrodicted_weights(leaf_weight: FloatArray, parents: Sequence[IntArray]) -> list[FloatArray]:
    """Weights of the hypotheses of earlier scans given the present ones.

    Parameters
    ----------
    leaf_weight
        (L,) weights of the present hypotheses, normalised or not.
    parents
        For each scan back, newest first: the row of each hypothesis' parent among those of the
        scan before; the first is (L,), each other has a row for every hypothesis of its scan.

    Returns
    -------
    list of ndarray
        For each scan, newest first, the normalised weights: that of a parent is the sum of its
        children's, zero where it has none (Koch 2014, (3.107)). Of the oldest scan there are as
        many as the largest parent's row asks for.

    Raises
    ------
    ValueError
        If sizes do not fit, or the weights do not sum to a positive number.
    """
    total = leaf_weight.sum()
    if not total > 0.0:
        raise ValueError(f"sum of leaf_weight = {total}: allowed is a number > 0")
    found = [leaf_weight / total]
    for level, parent in enumerate(parents):
        rows = len(parents[level + 1]) if level + 1 < len(parents) else int(parent.max()) + 1
        if len(parent) != len(found[-1]) or parent.min() < 0 or parent.max() >= rows:
            raise ValueError(
                f"parents[{level}]: allowed are {len(found[-1])} rows, one for each hypothesis, "
                f"each from 0 to {rows - 1}"
            )
        found.append(np.bincount(parent, found[-1], rows))
    return found
