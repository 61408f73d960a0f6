"""What docs/clutter-maps.md measures: tracking on estimated maps, and the bias of the maps."""

from __future__ import annotations

from typing import Any

import numpy as np

from gda_tracker.evaluation.quality import score_quality
from gda_tracker.kinematics.measurement_kinds import AZIMUTH
from gda_tracker.simulation.playback import with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import Scenario
from gda_tracker.simulation.sensor_network import simulate_network
from gda_tracker.tracking.measurement_clutter import MeasurementClutter, densities, grid_shape
from gda_tracker.tracking.parameter_groups.sensor import ESTIMATED, GIVEN
from gda_tracker.tracking.ring import Ring

# A map that so many scans have made does not change any more.
FOR_EVER = 1e9


def true_map(scenario: Scenario) -> MeasurementClutter:
    """The map of sensors of bearings alone that counts of endless scans would make."""
    counts = []
    for sensor in scenario.sensors:
        assert sensor.measured.quantities == (AZIMUTH,)
        cells = grid_shape(sensor.measured)[0]
        azimuth = np.linspace(-np.pi, np.pi, 100 * cells, endpoint=False) + np.pi / (100 * cells)
        density = sensor.true_clutter_density(azimuth).reshape(cells, -1).mean(axis=1)
        counts.append(density * 2.0 * np.pi / cells * FOR_EVER)
    n = len(counts)
    return MeasurementClutter(
        tuple(sensor.id for sensor in scenario.sensors),
        tuple(sensor.model for sensor in scenario.sensors),
        np.tile([np.pi, 1.0, 1.0], (n, 1)),
        np.full((n, 3), -np.inf),
        np.full((n, 3), np.inf),
        np.full(n, FOR_EVER),
        np.concatenate(counts),
    )


def tracked(
    scenario: Scenario, method: str, variant: str, factor: float, runs: range, seed: int
) -> list[dict[str, float]]:
    """Track runs of a scenario of bearings and score each.

    ``variant`` is ``given``, ``estimated`` or ``truth``; the density told is ``factor`` times the
    mean one.
    """
    parameters = with_method(tracker_preset(scenario), method)
    manager = parameters["track_manager"]
    manager["sensor_clutter_densities"] = [
        factor * density for density in manager["sensor_clutter_densities"]
    ]
    manager["clutter_density"] = GIVEN if variant == "given" else ESTIMATED
    if variant == "truth":
        manager["clutter_memory_scans"] = FOR_EVER
    assert scenario.reach is not None
    scores = []
    for run in runs:
        recording = simulate_network(scenario, seed, run)
        ring = Ring(parameters)
        if variant == "truth":
            ring.manager.state.measurement_clutter = true_map(scenario)
        results = [ring.process(detections) for detections in recording.detections]
        assert recording.truth is not None
        quality = score_quality(results, recording.truth, scenario.reach.match_distance_m)
        own = quality.continuity
        scores.append(
            {
                "false_tracks": float(own.false_tracks or 0),
                "completeness": own.completeness,
                "false_life_s": float(own.false_track_life_s.sum()),
                "gospa_m": float(np.sqrt(np.mean(quality.distances.gospa_m**2))),
            }
        )
    return scores


def estimated_map(scenario: Scenario, method: str, seed: int) -> dict[str, Any]:
    """What the map of the first sensor, of bearings, says after one run, and what is true."""
    ring = Ring(with_method(tracker_preset(scenario), method))
    for detections in simulate_network(scenario, seed).detections:
        ring.process(detections)
    sensor = scenario.sensors[0]
    degrees = np.arange(-179.5, 180.0)
    azimuth = np.radians(degrees)
    local, _ = densities(
        ring.manager.state.measurement_clutter,
        sensor.id,
        sensor.measured,
        azimuth[:, None],
        sensor.clutter_density,
    )
    return {
        "azimuth_deg": degrees.tolist(),
        "truth": sensor.true_clutter_density(azimuth).round(5).tolist(),
        "estimate": local.round(5).tolist(),
        "given": round(sensor.clutter_density, 5),
    }
