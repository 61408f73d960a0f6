"""Parameters of the track manager: sensors that have a model of their own, by their ids."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from gda_tracker.kinematics.measurement_kinds import (
    MEASUREMENT_MODELS,
    RANGE_AZIMUTH,
    SENSOR_MODELS,
)
from gda_tracker.parameters import ParameterError, parameter
from gda_tracker.tracking.parameter_groups.sensor import GIVEN

# What each list of a sensor's own values stands in place of.
OWN_VALUES = {
    "sensor_detection_probabilities": "detection_probability",
    "sensor_clutter_densities": "clutter_density_per_m_rad",
    "sensor_range_stds_m": "range_std_m",
    "sensor_azimuth_stds_rad": "azimuth_std_rad",
    "sensor_range_rate_stds_mps": "range_rate_std_mps",
    "sensor_blind_speeds_mps": "blind_speed_mps",
}


@dataclass(frozen=True)
class SensorModelParameters:
    """Sensors with a model of their own; the lists name one sensor after the other."""

    sensor_ids: list[str] = parameter(
        [],
        "sensors with a model of their own, by the sensor_id of their detections; all others "
        "measure range and azimuth",
        live=False,
        advanced=True,
    )
    sensor_models: list[str] = parameter(
        [],
        "for each of sensor_ids what it measures: range_azimuth; bearing, range, range_doppler, "
        "doppler (range, azimuth and range rate; doppler_rotated: linearised in axes turned to the "
        "azimuth); bistatic, bistatic_doppler (sum of the distances to sensor and transmitter); "
        "tdoa, fdoa, tdoa_fdoa (difference of the distances, and of their rates, to two sensors)",
        choices=SENSOR_MODELS,
        live=False,
        advanced=True,
    )
    sensor_clutter_densities: list[float] = parameter(
        [],
        "for each of sensor_ids the detections per scan that belong to no track, per unit of what "
        "it measures: rad, m, m/s or their product (bearing: 1/rad, tdoa_fdoa: 1/(m m/s))",
        minimum=0.0,
        live=False,
        advanced=True,
    )
    sensor_detection_probabilities: list[float] = parameter(
        [],
        "for each of sensor_ids its detection_probability; empty: that of all",
        minimum=0.0,
        maximum=1.0,
        live=False,
        advanced=True,
    )
    sensor_blind_speeds_mps: list[float] = parameter(
        [],
        "for each of sensor_ids its blind_speed_mps, without effect on those that measure bearings "
        "alone, bistatic ranges or differences; empty: that of all",
        unit="m/s",
        minimum=0.0,
        live=False,
        advanced=True,
    )
    sensor_range_stds_m: list[float] = parameter(
        [],
        "for each of sensor_ids the noise of its range, sum or difference of ranges; empty: "
        "range_std_m",
        unit="m",
        minimum=0.0,
        minimum_excluded=True,
        live=False,
        advanced=True,
    )
    sensor_azimuth_stds_rad: list[float] = parameter(
        [],
        "for each of sensor_ids the noise of its azimuth; empty: azimuth_std_rad",
        unit="rad",
        minimum=0.0,
        maximum=3.2,
        minimum_excluded=True,
        live=False,
        advanced=True,
    )
    sensor_range_rate_stds_mps: list[float] = parameter(
        [],
        "for each of sensor_ids the noise of its range rate, sum or difference of range rates; "
        "empty: range_rate_std_mps",
        unit="m/s",
        minimum=0.0,
        minimum_excluded=True,
        live=False,
        advanced=True,
    )
    sensor_references_m: list[float] = parameter(
        [],
        "for each of sensor_ids x, y, z of its transmitter or second sensor in the tracking frame, "
        "for detections that do not bring it; 0, 0, 0 for models without; empty: all bring it",
        unit="m",
        live=False,
        advanced=True,
    )
    gaussian_sum_start: bool = parameter(
        True,
        "start a track from every detection without one of the sensors with a model other than "
        "range_azimuth, as a Gaussian sum along the ray, circle, ellipse or hyperbola that it "
        "leaves; false: those sensors only keep tracks up that others have started",
        live=False,
        advanced=True,
    )
    gaussian_sum_components: int = parameter(
        16,
        "components of a Gaussian sum, at its start and at most",
        minimum=2,
        maximum=100,
        live=False,
        advanced=True,
    )
    gaussian_sum_nearest_m: float = parameter(
        500.0,
        "nearest distance from the sensor at which a Gaussian sum looks for a target",
        unit="m",
        minimum=0.0,
        minimum_excluded=True,
        live=False,
        advanced=True,
    )
    gaussian_sum_farthest_m: float = parameter(
        50_000.0,
        "farthest distance from the sensor, or the middle of a pair, at which a Gaussian sum looks "
        "for a target",
        unit="m",
        minimum=0.0,
        minimum_excluded=True,
        live=False,
        advanced=True,
    )
    gaussian_sum_smallest_share: float = parameter(
        1e-4,
        "components of a Gaussian sum with less of its weight are left out",
        minimum=0.0,
        maximum=0.5,
        live=False,
        advanced=True,
    )
    gaussian_sum_merge_distance: float = parameter(
        0.5,
        "components of a Gaussian sum nearer to each other than so many standard deviations become "
        "one",
        minimum=0.0,
        live=False,
        advanced=True,
    )

    def check(self) -> None:
        """Raise :class:`ParameterError` for values that do not fit together."""
        ids, count = self.sensor_ids, len(self.sensor_ids)
        if len(set(ids)) < count or "" in ids:
            raise ParameterError(
                f"parameter sensor_ids = {ids}: allowed are names that differ, none of them empty"
            )
        self._check_sizes(count)
        special = [name for name in self.sensor_models if name != RANGE_AZIMUTH]
        if special and not self.sensor_clutter_densities:
            raise ParameterError(
                "parameter sensor_clutter_densities = []: allowed are as many numbers as "
                f"sensor_ids, {count}, with the models {', '.join(special)}"
            )
        estimated = getattr(self, "clutter_density", GIVEN) != GIVEN
        first = zip(self.sensor_models, self.sensor_clutter_densities, strict=False)
        if estimated and any(name in special and density == 0.0 for name, density in first):
            raise ParameterError(
                f"parameters clutter_density = 'estimated' and sensor_clutter_densities = "
                f"{self.sensor_clutter_densities}: allowed are numbers > 0, which the estimate "
                f"begins with, with sensor_models of {', '.join(special)}"
            )
        if not self.gaussian_sum_nearest_m < self.gaussian_sum_farthest_m:
            raise ParameterError(
                f"parameter gaussian_sum_nearest_m = {self.gaussian_sum_nearest_m:g}: allowed is "
                f"less than gaussian_sum_farthest_m = {self.gaussian_sum_farthest_m:g}"
            )

    def _check_sizes(self, count: int) -> None:
        sizes = {"sensor_models": (count,), "sensor_references_m": (0, 3 * count)}
        sizes.update(dict.fromkeys(OWN_VALUES, (0, count)))
        for name, allowed in sizes.items():
            values = getattr(self, name)
            if len(values) not in allowed:
                raise ParameterError(
                    f"parameter {name} = {values}: allowed are {allowed[-1]} entries with "
                    f"{count} sensor_ids" + (", or none" if len(allowed) > 1 else "")
                )

    def model_of(self, sensor_id: str) -> str:
        """Name of the measurement model of a sensor, empty for range and azimuth."""
        if not self.sensor_ids or sensor_id not in self.sensor_ids:
            return ""
        name = self.sensor_models[self.sensor_ids.index(sensor_id)]
        return name if name in MEASUREMENT_MODELS else ""

    def reference_of(self, sensor_id: str) -> tuple[float, ...] | None:
        """Position (3,) of the sensor's transmitter or second sensor, if the parameters know it."""
        if not self.sensor_references_m or sensor_id not in self.sensor_ids:
            return None
        first = 3 * self.sensor_ids.index(sensor_id)
        return tuple(self.sensor_references_m[first : first + 3])

    def of_sensor(self, sensor_id: str) -> Any:
        """The same parameters with the values of one sensor in place of those of all."""
        if not self.sensor_ids or sensor_id not in self.sensor_ids:
            return self
        return self._of_sensors[sensor_id]

    @cached_property
    def _of_sensors(self) -> dict[str, Any]:
        return {
            sensor_id: replace(
                self,
                **{
                    common: getattr(self, name)[place]
                    for name, common in OWN_VALUES.items()
                    if getattr(self, name)
                },
            )
            for place, sensor_id in enumerate(self.sensor_ids)
        }
