"""Simulation of one run of a scenario: detections, false alarms, RCS, and the truth.

A run depends on the scenario, the seed and the number of the run alone. ``SeedSequence([seed,
run])`` spawns one stream per source of chance, so that one of them can change (more clutter, say)
while the others stay as they are: 0 detection, 1 measurement noise, 2 radar cross sections of
targets, 3 false alarms, 4 order of the detections within a scan, 5 extended targets. Each stream is
drawn for all scans at once, scan by scan and within a scan target by target in the order of the
file.
"""

from __future__ import annotations

import math

import numpy as np

from gda_tracker.attributes.rcs import sample
from gda_tracker.simulation.extended_targets import detections_of, true_extents
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import Scenario
from gda_tracker.simulation.targets import true_states
from gda_tracker.vocabulary.arrays import FloatArray, IntArray
from gda_tracker.vocabulary.recordings import Recording
from gda_tracker.vocabulary.scans import Detections, ScanTruth

SENSOR_ID = "radar"
FRAME_ID = "map"
CLUTTER = -1


def simulate(
    scenario: Scenario,
    seed: int,
    run: int = 0,
    *,
    base_stamp_ns: int = 0,
    initiation: str = "labelled",
) -> Recording:
    """Simulate one run.

    In the first ``n_initiation_scans`` every target is detected; later with the true P_d. Range and
    azimuth carry Gaussian noise, the azimuth counter-clockwise from East (REP-103). The detections
    bring no standard deviations: the tracker is told them by its parameters. Their order within a
    scan is random, so that it tells nothing.

    Parameters
    ----------
    scenario
        What to simulate.
    seed, run
        The random numbers; not negative.
    base_stamp_ns
        Stamp of scan 1 in ns.
    initiation
        ``labelled`` or ``automatic``: how the tracker of the preset starts its tracks.

    Returns
    -------
    Recording
        One ``Detections`` and one ``ScanTruth`` per scan; the preset holds what the tracker is
        told.
    """
    streams = [np.random.default_rng(s) for s in np.random.SeedSequence([seed, run]).spawn(6)]
    states = true_states(scenario)
    n_scans, n_targets = states.shape[:2]

    seen = streams[0].random((n_scans, n_targets)) < scenario.sensor.detection_probability
    seen[: scenario.time.n_initiation_scans] = True
    scan, target = np.nonzero(seen)
    means = np.array([t.rcs_mean_m2 for t in scenario.targets])
    models = np.array([t.rcs_swerling for t in scenario.targets])
    extents = tuple(t.extent for t in scenario.targets)
    extended = any(extent is not None for extent in extents)
    if extended:
        scan, target, places, target_rcs = detections_of(
            states, extents, means, models, seen, [streams[2], streams[5]]
        )
        target_range, target_azimuth = _measure(scenario, places, streams[1])
    else:
        every_range, every_azimuth = _measure(scenario, states[..., :2], streams[1])
        every_rcs = sample(streams[2], means, models, (n_scans, n_targets))
        target_range, target_azimuth = every_range[seen], every_azimuth[seen]
        target_rcs = every_rcs[seen]
    ellipses = true_extents(states, extents) if extended else None
    clutter_scan, clutter_range, clutter_azimuth, clutter_rcs = _clutter(scenario, streams[3])

    ids = np.array([t.id for t in scenario.targets], dtype=np.int32)
    all_scans = np.concatenate([scan, clutter_scan])
    order = np.lexsort((streams[4].random(len(all_scans)), all_scans))
    ranges = np.concatenate([target_range, clutter_range])[order]
    azimuths = np.concatenate([target_azimuth, clutter_azimuth])[order]
    rcs = np.concatenate([target_rcs, clutter_rcs])[order]
    sources = np.concatenate([ids[target], np.full(len(clutter_scan), CLUTTER, np.int32)])[order]

    begin = np.searchsorted(all_scans[order], np.arange(n_scans + 1))
    period_ns = round(scenario.time.scan_period_s * 1e9)
    classes = tuple(t.class_name for t in scenario.targets)
    position = np.array([*scenario.sensor.position_m, 0.0])
    detections, truth = [], []
    for k in range(n_scans):
        rows = slice(begin[k], begin[k + 1])
        stamp_ns = base_stamp_ns + k * period_ns
        detections.append(
            Detections(
                sensor_id=SENSOR_ID,
                stamp_ns=stamp_ns,
                range_m=ranges[rows],
                azimuth_rad=azimuths[rows],
                rcs_m2=rcs[rows],
                rcs_valid=np.ones(begin[k + 1] - begin[k], dtype=bool),
                sensor_position_m=position.copy(),
                frame_id=FRAME_ID,
                sequence=k,
            )
        )
        truth.append(
            ScanTruth(
                sensor_id=SENSOR_ID,
                stamp_ns=stamp_ns,
                target_id=ids.copy(),
                target_state=states[k],
                source_id=sources[rows],
                target_class=classes,
                run=run,
                frame_id=FRAME_ID,
                target_extent=None if ellipses is None else ellipses[k],
            )
        )
    return Recording(
        name=scenario.name,
        detections=detections,
        truth=truth,
        preset_name=f"scenario {scenario.name}",
        preset=tracker_preset(scenario, initiation),
        match_distance_m=None if scenario.extended is None else scenario.extended.match_distance_m,
        origin=f"simulated from scenario {scenario.name}, seed {seed}, run {run}",
    )


def _measure(
    scenario: Scenario, positions: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Noisy range and azimuth of positions (..., 2); the noise of the range is drawn first."""
    noise = rng.standard_normal(positions.shape)
    dx = positions[..., 0] - scenario.sensor.position_m[0]
    dy = positions[..., 1] - scenario.sensor.position_m[1]
    # A range cannot be negative: close to the sensor the noise is reflected at zero.
    ranges = np.abs(np.hypot(dx, dy) + scenario.sensor.range_std_m * noise[..., 0])
    azimuth_std = math.radians(scenario.sensor.azimuth_std_deg)
    return ranges, _wrap(np.arctan2(dy, dx) + azimuth_std * noise[..., 1])


def _clutter(
    scenario: Scenario, rng: np.random.Generator
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Scan, range, azimuth and RCS of all false alarms: numbers, then x, then y, then RCS."""
    clutter = scenario.clutter
    counts = rng.poisson(clutter.mean_false_alarms_per_scan, scenario.time.n_scans)
    total = int(counts.sum())
    dx = rng.uniform(*clutter.region_x_m, total) - scenario.sensor.position_m[0]
    dy = rng.uniform(*clutter.region_y_m, total) - scenario.sensor.position_m[1]
    rcs = sample(rng, clutter.rcs_mean_m2, clutter.rcs_swerling, total)
    return np.repeat(np.arange(len(counts)), counts), np.hypot(dx, dy), np.arctan2(dy, dx), rcs


def _wrap(angle: FloatArray) -> FloatArray:
    """Angles in (-pi, pi]."""
    return math.pi - np.mod(math.pi - angle, 2.0 * math.pi)
