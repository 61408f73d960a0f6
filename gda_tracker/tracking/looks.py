"""Looks at targets: hits and misses by region of range and azimuth around each sensor.

They are forgotten exponentially. A cell's detection probability is the mean of the Beta
distribution that a Bernoulli probability has after these counts, with the one that was given as its
prior (a conjugate pair).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from gda_tracker.tracking.clutter import (
    AZIMUTH_CELLS,
    RANGE_CELLS,
    SMALLEST_EXTENT_M,
    cells_of,
)
from gda_tracker.vocabulary.arrays import FloatArray, empty_floats

# What the given probability counts for, in looks at a target.
PRIOR_LOOKS = 5.0
LARGEST = 0.999
EMPTY = (0, RANGE_CELLS, AZIMUTH_CELLS)


@dataclass(slots=True)
class DetectionMap:
    """Looks at targets of N sensors, by the order of ``sensor_ids``, the older the less.

    ``extent_m`` (N,) is the range that the grid reaches; it doubles when a target lies beyond, and
    two cells become one. ``hits`` and ``misses`` (N, R, A).
    """

    sensor_ids: tuple[str, ...] = ()
    extent_m: FloatArray = field(default_factory=empty_floats)
    hits: FloatArray = field(default_factory=lambda: empty_floats(*EMPTY))
    misses: FloatArray = field(default_factory=lambda: empty_floats(*EMPTY))


def observe(
    known: DetectionMap,
    sensor_id: str,
    range_m: FloatArray,
    azimuth_rad: FloatArray,
    hits: FloatArray,
    misses: FloatArray,
    memory_scans: float,
) -> DetectionMap:
    """Return the map after one more scan; the map given stays as it is.

    Parameters
    ----------
    known
        The map before the scan.
    sensor_id
        Whose scan it is.
    range_m, azimuth_rad
        (T,) where the targets are.
    hits, misses
        (T,) how much of a look at each was a hit, and a miss.
    memory_scans
        Scans after which a count has faded to 1/e, > 1.
    """
    if sensor_id in known.sensor_ids:
        row, ids = known.sensor_ids.index(sensor_id), known.sensor_ids
        extents, counts = known.extent_m.copy(), [known.hits.copy(), known.misses.copy()]
    else:
        row, ids = len(known.sensor_ids), (*known.sensor_ids, sensor_id)
        extents = np.append(known.extent_m, SMALLEST_EXTENT_M)
        fresh = empty_floats(1, RANGE_CELLS, AZIMUTH_CELLS)
        counts = [np.concatenate([each, fresh]) for each in (known.hits, known.misses)]
    doublings = 0
    farthest, extent = float(range_m.max(initial=0.0)), float(extents[row])
    if farthest >= extent:
        doublings = math.floor(math.log2(farthest / extent)) + 1
        extents[row] = extent = extent * 2.0**doublings
    cell = cells_of(range_m, azimuth_rad, extent)
    keep = 1.0 - 1.0 / memory_scans
    for count, weight in zip(counts, (hits, misses), strict=True):
        old = count[row]
        for _ in range(min(doublings, int(math.log2(RANGE_CELLS)) + 1)):
            merged = old[0::2] + old[1::2]
            old = np.concatenate([merged, np.zeros_like(merged)])
        seen = np.bincount(cell, weight, minlength=RANGE_CELLS * AZIMUTH_CELLS)
        count[row] = keep * old + seen.reshape(RANGE_CELLS, AZIMUTH_CELLS)
    return DetectionMap(ids, extents, *counts)


def probabilities(
    known: DetectionMap,
    sensor_id: str,
    range_m: FloatArray,
    azimuth_rad: FloatArray,
    given: float,
    gate_probability: float,
) -> FloatArray:
    """Detection probability (P,) at places around a sensor; where nothing is known, that given."""
    found = np.full(len(range_m), given)
    if sensor_id not in known.sensor_ids:
        return found
    row = known.sensor_ids.index(sensor_id)
    inside = range_m < known.extent_m[row]
    cell = cells_of(range_m[inside], azimuth_rad[inside], float(known.extent_m[row]))
    hits, misses = known.hits[row].reshape(-1)[cell], known.misses[row].reshape(-1)[cell]
    looks = hits + misses
    # Of the looks beyond the prior's a share of one over the gate's probability are detections.
    mean = (PRIOR_LOOKS * given + hits / gate_probability) / (PRIOR_LOOKS + looks)
    # What was given may be more than the largest estimate.
    found[inside] = np.where(looks > 0.0, np.minimum(mean, max(LARGEST, given)), given)
    return found
