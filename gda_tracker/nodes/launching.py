"""What the launch files have in common: a plan of nodes and programs as a launch description."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from typing import Any

from ament_index_python.packages import get_package_prefix
from launch.actions import (
    DeclareLaunchArgument,
    ExecuteProcess,
    OpaqueFunction,
    SetEnvironmentVariable,
)
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode

from gda_tracker.io.launch_plan import Plan
from launch import LaunchDescription


def launch_description(
    arguments: Sequence[Any], make_plan: Callable[[dict[str, str], Any], Plan]
) -> LaunchDescription:
    """Return the description of a launch file.

    Parameters
    ----------
    arguments
        The launch arguments: name, default, description.
    make_plan
        Makes the plan of their values and the environment.
    """

    def start(context: Any) -> list[Any]:
        values = {a.name: LaunchConfiguration(a.name).perform(context) for a in arguments}
        plan = make_plan(values, os.environ)
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
                    namespace=plan.namespace if node.namespace is None else node.namespace,
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

    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(a.name, default_value=a.default, description=a.description)
                for a in arguments
            ),
            OpaqueFunction(function=start),
        ]
    )
