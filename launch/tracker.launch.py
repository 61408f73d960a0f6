"""The tracker: four nodes, the input of a radar, outputs, a bag, RViz.

ros2 launch gda_tracker tracker.launch.py topic:=/radar/points preset:=continental_ars548
ros2 launch gda_tracker tracker.launch.py --show-args
"""

import os

from ament_index_python.packages import get_package_prefix
from launch.actions import (
    DeclareLaunchArgument,
    ExecuteProcess,
    OpaqueFunction,
    SetEnvironmentVariable,
)
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode

from gda_tracker.io.launch_plan import TRACKER_ARGUMENTS, tracker_plan
from launch import LaunchDescription


def start(context):
    values = {a.name: LaunchConfiguration(a.name).perform(context) for a in TRACKER_ARGUMENTS}
    plan = tracker_plan(values, os.environ)
    # Scripts of a package are not on the path of a workspace.
    scripts = os.path.join(get_package_prefix("gda_tracker"), "lib", "gda_tracker")
    return [
        *(SetEnvironmentVariable(name, value) for name, value in plan.environment.items()),
        # The nodes configure and activate themselves (parameter autostart).
        *(
            LifecycleNode(
                package="gda_tracker",
                executable=node.executable,
                name=node.executable,
                namespace=plan.namespace,
                parameters=node.parameters,
                output="screen",
                respawn=node.respawn,
            )
            for node in plan.nodes
        ),
        *(
            ExecuteProcess(
                cmd=[os.path.join(scripts, name) if name == "gda-tracker" else name, *rest],
                output="screen",
            )
            for name, *rest in plan.programs
        ),
    ]


def generate_launch_description():
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(a.name, default_value=a.default, description=a.description)
                for a in TRACKER_ARGUMENTS
            ),
            OpaqueFunction(function=start),
        ]
    )
