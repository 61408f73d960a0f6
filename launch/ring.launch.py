"""The four nodes of the ring, for a normal ROS 2 installation.

ros2 launch gda_tracker ring.launch.py params:=my_radar.yaml namespace:=radar_1
"""

import os

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, SetEnvironmentVariable
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode

from launch import LaunchDescription

STAGES = ("track_manager", "rcs_fuzzifier", "attribute_fusion", "association")


def generate_launch_description():
    share = get_package_share_directory("gda_tracker")
    profile = os.path.join(share, "params", "fastdds.xml")
    actions = [
        DeclareLaunchArgument(
            "params",
            default_value=os.path.join(share, "params", "basic.yaml"),
            description="parameter file of the nodes",
        ),
        DeclareLaunchArgument("namespace", default_value="", description="namespace of the ring"),
        DeclareLaunchArgument("use_sim_time", default_value="false", description="use /clock"),
    ]
    if "FASTDDS_DEFAULT_PROFILES_FILE" not in os.environ:
        # A shared-memory segment that large scans fit into.
        actions += [
            SetEnvironmentVariable("FASTDDS_DEFAULT_PROFILES_FILE", profile),
            SetEnvironmentVariable("FASTRTPS_DEFAULT_PROFILES_FILE", profile),
        ]
    # The nodes configure and activate themselves (parameter autostart).
    actions += [
        LifecycleNode(
            package="gda_tracker",
            executable=stage,
            name=stage,
            namespace=LaunchConfiguration("namespace"),
            parameters=[
                LaunchConfiguration("params"),
                {"use_sim_time": LaunchConfiguration("use_sim_time")},
            ],
            output="screen",
            respawn=True,
        )
        for stage in STAGES
    ]
    return LaunchDescription(actions)
