"""Clutter density of sensors with a model of their own, estimated in what they measure.

A direction finder has false bearings per radian, a pair of receivers false differences per metre.
Detections that belong to no confirmed track are counted in cells of the measurement space, and
forgotten exponentially. Two Gamma densities, each conjugate to the Poisson counts, make the
estimate: the *mean* rate of all that the sensor has seen begins with the density given, which
counts for ``MEAN_PRIOR`` detections; the rate of a *cell* begins with this mean, which counts for
``CELL_PRIOR`` of one. So few detections in many cells say how many there are in all, and many where
they are. With cells of one size the rates of all cells add up to what was counted.

What the estimate does in the ring: each detection of a scan brings the density where it is, over
the mean one. Every pair's likelihood ratio is then one against the clutter there, in association,
sequential test and trees alike, whatever decides; and a new track is weighed against the false
detections of its place, new targets being as many everywhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from gda_tracker.kinematics.measurement_kinds import (
    AZIMUTH,
    MEASUREMENT_MODELS,
    RANGE,
    MeasurementModel,
)
from gda_tracker.kinematics.measurement_models import observed
from gda_tracker.tracking.initiation import NewTracks
from gda_tracker.tracking.parameter_groups.sensor import GIVEN
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array, IntArray, empty_floats
from gda_tracker.vocabulary.scans import Scan
from gda_tracker.vocabulary.tracks import CONFIRMED

# Cells of one quantity by the number of quantities; a turn of bearings alone has ten degrees each.
CELLS = {1: 32, 2: 16, 3: 8}
SECTORS = {1: 36, 3: 12}
# What priors count for, in detections.
MEAN_PRIOR, CELL_PRIOR = 2.0, 0.5
# What lies beyond the largest is no measurement, and not counted.
SMALLEST_EXTENT, LARGEST_EXTENT = 1.0, 1e9
MOST = 3  # quantities


@dataclass(slots=True)
class MeasurementClutter:
    """Counts of N sensors, by the order of ``sensor_ids``, with the names of their ``models``.

    ``extent`` (N, 3) is how far the grid reaches from zero in each quantity [m, rad or m/s]; it
    doubles when a detection lies beyond, and two cells become one. ``lowest`` and ``highest``
    (N, 3) are the smallest and largest measurements so far, without bounds for azimuths;
    ``exposure_scans`` (N,) the scans, the older the less. ``count`` is
    flat, sensor after sensor, each of the shape of :func:`grid_shape`.
    """

    sensor_ids: tuple[str, ...] = ()
    models: tuple[str, ...] = ()
    extent: FloatArray = field(default_factory=lambda: empty_floats(0, MOST))
    lowest: FloatArray = field(default_factory=lambda: empty_floats(0, MOST))
    highest: FloatArray = field(default_factory=lambda: empty_floats(0, MOST))
    exposure_scans: FloatArray = field(default_factory=empty_floats)
    count: FloatArray = field(default_factory=empty_floats)

    def counts_of(self, row: int) -> FloatArray:
        """Counts of one sensor, of the shape of its grid."""
        shapes = [grid_shape(MEASUREMENT_MODELS[name]) for name in self.models[: row + 1]]
        first = sum(math.prod(shape) for shape in shapes[:-1])
        return self.count[first : first + math.prod(shapes[-1])].reshape(shapes[-1])


def grid_shape(model: MeasurementModel) -> tuple[int, ...]:
    """Cells of each quantity of a model."""
    m = len(model)
    return tuple(SECTORS[m] if q == AZIMUTH else CELLS[m] for q in model.quantities)


def lowest_edge(model: MeasurementModel, extent: FloatArray) -> FloatArray:
    """Where the grid begins in each quantity (m,): at zero, or as far below as it ends above.

    Distances and their sums are never negative; differences and rates are, and azimuths go round
    from -pi.
    """
    whole = [q == RANGE and model.reference_sign >= 0.0 for q in model.quantities]
    return np.where(whole, 0.0, -extent[: len(model)])


def observe(
    known: MeasurementClutter,
    sensor_id: str,
    model: MeasurementModel,
    value: FloatArray,
    free: IntArray,
    memory_scans: float,
) -> MeasurementClutter:
    """Return the map after one more scan; the map given stays as it is.

    Parameters
    ----------
    known
        The map before the scan.
    sensor_id, model
        Whose scan it is, and what it measures.
    value
        (n, m) all measurements of the scan, in the quantities of the model.
    free
        Rows of those that belong to no confirmed track.
    memory_scans
        Scans after which a count has faded to 1/e, > 1.
    """
    known = _with_sensor(known, sensor_id, model)
    row, m = known.sensor_ids.index(sensor_id), len(model)
    lowest, highest = known.lowest.copy(), known.highest.copy()
    extent, exposure = known.extent.copy(), known.exposure_scans.copy()
    sound = np.all(np.abs(value) < LARGEST_EXTENT, axis=1)
    value, free = np.where(sound[:, None], value, 0.0), free[sound[free]]
    # What a track was given shows how far the sensor reaches, too.
    lowest[row, :m] = np.minimum(lowest[row, :m], value[sound].min(axis=0, initial=np.inf))
    highest[row, :m] = np.maximum(highest[row, :m], value[sound].max(axis=0, initial=-np.inf))
    counts = known.counts_of(row)
    farthest = np.abs(value).max(axis=0, initial=0.0)
    begins = lowest_edge(model, extent[row])
    for axis, quantity in enumerate(model.quantities):
        if quantity != AZIMUTH and farthest[axis] >= extent[row, axis]:
            doublings = math.floor(math.log2(farthest[axis] / extent[row, axis])) + 1
            extent[row, axis] *= 2.0**doublings
            counts = _coarser(counts, axis, doublings, bool(begins[axis] < 0.0))
    keep = 1.0 - 1.0 / memory_scans
    exposure[row] = keep * exposure[row] + 1.0
    cell = cells_of(model, value[free], extent[row])
    fresh = np.bincount(cell, minlength=counts.size).reshape(counts.shape)
    every = [known.counts_of(place) for place in range(len(known.sensor_ids))]
    every[row] = keep * counts + fresh
    return MeasurementClutter(
        known.sensor_ids,
        known.models,
        extent,
        lowest,
        highest,
        exposure,
        np.concatenate([each.reshape(-1) for each in every]),
    )


def densities(
    known: MeasurementClutter,
    sensor_id: str,
    model: MeasurementModel,
    value: FloatArray,
    given_density: float,
) -> tuple[FloatArray, float]:
    """Clutter density per scan at measurements, and its mean over what the sensor has seen.

    Beyond what it has seen the density is the mean; before the first scan both are the one given.

    Parameters
    ----------
    known
        The map.
    sensor_id, model
        Which sensor measures, and what.
    value
        (P, m) points of the measurement space.
    given_density
        The prior, > 0 [one over the unit of the measurement space].

    Returns
    -------
    local, mean
        (P,) and a number, in the unit of ``given_density``.
    """
    row = known.sensor_ids.index(sensor_id) if sensor_id in known.sensor_ids else -1
    if row < 0 or known.models[row] != model.name:
        return np.full(len(value), given_density), given_density
    counts, exposure = known.counts_of(row), float(known.exposure_scans[row])
    volume = seen_volumes(known, row)
    mean = (MEAN_PRIOR + counts.sum()) / (MEAN_PRIOR / given_density + exposure * volume.sum())
    cell_rate = (CELL_PRIOR + counts) / (CELL_PRIOR / mean + exposure * volume)
    m = len(model)
    inside = np.all((value >= known.lowest[row, :m]) & (value <= known.highest[row, :m]), axis=1)
    local = np.full(len(value), mean)
    cell = cells_of(model, value[inside], known.extent[row])
    local[inside] = cell_rate.reshape(-1)[cell]
    return local, float(mean)


def seen_volumes(known: MeasurementClutter, row: int) -> FloatArray:
    """Volume of each cell of a sensor, as far as it lies between its extreme measurements.

    Of azimuths the whole turn counts.
    """
    model = MEASUREMENT_MODELS[known.models[row]]
    begins = lowest_edge(model, known.extent[row])
    volume = np.ones(())
    for axis, (quantity, cells) in enumerate(zip(model.quantities, grid_shape(model), strict=True)):
        edges = np.linspace(begins[axis], known.extent[row, axis], cells + 1)
        if quantity != AZIMUTH and known.lowest[row, axis] <= known.highest[row, axis]:
            edges = np.clip(edges, known.lowest[row, axis], known.highest[row, axis])
        volume = volume[..., None] * np.diff(edges)
    return volume


def cells_of(model: MeasurementModel, value: FloatArray, extent: FloatArray) -> IntArray:
    """Cells of points (P, m) inside the extent, in the order of the flat counts."""
    shape, begins = grid_shape(model), lowest_edge(model, extent)
    width = extent[: len(model)] - begins
    place = np.floor((value - begins) / width * np.array(shape)).astype(np.int64)
    place = np.clip(place, 0, np.array(shape) - 1)
    return np.asarray(np.ravel_multi_index(tuple(place.T), shape), dtype=np.int64)


def with_relative_density(
    known: MeasurementClutter, scan: Scan, density: FloatArray, parameters: TrackManagerParameters
) -> tuple[Scan, FloatArray]:
    """Give a scan's detections the density where they are, and hypotheses (H,) the mean one."""
    if parameters.clutter_density == GIVEN or not scan.sensor_model:
        return scan, density
    seen = observed(scan)
    given = parameters.clutter_density_per_m_rad
    local, mean = densities(known, scan.key.sensor_id, seen.model, seen.value, given)
    return replace(scan, relative_clutter_density=local / mean), np.full(len(density), mean)


def measurement_clutter_after(
    known: MeasurementClutter,
    scan: Scan,
    status: IntArray,
    assigned: Int32Array,
    parameters: TrackManagerParameters,
) -> MeasurementClutter:
    """Return the map after a scan; ``assigned`` (H,) are the rows that hypotheses were given.

    ``status`` (H,) is that of the same hypotheses after the scan.
    """
    if parameters.clutter_density == GIVEN or not scan.sensor_model:
        return known
    free = np.ones(len(scan), dtype=bool)
    free[assigned[(status == CONFIRMED) & (assigned >= 0)]] = False
    seen = observed(scan)
    return observe(
        known,
        scan.key.sensor_id,
        seen.model,
        seen.value,
        np.flatnonzero(free),
        parameters.clutter_memory_scans,
    )


def log_ratio_of_starts(new: NewTracks, scan: Scan, new_target_ratio: float) -> FloatArray:
    """Log ratio (N,) of new targets to false detections where tracks start from one detection.

    ``new_target_ratio`` is that over all that the sensor sees. New targets are as probable here as
    there, false detections are not.
    """
    ratio = np.full(len(new.detection), np.log(new_target_ratio))
    if scan.relative_clutter_density is None:
        return ratio
    return ratio - np.log(scan.relative_clutter_density[new.detection])


def _with_sensor(
    known: MeasurementClutter, sensor_id: str, model: MeasurementModel
) -> MeasurementClutter:
    """The map with an entry for a sensor; one that measures something else now begins anew."""
    kept = [
        place
        for place, pair in enumerate(zip(known.sensor_ids, known.models, strict=True))
        if pair[0] != sensor_id or pair[1] == model.name
    ]
    held = [known.sensor_ids[place] for place in kept]
    if sensor_id in held:
        return known
    first = np.array([math.pi if q == AZIMUTH else SMALLEST_EXTENT for q in model.quantities])
    extent = np.ones(MOST)
    extent[: len(model)] = first
    turn = np.zeros(MOST, dtype=bool)
    turn[: len(model)] = [q == AZIMUTH for q in model.quantities]
    counts = [known.counts_of(place).reshape(-1) for place in kept]
    return MeasurementClutter(
        (*held, sensor_id),
        (*(known.models[place] for place in kept), model.name),
        np.concatenate([known.extent[kept], extent[None]]),
        np.concatenate([known.lowest[kept], np.where(turn, -np.inf, np.inf)[None]]),
        np.concatenate([known.highest[kept], np.where(turn, np.inf, -np.inf)[None]]),
        np.append(known.exposure_scans[kept], 0.0),
        np.concatenate([*counts, np.zeros(math.prod(grid_shape(model)))]),
    )


def _coarser(counts: FloatArray, axis: int, doublings: int, both_ways: bool) -> FloatArray:
    """Counts on a grid that reaches so many times twice as far in one quantity."""
    moved = np.moveaxis(counts, axis, 0)
    cells = len(moved)
    # After so many the whole grid is in one cell, or in the two about zero.
    for _ in range(min(doublings, int(math.log2(cells)) + 1)):
        merged = moved[0::2] + moved[1::2]
        nothing = np.zeros_like(merged)
        if both_ways:
            quarter = nothing[: cells // 4]
            moved = np.concatenate([quarter, merged, quarter])
        else:
            moved = np.concatenate([merged, nothing])
    return np.moveaxis(moved, 0, axis)
