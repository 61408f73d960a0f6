"""The table that declares which events are looked for, and with what errors."""

from __future__ import annotations

from dataclasses import dataclass

from gda_tracker.events.sequential import DIRECTION_LOSS
from gda_tracker.parameters import ParameterError, parameter
from gda_tracker.tracking.extraction import SequentialTest, sequential_test

TESTS = ("lanes", "plans", "stops", "accelerations", "splits")


@dataclass(frozen=True)
class EventParameters:
    """Which tests run, their error probabilities and where their hypotheses part."""

    context_file: str = parameter(
        "",
        "YAML file with lanes and plans (docs/track-events.md); empty: none, only stops, "
        "accelerations and splits are looked for",
    )
    tests: list[str] = parameter(list(TESTS), "what is tested", choices=TESTS)
    false_alarm_probability: float = parameter(
        0.001,
        "chance that one test accepts the unusual (h1: lane left, off the plan, stopped, "
        "accelerates, split off) although it is not so",
        minimum=0.0,
        minimum_excluded=True,
        maximum=0.499,
    )
    miss_probability: float = parameter(
        0.01,
        "chance that one test accepts the usual (h0) although h1 holds",
        minimum=0.0,
        minimum_excluded=True,
        maximum=0.499,
    )
    independence_factor: float = parameter(
        3.0,
        "a track's state is used again after so many of its filter's memories, the square root of "
        "position variance over velocity variance; below 2 the states are correlated and the "
        "errors larger than asked for",
        minimum=1.0,
        maximum=20.0,
        advanced=True,
    )
    covariance_factor: float = parameter(
        1.0,
        "covariances of tracks are taken so many times as large; more than 1 where the tracker is "
        "too sure of itself (NEES above its bounds)",
        minimum=1.0,
        maximum=100.0,
        advanced=True,
    )
    lane_heading_tolerance_rad: float = parameter(
        0.6,
        "a track is taken to be on a lane while it moves along it within this angle, in either "
        "direction; what crosses is not tested",
        unit="rad",
        minimum=0.0,
        minimum_excluded=True,
        maximum=1.571,
    )
    wrong_way_speed_mps: float = parameter(
        2.0,
        "speed against a lane's direction that counts as driving the wrong way",
        unit="m/s",
        minimum=0.0,
        minimum_excluded=True,
        maximum=1e4,
    )
    stopped_speed_mps: float = parameter(
        0.5,
        "largest speed of what has stopped",
        unit="m/s",
        minimum=0.0,
        maximum=1e4,
    )
    moving_speed_mps: float = parameter(
        2.0,
        "least speed of what moves; must exceed stopped_speed_mps",
        unit="m/s",
        minimum=0.0,
        minimum_excluded=True,
        maximum=1e4,
    )
    blind_speed_mps: float = parameter(
        0.0,
        "tracks of a radar that drops slow echoes, as blind_speed_mps of track_manager: that a "
        "track is not seen counts for a stop (docs/track-events.md); moving_speed_mps should be "
        "well above; 0: only states are looked at",
        unit="m/s",
        minimum=0.0,
        maximum=1e4,
    )
    detection_probability: float = parameter(
        0.9,
        "blind_speed_mps: chance that a target far from the blind zone is detected",
        minimum=0.0,
        minimum_excluded=True,
        maximum=0.999,
    )
    sensor_position_m: list[float] = parameter(
        [0.0, 0.0],
        "blind_speed_mps: x, y of the radar in the tracking frame",
        unit="m",
    )
    blind_turn_rad: float = parameter(
        0.3,
        "blind_speed_mps: a target that moves may have turned so far since its course was last "
        "seen; what may have turned across the line of sight is not told to have stopped",
        unit="rad",
        minimum=0.0,
        maximum=1.571,
        advanced=True,
    )
    blind_false_detection_probability: float = parameter(
        0.05,
        "blind_speed_mps: chance that a false alarm passes for the detection of a track that is "
        "not seen",
        minimum=0.0,
        maximum=0.5,
        advanced=True,
    )
    steady_acceleration_mps2: float = parameter(
        0.5,
        "largest acceleration, along or across, that is usual",
        unit="m/s2",
        minimum=0.0,
        maximum=1e4,
    )
    event_acceleration_mps2: float = parameter(
        2.0,
        "least acceleration that is an event, held over the time between two independent states; "
        "must exceed steady_acceleration_mps2 by 4 %",
        unit="m/s2",
        minimum=0.0,
        minimum_excluded=True,
        maximum=1e4,
    )
    split_radius_m: float = parameter(
        50.0,
        "a new track is taken to come from a confirmed one that is nearer than this",
        unit="m",
        minimum=0.0,
        minimum_excluded=True,
        maximum=1e6,
    )
    split_departure_m: float = parameter(
        100.0,
        "distance between them at which it has split off; must exceed split_radius_m by 4 %",
        unit="m",
        minimum=0.0,
        minimum_excluded=True,
        maximum=1e6,
    )
    split_watch_s: float = parameter(
        120.0,
        "new tracks are watched for so long",
        unit="s",
        minimum=0.0,
        minimum_excluded=True,
        maximum=1e6,
    )

    def __post_init__(self) -> None:
        """Refuse hypotheses that do not part."""
        for usual, unusual, loss in (
            ("stopped_speed_mps", "moving_speed_mps", 1.0),
            ("steady_acceleration_mps2", "event_acceleration_mps2", DIRECTION_LOSS),
            ("split_radius_m", "split_departure_m", DIRECTION_LOSS),
        ):
            low, high = getattr(self, usual), getattr(self, unusual)
            if not high * loss > low:
                raise ParameterError(
                    f"parameter {unusual} = {high}: allowed is a number > {low / loss:.6g}, as "
                    f"{usual} = {low}"
                )

        if len(self.sensor_position_m) != 2:
            raise ParameterError(
                f"parameter sensor_position_m = {self.sensor_position_m}: allowed is a list of 2 "
                "numbers"
            )
        if self.blind_speed_mps and not self.stopped_speed_mps < self.blind_speed_mps:
            raise ParameterError(
                f"parameter blind_speed_mps = {self.blind_speed_mps}: allowed is 0 or a number > "
                f"stopped_speed_mps = {self.stopped_speed_mps}: what has stopped is hidden"
            )

    def thresholds(self) -> SequentialTest:
        """Return log A and log B of every test."""
        return sequential_test(self.false_alarm_probability, self.miss_probability)
