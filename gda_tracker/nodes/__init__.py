"""The ROS 2 nodes: each converts messages, calls one function of the core, and publishes."""
