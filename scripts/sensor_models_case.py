"""What docs/sensor-models.md measures: errors against the Cramer-Rao bound, ghosts, range rates."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from gda_tracker.kinematics.cramer_rao import Look, cramer_rao_bounds
from gda_tracker.kinematics.measurement_kinds import MEASUREMENT_MODELS
from gda_tracker.kinematics.measurement_models import Sites, compare, expected, measure, update
from gda_tracker.simulation.playback import with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import Scenario, load_scenario
from gda_tracker.simulation.sensor_network import simulate_network, sites_at
from gda_tracker.tracking.manager import TrackManager
from gda_tracker.tracking.ring import Ring, RingResult
from gda_tracker.vocabulary.arrays import FloatArray
from gda_tracker.vocabulary.recordings import Recording
from gda_tracker.vocabulary.tracks import CONFIRMED


@dataclass(frozen=True)
class Bounded:
    """Errors of one target in R runs of K scans, against the bound.

    ``squared_m2`` (R, K) squared position error of the confirmed track with the most hits, NaN
    without one; ``nees`` (R, K); ``bound_m2`` (R, K) that of the detections there were;
    ``components`` (K,) mean number of components; ``ms_per_scan`` processor time.
    """

    time_s: FloatArray
    squared_m2: FloatArray
    nees: FloatArray
    bound_m2: FloatArray
    components: FloatArray
    ms_per_scan: float

    def ratio(self, scans: slice) -> float:
        """Root mean squared error over the root of the mean bound, where there is a track."""
        there = np.isfinite(self.squared_m2[:, scans])
        error = self.squared_m2[:, scans][there].mean()
        return float(np.sqrt(error / self.bound_m2[:, scans][there].mean()))


def with_model(name: str) -> Scenario:
    """The scenario two_sensors with another model; fdoa has a tdoa pair beside it, to start."""
    scenario = load_scenario("two_sensors")
    models = ("tdoa", "fdoa") if name == "fdoa" else (name, name)
    sensors = tuple(
        replace(sensor, model=model) for sensor, model in zip(scenario.sensors, models, strict=True)
    )
    return replace(scenario, sensors=sensors)


def against_the_bound(scenario: Scenario, method: str, runs: int, seed: int) -> Bounded:
    """Track a scenario of one target and compare with the Cramer-Rao bound."""
    ring = Ring(with_method(tracker_preset(scenario), method))
    squared, nees, bounds, components = [], [], [], []
    spent, times = 0.0, np.zeros(0)
    for run in range(runs):
        recording = simulate_network(scenario, seed, run)
        ring.manager = TrackManager(ring.manager.parameters)
        start = time.process_time()
        results = [ring.process(detections) for detections in recording.detections]
        spent += time.process_time() - start
        found = [
            _error(result, truth.target_state[0])
            for result, truth in zip(results, recording.truth or (), strict=True)
        ]
        squared.append([one for one, _ in found])
        nees.append([other for _, other in found])
        bounds.append(bound_of(scenario, recording))
        components.append(
            [0 if r.predictions is None else len(r.predictions.component_weight) for r in results]
        )
        times = np.array([d.stamp_ns for d in recording.detections]) / 1e9
    return Bounded(
        times,
        np.array(squared),
        np.array(nees),
        np.array(bounds),
        np.mean(components, axis=0),
        1e3 * spent / (runs * len(times)),
    )


def _error(result: RingResult, truth: FloatArray) -> tuple[float, float]:
    """Squared position error and NEES of the confirmed track with the most hits."""
    tracks = result.tracks
    assert tracks is not None
    rows = np.flatnonzero(tracks.status == CONFIRMED)
    if not len(rows):
        return np.nan, np.nan
    row = rows[np.argmax(tracks.hits[rows])]
    gap = tracks.mean[row] - truth
    return float(gap[:2] @ gap[:2]), float(gap @ np.linalg.solve(tracks.covariance[row], gap))


def bound_of(scenario: Scenario, recording: Recording) -> FloatArray:
    """Bound [m2] on the squared position error after each scan (K,), from what was detected.

    What the tracker knows beforehand is in it: the reach, as a position somewhere in it, and the
    largest speed.
    """
    assert recording.truth is not None
    assert scenario.reach is not None
    sensors = {sensor.id: sensor for sensor in scenario.sensors}
    looks, rows = [], []
    first = recording.truth[0].target_state[0]
    start_s = recording.truth[0].stamp_ns / 1e9
    for row, truth in enumerate(recording.truth):
        assert truth.source_id is not None
        if not (truth.source_id == truth.target_id[0]).any():
            continue
        sensor, time_s = sensors[truth.sensor_id], truth.stamp_ns / 1e9
        noise = np.diag(np.square(sensor.deviations))
        looks.append(Look(time_s, sensor.measured, sites_at(sensor, time_s), noise))
        rows.append(row)
    first = first + (looks[0].time_s - start_s) * np.array([first[2], first[3], 0.0, 0.0])
    place, speed = scenario.reach.farthest_m / 2.0, scenario.reach.max_speed_mps / 2.0
    prior = np.diag(1.0 / np.square([place, place, speed, speed]))
    bounds = cramer_rao_bounds(first, looks, prior)
    told = np.full(len(recording.truth), np.nan)
    told[rows] = bounds[:, 0, 0] + bounds[:, 1, 1]
    # Between detections the bound of the last one, which is a little too low.
    for row in range(1, len(told)):
        if np.isnan(told[row]):
            told[row] = told[row - 1]
    return told


def both_found(
    scenario: Scenario, method: str, runs: int, seed: int, within_m: float
) -> FloatArray:
    """Share (K,) of runs in which every target has a confirmed track within a distance."""
    ring = Ring(with_method(tracker_preset(scenario), method))
    found = []
    for run in range(runs):
        recording = simulate_network(scenario, seed, run)
        ring.manager = TrackManager(ring.manager.parameters)
        row = []
        for detections, truth in zip(recording.detections, recording.truth or (), strict=True):
            tracks = ring.process(detections).tracks
            assert tracks is not None
            mean = tracks.mean[tracks.status == CONFIRMED, :2]
            gap = truth.target_state[:, None, :2] - mean
            nearest = np.hypot(gap[..., 0], gap[..., 1]).min(axis=1, initial=np.inf)
            row.append(bool((nearest < within_m).all()))
        found.append(row)
    return np.mean(found, axis=0)


def range_rate_errors(position_std_m: float, count: int, seed: int) -> dict[str, FloatArray]:
    """Errors of the velocity along the line of sight after one update, by linearisation.

    A target 4 km away moves across the line of sight at 150 m/s; its predicted position is off by
    the standard deviation in each coordinate, its velocity by 100 m/s.
    """
    rng = np.random.default_rng(seed)
    truth = np.array([4_000.0, 0.0, 0.0, 150.0])
    spread = np.diag([position_std_m, position_std_m, 100.0, 100.0])[None] ** 2
    means = truth + rng.multivariate_normal(np.zeros(4), spread[0], count)
    noise = np.diag([20.0, 0.005, 0.5]) ** 2
    sites = Sites(np.zeros((1, 2)), np.zeros((1, 2)))
    error = rng.multivariate_normal(np.zeros(3), noise, count)
    value = measure(MEASUREMENT_MODELS["doppler"], sites, truth) + error
    found = {}
    for name in ("doppler", "doppler_rotated"):
        of = expected(MEASUREMENT_MODELS[name], sites, means, np.tile(spread, (count, 1, 1)))
        pair = compare(of, value, np.tile(noise, (count, 1, 1)))
        mean, covariance = update(means, np.tile(spread, (count, 1, 1)), pair)
        gap = mean - truth
        nees = np.einsum("ni,nij,nj->n", gap, np.linalg.inv(covariance), gap)
        found[name] = np.stack([gap[:, 2], nees], axis=1)
    return found
