"""Parameters of radar_input: where the radar is and how it moves: declared, TF, odometry."""

from __future__ import annotations

from dataclasses import dataclass

from gda_tracker.parameters import ParameterError, parameter

RANGE_RATE_REFERENCES = ("sensor", "ground")
SENSOR_MOTIONS = ("declared", "estimated", "tf", "odometry")
POSE_SOURCES = ("declared", "tf", "odometry")
# Types of messages that tell how a vehicle moves.
ODOMETRY = "nav_msgs/msg/Odometry"
TWIST = "geometry_msgs/msg/TwistStamped"
TWIST_WITH_COVARIANCE = "geometry_msgs/msg/TwistWithCovarianceStamped"
ODOMETRY_TYPES = (ODOMETRY, TWIST, TWIST_WITH_COVARIANCE)


@dataclass(frozen=True)
class MotionParameters:
    """Where the radar is, and how it moves."""

    sensor_speed_mps: float = parameter(
        0.0,
        "speed of the radar along its x axis (the car's own speed for one that looks ahead); what "
        "stands still is told by the range rates corrected by it",
        unit="m/s",
        minimum=-1e4,
        maximum=1e4,
    )
    sensor_speed_left_mps: float = parameter(
        0.0,
        "speed of the radar along its y axis, for one that looks sideways from a car",
        unit="m/s",
        minimum=-1e4,
        maximum=1e4,
    )
    sensor_motion: str = parameter(
        "declared",
        "where the radar's own speed comes from: declared (the two parameters above), estimated "
        "(from each scan: the speed at which most of its points stand still), tf (from its poses "
        "on /tf) or odometry (from the vehicle's twist on odometry_topic and the mounting pose)",
        choices=SENSOR_MOTIONS,
    )
    pose_source: str = parameter(
        "declared",
        "where the radar's pose in the tracking frame comes from: declared (the next two "
        "parameters), tf (/tf and /tf_static at the time of each scan) or odometry (the vehicle's "
        "pose on odometry_topic; the next two parameters are the mounting pose in its frame)",
        choices=POSE_SOURCES,
        live=False,
    )
    sensor_position_m: list[float] = parameter(
        [0.0, 0.0, 0.0],
        "x, y, z of the radar in the tracking frame, or on the vehicle with odometry",
        unit="m",
        minimum=-1e9,
        maximum=1e9,
    )
    sensor_roll_pitch_yaw_deg: list[float] = parameter(
        [0.0, 0.0, 0.0],
        "turn of the radar's axes in the tracking frame, or on the vehicle with odometry, about "
        "its x, then y, then z axis; yaw is counter-clockwise, a positive pitch looks down",
        unit="deg",
        minimum=-360.0,
        maximum=360.0,
    )
    tracking_frame: str = parameter(
        "map",
        "with pose_source tf or odometry: frame of the tracks, the same as in track_manager",
        live=False,
    )
    sensor_frame: str = parameter(
        "",
        "with tf: frame of the radar; empty: the one that its messages name",
        live=False,
        advanced=True,
    )
    motion_frame: str = parameter(
        "",
        "with sensor_motion tf: frame in which the ground stands still, e.g. odom; empty: the "
        "tracking frame",
        live=False,
        advanced=True,
    )
    motion_interval_s: float = parameter(
        0.1,
        "with sensor_motion tf: the radar's own speed is the mean over so long before the scan",
        unit="s",
        minimum=0.001,
        maximum=10.0,
        advanced=True,
    )
    tf_timeout_s: float = parameter(
        0.5,
        "with tf and odometry: a scan waits for its transform or report no longer than this on the "
        "clock on the wall",
        unit="s",
        minimum=0.0,
        maximum=60.0,
        advanced=True,
    )
    odometry_topic: str = parameter(
        "odom",
        "with odometry: topic on which the vehicle tells how it moves",
        live=False,
    )
    odometry_type: str = parameter(
        "",
        "type of that topic; empty: the one that is found on it",
        choices=("", *ODOMETRY_TYPES),
        live=False,
        advanced=True,
    )
    odometry_frame: str = parameter(
        "",
        "with odometry: the vehicle's own frame, reports of another one are refused; empty: that "
        "of the first report",
        live=False,
        advanced=True,
    )
    odometry_gap_s: float = parameter(
        0.5,
        "with odometry: a scan between two reports that are farther apart is dropped",
        unit="s",
        minimum=0.001,
        maximum=60.0,
        advanced=True,
    )
    maximum_tilt_deg: float = parameter(
        30.0,
        "a radar that measures no elevation and is tilted by more than this is refused: where its "
        "detections lie over the plane cannot be told",
        unit="deg",
        minimum=0.0,
        maximum=90.0,
        advanced=True,
    )
    range_rate_reference: str = parameter(
        "sensor",
        "range rates that are passed on: sensor (as measured; fits tracks in a frame that moves "
        "with the radar) or ground (corrected by the radar's own speed; fits a fixed frame in "
        "which the radar's pose is known); the two are the same for a radar that stands",
        choices=RANGE_RATE_REFERENCES,
    )

    def check(self) -> None:
        """Refuse what does not fit together."""
        for name in ("sensor_position_m", "sensor_roll_pitch_yaw_deg"):
            if len(getattr(self, name)) != 3:
                raise ParameterError(
                    f"parameter {name} = {getattr(self, name)}: allowed are 3 numbers"
                )
        if self.pose_source != "declared" and not self.tracking_frame:
            raise ParameterError(
                f"parameter tracking_frame is empty: pose_source {self.pose_source} needs a frame"
            )
        if self.uses_odometry and not self.odometry_topic:
            raise ParameterError("parameter odometry_topic is empty: odometry needs a topic")
        if self.pose_source == "odometry" and self.odometry_type not in ("", ODOMETRY):
            raise ParameterError(
                f"parameter odometry_type = {self.odometry_type!r}: pose_source odometry needs "
                f"{ODOMETRY}, a twist tells no pose"
            )
        if self.sensor_motion == "tf" and self.pose_source != "tf" and not self.motion_frame:
            raise ParameterError(
                "parameter sensor_motion = 'tf': allowed with pose_source tf, or with motion_frame"
            )

    @property
    def uses_transforms(self) -> bool:
        """Whether poses or speeds come from ``/tf``."""
        return self.pose_source == "tf" or self.sensor_motion == "tf"

    @property
    def uses_odometry(self) -> bool:
        """Whether poses or speeds come from ``odometry_topic``."""
        return "odometry" in (self.pose_source, self.sensor_motion)
