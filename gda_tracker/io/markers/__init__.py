"""What the tracker knows, as ``visualization_msgs/MarkerArray``, one array per layer."""
