"""The ROS 2 nodes: each converts messages, calls one function of the core, and publishes."""

from gda_tracker.threads import one_thread_of_linear_algebra

# Here, since numpy comes with the first node and looks at the environment only then.
one_thread_of_linear_algebra()
