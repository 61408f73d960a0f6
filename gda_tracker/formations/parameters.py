"""The table that declares what a formation is and how its objects are counted."""

from __future__ import annotations

from dataclasses import dataclass

from gda_tracker.events.sequential import DIRECTION_LOSS
from gda_tracker.formations.resolution import MOST_OBJECTS
from gda_tracker.parameters import ParameterError, parameter
from gda_tracker.tracking.extraction import SequentialTest, sequential_test


@dataclass(frozen=True)
class FormationParameters:
    """Who flies together, how many there may be, and the errors of all decisions."""

    largest_number: int = parameter(
        MOST_OBJECTS,
        f"N, the most objects that one formation is taken to have; at most {MOST_OBJECTS} with a "
        "limited resolution",
        minimum=1,
        maximum=20,
    )
    overcount_probability: float = parameter(
        0.001,
        "chance that one test accepts more objects than there are",
        minimum=0.0,
        minimum_excluded=True,
        maximum=0.499,
    )
    undercount_probability: float = parameter(
        0.001,
        "chance that one test accepts fewer objects than there are",
        minimum=0.0,
        minimum_excluded=True,
        maximum=0.499,
    )
    number_change_s: float = parameter(
        600.0,
        "mean time between two changes of the number of objects, for its probabilities; 0: it "
        "never changes (the decision needs no such time)",
        unit="s",
        minimum=0.0,
        maximum=1e9,
    )
    together_distance_m: float = parameter(
        1000.0,
        "tracks no farther from each other fly together (h0); formations are chains of such "
        "pairs, and twice the usual spacing lets a chain survive the loss of a track. A new track "
        "is also taken to have begun beside a confirmed one within it",
        unit="m",
        minimum=0.0,
        minimum_excluded=True,
        maximum=1e6,
    )
    apart_distance_m: float = parameter(
        2000.0,
        "tracks at least so far from each other do not (h1); must exceed together_distance_m by "
        "4 %",
        unit="m",
        minimum=0.0,
        minimum_excluded=True,
        maximum=1e7,
    )
    together_speed_mps: float = parameter(
        10.0,
        "velocities of tracks that fly together (h0) differ by no more",
        unit="m/s",
        minimum=0.0,
        minimum_excluded=True,
        maximum=1e4,
    )
    apart_speed_mps: float = parameter(
        40.0,
        "velocities that differ by so much are of tracks that do not (h1); must exceed "
        "together_speed_mps by 4 %",
        unit="m/s",
        minimum=0.0,
        minimum_excluded=True,
        maximum=1e5,
    )
    false_split_probability: float = parameter(
        0.001,
        "chance that one test of a pair of tracks accepts apart although they are together",
        minimum=0.0,
        minimum_excluded=True,
        maximum=0.499,
    )
    false_merge_probability: float = parameter(
        0.01,
        "chance that one test of a pair of tracks accepts together although they are apart",
        minimum=0.0,
        minimum_excluded=True,
        maximum=0.499,
    )
    spread_std_m: float = parameter(
        100.0,
        "standard deviation of the places of objects about the centroid beside what the tracks "
        "tell; of a formation with one track all there is",
        unit="m",
        minimum=0.0,
        minimum_excluded=True,
        maximum=1e6,
    )
    uniform_share: float = parameter(
        0.2,
        "chance that an object is anywhere in the formation's gate and not at one of its tracks; 1 "
        "counts the detections in the gate alone",
        minimum=0.0,
        minimum_excluded=True,
        maximum=1.0,
        advanced=True,
    )
    resolution_range_m: float = parameter(
        0.0,
        "distance in range at which two objects are resolved half of the time; 0: they always are. "
        "Goes with resolution_azimuth_rad",
        unit="m",
        minimum=0.0,
        maximum=1e6,
    )
    resolution_azimuth_rad: float = parameter(
        0.0,
        "the same in azimuth; 0: they always are",
        unit="rad",
        minimum=0.0,
        maximum=3.14,
    )
    independence_factor: float = parameter(
        3.0,
        "a pair of tracks is tested again after so many of their filters' memories, as in "
        "track_events",
        minimum=1.0,
        maximum=20.0,
        advanced=True,
    )

    def __post_init__(self) -> None:
        """Refuse hypotheses that do not part, half a resolution, and too many objects for it."""
        for usual, unusual in (
            ("together_distance_m", "apart_distance_m"),
            ("together_speed_mps", "apart_speed_mps"),
        ):
            low, high = getattr(self, usual), getattr(self, unusual)
            if not high * DIRECTION_LOSS > low:
                raise ParameterError(
                    f"parameter {unusual} = {high}: allowed is a number > "
                    f"{low / DIRECTION_LOSS:.6g}, as {usual} = {low}"
                )
        if (self.resolution_range_m > 0.0) != (self.resolution_azimuth_rad > 0.0):
            raise ParameterError(
                f"parameters resolution_range_m = {self.resolution_range_m} and "
                f"resolution_azimuth_rad = {self.resolution_azimuth_rad}: allowed are both > 0, or "
                "both 0"
            )
        if self.limited_resolution and self.largest_number > MOST_OBJECTS:
            raise ParameterError(
                f"parameter largest_number = {self.largest_number}: allowed are numbers <= "
                f"{MOST_OBJECTS}, as resolution_range_m = {self.resolution_range_m}"
            )

    @property
    def limited_resolution(self) -> bool:
        """Whether objects may be too close to be told apart."""
        return self.resolution_range_m > 0.0

    def pair_test(self) -> SequentialTest:
        """Return log A and log B of the tests of pairs of tracks."""
        return sequential_test(self.false_split_probability, self.false_merge_probability)
