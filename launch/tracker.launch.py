"""The tracker: four nodes, the input of a radar, outputs, a bag, RViz.

ros2 launch gda_tracker tracker.launch.py topic:=/radar/points preset:=continental_ars548
ros2 launch gda_tracker tracker.launch.py --show-args
"""

from gda_tracker.io.launch_plan import TRACKER_ARGUMENTS, tracker_plan
from gda_tracker.nodes.launching import launch_description


def generate_launch_description():
    return launch_description(TRACKER_ARGUMENTS, tracker_plan)
