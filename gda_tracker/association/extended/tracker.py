"""A tracker of extended objects: positions in, ellipses that move out.

Each scan is partitioned in a few ways (by distance), the most probable hypothesis over partitions
and assignments is taken, and each object updated by its cell. Cells that nobody claims begin tracks
unless a new object explains them far worse than false alarms; Wald's ratio test confirms and ends
tracks (Koch 2014, section 4.1).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gda_tracker.association.extended.hypotheses import Explanation, ExtendedSensor, explain
from gda_tracker.kinematics.extended.detection_rate import predict_rate, update_rate
from gda_tracker.kinematics.extended.partitions import distance_partitions
from gda_tracker.kinematics.extended.random_matrix import ExtendedStates, feldmann_update, predict
from gda_tracker.kinematics.motion_models import white_noise_acceleration
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class ExtendedTrackerParameters:
    """Parameters of :class:`ExtendedTracker`.

    ``partition_least_m`` and ``partition_largest_m`` are the thresholds between which partitions
    are looked for, ``partitions`` how many at most. ``log_accept`` and ``log_reject`` are the
    thresholds of the ratio test, ``log_cap`` holds the ratio down.
    """

    sensor: ExtendedSensor = field(default_factory=ExtendedSensor)
    acceleration_density_m2ps3: float = 1.0
    speed_std_mps: float = 2.0
    extent_memory_s: float = 2.0
    rate_memory_s: float = 2.0
    partition_least_m: float = 0.3
    partition_largest_m: float = 1.5
    partitions: int = 8
    log_accept: float = 7.0
    log_reject: float = -4.0
    log_cap: float = 15.0


@dataclass(slots=True)
class ExtendedTracks:
    """N tracks after a scan: ``track_id`` (N,), states, rates (N,), ``log_ratio`` (N,), and more.

    ``confirmed`` (N,); ``count`` (N,) is the number of detections each took from the scan.
    ``partition_probability`` is that of the hypotheses looked at, the chosen one first.
    """

    track_id: IntArray
    states: ExtendedStates
    rate_shape: FloatArray
    rate_rate: FloatArray
    log_ratio: FloatArray
    confirmed: BoolArray
    count: IntArray
    partition_probability: FloatArray

    def expected_detections(self) -> FloatArray:
        """Expected number (N,) of detections in a scan."""
        return self.rate_shape / self.rate_rate


class ExtendedTracker:
    """Tracks extended objects in the plane, one scan after the other."""

    def __init__(self, parameters: ExtendedTrackerParameters | None = None) -> None:
        self.parameters = parameters or ExtendedTrackerParameters()
        self.tracks = _no_tracks()
        self._time_s: float | None = None
        self._next_id = 1

    def process(self, time_s: float, positions: FloatArray, noise: FloatArray) -> ExtendedTracks:
        """Take in a scan.

        Parameters
        ----------
        time_s
            Not before the last scan's.
        positions, noise
            (n, 2) detections [m] and (n, 2, 2) covariances of their noise [m2].

        Raises
        ------
        ValueError
            If time goes backwards or an array has a wrong shape or values; nothing is changed then.
        """
        if not np.isfinite(time_s) or (self._time_s is not None and time_s < self._time_s):
            raise ValueError(f"time_s = {time_s}: allowed are times from {self._time_s} on")
        if positions.ndim != 2 or positions.shape[1] != 2:
            raise ValueError(f"positions have the shape {positions.shape}: allowed is (n, 2)")
        if noise.shape != (len(positions), 2, 2) or not np.isfinite(noise).all():
            raise ValueError(f"noise {noise.shape}: allowed are finite (n, 2, 2) covariances")
        p = self.parameters
        partitions = distance_partitions(
            positions, p.partition_least_m, p.partition_largest_m, p.partitions
        )
        dt_s = 0.0 if self._time_s is None else time_s - self._time_s
        ahead = self._predicted(dt_s)
        found, probability = explain(
            ahead.states,
            ahead.rate_shape,
            ahead.rate_rate,
            positions,
            noise,
            partitions if len(positions) else np.zeros((1, 0), dtype=np.int64),
            p.sensor,
        )
        self.tracks = self._pruned(
            _joined(self._updated(ahead, found[0], probability), self._born(found[0], probability))
        )
        self._time_s = time_s
        return self.tracks

    def _predicted(self, dt_s: float) -> ExtendedTracks:
        p, t = self.parameters, self.tracks
        step, noise = white_noise_acceleration(dt_s, p.acceleration_density_m2ps3)
        states = predict(t.states, step, noise, dt_s, p.extent_memory_s)
        shape, rate = predict_rate(t.rate_shape, t.rate_rate, dt_s, p.rate_memory_s)
        return ExtendedTracks(
            t.track_id, states, shape, rate, t.log_ratio, t.confirmed, t.count, np.ones(1)
        )

    def _updated(
        self, ahead: ExtendedTracks, best: Explanation, probability: FloatArray
    ) -> ExtendedTracks:
        sensor = self.parameters.sensor
        seen, unseen = np.flatnonzero(best.cell_of >= 0), np.flatnonzero(best.cell_of < 0)
        cell = best.cell_of[seen]
        states, shape, rate = ahead.states, ahead.rate_shape.copy(), ahead.rate_rate.copy()
        log_ratio = ahead.log_ratio.copy()
        count = np.zeros(len(states), dtype=np.int64)
        count[seen] = best.cells.count[cell]
        log_ratio[seen] += best.log_pair[seen, cell] - best.log_false[cell]
        # What a missing object makes of the ratio: the same as in the hypotheses.
        none = np.exp(shape * (np.log(rate) - np.log1p(rate)))[unseen]
        log_ratio[unseen] += np.log1p(-sensor.detection_probability * (1.0 - none))
        if len(seen):
            new, _ = feldmann_update(states.select(seen), best.cells.select(cell), sensor.spread)
            for name in ("mean", "covariance", "extent", "weight"):
                whole = getattr(states, name).copy()
                whole[seen] = getattr(new, name)
                setattr(states, name, whole)
        shape[seen], rate[seen] = update_rate(shape[seen], rate[seen], count[seen])
        # An object not seen keeps its rate: else the rate would fall until it explains every
        # further miss, and a lost track would live for ever.
        return ExtendedTracks(
            ahead.track_id, states, shape, rate, log_ratio, ahead.confirmed, count, probability
        )

    def _born(self, best: Explanation, probability: FloatArray) -> ExtendedTracks:
        p, cells = self.parameters, best.cells
        free = np.ones(len(cells.count), dtype=bool)
        free[best.cell_of[best.cell_of >= 0]] = False
        rows = np.flatnonzero(free & (best.log_new - best.log_false > p.log_reject))
        own, number = cells.select(rows), len(rows)
        radius = p.sensor.birth_radius_m**2 * np.eye(2)
        wide = np.zeros((number, 4, 4))
        # A centroid that is not known at all before: its covariance is that of the cell's mean.
        wide[:, :2, :2] = (p.sensor.spread * radius + own.noise) / own.count[:, None, None]
        wide[:, 2:, 2:] = p.speed_std_mps**2 * np.eye(2)
        mean = np.concatenate([own.centroid, np.zeros((number, 2))], axis=1)
        prior = ExtendedStates(
            mean, wide, np.tile(radius, (number, 1, 1)), np.full(number, p.sensor.birth_weight)
        )
        shaped = prior
        if number:
            shaped, _ = feldmann_update(prior, own, p.sensor.spread)
        ids = self._next_id + np.arange(number)
        self._next_id += number
        return ExtendedTracks(
            ids,
            ExtendedStates(mean, wide, shaped.extent, shaped.weight),
            np.full(number, p.sensor.birth_rate_shape) + own.count,
            np.full(number, p.sensor.birth_rate_rate) + 1.0,
            best.log_new[rows] - best.log_false[rows],
            np.zeros(number, dtype=bool),
            own.count,
            probability,
        )

    def _pruned(self, tracks: ExtendedTracks) -> ExtendedTracks:
        p = self.parameters
        tracks.log_ratio = np.minimum(tracks.log_ratio, p.log_cap)
        tracks.confirmed = tracks.confirmed | (tracks.log_ratio >= p.log_accept)
        return _selected(tracks, np.flatnonzero(tracks.log_ratio > p.log_reject))


def _no_tracks() -> ExtendedTracks:
    states = ExtendedStates(np.empty((0, 4)), np.empty((0, 4, 4)), np.empty((0, 2, 2)), np.empty(0))
    none = np.zeros(0, dtype=np.int64)
    empty = np.empty(0)
    return ExtendedTracks(
        none, states, empty, empty, empty, np.zeros(0, dtype=bool), none, np.ones(1)
    )


def _selected(tracks: ExtendedTracks, rows: IntArray) -> ExtendedTracks:
    return ExtendedTracks(
        tracks.track_id[rows],
        tracks.states.select(rows),
        tracks.rate_shape[rows],
        tracks.rate_rate[rows],
        tracks.log_ratio[rows],
        tracks.confirmed[rows],
        tracks.count[rows],
        tracks.partition_probability,
    )


def _joined(first: ExtendedTracks, second: ExtendedTracks) -> ExtendedTracks:
    a, b = first.states, second.states
    states = ExtendedStates(
        np.concatenate([a.mean, b.mean]),
        np.concatenate([a.covariance, b.covariance]),
        np.concatenate([a.extent, b.extent]),
        np.concatenate([a.weight, b.weight]),
    )
    return ExtendedTracks(
        np.concatenate([first.track_id, second.track_id]),
        states,
        np.concatenate([first.rate_shape, second.rate_shape]),
        np.concatenate([first.rate_rate, second.rate_rate]),
        np.concatenate([first.log_ratio, second.log_ratio]),
        np.concatenate([first.confirmed, second.confirmed]),
        np.concatenate([first.count, second.count]),
        first.partition_probability,
    )
