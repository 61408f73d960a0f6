"""A radar that does not resolve close targets: which are one group, and its detection.

Two targets are linked with the probability P_u(d) = exp(-d' R_u^-1 d / 2) of their distance d in
range and azimuth, every pair on its own; what hangs together is one group and gives one detection
at most, at the mean of its members (Koch 2014, section 2.3.3).
"""

from __future__ import annotations

import math

import numpy as np

from gda_tracker.association.unresolved import resolution_covariance, unresolved_probability
from gda_tracker.kinematics.sensor_models import wrap_angle
from gda_tracker.simulation.scenarios import Scenario
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray


def unresolved_groups(
    scenario: Scenario, positions: FloatArray, rng: np.random.Generator
) -> IntArray:
    """Draw the group (K, T) of each target on each scan, named by its first member.

    Parameters
    ----------
    scenario
        Its sensor has a resolution.
    positions
        (K, T, 2) true positions [m].
    rng
        One number is drawn for every scan and pair.
    """
    scans, targets = positions.shape[:2]
    group = np.tile(np.arange(targets), (scans, 1))
    polar = _polar(scenario, positions)
    sensor = scenario.sensor
    resolution = resolution_covariance(
        np.array([sensor.resolution_range_m, math.radians(sensor.resolution_azimuth_deg)])
    )
    for one in range(targets):
        for two in range(one + 1, targets):
            gap = polar[:, one] - polar[:, two]
            gap[:, 1] = wrap_angle(gap[:, 1])
            linked = rng.random(scans) < unresolved_probability(gap, resolution)
            low = np.minimum(group[:, one], group[:, two])[:, None]
            high = np.maximum(group[:, one], group[:, two])[:, None]
            group = np.where(linked[:, None] & (group == high), low, group)
    return group


def merged_detections(
    scenario: Scenario,
    positions: FloatArray,
    group: IntArray,
    seen: BoolArray,
    measured: tuple[FloatArray, FloatArray],
    rcs: FloatArray,
    rng: np.random.Generator,
) -> tuple[BoolArray, FloatArray, FloatArray, FloatArray, IntArray]:
    """Detections after groups have become one.

    A group is detected when its first member is, with that member's noise around the mean of all in
    range and azimuth, and the sum of their RCS. Of its members the truth names one at random.

    Parameters
    ----------
    scenario, positions, group
        As for :func:`unresolved_groups`.
    seen
        (K, T) which targets would be detected.
    measured
        (K, T) ranges and azimuths with noise.
    rcs
        (K, T) [m2].
    rng
        Names the members.

    Returns
    -------
    seen, range_m, azimuth_rad, rcs_m2, source
        (K, T) each: at the first member of a group its detection, nothing at the others.
    """
    scans, targets = group.shape
    polar = _polar(scenario, positions)
    offset = np.stack(measured, axis=-1) - polar
    first = group == np.arange(targets)
    member = group[:, None, :] == np.arange(targets)[:, None]  # (K, group, T)
    count = np.maximum(member.sum(axis=2), 1)
    # Relative to the first member: an azimuth may wrap.
    gap = polar[:, None, :, :] - polar[:, :, None, :]
    gap[..., 1] = wrap_angle(gap[..., 1])
    shift = np.sum(gap * member[..., None], axis=2) / count[..., None]
    place = polar + shift + offset
    draw = np.where(member, rng.random((scans, 1, targets)), -1.0)
    source = draw.argmax(axis=2)
    azimuth = math.pi - np.mod(math.pi - place[..., 1], 2.0 * math.pi)
    total = (rcs[:, None, :] * member).sum(axis=2)
    return seen & first, np.abs(place[..., 0]), azimuth, total, source


def _polar(scenario: Scenario, positions: FloatArray) -> FloatArray:
    """Range and azimuth (..., 2) of positions."""
    x, y = (positions[..., axis] - scenario.sensor.position_m[axis] for axis in (0, 1))
    return np.stack([np.hypot(x, y), np.arctan2(y, x)], axis=-1)
