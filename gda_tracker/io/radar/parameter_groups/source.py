"""Parameters of radar_input: where its messages come from."""

from __future__ import annotations

from dataclasses import dataclass

from gda_tracker.parameters import parameter

# Types of messages that are read.
POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
RADAR_SCAN = "radar_msgs/msg/RadarScan"
RADAR_TRACKS = "radar_msgs/msg/RadarTracks"
RADAR_TYPES = (POINT_CLOUD, RADAR_SCAN, RADAR_TRACKS)
STAMP_SOURCES = ("header", "received")


@dataclass(frozen=True)
class SourceParameters:
    """Which radar, and where its messages come from."""

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
