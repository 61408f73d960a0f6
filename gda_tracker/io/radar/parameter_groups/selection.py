"""Parameters of radar_input: which detections are passed on, and which become one."""

from __future__ import annotations

from dataclasses import dataclass

from gda_tracker.parameters import ParameterError, parameter


@dataclass(frozen=True)
class SelectionParameters:
    """Which detections are passed on, and clusters of them that become one."""

    minimum_range_m: float = parameter(0.0, "closer detections are left out", unit="m", minimum=0.0)
    maximum_range_m: float = parameter(
        1e9, "more distant detections are left out", unit="m", minimum=0.0, minimum_excluded=True
    )
    minimum_snr_db: float = parameter(
        -1e6, "detections with a smaller field snr are left out", unit="dB"
    )
    moving_above_mps: float = parameter(
        0.0,
        "detections whose corrected range rate is at most this stand still and are left out; 0: "
        "all are kept",
        unit="m/s",
        minimum=0.0,
    )
    padding_zeros: bool = parameter(
        False, "points with x = y = z = 0 fill up the message and are left out", advanced=True
    )
    cluster_distance_m: float = parameter(
        0.0,
        "detections closer to each other belong to one object and become one detection at their "
        "centroid; 0: each stays",
        unit="m",
        minimum=0.0,
    )
    cluster_range_rate_mps: float = parameter(
        2.0,
        "they belong together only if their range rates differ by less",
        unit="m/s",
        minimum=0.0,
        minimum_excluded=True,
        advanced=True,
    )
    cluster_minimum_points: int = parameter(
        1, "clusters of fewer points are left out", minimum=1, advanced=True
    )
    cluster_extent_m: float = parameter(
        0.5,
        "standard deviation of the centroid about the object's own point, added to the spread of "
        "the mean",
        unit="m",
        minimum=0.0,
        advanced=True,
    )
    cluster_range_rate_std_mps: float = parameter(
        0.2,
        "standard deviation of the mean range rate about the object's own, added to the spread of "
        "the mean: wheels, arms and legs",
        unit="m/s",
        minimum=0.0,
        minimum_excluded=True,
        advanced=True,
    )

    def check(self) -> None:
        """Refuse what does not fit together."""
        if not self.minimum_range_m < self.maximum_range_m:
            raise ParameterError(
                f"parameter maximum_range_m = {self.maximum_range_m}: allowed is a number > "
                f"minimum_range_m = {self.minimum_range_m}"
            )
