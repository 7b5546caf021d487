"""Files for ROS 2 nodes, made from the configuration: the robot's model and nodes' parameters.

A bring-up of the robot needs no copy of its sizes and limits: ``config urdf`` and
``config parameters`` print what follows from them.
"""
