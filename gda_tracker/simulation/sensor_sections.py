"""Sections ``sensors`` and ``reach`` of a scenario: several sensors, each with its own model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from gda_tracker.kinematics.measurement_kinds import (
    AZIMUTH,
    MEASUREMENT_MODELS,
    RANGE,
    RANGE_AZIMUTH,
    RANGE_RATE,
    SENSOR_MODELS,
    MeasurementModel,
)
from gda_tracker.parameters import ParameterError
from gda_tracker.simulation.schema import ScenarioError, check_list, key, read_section
from gda_tracker.vocabulary.arrays import FloatArray

PLACE = "[x East, y North] at time 0"
POLAR = MeasurementModel(RANGE_AZIMUTH, (RANGE, AZIMUTH))


@dataclass(frozen=True)
class ModelledSensor:
    """One entry of ``sensors``; its platform, and that of its reference, move straight on."""

    id: str = key("name of the sensor")
    model: str = key("what it measures", choices=SENSOR_MODELS)
    position_m: tuple[float, float] = key(PLACE, unit="m")
    detection_probability: float = key("P_d, told the tracker", minimum=0.0, maximum=1.0)
    velocity_mps: tuple[float, float] = key("of the platform", unit="m/s", default=(0.0, 0.0))
    reference_position_m: tuple[float, float] = key(
        "of the transmitter or the second sensor, " + PLACE, unit="m", default=(0.0, 0.0)
    )
    reference_velocity_mps: tuple[float, float] = key(
        "of its platform", unit="m/s", default=(0.0, 0.0)
    )
    offset_s: float = key("time of its first scan", unit="s", minimum=0.0, default=0.0)
    range_std_m: float = key(
        "noise of the range, sum or difference of ranges",
        unit="m",
        minimum=0.0,
        minimum_excluded=True,
        default=30.0,
    )
    azimuth_std_deg: float = key(
        "azimuth noise", unit="deg", minimum=0.0, minimum_excluded=True, default=0.3
    )
    range_rate_std_mps: float = key(
        "noise of the range rate, sum or difference of range rates",
        unit="m/s",
        minimum=0.0,
        minimum_excluded=True,
        default=1.0,
    )
    false_alarms_per_scan: float = key("Poisson mean", minimum=0.0, maximum=1e6, default=0.0)
    range_extent_m: tuple[float, float] = key(
        "false alarms are uniform between", unit="m", default=(0.0, 50_000.0)
    )
    busy_sector_deg: tuple[float, float] = key(
        "azimuths [from, to], counter-clockwise from East, of a sector with more false alarms",
        unit="deg",
        default=(0.0, 0.0),
    )
    busy_share: float = key(
        "of the false alarms that lie in that sector; the tracker is told that all are uniform",
        minimum=0.0,
        maximum=1.0,
        default=0.0,
    )
    range_rate_extent_mps: tuple[float, float] = key(
        "false alarms are uniform between", unit="m/s", default=(-300.0, 300.0)
    )

    def __post_init__(self) -> None:
        """Refuse empty extents and a reference at the sensor itself."""
        for name in ("range_extent_m", "range_rate_extent_mps"):
            low, high = getattr(self, name)
            if not low < high:
                raise ParameterError(
                    f"{name} = [{low:g}, {high:g}]: allowed is [low, high], low < high"
                )
        low, high = self.busy_sector_deg
        sector = AZIMUTH in self.measured.quantities and low < high <= low + 360.0
        if self.busy_share > 0.0 and not sector:
            raise ParameterError(
                f"busy_share = {self.busy_share:g}: allowed is 0 without azimuths, or without a "
                f"busy_sector_deg [low, high] of at most a turn, now [{low:g}, {high:g}]"
            )
        if self.measured.has_reference and self.reference_position_m == self.position_m:
            x, y = self.reference_position_m
            raise ParameterError(
                f"reference_position_m = [{x:g}, {y:g}]: allowed is another place than position_m "
                f"for model {self.model}"
            )

    @property
    def measured(self) -> MeasurementModel:
        """The measurement model."""
        return MEASUREMENT_MODELS.get(self.model, POLAR)

    @property
    def extents(self) -> list[tuple[float, float]]:
        """Where false alarms lie, for each measured quantity."""
        known = {
            RANGE: self.range_extent_m,
            AZIMUTH: (-math.pi, math.pi),
            RANGE_RATE: self.range_rate_extent_mps,
        }
        return [known[quantity] for quantity in self.measured.quantities]

    @property
    def clutter_density(self) -> float:
        """False alarms per scan and unit of the measurement space."""
        return self.false_alarms_per_scan / math.prod(high - low for low, high in self.extents)

    def false_alarms(self, rng: np.random.Generator) -> FloatArray:
        """False alarms (n, m) of one scan."""
        low, high = np.array(self.extents).T
        count = rng.poisson(self.false_alarms_per_scan)
        found = rng.uniform(low, high, (count, len(low)))
        if self.busy_share > 0.0:
            azimuth = self.measured.quantities.index(AZIMUTH)
            start, end = np.radians(self.busy_sector_deg)
            # Outside the sector they are uniform over the turn, what falls on it included.
            busy = rng.random(count) < self.busy_share
            found[busy, azimuth] = rng.uniform(start, end, np.count_nonzero(busy))
        return found

    def true_clutter_density(self, azimuth_rad: FloatArray) -> FloatArray:
        """False alarms per scan and unit of the measurement space at azimuths (P,)."""
        low, high = np.radians(self.busy_sector_deg)
        density = np.full(len(azimuth_rad), (1.0 - self.busy_share) * self.clutter_density)
        if self.busy_share > 0.0:
            inside = np.mod(azimuth_rad - low, 2.0 * math.pi) < high - low
            busy = self.busy_share * self.clutter_density * 2.0 * math.pi / (high - low)
            density[inside] += busy
        return density

    @property
    def deviations(self) -> list[float]:
        """Standard deviation of each measured quantity [m, rad, m/s]."""
        known = {
            RANGE: self.range_std_m,
            AZIMUTH: math.radians(self.azimuth_std_deg),
            RANGE_RATE: self.range_rate_std_mps,
        }
        return [known[quantity] for quantity in self.measured.quantities]


@dataclass(frozen=True)
class ReachSection:
    """Section ``reach``: where the tracker is told to look for targets, and how they are scored."""

    nearest_m: float = key("from the sensor", unit="m", minimum=0.0, minimum_excluded=True)
    farthest_m: float = key("from the sensor or pair", unit="m", minimum=0.0, minimum_excluded=True)
    max_speed_mps: float = key("of a target", unit="m/s", minimum=0.0, minimum_excluded=True)
    match_distance_m: float = key(
        "how far a track may be from its target", unit="m", minimum=0.0, minimum_excluded=True
    )
    components: int = key("of a Gaussian sum", minimum=2, maximum=100, default=16)
    mht_scans: int = key("decided so many scans later", minimum=1, maximum=60, default=8)


def read_sensors(content: Mapping[str, Any], where: str) -> tuple[ModelledSensor, ...]:
    """Read section ``sensors``.

    Raises
    ------
    ScenarioError
        Naming the section, the key, its value and what is allowed.
    """
    entries = check_list(content["sensors"], f"{where}: sensors", 1)
    sensors = tuple(
        read_section(ModelledSensor, entry, f"{where}: sensors[{index}]")
        for index, entry in enumerate(entries)
    )
    ids = [sensor.id for sensor in sensors]
    if len(set(ids)) < len(ids) or "" in ids:
        raise ScenarioError(f"{where}: sensors: id = {ids}: allowed are names that differ")
    return sensors


def sensor_parameters(sensors: tuple[ModelledSensor, ...], reach: ReachSection) -> dict[str, Any]:
    """Parameters of the track manager that tell it of the sensors."""
    return {
        "sensor_ids": [sensor.id for sensor in sensors],
        "sensor_models": [sensor.model for sensor in sensors],
        "sensor_clutter_densities": [sensor.clutter_density for sensor in sensors],
        "sensor_detection_probabilities": [sensor.detection_probability for sensor in sensors],
        "sensor_range_stds_m": [sensor.range_std_m for sensor in sensors],
        "sensor_azimuth_stds_rad": [math.radians(sensor.azimuth_std_deg) for sensor in sensors],
        "sensor_range_rate_stds_mps": [sensor.range_rate_std_mps for sensor in sensors],
        "max_speed_mps": reach.max_speed_mps,
        "gaussian_sum_nearest_m": reach.nearest_m,
        "gaussian_sum_farthest_m": reach.farthest_m,
        "gaussian_sum_components": reach.components,
        "mht_scans": reach.mht_scans,
    }
