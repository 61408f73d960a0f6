"""Several sensors at one time: the effective measurement, and how often a target is detected."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gda_tracker.vocabulary.arrays import FloatArray


def effective_measurement(
    value: FloatArray, noise: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """One measurement in place of those of S homogeneous sensors of the same time.

    Parameters
    ----------
    value, noise
        (..., S, m) and (..., S, m, m) of the same linear quantity H x.

    Returns
    -------
    value, noise
        (..., m), (..., m, m): R = (sum R_s^-1)^-1 and z = R sum R_s^-1 z_s
        (Koch 2014, (2.27), (2.28)).
    log_factor
        (...,): the product of the N(z_s; Hx, R_s) is N(z; Hx, R) times its exponential, which does
        not depend on the state but on how well the measurements agree.
    """
    information = np.linalg.inv(noise)
    fused = np.linalg.inv(information.sum(axis=-3))
    fused = 0.5 * (fused + np.swapaxes(fused, -1, -2))
    pulled = (information @ value[..., None])[..., 0].sum(axis=-2)
    centre = (fused @ pulled[..., None])[..., 0]
    gap = value - centre[..., None, :]
    squared = np.sum(gap * (information @ gap[..., None])[..., 0], axis=(-2, -1))
    count, size = value.shape[-2:]
    log_factor = -0.5 * (
        squared
        + np.linalg.slogdet(noise)[1].sum(axis=-1)
        - np.linalg.slogdet(fused)[1]
        + (count - 1) * size * np.log(2.0 * np.pi)
    )
    return centre, fused, log_factor


def mean_update_interval(interval_s: Sequence[float]) -> float:
    """Mean cumulative time between updates T_c of sensors with intervals T_s > 0 (Koch, (2.29)).

    >>> mean_update_interval([4.0, 4.0])
    2.0
    """
    intervals = np.asarray(interval_s, dtype=np.float64)
    if not len(intervals) or not (intervals > 0.0).all():
        raise ValueError(f"interval_s = {list(interval_s)}: allowed are numbers > 0, at least one")
    return float(1.0 / np.sum(1.0 / intervals))


def cumulative_detection_probability(
    detection_probability: Sequence[float], interval_s: Sequence[float] | None = None
) -> float:
    """Probability that at least one of several sensors detects a target.

    Parameters
    ----------
    detection_probability
        P_D of each sensor.
    interval_s
        T_s of each [s]: within T_c of :func:`mean_update_interval` sensor s looks T_c/T_s times
        (Koch 2014, (2.30)). ``None``: each looks once, 1 - prod (1 - P_D).

    >>> cumulative_detection_probability([0.5, 0.5])
    0.75
    >>> cumulative_detection_probability([0.75, 0.75], [4.0, 4.0])
    0.75
    """
    probability = np.asarray(detection_probability, dtype=np.float64)
    if not ((probability >= 0.0) & (probability <= 1.0)).all():
        raise ValueError(
            f"detection_probability = {list(detection_probability)}: allowed are numbers from 0 to "
            "1"
        )
    looks = np.ones(len(probability))
    if interval_s is not None:
        if len(interval_s) != len(probability):
            raise ValueError(
                f"interval_s = {list(interval_s)}: allowed are {len(probability)} numbers > 0"
            )
        looks = mean_update_interval(interval_s) / np.asarray(interval_s, dtype=np.float64)
    return float(1.0 - np.prod((1.0 - probability) ** looks))
