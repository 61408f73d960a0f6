"""Input and output: message <-> array conversion, bags, recordings, parameter files, track tables.

Nothing here needs ROS to be imported; a function that makes ROS messages imports them itself.
"""
