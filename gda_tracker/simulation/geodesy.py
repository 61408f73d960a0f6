"""Positions on the ellipsoid WGS 84 made positions in a local frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from gda_tracker.vocabulary.arrays import FloatArray

SEMI_MAJOR_AXIS_M = 6_378_137.0
FLATTENING = 1.0 / 298.257223563
ECCENTRICITY_SQUARED = FLATTENING * (2.0 - FLATTENING)

Geodetic = tuple[float, float, float]


def earth_centred(
    latitude_deg: ArrayLike, longitude_deg: ArrayLike, height_m: ArrayLike
) -> FloatArray:
    """Return positions (..., 3) [m] in the frame that turns with the earth, x towards 0 N 0 E."""
    latitude, longitude = np.radians(latitude_deg), np.radians(longitude_deg)
    height = np.asarray(height_m, dtype=np.float64)
    normal = SEMI_MAJOR_AXIS_M / np.sqrt(1.0 - ECCENTRICITY_SQUARED * np.sin(latitude) ** 2)
    across = (normal + height) * np.cos(latitude)
    up = (normal * (1.0 - ECCENTRICITY_SQUARED) + height) * np.sin(latitude)
    return np.stack([across * np.cos(longitude), across * np.sin(longitude), up], axis=-1)


def east_north_up(
    latitude_deg: ArrayLike, longitude_deg: ArrayLike, height_m: ArrayLike, origin: Geodetic
) -> FloatArray:
    """Return positions (..., 3) East, North, up [m] of the plane that touches at ``origin``.

    Parameters
    ----------
    latitude_deg, longitude_deg, height_m
        Broadcast against each other; the height is above the ellipsoid.
    origin
        Latitude, longitude [degrees] and height [m].
    """
    latitude, longitude, height = np.broadcast_arrays(latitude_deg, longitude_deg, height_m)
    gap = earth_centred(latitude, longitude, height) - earth_centred(*origin)
    phi, lam = np.radians(origin[:2])
    axes = np.array(
        [
            [-np.sin(lam), np.cos(lam), 0.0],
            [-np.sin(phi) * np.cos(lam), -np.sin(phi) * np.sin(lam), np.cos(phi)],
            [np.cos(phi) * np.cos(lam), np.cos(phi) * np.sin(lam), np.sin(phi)],
        ]
    )
    return gap @ axes.T
