"""Parameters of the track manager: noise of the sensor, what it sees and what it makes up."""

from __future__ import annotations

from dataclasses import dataclass

from gda_tracker.parameters import parameter

GIVEN, ESTIMATED = "given", "estimated"
CLUTTER_DENSITIES = (GIVEN, ESTIMATED)


@dataclass(frozen=True)
class SensorParameters:
    """What the sensor does."""

    range_std_m: float = parameter(
        30.0,
        "range noise of detections that bring none of their own",
        unit="m",
        minimum=0.0,
        minimum_excluded=True,
    )
    azimuth_std_rad: float = parameter(
        0.005,
        "azimuth noise of detections that bring none of their own",
        unit="rad",
        minimum=0.0,
        maximum=3.2,
        minimum_excluded=True,
    )
    elevation_std_rad: float = parameter(
        0.01,
        "elevation noise of detections that bring none of their own",
        unit="rad",
        minimum=0.0,
        maximum=3.2,
        minimum_excluded=True,
        advanced=True,
    )
    range_rate_std_mps: float = parameter(
        1.0,
        "range-rate noise of detections that bring none of their own",
        unit="m/s",
        minimum=0.0,
        minimum_excluded=True,
        advanced=True,
    )
    use_range_rate: bool = parameter(
        True,
        "update states also with the range rates that detections bring; false for a sensor whose "
        "own motion is still in them",
        advanced=True,
    )
    detection_probability: float = parameter(
        0.9, "chance that a target is detected on a scan", minimum=0.0, maximum=1.0
    )
    detection_probability_map: str = parameter(
        GIVEN,
        "given: detection_probability everywhere; estimated: by region of range and azimuth, from "
        "hits and misses of confirmed tracks, beginning with it",
        choices=CLUTTER_DENSITIES,
    )
    detection_memory_scans: float = parameter(
        200.0,
        "estimated: scans after which a hit or a miss has faded to 1/e",
        minimum=2.0,
        advanced=True,
    )
    gate_probability: float = parameter(
        0.99,
        "chance that a target's own detection lies in its gate",
        minimum=0.0,
        maximum=0.999999,
        minimum_excluded=True,
    )
    clutter_density_per_m_rad: float = parameter(
        1e-6,
        "detections per scan, metre of range and radian of azimuth that belong to no track",
        unit="1/(m rad)",
        minimum=0.0,
    )
    clutter_density: str = parameter(
        GIVEN,
        "given: clutter_density_per_m_rad everywhere; estimated: by region of range and azimuth, "
        "from detections without a confirmed track, beginning with it; of sensors with a model of "
        "their own by region of what they measure, beginning with sensor_clutter_densities",
        choices=CLUTTER_DENSITIES,
    )
    clutter_memory_scans: float = parameter(
        50.0,
        "estimated: scans after which a detection has faded to 1/e",
        minimum=2.0,
        advanced=True,
    )
