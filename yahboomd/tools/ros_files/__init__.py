"""Files for ROS 2, made from the configuration: the robot's model and nodes' parameters.

``config urdf`` and ``config parameters`` print them, so that a bring-up needs no copy of the
robot's sizes and limits.
"""
