#!/bin/sh
# Sources ROS and the workspace, then runs the command of the container.
set -e
. "/opt/ros/${ROS_DISTRO}/setup.sh"
. /workspace/install/setup.sh
exec "$@"
