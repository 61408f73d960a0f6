"""Message fields are checked here: without it a wrong Python type corrupts data silently."""

import os

os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
