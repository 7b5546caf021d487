"""ROS 2: the ways into its graphs, and what is published, heard and answered there.

`ros2_plane.start` does all of it, as far as configured.
"""
