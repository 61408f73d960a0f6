"""What seeing a track, and not seeing it, tells of a stop: the Doppler blind zone of the radar.

A radar that drops slow echoes does not see what stands, so that nothing is measured of it any
more: the states of the track are what the filter believes. That it is *not seen* is what is
measured (Koch 2014, 1.3.5, stopping events: "missing data due to Doppler blindness"). With the
detection probability of the blind zone (:mod:`gda_tracker.kinematics.blind_zone`)

    P(r') = P_d (1 - 2^(-(r' / v)^2)),

a target of speed <= ``stopped`` (h1) has a range rate of at most that, and is detected with at
most P1 = P(stopped), or by a false alarm; one of speed >= ``moving`` (h0) on a course that makes an
angle of at most theta with the line of sight has at least P0 = P(moving cos theta). A scan adds

    log (P1 / P0) if it is detected,   log ((1 - P1) / (1 - P0)) if not.

These are the ratios between the bounds, as of all other tests: for any detection probability above
P0 their mean factor is at most 1, so that Wald's thresholds hold for whatever path in the sets, and
given the path the scans are independent, one by one. Where P0 does not exceed P1 (a course across
the line of sight, where who moves is hidden too) a scan tells nothing.

The course is the one on which the track was last seen clearly; it may have turned since by
``blind_turn_rad``.
"""

from __future__ import annotations

import math

import numpy as np

from gda_tracker.vocabulary.arrays import BoolArray, FloatArray

# Standard deviations of a course that are added to its angle.
_SURE = 2.0
# Courses known worse than this [rad] do not replace one that was known.
_CLEAR_RAD = 0.1
_SMALLEST_M = 1.0


def clear_courses(
    velocity: FloatArray, covariance: FloatArray
) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Courses of tracks, where they are clear.

    Parameters
    ----------
    velocity, covariance
        (N, 2) [m/s], (N, 2, 2).

    Returns
    -------
    clear, course, spread_rad
        (N,) whether the standard deviation of the course is small; (N, 2) unit vectors; (N,) two
        standard deviations of their angles.
    """
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    safe = np.where(speed > 0.0, speed, 1.0)
    course = velocity / safe[:, None]
    across = np.stack([-course[:, 1], course[:, 0]], axis=1)
    variance = np.einsum("ni,nij,nj->n", across, covariance, across)
    std = np.where(speed > 0.0, np.sqrt(np.maximum(variance, 0.0)) / safe, np.inf)
    return std < _CLEAR_RAD, course, _SURE * std


def least_range_rates(
    course: FloatArray, spread_rad: FloatArray, line_of_sight: FloatArray, speed: float
) -> FloatArray:
    """Least size (N,) [m/s] of the range rate of what moves at ``speed`` or more.

    Parameters
    ----------
    course
        (N, 2) unit vectors.
    spread_rad
        (N,) angle by which the course may be another.
    line_of_sight
        (N, 2) from the radar to the track, of any length; at the radar itself nothing is known.
    speed
        [m/s].
    """
    distance = np.hypot(line_of_sight[:, 0], line_of_sight[:, 1])
    cosine = np.abs((course * line_of_sight).sum(axis=1)) / np.maximum(distance, _SMALLEST_M)
    angle = np.arccos(np.minimum(cosine, 1.0)) + spread_rad
    rate: FloatArray = speed * np.cos(np.minimum(angle, 0.5 * math.pi))
    return np.where(distance < _SMALLEST_M, 0.0, rate)


def look_increments(
    detected: BoolArray,
    least_rate: FloatArray,
    *,
    stopped: float,
    blind_speed: float,
    detection_probability: float,
    false_detection_probability: float,
) -> FloatArray:
    """Log ratio (N,) of a scan, of a stop against motion.

    Parameters
    ----------
    detected
        (N,) whether the track has a detection.
    least_rate
        (N,) [m/s], of :func:`least_range_rates` under h0.
    stopped
        Largest speed under h1 [m/s].
    blind_speed
        v [m/s].
    detection_probability
        P_d.
    false_detection_probability
        Chance that a false alarm passes for a detection of a track that has none.

    Examples
    --------
    At 10 m/s towards the radar, P_d = 0.9, a miss counts log 10 = 2.3 where nothing else hides:

    >>> add = look_increments(np.array([False]), np.array([10.0]), stopped=0.0, blind_speed=2.0,
    ...     detection_probability=0.9, false_detection_probability=0.0)
    >>> round(float(add[0]), 3)
    2.303
    """

    def seen(rate: FloatArray) -> FloatArray:
        visible = -np.expm1(-math.log(2.0) * np.square(rate / blind_speed))
        return np.asarray(detection_probability * visible)

    moving = seen(least_rate)
    hidden = 1.0 - seen(np.array(stopped))
    standing = 1.0 - hidden * (1.0 - false_detection_probability)
    told = moving > standing
    with np.errstate(divide="ignore"):
        # What stands and is never detected by chance: a ratio of 0, and still a number.
        hit = np.log(np.maximum(standing, np.finfo(np.float64).tiny) / np.where(told, moving, 1.0))
        miss = np.log((1.0 - standing) / (1.0 - np.where(told, moving, 0.0)))
    return np.where(told, np.where(detected, hit, miss), 0.0)
