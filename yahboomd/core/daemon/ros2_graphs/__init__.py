"""ROS 2: the ways into its graphs, and the topics and services there.

`ros2_plane.start` does all of it, as far as configured.
"""
