"""Parameters of the track manager: extended objects and groups."""

from __future__ import annotations

from dataclasses import dataclass

from gda_tracker.parameters import ParameterError, parameter

NONE, RANDOM_MATRIX = "none", "random_matrix"
EXTENDED_OBJECTS = (NONE, RANDOM_MATRIX)
# The distances of all pairs of detections are looked at.
MOST_DETECTIONS = 5000


@dataclass(frozen=True)
class ExtendedParameters:
    """What objects with several detections a scan are like."""

    extended_objects: str = parameter(
        NONE,
        "none: an object gives one detection a scan at most; random_matrix: objects and groups "
        "give several, all over an ellipse that is estimated with the track",
        choices=EXTENDED_OBJECTS,
    )
    cell_least_distance_m: float = parameter(
        1.0,
        "extended objects: detections nearer to each other always belong to one object",
        unit="m",
        minimum=0.0,
        minimum_excluded=True,
    )
    cell_largest_distance_m: float = parameter(
        10.0,
        "extended objects: detections belong to one object only along chains without a larger gap",
        unit="m",
        minimum=0.0,
        minimum_excluded=True,
    )
    cell_partitions: int = parameter(
        8,
        "extended objects: ways to put detections together that are compared, at most; they "
        "differ in the distance between the two above",
        minimum=1,
        maximum=64,
        advanced=True,
    )
    extent_radius_m: float = parameter(
        5.0,
        "extended objects: radius of a new object as it is expected before its detections speak",
        unit="m",
        minimum=0.0,
        minimum_excluded=True,
    )
    extent_prior_weight: float = parameter(
        4.0,
        "extended objects: how many detections the expected radius of a new object is worth",
        minimum=2.0,
        minimum_excluded=True,
        advanced=True,
    )
    extent_spread: float = parameter(
        0.25,
        "extended objects: covariance of the places where an object reflects, in units of its "
        "extent matrix: 0.25 all over the ellipse, 1 if the extent is to be that covariance itself",
        minimum=0.0,
        minimum_excluded=True,
        advanced=True,
    )
    extent_memory_s: float = parameter(
        10.0,
        "extended objects: time after which what is known of size and shape has faded to 1/e",
        unit="s",
        minimum=0.0,
        minimum_excluded=True,
    )
    extent_turns_with_course: bool = parameter(
        True, "extended objects: the ellipse turns as the course of the track does"
    )
    detections_per_object: float = parameter(
        10.0,
        "extended objects: detections of a new object in a scan, expected before they are counted",
        minimum=0.0,
        minimum_excluded=True,
    )
    detection_rate_memory_s: float = parameter(
        10.0,
        "extended objects: time after which what is known of the number of detections has faded "
        "to 1/e",
        unit="s",
        minimum=0.0,
        minimum_excluded=True,
        advanced=True,
    )
    false_group_ratio: float = parameter(
        0.01,
        "extended objects: groups of detections that are no object and do not last, such as "
        "echoes by way of walls, per false alarm",
        minimum=0.0,
        advanced=True,
    )

    def check_extended(self, max_detections_per_scan: int, clutter_density: float) -> None:
        """Raise :class:`ParameterError` for values that do not fit together."""
        if self.cell_least_distance_m > self.cell_largest_distance_m:
            raise ParameterError(
                f"parameter cell_least_distance_m = {self.cell_least_distance_m}: allowed is at "
                f"most cell_largest_distance_m = {self.cell_largest_distance_m}"
            )
        if self.extended_objects == NONE:
            return
        for name, off in (
            ("signal_strength", NONE),
            ("resolution_range_m", 0.0),
            ("blind_speed_mps", 0.0),
            ("sensor_blind_speeds_mps", []),
        ):
            # Of single detections of point targets, and declared in other groups.
            if getattr(self, name, off) != off:
                raise ParameterError(
                    f"parameter {name} = {getattr(self, name)!r}: allowed with extended_objects = "
                    f"{self.extended_objects!r} is {off!r} only"
                )
        if max_detections_per_scan > MOST_DETECTIONS:
            raise ParameterError(
                f"parameter max_detections_per_scan = {max_detections_per_scan}: allowed with "
                f"extended_objects = {self.extended_objects!r} is at most {MOST_DETECTIONS}"
            )
        if not clutter_density > 0.0:
            raise ParameterError(
                f"parameter clutter_density_per_m_rad = {clutter_density}: allowed with "
                f"extended_objects = {self.extended_objects!r} are numbers > 0"
            )
