"""Clutter density, estimated while tracking, by region of range and azimuth around each sensor.

Sensors with a model of their own have maps of what they measure, in
:mod:`gda_tracker.tracking.measurement_clutter`.

Detections that belong to no confirmed track are counted in cells of a polar grid, and forgotten
exponentially. A cell's density is the mean of the Gamma distribution that a Poisson rate has after
these counts, with the density that was given as its prior (a conjugate pair; compare the clutter
maps of radar detectors): counts over scans and volume, the prior counting as some scans at first
and as a fifth of one for ever, so that a cell without detections is not said to have none at all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from gda_tracker.kinematics.sensor_models import (
    PolarMeasurements,
    polar_measurements,
    predicted_measurements,
)
from gda_tracker.tracking.parameter_groups.sensor import GIVEN
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array, IntArray, empty_floats
from gda_tracker.vocabulary.scans import Scan
from gda_tracker.vocabulary.tracks import CONFIRMED

RANGE_CELLS, AZIMUTH_CELLS = 16, 12
# What the given density counts for, in scans: before the first, and at least.
FIRST_PRIOR_SCANS, LEAST_PRIOR_SCANS = 5.0, 0.2
SMALLEST_EXTENT_M = 1.0


@dataclass(slots=True)
class ClutterMap:
    """Counts of N sensors, by the order of ``sensor_ids``.

    ``extent_m`` (N,) is the range that the grid reaches; it doubles when a detection lies beyond,
    and two cells become one. ``exposure_scans`` (N,) and ``count`` (N, R, A) are the scans and the
    detections in each cell, the older the less.
    """

    sensor_ids: tuple[str, ...] = ()
    extent_m: FloatArray = field(default_factory=empty_floats)
    exposure_scans: FloatArray = field(default_factory=empty_floats)
    count: FloatArray = field(default_factory=lambda: empty_floats(0, RANGE_CELLS, AZIMUTH_CELLS))


def observe(
    clutter: ClutterMap,
    sensor_id: str,
    measurements: PolarMeasurements,
    free: IntArray,
    memory_scans: float,
) -> ClutterMap:
    """Return the map after one more scan; the map given stays as it is.

    Parameters
    ----------
    clutter
        The map before the scan.
    sensor_id
        Whose scan it is.
    measurements
        All measurements of the scan.
    free
        Rows of those that belong to no confirmed track.
    memory_scans
        Scans after which a count has faded to 1/e, > 1.
    """
    if sensor_id in clutter.sensor_ids:
        row = clutter.sensor_ids.index(sensor_id)
        extent, exposure = float(clutter.extent_m[row]), float(clutter.exposure_scans[row])
        count = clutter.count[row]
        ids, extents = clutter.sensor_ids, clutter.extent_m.copy()
        exposures, counts = clutter.exposure_scans.copy(), clutter.count.copy()
    else:
        row, extent, exposure = len(clutter.sensor_ids), SMALLEST_EXTENT_M, 0.0
        count = np.zeros((RANGE_CELLS, AZIMUTH_CELLS))
        ids = (*clutter.sensor_ids, sensor_id)
        extents = np.append(clutter.extent_m, extent)
        exposures = np.append(clutter.exposure_scans, exposure)
        counts = np.concatenate([clutter.count, count[None]])
    # The grid reaches as far as the sensor, not only as far as the clutter.
    farthest = float(measurements.range_m.max(initial=0.0))
    if farthest >= extent:
        doublings = math.floor(math.log2(farthest / extent)) + 1
        extent *= 2.0**doublings
        for _ in range(min(doublings, int(math.log2(RANGE_CELLS)) + 1)):
            merged = count[0::2] + count[1::2]
            count = np.concatenate([merged, np.zeros_like(merged)])
    keep = 1.0 - 1.0 / memory_scans
    cell = cells_of(measurements.range_m[free], measurements.azimuth_rad[free], extent)
    fresh = np.bincount(cell, minlength=RANGE_CELLS * AZIMUTH_CELLS)
    extents[row], exposures[row] = extent, keep * exposure + 1.0
    counts[row] = keep * count + fresh.reshape(RANGE_CELLS, AZIMUTH_CELLS)
    return ClutterMap(ids, extents, exposures, counts)


def densities(
    clutter: ClutterMap,
    sensor_id: str,
    range_m: FloatArray,
    azimuth_rad: FloatArray,
    given_density: float,
    memory_scans: float,
) -> FloatArray:
    """Clutter density (P,) [1/(m rad)] per scan at points of the measurement space.

    Beyond the grid, and for a sensor without scans so far, it is the density given.

    Parameters
    ----------
    clutter
        The map.
    sensor_id
        Which sensor measures.
    range_m, azimuth_rad
        (P,) the points.
    given_density
        The prior [1/(m rad)].
    memory_scans
        As in :func:`observe`.
    """
    if sensor_id not in clutter.sensor_ids:
        return np.full(len(range_m), given_density)
    row = clutter.sensor_ids.index(sensor_id)
    extent, exposure = clutter.extent_m[row], clutter.exposure_scans[row]
    # The exposure tends to memory_scans, and what is missing of it is how much is left of the past.
    left = max(1.0 - exposure / memory_scans, 0.0)
    prior_scans = max(FIRST_PRIOR_SCANS * left, LEAST_PRIOR_SCANS)
    volume = (extent / RANGE_CELLS) * (2.0 * math.pi / AZIMUTH_CELLS)
    inside = range_m < extent
    cell = cells_of(range_m[inside], azimuth_rad[inside], extent)
    found = np.full(len(range_m), given_density)
    counted = clutter.count[row].reshape(-1)[cell] / volume
    found[inside] = (prior_scans * given_density + counted) / (prior_scans + exposure)
    return found


def densities_of_hypotheses(
    clutter: ClutterMap, scan: Scan, mean: FloatArray, parameters: TrackManagerParameters
) -> FloatArray:
    """Clutter density (H,) [1/(m rad)] where predicted states (H, s) appear to a scan's sensor."""
    given = parameters.clutter_density_per_m_rad
    if parameters.clutter_density == GIVEN or scan.sensor_model:
        return np.full(len(mean), given)
    seen = predicted_measurements(
        mean[:, :2], np.zeros((len(mean), 2, 2)), scan.sensor_position_m[:2]
    )
    return densities(
        clutter,
        scan.key.sensor_id,
        seen.range_m,
        seen.azimuth_rad,
        given,
        parameters.clutter_memory_scans,
    )


def clutter_after(
    clutter: ClutterMap,
    scan: Scan,
    status: IntArray,
    assigned: Int32Array,
    parameters: TrackManagerParameters,
) -> ClutterMap:
    """Return the map after a scan; ``assigned`` (H,) are the rows that hypotheses were given.

    ``status`` (H,) is that of the same hypotheses after the scan.
    """
    if parameters.clutter_density == GIVEN or scan.sensor_model:
        return clutter
    free = np.ones(len(scan), dtype=bool)
    free[assigned[(status == CONFIRMED) & (assigned >= 0)]] = False
    return observe(
        clutter,
        scan.key.sensor_id,
        polar_measurements(scan),
        np.flatnonzero(free),
        parameters.clutter_memory_scans,
    )


def cells_of(range_m: FloatArray, azimuth_rad: FloatArray, extent_m: float) -> IntArray:
    """Cells of points inside the extent, counted row by row."""
    ring = np.minimum((range_m * (RANGE_CELLS / extent_m)).astype(np.int64), RANGE_CELLS - 1)
    turn = np.mod(azimuth_rad / (2.0 * math.pi), 1.0)
    sector = np.minimum((turn * AZIMUTH_CELLS).astype(np.int64), AZIMUTH_CELLS - 1)
    return ring * AZIMUTH_CELLS + sector
