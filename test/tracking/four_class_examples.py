"""A fighter beside a cargo aircraft past a drone, with the attributes of the preset."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from gda_tracker.io.parameter_files import read_preset
from gda_tracker.simulation.scenarios import scenario_from_mapping
from gda_tracker.simulation.simulate import simulate
from gda_tracker.vocabulary.recordings import Recording

PRESET = "four_classes"
CLASSES = ("false_alarm", "drone", "fighter", "cargo")
# What the targets are, apart from what the tracker is told: median and log deviation of the length.
LENGTH = np.array([[5.0, 1.0], [1.5, 0.5], [15.0, 0.3], [40.0, 0.3]])
CALLS = np.array(
    [
        [0.70, 0.10, 0.10, 0.10],
        [0.15, 0.75, 0.05, 0.05],
        [0.05, 0.05, 0.70, 0.20],
        [0.05, 0.05, 0.20, 0.70],
    ]
)
# How many of the detections bring a length and a call.
REPORTED = 0.7


def _target(number, kind, rcs, swerling, position, speed, heading):
    return {
        "id": number,
        "class": kind,
        "rcs_mean_m2": rcs,
        "rcs_swerling": swerling,
        "initial_position_m": position,
        "speed_mps": speed,
        "initial_heading_deg_ccw_from_north": heading,
    }


def scenario():
    """Return two aircraft side by side that pass a drone 10 km north of the radar."""
    return scenario_from_mapping(
        {
            "name": "four_classes",
            "time": {"scan_period_s": 2.0, "n_scans": 24, "n_initiation_scans": 2},
            "sensor": {
                "position_m": [0.0, 0.0],
                "azimuth_std_deg": math.degrees(0.003),
                "range_std_m": 30.0,
                "detection_probability": 0.95,
            },
            "clutter": {
                "region_x_m": [-8000.0, 8000.0],
                "region_y_m": [2000.0, 18000.0],
                "mean_false_alarms_per_scan": 10.0,
                "rcs_mean_m2": 0.3,
                "rcs_swerling": 2,
            },
            "targets": [
                _target(1, "drone", 0.15, 1, [0.0, 10_400.0], 10.0, 180.0),
                _target(2, "fighter", 1.2, 3, [-3500.0, 10_000.0], 150.0, 270.0),
                _target(3, "cargo", 4.0, 3, [-3500.0, 10_100.0], 150.0, 270.0),
            ],
            "tracker": {
                "process_noise_std_mps2": 3.0,
                "gate_probability": 0.99,
                "detection_probability": 0.95,
                "extraneous_return_density_per_rad_m": 1.6e-4,
            },
            "attribute": {
                "classes": [
                    {"name": "drone", "rcs_mean_m2": 0.15, "rcs_swerling": 1},
                    {"name": "fighter", "rcs_mean_m2": 1.2, "rcs_swerling": 3},
                    {"name": "cargo", "rcs_mean_m2": 4.0, "rcs_swerling": 3},
                ]
            },
        }
    )


def recording(run: int, seed: int = 7) -> Recording:
    """Simulate a run and give its detections a length, an ESM call and a range rate."""
    simulated = simulate(scenario(), seed, run)
    random = np.random.default_rng([seed, run, 99])
    assert simulated.truth is not None
    detections = []
    for item, truth in zip(simulated.detections, simulated.truth, strict=True):
        n = len(item.range_m)
        target = np.array(
            [truth.target_id.tolist().index(i) if i > 0 else -1 for i in truth.source_id]
        )
        kind = np.where(target < 0, 0, target + 1).astype(int)
        median, deviation = LENGTH[kind].T
        length = median * np.exp(deviation * random.standard_normal(n))
        call = (random.random((n, 1)) > CALLS[kind].cumsum(axis=1)).sum(axis=1).clip(max=3)
        state = truth.target_state[target]
        sight = np.stack([np.cos(item.azimuth_rad), np.sin(item.azimuth_rad)], axis=1)
        radial = np.where(target < 0, random.uniform(-300.0, 300.0, n), 0.0)
        radial = np.where(target < 0, radial, (state[:, 2:] * sight).sum(axis=1))
        detections.append(
            replace(
                item,
                range_rate_mps=radial + random.normal(0.0, 1.0, n),
                attribute_names=("esm_class", "length_m"),
                attribute_values=np.stack([call.astype(float), length]),
                attribute_valid=random.random((2, n)) < REPORTED,
            )
        )
    return replace(simulated, detections=detections)


def parameters(**changes):
    """Return the preset, with changes to the track manager or the fuzzifier by prefix."""
    values = read_preset(PRESET)
    for name, value in changes.items():
        node, parameter = name.split("__")
        values[node][parameter] = value
    return values
