"""Simulation of one run of a scenario: detections, false alarms, RCS, and the truth.

A run depends on the scenario, the seed and the number of the run alone. ``SeedSequence([seed,
run])`` spawns one stream per source of chance, so that one of them can change (more clutter, say)
while the others stay as they are: 0 detection, 1 measurement noise, 2 radar cross sections of
targets, 3 false alarms, 4 order of the detections within a scan, 5 signal strengths, 6 which
targets the radar resolves (:mod:`gda_tracker.simulation.resolution`), 7 echoes too slow to be kept,
8 range rates (noise of targets, then those of false alarms, uniform as far as targets go), 9
extended targets. Each
stream is drawn for all scans at once, scan by scan and within a scan target by target in the order
of the file.
"""

from __future__ import annotations

import math

import numpy as np

from gda_tracker.attributes.rcs import sample
from gda_tracker.kinematics.blind_zone import BlindZone, detection_probability_at
from gda_tracker.kinematics.sensor_models import SMALLEST_RANGE_M
from gda_tracker.simulation.extended_targets import detections_of, true_extents
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.resolution import merged_detections, unresolved_groups
from gda_tracker.simulation.scenarios import Scenario
from gda_tracker.simulation.signal_strengths import (
    ATTRIBUTE,
    draw_false_signals,
    draw_signals,
)
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
    bring no standard deviations: the tracker is told them by its parameters. With signal strengths
    (:mod:`gda_tracker.simulation.signal_strengths`) they decide what is detected. Their order
    within a scan is random, so that it tells nothing.

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
    streams = [np.random.default_rng(s) for s in np.random.SeedSequence([seed, run]).spawn(10)]
    states = true_states(scenario)
    n_scans, n_targets = states.shape[:2]

    seen = streams[0].random((n_scans, n_targets)) < scenario.sensor.detection_probability
    speeds = _range_rates(scenario, states)
    if scenario.sensor.blind_speed_mps:
        zone = BlindZone(scenario.sensor.blind_speed_mps, 1.0, np.zeros(2))
        seen &= streams[7].random(seen.shape) < detection_probability_at(speeds, zone)
    seen[: scenario.time.n_initiation_scans] = True
    strengths = scenario.sensor.false_alarm_probability > 0.0
    means = np.array([t.rcs_mean_m2 for t in scenario.targets])
    if strengths:
        signal, seen = draw_signals(
            streams[5],
            scenario.sensor.strength_per_m2 * means,
            n_scans,
            scenario.time.n_initiation_scans,
            scenario.sensor.false_alarm_probability,
        )
    target_range, target_azimuth = _measure(scenario, states[..., :2], streams[1])
    models = np.array([t.rcs_swerling for t in scenario.targets])
    target_rcs = sample(streams[2], means, models, (n_scans, n_targets))
    if scenario.sensor.resolution_range_m > 0.0:
        groups = unresolved_groups(scenario, states[..., :2], streams[6])
        groups[: scenario.time.n_initiation_scans] = np.arange(n_targets)
        measured = target_range, target_azimuth
        seen, target_range, target_azimuth, target_rcs, owner = merged_detections(
            scenario, states[..., :2], groups, seen, measured, target_rcs, streams[6]
        )
    else:
        owner = np.tile(np.arange(n_targets), (n_scans, 1))
    scan, _ = np.nonzero(seen)
    target = owner[seen]
    target_range, target_azimuth = target_range[seen], target_azimuth[seen]
    target_rcs = target_rcs[seen]
    extents, ellipses = tuple(t.extent for t in scenario.targets), None
    if any(extent is not None for extent in extents):
        scan, target, places, target_rcs = detections_of(
            states, extents, means, models, seen, [streams[2], streams[9]]
        )
        target_range, target_azimuth = _measure(scenario, places, streams[1])
        ellipses = true_extents(states, extents)
    clutter_scan, clutter_range, clutter_azimuth, clutter_rcs = _clutter(scenario, streams[3])

    ids = np.array([t.id for t in scenario.targets], dtype=np.int32)
    all_scans = np.concatenate([scan, clutter_scan])
    order = np.lexsort((streams[4].random(len(all_scans)), all_scans))
    ranges = np.concatenate([target_range, clutter_range])[order]
    azimuths = np.concatenate([target_azimuth, clutter_azimuth])[order]
    if strengths:
        false = draw_false_signals(
            streams[5], len(clutter_scan), scenario.sensor.false_alarm_probability
        )
        signals = np.concatenate([signal[seen], false])[order]
        rcs = (signals - 1.0) / scenario.sensor.strength_per_m2
    else:
        rcs = np.concatenate([target_rcs, clutter_rcs])[order]
    sources = np.concatenate([ids[target], np.full(len(clutter_scan), CLUTTER, np.int32)])[order]

    begin = np.searchsorted(all_scans[order], np.arange(n_scans + 1))
    period_ns = round(scenario.time.scan_period_s * 1e9)
    classes = tuple(t.class_name for t in scenario.targets)
    position = np.array([*scenario.sensor.position_m, 0.0])
    rates: FloatArray | None = None
    if scenario.sensor.range_rate_std_mps:
        rate_noise = scenario.sensor.range_rate_std_mps * streams[8].standard_normal(speeds.shape)
        fastest = max(target.speed_mps for target in scenario.targets)
        false_rate = streams[8].uniform(-fastest, fastest, len(clutter_scan))
        rates = np.concatenate([(speeds + rate_noise)[seen], false_rate])[order]
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
                range_rate_mps=None if rates is None else rates[rows],
                rcs_m2=rcs[rows],
                rcs_valid=np.ones(begin[k + 1] - begin[k], dtype=bool),
                sensor_position_m=position.copy(),
                frame_id=FRAME_ID,
                sequence=k,
                attribute_names=(ATTRIBUTE,) if strengths else (),
                attribute_values=signals[None, rows] if strengths else None,
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


def _range_rates(scenario: Scenario, states: FloatArray) -> FloatArray:
    """True range rates (...) of states (..., 4)."""
    from_sensor = states[..., :2] - np.array(scenario.sensor.position_m)
    distance = np.hypot(from_sensor[..., 0], from_sensor[..., 1])
    along: FloatArray = np.sum(from_sensor * states[..., 2:], axis=-1)
    return along / np.maximum(distance, SMALLEST_RANGE_M)


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
