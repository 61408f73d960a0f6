"""The demo: four nodes and a scenario that is played into them.

ros2 launch gda_tracker demo.launch.py rviz:=true
"""

from gda_tracker.io.launch_plan import DEMO_ARGUMENTS, demo_plan
from gda_tracker.nodes.launching import launch_description


def generate_launch_description():
    return launch_description(DEMO_ARGUMENTS, demo_plan)
