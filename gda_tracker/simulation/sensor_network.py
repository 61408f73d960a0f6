"""Simulation of a scenario with several sensors, each with a model of its own.

As in :mod:`gda_tracker.simulation.simulate` a run depends on the scenario, the seed and the number
of the run alone, with one stream for each source of chance: detection, noise, false alarms, order.
"""

from __future__ import annotations

import numpy as np

from gda_tracker.kinematics.measurement_kinds import AZIMUTH, RANGE, RANGE_RATE
from gda_tracker.kinematics.measurement_models import Sites, measure
from gda_tracker.kinematics.sensor_models import wrap_angle
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import Scenario
from gda_tracker.simulation.sensor_sections import ModelledSensor
from gda_tracker.simulation.targets import target_states
from gda_tracker.vocabulary.arrays import FloatArray
from gda_tracker.vocabulary.recordings import Recording
from gda_tracker.vocabulary.scans import Detections, ScanTruth

FRAME_ID = "map"
CLUTTER = -1


def sites_at(sensor: ModelledSensor, time_s: float) -> Sites:
    """Where a sensor and its reference are at a time."""
    count = 1 + sensor.measured.has_reference
    position = np.array([sensor.position_m, sensor.reference_position_m])[:count]
    velocity = np.array([sensor.velocity_mps, sensor.reference_velocity_mps])[:count]
    return Sites(position + time_s * velocity, velocity)


def simulate_network(
    scenario: Scenario, seed: int, run: int = 0, *, base_stamp_ns: int = 0
) -> Recording:
    """Simulate one run: every sensor scans ``n_scans`` times, from its own first scan on.

    Returns
    -------
    Recording
        Detections and truth in the order of time; the tracker starts its tracks itself.
    """
    streams = [np.random.default_rng(s) for s in np.random.SeedSequence([seed, run]).spawn(4)]
    period = scenario.time.scan_period_s
    looks = [
        (sensor.offset_s + k * period, place, k)
        for place, sensor in enumerate(scenario.sensors)
        for k in range(scenario.time.n_scans)
    ]
    looks.sort()
    times = np.array([time_s for time_s, _, _ in looks])
    paths = [target_states(target, times, period) for target in scenario.targets]
    states = np.stack(paths, axis=1)
    ids = np.array([target.id for target in scenario.targets], dtype=np.int32)
    classes = tuple(target.class_name for target in scenario.targets)
    detections, truth = [], []
    for row, (time_s, place, number) in enumerate(looks):
        sensor = scenario.sensors[place]
        stamp_ns = base_stamp_ns + round(time_s * 1e9)
        value, source = _look(sensor, sites_at(sensor, time_s), states[row], ids, streams)
        detections.append(_message(sensor, time_s, stamp_ns, number, value))
        truth.append(
            ScanTruth(
                sensor_id=sensor.id,
                stamp_ns=stamp_ns,
                target_id=ids.copy(),
                target_state=states[row],
                source_id=source,
                target_class=classes,
                run=run,
                frame_id=FRAME_ID,
            )
        )
    return Recording(
        name=scenario.name,
        detections=detections,
        truth=truth,
        preset_name=f"scenario {scenario.name}",
        preset=tracker_preset(scenario),
        origin=f"simulated from scenario {scenario.name}, seed {seed}, run {run}",
    )


def _look(
    sensor: ModelledSensor,
    sites: Sites,
    states: FloatArray,
    ids: np.ndarray,
    streams: list[np.random.Generator],
) -> tuple[FloatArray, np.ndarray]:
    """What a sensor measures on one scan, values (n, m), and of which target or of none (n,)."""
    model = sensor.measured
    seen = streams[0].random(len(ids)) < sensor.detection_probability
    noise = streams[1].standard_normal((len(ids), len(model))) * sensor.deviations
    value = (measure(model, sites, states) + noise)[seen]
    false = sensor.false_alarms(streams[2])
    value = np.concatenate([value, false])
    source = np.concatenate([ids[seen], np.full(len(false), CLUTTER, dtype=np.int32)])
    order = streams[3].permutation(len(value))
    return value[order], source[order].astype(np.int32)


def _message(
    sensor: ModelledSensor, time_s: float, stamp_ns: int, number: int, value: FloatArray
) -> Detections:
    """The detections as the sensor publishes them; what it does not measure is NaN."""
    model = sensor.measured
    column = dict(zip(model.quantities, value.T, strict=True))
    nothing = np.full(len(value), np.nan)
    sites = sites_at(sensor, time_s)
    range_m = column.get(RANGE, nothing)
    if model.reference_sign >= 0.0:
        range_m = np.abs(range_m)  # close to the sensor the noise is reflected at zero
    azimuth = wrap_angle(column[AZIMUTH]) if AZIMUTH in column else nothing

    def of(place: int, values: FloatArray) -> FloatArray | None:
        return np.array([*values[place], 0.0]) if place < len(values) else None

    position = of(0, sites.position_m)
    assert position is not None
    return Detections(
        sensor_id=sensor.id,
        stamp_ns=stamp_ns,
        range_m=range_m,
        azimuth_rad=azimuth,
        range_rate_mps=column.get(RANGE_RATE),
        sensor_position_m=position,
        sensor_velocity_mps=of(0, sites.velocity_mps),
        reference_position_m=of(1, sites.position_m),
        reference_velocity_mps=of(1, sites.velocity_mps),
        frame_id=FRAME_ID,
        sequence=number,
    )
