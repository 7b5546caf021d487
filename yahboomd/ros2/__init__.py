"""ROS 2: the ways into its graphs, and the topics and services there.

`ros2_plane.Ros2Plane` is handed to the daemon, which starts it, as far as configured.
"""
