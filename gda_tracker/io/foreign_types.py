"""Message definitions of packages that need not be installed, for bags.

The package ``radar_msgs`` is not part of the ROS 2 desktop; its definitions are a few lines.
Comments and constants take no part in a type's hash or in the bytes of its messages.
"""

from __future__ import annotations

RADAR_MESSAGES = {
    "radar_msgs/msg/RadarReturn": """
        float32 range
        float32 azimuth
        float32 elevation
        float32 doppler_velocity
        float32 amplitude
        """,
    "radar_msgs/msg/RadarScan": """
        std_msgs/Header header
        radar_msgs/RadarReturn[] returns
        """,
    "radar_msgs/msg/RadarTrack": """
        unique_identifier_msgs/UUID uuid
        geometry_msgs/Point position
        geometry_msgs/Vector3 velocity
        geometry_msgs/Vector3 acceleration
        geometry_msgs/Vector3 size
        uint16 classification
        float32[6] position_covariance
        float32[6] velocity_covariance
        float32[6] acceleration_covariance
        float32[6] size_covariance
        """,
    "radar_msgs/msg/RadarTracks": """
        std_msgs/Header header
        radar_msgs/RadarTrack[] tracks
        """,
}


def definition(kind: str) -> str:
    """Return the text of a definition, one field a line."""
    return "\n".join(line.strip() for line in RADAR_MESSAGES[kind].strip().splitlines()) + "\n"
