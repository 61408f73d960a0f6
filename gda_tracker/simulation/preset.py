"""What a scenario tells the tracker, as parameters of the nodes.

Nothing else about the truth reaches it: the sections ``tracker`` and ``attribute``, the noise of
the sensor, and the RCS model of the clutter, which the tracker knows (Tchamova et al. 2004,
14.3.1).
"""

from __future__ import annotations

import math
from typing import Any

from gda_tracker.parameters import ParameterError
from gda_tracker.simulation.scenarios import Scenario
from gda_tracker.simulation.sensor_sections import sensor_parameters
from gda_tracker.simulation.tracker_sections import NOT_KNOWN, KnownClass

FALSE_ALARM = "false_alarm"
FALSE_ALARM_LABEL = "VS"
# From small to big, by the number of classes beside the false alarm.
CLASS_LABELS = {1: ("B",), 2: ("S", "B"), 3: ("S", "M", "B")}
# Of a set of models with a standstill; the noise of the last is a speed.
STANDSTILL_NOISE_FACTORS = [0.2, 1.3, 0.1]
STANDSTILL_SOJOURN_S = [30.0, 10.0, 30.0]
# Silence that ends all tracks; a slow radar needs more than the tracker's own default.
GAP_SCANS = 12


def tracker_preset(scenario: Scenario, initiation: str = "labelled") -> dict[str, dict[str, Any]]:
    """Parameters ``{node: {name: value}}`` for a scenario.

    Parameters
    ----------
    scenario
        The scenario.
    initiation
        ``labelled``: the tracks are given and never end, as in the chapter. ``automatic``: the
        tracker's own confirmation and deletion. A scenario with several sensors, or with extended
        targets, has no other.

    Raises
    ------
    ParameterError
        If the scenario knows more classes than there are labels.
    """
    told, sensor = scenario.tracker, scenario.sensor
    manager: dict[str, Any] = {
        "initiation": initiation,
        "range_std_m": sensor.range_std_m,
        "azimuth_std_rad": math.radians(sensor.azimuth_std_deg),
        "process_noise_std_mps2": told.process_noise_std_mps2,
        "gate_probability": told.gate_probability,
        "detection_probability": told.detection_probability,
        "clutter_density_per_m_rad": told.extraneous_return_density_per_rad_m,
        "missed_track_hypotheses": scenario.attribute.missed_track_hypotheses,
        "max_gap_s": max(60.0, GAP_SCANS * scenario.time.scan_period_s),
    }
    if told.extraction != "m_of_n":
        manager["extraction"] = told.extraction
    if told.clutter_density != "given":
        manager["clutter_density"] = told.clutter_density
    if sensor.false_alarm_probability > 0.0:
        manager["false_alarm_probability"] = sensor.false_alarm_probability
        manager["signal_strength"] = told.signal_strength
    if sensor.resolution_range_m > 0.0 and told.resolution == "told":
        manager["resolution_range_m"] = sensor.resolution_range_m
        manager["resolution_azimuth_rad"] = math.radians(sensor.resolution_azimuth_deg)
    if told.blind_speed_mps:
        manager["blind_speed_mps"] = told.blind_speed_mps
    if sensor.range_rate_std_mps:
        manager["range_rate_std_mps"] = sensor.range_rate_std_mps
    if told.context_file:
        manager["context_file"] = told.context_file
    if told.imm_standstill:
        manager["imm_models"] = ["constant_velocity", "constant_velocity", "standstill"]
        manager["imm_process_noise_factors"] = STANDSTILL_NOISE_FACTORS
        manager["imm_mean_sojourn_s"] = STANDSTILL_SOJOURN_S
    if told.class_motion != "off":
        manager.update(_motion(told.class_motion, scenario.attribute.classes))
    if scenario.reach is not None:
        manager["initiation"] = initiation = "automatic"
        manager.update(sensor_parameters(scenario.sensors, scenario.reach))
    if scenario.extended is not None:
        manager["initiation"] = initiation = "automatic"
        manager.update(scenario.extended.parameters())
    if initiation == "labelled":
        manager["deletion_misses"] = 0
    return {"track_manager": manager, "rcs_fuzzifier": _classes(scenario)}


def _motion(reading: str, classes: tuple[KnownClass, ...]) -> dict[str, Any]:
    """How classes move, of those of which something is known."""
    ranges = {
        "class_speed_mps": [known.speed_mps for known in classes],
        "class_acceleration_mps2": [known.acceleration_mps2 for known in classes],
    }
    told = [any(each != NOT_KNOWN for each in rows) for rows in zip(*ranges.values(), strict=True)]
    chosen: dict[str, Any] = {
        "class_motion": reading,
        "class_motion_names": [k.name for k, some in zip(classes, told, strict=True) if some],
    }
    for name, rows in ranges.items():
        kept = [row for row, some in zip(rows, told, strict=True) if some]
        if any(row != NOT_KNOWN for row in kept):
            chosen[name] = [float(number) for row in kept for number in row]
    return chosen


def _classes(scenario: Scenario) -> dict[str, Any]:
    classes, clutter = scenario.attribute.classes, scenario.clutter
    if len(classes) not in CLASS_LABELS:
        raise ParameterError(
            f"scenario {scenario.name}: attribute.classes has {len(classes)} entries: allowed are "
            f"at most {max(CLASS_LABELS)}"
        )
    by_size = sorted(range(len(classes)), key=lambda index: classes[index].rcs_mean_m2)
    labels = [""] * len(classes)
    for label, index in zip(CLASS_LABELS[len(classes)], by_size, strict=True):
        labels[index] = label
    membership = scenario.attribute.membership
    return {
        "class_names": [FALSE_ALARM, *(known.name for known in classes)],
        "class_rcs_mean_m2": [clutter.rcs_mean_m2, *(known.rcs_mean_m2 for known in classes)],
        "class_rcs_swerling": [clutter.rcs_swerling, *(known.rcs_swerling for known in classes)],
        "class_labels": [FALSE_ALARM_LABEL, *labels],
        # Empty: a target is any of the classes with equal probability, and no false alarm.
        "class_prior": [],
        "membership": membership.kind,
        "histogram_n_draws": membership.n_draws,
        "histogram_bin_width_m2": membership.bin_width_m2,
        "histogram_max_rcs_m2": membership.max_rcs_m2,
        "histogram_normalisation": membership.normalisation,
        "histogram_interpolation": membership.interpolation,
        "histogram_seed": membership.seed,
    }
