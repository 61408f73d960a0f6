"""Bias of the estimated maps: converged estimates of the tracker against the simulated truth."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from gda_tracker.kinematics.measurement_kinds import AZIMUTH
from gda_tracker.simulation.playback import with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import Scenario
from gda_tracker.simulation.sensor_network import simulate_network
from gda_tracker.tracking import clutter, looks
from gda_tracker.tracking.measurement_clutter import densities
from gda_tracker.tracking.ring import Ring
from gda_tracker.vocabulary.arrays import FloatArray
from gda_tracker.vocabulary.scans import Detections

# Detection probabilities of the twelve sectors of the maps, from azimuth 0 on.
FIELD = (0.95, 0.8, 0.6, 0.4) * 3
TOLD = 0.8
TARGETS, DISTANCE_M, FAR_M = 24, 3000.0, 4096.0 * 0.999
# False detections a scan: over all, and besides over the busy sectors.
PLAIN, BUSY, BUSY_SECTORS = 40.0, 40.0, (0, 1, 2)
SECTOR = math.pi / 6.0
MEASURED_METHODS = ("map/none/cv", "jpda/none/cv", "mht/none/cv")


def true_clutter(sector: int) -> float:
    """False detections per scan, metre and radian in a sector of the field."""
    density = PLAIN / (FAR_M * 2.0 * math.pi)
    if sector in BUSY_SECTORS:
        density += BUSY / (FAR_M * SECTOR * len(BUSY_SECTORS))
    return density


def field_scans(rng: np.random.Generator, n_scans: int) -> Iterator[Detections]:
    """Targets that circle slowly, two in each sector, among false detections."""
    start = SECTOR / 4.0 + 0.5 * SECTOR * np.arange(TARGETS)
    for k in range(n_scans):
        azimuth = start + 0.002 * k
        seen = rng.random(TARGETS) < np.array(FIELD)[sectors(azimuth)]
        plain, busy = rng.poisson(PLAIN), rng.poisson(BUSY)
        false = rng.uniform(0.0, 2.0 * math.pi, plain)
        dense = rng.uniform(0.0, SECTOR * len(BUSY_SECTORS), busy)
        yield Detections(
            "radar",
            round(k * 1e9),
            np.concatenate(
                [
                    DISTANCE_M + rng.normal(0.0, 10.0, int(seen.sum())),
                    rng.uniform(0.0, FAR_M, plain + busy),
                ]
            ),
            wrapped(
                np.concatenate(
                    [azimuth[seen] + rng.normal(0.0, 0.001, int(seen.sum())), false, dense]
                )
            ),
        )


def sectors(azimuth: FloatArray) -> np.ndarray:
    """Sectors (P,) of azimuths."""
    return (np.mod(azimuth, 2.0 * math.pi) / SECTOR).astype(np.int64) % len(FIELD)


def wrapped(azimuth: FloatArray) -> FloatArray:
    """Azimuths in [-pi, pi)."""
    return np.mod(azimuth + math.pi, 2.0 * math.pi) - math.pi


def field_estimates(
    method: str, factor: float, n_scans: int, run: int, seed: int
) -> dict[str, FloatArray]:
    """Both maps of a position sensor after ``n_scans`` scans of one run.

    The clutter density told is ``factor`` times the mean one. Estimates (12,) by sector: of the
    detection probability where the targets are, and of the clutter density, over the truth, in the
    ring of the targets and in the others that the sensor sees as a whole.
    """
    rng = np.random.default_rng([seed, run])
    mean = (PLAIN + BUSY) / (FAR_M * 2.0 * math.pi)
    parameters = with_method({}, method)
    parameters["track_manager"] |= {
        "detection_probability": TOLD,
        "detection_probability_map": "estimated",
        "clutter_density": "estimated",
        "clutter_density_per_m_rad": factor * mean,
        "extraction": "sequential",
        "range_std_m": 10.0,
        "azimuth_std_rad": 0.001,
        "max_speed_mps": 20.0,
        "process_noise_std_mps2": 0.1,
    }
    ring = Ring(parameters)
    for scan in field_scans(rng, n_scans):
        ring.process(scan)
    state, p = ring.manager.state, ring.manager.parameters
    azimuth = wrapped(SECTOR * (np.arange(len(FIELD)) + 0.5))
    found = looks.probabilities(
        state.looks,
        "radar",
        np.full(len(FIELD), DISTANCE_M),
        azimuth,
        TOLD,
        p.gate_probability,
    )
    extent = float(state.clutter.extent_m[0])
    ring_m = extent / clutter.RANGE_CELLS
    own = int(DISTANCE_M / ring_m)
    truth = np.array([true_clutter(sector) for sector in range(len(FIELD))])
    ratio = np.array(
        [
            clutter.densities(
                state.clutter,
                "radar",
                np.full(len(FIELD), (cell + 0.5) * ring_m),
                azimuth,
                p.clutter_density_per_m_rad,
                p.clutter_memory_scans,
            )
            / truth
            for cell in range(int(FAR_M / ring_m))
        ]
    )
    elsewhere = np.delete(ratio, own, axis=0).mean(axis=0)
    return {"probability": found, "at_targets": ratio[own], "elsewhere": elsewhere}


def measured_estimates(
    scenario: Scenario, method: str, factor: float, memory_scans: float, run: int, seed: int
) -> dict[str, float]:
    """Estimate over truth of sensors with models of their own, at the end of one run.

    Of bearings in the busy sectors and in the others, ten degrees about the borders left out, which
    cells blur; of other quantities the mean over a thousand false detections drawn anew.
    """
    parameters = with_method(tracker_preset(scenario), method)
    manager = parameters["track_manager"]
    manager |= {"clutter_density": "estimated", "extraction": "sequential"}
    manager["clutter_memory_scans"] = memory_scans
    manager["sensor_clutter_densities"] = [
        factor * density for density in manager["sensor_clutter_densities"]
    ]
    ring = Ring(parameters)
    for scan in simulate_network(scenario, seed, run).detections:
        ring.process(scan)
    found: dict[str, list[float]] = {}
    for sensor in scenario.sensors:
        model, many = sensor.measured, replace(sensor, false_alarms_per_scan=1000.0)
        value = many.false_alarms(np.random.default_rng(run))
        busy = np.zeros(len(value), dtype=bool)
        truth = np.full(len(value), sensor.clutter_density)
        if AZIMUTH in model.quantities:
            # Evenly over the turn: a mean over false detections would hardly see the quiet part.
            azimuth = wrapped(np.linspace(0.0, 2.0 * math.pi, 3600, endpoint=False))
            value, truth = azimuth[:, None], sensor.true_clutter_density(azimuth)
            busy = truth > sensor.clutter_density
            wide = [np.roll(busy, turn) for turn in range(-100, 101)]
            clear = np.all(wide, axis=0) | ~np.any(wide, axis=0)
            value, truth, busy = value[clear], truth[clear], busy[clear]
        local, _ = densities(
            ring.manager.state.measurement_clutter,
            sensor.id,
            model,
            value,
            factor * sensor.clutter_density,
        )
        for name, rows in (("busy", busy), ("quiet", ~busy)):
            if rows.any():
                found.setdefault(name, []).append(float(local[rows].mean() / truth[rows].mean()))
    return {name: float(np.mean(values)) for name, values in found.items()}
