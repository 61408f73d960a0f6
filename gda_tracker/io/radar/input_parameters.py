"""The table that declares what a radar's fields mean: names, units, signs, radar cross section."""

from __future__ import annotations

import math
from dataclasses import dataclass

from gda_tracker.io.radar.point_cloud import TYPE_NAMES
from gda_tracker.parameters import ParameterError, parameter

ANGLE_UNITS = ("rad", "deg")
RCS_UNITS = ("none", "dbsm", "m2")
RANGE_RATE_REFERENCES = ("sensor", "ground")
SENSOR_MOTIONS = ("declared", "estimated", "tf", "odometry")
POSE_SOURCES = ("declared", "tf", "odometry")
# Types of messages that tell how a vehicle moves.
ODOMETRY = "nav_msgs/msg/Odometry"
TWIST = "geometry_msgs/msg/TwistStamped"
TWIST_WITH_COVARIANCE = "geometry_msgs/msg/TwistWithCovarianceStamped"
ODOMETRY_TYPES = (ODOMETRY, TWIST, TWIST_WITH_COVARIANCE)
# Types of messages that are read.
POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
RADAR_SCAN = "radar_msgs/msg/RadarScan"
RADAR_TRACKS = "radar_msgs/msg/RadarTracks"
RADAR_TYPES = (POINT_CLOUD, RADAR_SCAN, RADAR_TRACKS)
STAMP_SOURCES = ("header", "received")
# Names under which drivers publish a quantity, in the order in which they are looked for. A signal
# strength is never taken for a radar cross section.
ALIASES: dict[str, tuple[str, ...]] = {
    "x": ("x",),
    "y": ("y",),
    "z": ("z",),
    "range": ("range", "Range", "r"),
    "azimuth": ("azimuth", "azimuth_angle", "AzimuthAngle"),
    "elevation": ("elevation", "elevation_angle", "ElevationAngle"),
    "range_rate": (
        "range_rate",
        "radial_speed",
        "doppler_velocity",
        "doppler",
        "Velocity",
        "radar_relative_radial_velocity",
    ),
    "rcs": ("rcs",),
    "range_std": ("range_std",),
    "azimuth_std": ("azimuth_std",),
    "elevation_std": ("elevation_std",),
    "range_rate_std": ("range_rate_std",),
    "snr": ("snr", "signal_to_noise_ratio"),
    # Time of each point after the stamp of the scan.
    "time_offset": ("time_offset",),
}
QUANTITIES = tuple(ALIASES)


@dataclass(frozen=True)
class RadarInputParameters:
    """What the fields of a radar mean, and which detections are passed on."""

    sensor_id: str = parameter("radar", "name of the sensor in all messages", live=False)
    input_topic: str = parameter(
        "points",
        "topic of the radar's driver, or udp://HOST:PORT where ASTERIX comes",
        live=False,
    )
    input_type: str = parameter(
        "",
        "type of the topic; empty: the one that is found on it",
        choices=("", *RADAR_TYPES),
        live=False,
        advanced=True,
    )
    stamp_source: str = parameter(
        "header",
        "time of a scan: header (the message's own stamp) or received (when it came, for drivers "
        "that leave the stamp empty)",
        choices=STAMP_SOURCES,
        advanced=True,
    )
    asterix_source: str = parameter(
        "",
        "ASTERIX: the radar to listen to, as SAC/SIC, e.g. 25/201; empty: the one whose plot comes "
        "first, or the only one of a file",
        live=False,
        advanced=True,
    )
    asterix_date: str = parameter(
        "",
        "ASTERIX files without times of capture: day of the first message, e.g. 2026-11-22; empty: "
        "times count from midnight",
        live=False,
        advanced=True,
    )
    position_source: str = parameter(
        "auto",
        "polar: from range and azimuth; cartesian: from x, y and z; auto: polar where there is "
        "range and azimuth",
        choices=("auto", "polar", "cartesian"),
    )
    field_names: list[str] = parameter(
        [],
        "fields that go by other names than the usual ones, as quantity=field, e.g. rcs=s; "
        f"quantity= for one that is not to be used. Quantities: {', '.join(QUANTITIES)}",
    )
    field_types: list[str] = parameter(
        [],
        "types in place of those a driver declares, as field=type, e.g. rcs=float32; one of "
        f"{', '.join(TYPE_NAMES)}",
        advanced=True,
    )
    angle_unit: str = parameter("rad", "unit of azimuth and elevation", choices=ANGLE_UNITS)
    azimuth_sign: int = parameter(
        1,
        "1: azimuth counts counter-clockwise seen from above, -1: clockwise",
        minimum=-1,
        maximum=1,
    )
    azimuth_zero_deg: float = parameter(
        0.0,
        "direction of azimuth 0 in the sensor's frame, counter-clockwise from its x axis: 90 if it "
        "is the y axis",
        unit="deg",
        minimum=-360.0,
        maximum=360.0,
    )
    cartesian_yaw_deg: float = parameter(
        0.0,
        "turn that brings the published x and y to x ahead and y left: 90 where y is ahead and x "
        "right",
        unit="deg",
        minimum=-360.0,
        maximum=360.0,
    )
    elevation_used: bool = parameter(
        True, "pass the elevation on; without it the radar is taken for one in the plane"
    )
    range_rate_sign: int = parameter(
        1,
        "1: a positive range rate goes away from the radar, -1: comes closer",
        minimum=-1,
        maximum=1,
    )
    range_rate_used: bool = parameter(True, "pass the range rate on")
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
    rcs_unit: str = parameter(
        "none",
        "what the field rcs holds after scale and offset: dbsm (dB relative to 1 m2), m2, or none: "
        "it is not used",
        choices=RCS_UNITS,
    )
    rcs_scale: float = parameter(1.0, "the field is multiplied by it", advanced=True)
    rcs_offset: float = parameter(0.0, "then this is added", advanced=True)
    rcs_minimum: float = parameter(
        -1e6, "smaller values count as unknown, in the unit of rcs_unit", advanced=True
    )
    rcs_maximum: float = parameter(
        1e6, "larger values count as unknown, in the unit of rcs_unit", advanced=True
    )
    attribute_fields: list[str] = parameter(
        [],
        "fields that detections bring as further attributes, as name=field, e.g. snr_db=snr; what "
        "they say of a class is declared in rcs_fuzzifier",
    )
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

    def __post_init__(self) -> None:
        """Refuse what does not fit together."""
        for name in ("azimuth_sign", "range_rate_sign"):
            if getattr(self, name) not in (-1, 1):
                raise ParameterError(
                    f"parameter {name} = {getattr(self, name)}: allowed is 1 or -1"
                )
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
        if not self.minimum_range_m < self.maximum_range_m:
            raise ParameterError(
                f"parameter maximum_range_m = {self.maximum_range_m}: allowed is a number > "
                f"minimum_range_m = {self.minimum_range_m}"
            )
        if not self.rcs_minimum < self.rcs_maximum:
            raise ParameterError(
                f"parameter rcs_maximum = {self.rcs_maximum}: allowed is a number > rcs_minimum = "
                f"{self.rcs_minimum}"
            )
        if not math.isfinite(self.rcs_scale) or self.rcs_scale == 0.0:
            raise ParameterError(
                f"parameter rcs_scale = {self.rcs_scale}: allowed is a number other than 0"
            )
        names = _pairs("field_names", self.field_names)
        for quantity in names:
            if quantity not in ALIASES:
                raise ParameterError(
                    f"parameter field_names: quantity {quantity!r}, allowed is one of "
                    f"{', '.join(QUANTITIES)}"
                )
        for field, kind in _pairs("field_types", self.field_types).items():
            if kind not in TYPE_NAMES:
                raise ParameterError(
                    f"parameter field_types: {field}={kind}, allowed is one of "
                    f"{', '.join(TYPE_NAMES)}"
                )
        if "" in _pairs("attribute_fields", self.attribute_fields).values():
            raise ParameterError(
                f"parameter attribute_fields = {self.attribute_fields}: allowed are name=field"
            )

    @property
    def uses_transforms(self) -> bool:
        """Whether poses or speeds come from ``/tf``."""
        return self.pose_source == "tf" or self.sensor_motion == "tf"

    @property
    def uses_odometry(self) -> bool:
        """Whether poses or speeds come from ``odometry_topic``."""
        return "odometry" in (self.pose_source, self.sensor_motion)

    @property
    def type_overrides(self) -> dict[str, str]:
        """Types in place of the declared ones, by field."""
        return _pairs("field_types", self.field_types)

    @property
    def attributes(self) -> dict[str, str]:
        """Fields of the further attributes, by name."""
        return _pairs("attribute_fields", self.attribute_fields)

    def fields_of(self, present: list[str]) -> dict[str, str]:
        """Return the field of each quantity, of those that are ``present`` in the input.

        Raises
        ------
        ParameterError
            If ``field_names`` names a field that is not there.
        """
        named = _pairs("field_names", self.field_names)
        found = {}
        for quantity, usual in ALIASES.items():
            if quantity in named:
                if not named[quantity]:
                    continue
                if named[quantity] not in present:
                    raise ParameterError(
                        f"parameter field_names: {quantity}={named[quantity]}, but the fields are "
                        f"{', '.join(present)}"
                    )
                found[quantity] = named[quantity]
                continue
            match = next((name for name in usual if name in present), None)
            if match is not None:
                found[quantity] = match
        if self.rcs_unit == "none":
            found.pop("rcs", None)
        return found


def _pairs(parameter_name: str, entries: list[str]) -> dict[str, str]:
    """Return ``a=b`` entries as a mapping."""
    found: dict[str, str] = {}
    for entry in entries:
        name, sign, value = entry.partition("=")
        if not sign or not name.strip() or name.strip() in found:
            raise ParameterError(
                f"parameter {parameter_name}: {entry!r}, allowed are entries name=value that differ"
            )
        found[name.strip()] = value.strip()
    return found
