"""Message definitions of packages that need not be installed.

Bags of them are read and written by these, and ``make messages`` builds them where there is no ROS
installation. Comments and constants take no part in a type's hash or in the bytes of its messages.
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

OUTPUT_MESSAGES = {
    "vision_msgs/msg/ObjectHypothesis": """
        string class_id
        float64 score
        """,
    "vision_msgs/msg/ObjectHypothesisWithPose": """
        vision_msgs/ObjectHypothesis hypothesis
        geometry_msgs/PoseWithCovariance pose
        """,
    "vision_msgs/msg/BoundingBox3D": """
        geometry_msgs/Pose center
        geometry_msgs/Vector3 size
        """,
    "vision_msgs/msg/Detection3D": """
        std_msgs/Header header
        vision_msgs/ObjectHypothesisWithPose[] results
        vision_msgs/BoundingBox3D bbox
        string id
        """,
    "vision_msgs/msg/Detection3DArray": """
        std_msgs/Header header
        vision_msgs/Detection3D[] detections
        """,
    "autoware_perception_msgs/msg/ObjectClassification": """
        uint8 UNKNOWN = 0
        uint8 CAR = 1
        uint8 TRUCK = 2
        uint8 BUS = 3
        uint8 TRAILER = 4
        uint8 MOTORCYCLE = 5
        uint8 BICYCLE = 6
        uint8 PEDESTRIAN = 7
        uint8 label
        float32 probability
        """,
    "autoware_perception_msgs/msg/TrackedObjectKinematics": """
        uint8 UNAVAILABLE = 0
        uint8 SIGN_UNKNOWN = 1
        uint8 AVAILABLE = 2
        geometry_msgs/PoseWithCovariance pose_with_covariance
        geometry_msgs/TwistWithCovariance twist_with_covariance
        geometry_msgs/AccelWithCovariance acceleration_with_covariance
        uint8 orientation_availability
        bool is_stationary
        """,
    "autoware_perception_msgs/msg/Shape": """
        uint8 BOUNDING_BOX = 0
        uint8 CYLINDER = 1
        uint8 POLYGON = 2
        uint8 type
        geometry_msgs/Polygon footprint
        geometry_msgs/Vector3 dimensions
        """,
    "autoware_perception_msgs/msg/TrackedObject": """
        unique_identifier_msgs/UUID object_id
        float32 existence_probability
        autoware_perception_msgs/ObjectClassification[] classification
        autoware_perception_msgs/TrackedObjectKinematics kinematics
        autoware_perception_msgs/Shape shape
        """,
    "autoware_perception_msgs/msg/TrackedObjects": """
        std_msgs/Header header
        autoware_perception_msgs/TrackedObject[] objects
        """,
}
# Of these the rosbags library knows the definition already.
TRANSFORM_MESSAGES = {
    "tf2_msgs/msg/TFMessage": """
        geometry_msgs/TransformStamped[] transforms
        """,
}
# Not known to the rosbags library; a bag may bring other versions of them.
FOREIGN_MESSAGES = {**RADAR_MESSAGES, **OUTPUT_MESSAGES}
ALL_MESSAGES = {**FOREIGN_MESSAGES, **TRANSFORM_MESSAGES}


def package_of(kind: str) -> str:
    """Return the package of a type."""
    return kind.split("/")[0]


def definition(kind: str) -> str:
    """Return the text of a definition, one field a line."""
    return "\n".join(line.strip() for line in ALL_MESSAGES[kind].strip().splitlines()) + "\n"
