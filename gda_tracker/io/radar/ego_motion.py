"""A radar's own velocity, from the range rates of what stands still.

A point at rest in the direction u has the range rate -v.u, if v is the velocity of the radar. Most
points of a street stand still: the velocity that explains most of them is the radar's own (Kellner
et al., Instantaneous ego-motion estimation using Doppler radar, ITSC 2013).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gda_tracker.vocabulary.arrays import FloatArray

SAMPLES = 150
FASTEST_MPS = 150.0
FEWEST_POINTS = 10


@dataclass(frozen=True, slots=True)
class SensorVelocity:
    """Velocity of the radar along its own x and y axes, and the share of points that it explains.

    ``share_at_rest`` is what a radar at rest would explain.
    """

    ahead_mps: float
    left_mps: float
    share: float
    share_at_rest: float


def static_range_rate(
    azimuth_rad: FloatArray,
    elevation_rad: FloatArray | None,
    ahead_mps: float,
    left_mps: float,
    up_mps: float = 0.0,
) -> FloatArray:
    """Return the range rate (n,) of points at rest for a radar that moves.

    The speeds are along the radar's own x, y and z axes.
    """
    rate = -(ahead_mps * np.cos(azimuth_rad) + left_mps * np.sin(azimuth_rad))
    if elevation_rad is None:
        return rate
    return rate * np.cos(elevation_rad) - up_mps * np.sin(elevation_rad)


def estimate_sensor_velocity(
    azimuth_rad: FloatArray,
    elevation_rad: FloatArray | None,
    range_rate_mps: FloatArray,
    tolerance_mps: float = 1.0,
) -> SensorVelocity | None:
    """Estimate the velocity of a radar from one scan.

    Random pairs of points, the same on every call, propose velocities; the one that explains most
    points within the tolerance is fitted to them by least squares.

    Parameters
    ----------
    azimuth_rad, elevation_rad, range_rate_mps
        (n,) of the points; rows that are not finite are left out.
    tolerance_mps
        How far the range rate of a point at rest may be off.

    Returns
    -------
    SensorVelocity or None
        ``None`` with fewer than ten points, or all in about one direction.
    """
    up = np.zeros(len(azimuth_rad)) if elevation_rad is None else elevation_rad
    good = np.isfinite(azimuth_rad) & np.isfinite(up) & np.isfinite(range_rate_mps)
    azimuth, up, rate = azimuth_rad[good], up[good], range_rate_mps[good]
    if len(rate) < FEWEST_POINTS or np.ptp(np.sin(azimuth)) + np.ptp(np.cos(azimuth)) < 0.1:
        return None
    design = -np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1) * np.cos(up)[:, None]
    proposed = _proposals(design, rate)
    if not len(proposed):
        return None
    inliers = np.abs(design @ proposed.T - rate[:, None]) <= tolerance_mps
    velocity = proposed[np.argmax(inliers.sum(axis=0))]
    for _ in range(5):
        inside = np.abs(design @ velocity - rate) <= tolerance_mps
        if np.count_nonzero(inside) < 2:
            break
        velocity = np.linalg.lstsq(design[inside], rate[inside], rcond=None)[0]
    return SensorVelocity(
        float(velocity[0]),
        float(velocity[1]),
        float(np.mean(np.abs(design @ velocity - rate) <= tolerance_mps)),
        float(np.mean(np.abs(rate) <= tolerance_mps)),
    )


def _proposals(design: FloatArray, rate: FloatArray) -> FloatArray:
    """Velocities (m, 2) that explain two points each, and the radar at rest."""
    rng = np.random.default_rng(0)
    pairs = rng.integers(0, len(rate), (SAMPLES, 2))
    matrix, value = design[pairs], rate[pairs]
    usable = np.abs(np.linalg.det(matrix)) > 1e-3
    if not usable.any():
        return np.zeros((0, 2))
    found = np.linalg.solve(matrix[usable], value[usable][..., None])[..., 0]
    found = found[np.hypot(found[:, 0], found[:, 1]) <= FASTEST_MPS]
    return np.concatenate([np.zeros((1, 2)), found])
