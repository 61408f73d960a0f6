"""Several radars: a ring in the namespace of each, and the node that fuses their tracks.

ros2 launch gda_tracker fusion.launch.py radars:=north,south topics:=/north/points,/south/points
ros2 launch gda_tracker fusion.launch.py --show-args
"""

from gda_tracker.io.launch_plan import FUSION_ARGUMENTS, fusion_plan
from gda_tracker.nodes.launching import launch_description


def generate_launch_description():
    return launch_description(FUSION_ARGUMENTS, fusion_plan)
