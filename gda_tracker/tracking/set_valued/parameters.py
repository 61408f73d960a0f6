"""Parameters of the set-valued tracker."""

from __future__ import annotations

import math
from dataclasses import dataclass

from gda_tracker.kinematics.set_valued.association_test import MEASUREMENT, SPACES, AssociationTest
from gda_tracker.parameters import ParameterError, parameter
from gda_tracker.tracking.door import DefaultNoise

# Scans of detections that a set remembers.
MEMORY_SCANS = 16

ALL, CONFIRMED_TRACKS, LEADING = "all", "confirmed", "leading"
CLAIMANTS = (ALL, CONFIRMED_TRACKS, LEADING)
NEVER, AMBIGUOUS, ALWAYS = "never", "ambiguous", "always"
MISS_BRANCHES = (NEVER, AMBIGUOUS, ALWAYS)
JOINT, EACH = "joint", "each"
LEADING_SETS = (JOINT, EACH)


@dataclass(frozen=True)
class AssociationParameters:
    """What a set may own."""

    boldness: float = parameter(
        0.5,
        "b of the association test: at 1 as many associations are rejected as possible, near 0 as "
        "few; docs/set-valued-tracking.md measures it",
        minimum=0.0,
        maximum=1.0,
    )
    theta: float = parameter(
        6.0,
        "half width of the seriously possible region about a detection, in its standard "
        "deviations: what no member of a set predicts within it is not the set's",
        minimum=0.0,
        maximum=1000.0,
        minimum_excluded=True,
    )
    test_space: str = parameter(
        MEASUREMENT,
        "space of the credal density: measurement (answers do not depend on the unit of length) or "
        "state (as printed in the paper)",
        choices=SPACES,
        advanced=True,
    )


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
        maximum=0.5,
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
    detection_probability: float = parameter(
        0.9,
        "chance that a target is detected on a scan; scores a miss",
        minimum=0.01,
        maximum=0.9999,
    )
    clutter_density_per_m_rad: float = parameter(
        1e-6,
        "false detections per scan, metre of range and radian of azimuth; scores a detection",
        unit="1/(m rad)",
        minimum=0.0,
        minimum_excluded=True,
    )


@dataclass(frozen=True)
class MotionParameters:
    """What is known of a target before and between its detections."""

    process_noise_std_mps2: float = parameter(
        2.0,
        "acceleration of targets, standard deviation per scan",
        unit="m/s2",
        minimum=0.0,
    )
    initial_position_radius_m: float = parameter(
        10_000.0,
        "K of the set before its first detection: positions up to so far away are all equally "
        "good means",
        unit="m",
        minimum=0.0,
        maximum=1e9,
    )
    initial_position_std_m: float = parameter(
        1000.0,
        "P of the set before its first detection: standard deviation about each mean; the larger, "
        "the less is left of the radius after the detection",
        unit="m",
        minimum=0.0,
        maximum=1e9,
        minimum_excluded=True,
    )
    initial_speed_radius_mps: float = parameter(
        300.0,
        "K of the set before its first detection: velocities up to this speed are all equally "
        "good means",
        unit="m/s",
        minimum=0.0,
        maximum=1e6,
    )
    initial_speed_std_mps: float = parameter(
        100.0,
        "P of the set before its first detection: standard deviation about each mean velocity",
        unit="m/s",
        minimum=0.0,
        maximum=1e6,
        minimum_excluded=True,
    )


@dataclass(frozen=True)
class LifeParameters:
    """Which sets live."""

    miss_branches: str = parameter(
        ALWAYS,
        "when a set that may own detections also lives on without any: never, ambiguous (it may "
        "own several, or another track's set may own one of its detections too) or always",
        choices=MISS_BRANCHES,
        advanced=True,
    )
    leading_sets: str = parameter(
        JOINT,
        "which set speaks for its track: those with the best sum of scores of which no two have "
        "the same detection (joint), or the best scored of each track (each)",
        choices=LEADING_SETS,
        advanced=True,
    )
    initiation_claims: str = parameter(
        ALL,
        "which detections start no set: those that any set may own (all), a set of a confirmed "
        "track may own (confirmed), or only those that the leading set of a track was made with "
        "(leading)",
        choices=CLAIMANTS,
        advanced=True,
    )
    confirmation_hits: int = parameter(
        3, "detections that confirm a track", minimum=1, maximum=MEMORY_SCANS
    )
    confirmation_scans: int = parameter(
        4, "the last scans in which they are counted", minimum=1, maximum=MEMORY_SCANS
    )
    max_coasted_scans: int = parameter(
        4, "scans without a detection after which a set of a confirmed track ends", minimum=0
    )
    tentative_max_coasted_scans: int = parameter(
        1,
        "the same for a track that is not confirmed",
        minimum=0,
        advanced=True,
    )
    score_margin: float = parameter(
        10.0,
        "a set ends whose score is less than that of its track's leading set by more",
        minimum=0.0,
        advanced=True,
    )
    merge_distance: float = parameter(
        1.0,
        "two sets of a track become one, the better scored, if their centroids differ by less "
        "under P + K K'; 0: only by merge_scans",
        minimum=0.0,
        advanced=True,
    )
    merge_scans: int = parameter(
        3,
        "two sets of a track become one if their last detections of so many scans are the same",
        minimum=1,
        maximum=MEMORY_SCANS,
        advanced=True,
    )
    duplicate_scans: int = parameter(
        2,
        "of sets of different tracks with the same detections in so many scans only one stays: "
        "one that leads its track before others, then confirmed before tentative, then the better "
        "score; 0: all stay",
        minimum=0,
        maximum=MEMORY_SCANS,
        advanced=True,
    )
    max_sets_per_track: int = parameter(
        10, "the leading set and the best scored stay", minimum=1, maximum=100, advanced=True
    )
    max_sets: int = parameter(
        500,
        "sets of all tracks together; those of confirmed tracks stay before others, then the "
        "better rank within their track, then the better score",
        minimum=1,
        maximum=10_000,
        advanced=True,
    )


@dataclass(frozen=True)
class DoorParameters:
    """What comes in."""

    tracking_frame: str = parameter(
        "map", "frame in which sensor poses are given and sets are published", live=False
    )
    max_detections_per_scan: int = parameter(
        1000, "a scan with more is rejected", minimum=1, maximum=100_000, advanced=True
    )
    time_jump_s: float = parameter(
        10.0,
        "a stamp older than the newest by less is late, by more a restarted time axis (all sets "
        "end, ids go on)",
        unit="s",
        minimum=0.0,
        advanced=True,
    )
    detections_depth: int = parameter(
        100,
        "queue depth of the subscription to detections",
        minimum=1,
        maximum=10_000,
        live=False,
        advanced=True,
    )
    detections_reliability: str = parameter(
        "best_effort",
        "reliability of the subscription to detections; best_effort hears every publisher",
        choices=("best_effort", "reliable"),
        live=False,
        advanced=True,
    )
    ellipse_scale: float = parameter(
        1.0,
        "markers: the set of means, enlarged by so many standard deviations of P; 0: the bare set",
        minimum=0.0,
        maximum=100.0,
        advanced=True,
    )
    scan_reports: bool = parameter(
        False,
        "answer every scan on scan_reports, so that a replaying source can wait for the answer; "
        "only where no track_manager answers already",
        live=False,
    )


# The last group first: a dataclass takes its fields from its last base first.
@dataclass(frozen=True)
class SetValuedParameters(
    DoorParameters, LifeParameters, MotionParameters, SensorParameters, AssociationParameters
):
    """What the set-valued tracker is told."""

    def __post_init__(self) -> None:
        """Refuse values that do not go together."""
        if self.confirmation_hits > self.confirmation_scans:
            raise ParameterError(
                f"parameter confirmation_hits = {self.confirmation_hits}: allowed is at most "
                f"confirmation_scans = {self.confirmation_scans}"
            )

    @property
    def test(self) -> AssociationTest:
        """The association test."""
        return AssociationTest(self.boldness, self.theta, self.test_space)

    @property
    def noise(self) -> DefaultNoise:
        """Noise of detections that bring none; range rates are not used."""
        return DefaultNoise(self.range_std_m, self.azimuth_std_rad, self.elevation_std_rad, 1.0)

    @property
    def log_detected(self) -> float:
        """Logarithm of the chance that a target is detected."""
        return math.log(self.detection_probability)

    @property
    def log_missed(self) -> float:
        """Logarithm of the chance that it is not."""
        return math.log1p(-self.detection_probability)
