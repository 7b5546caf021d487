"""Moves such as a metre ahead, a quarter turn, or to a place; a service that steers by the pose.

``move_service`` puts them on the bus, ``move_keeper`` starts and ends them, ``motion`` plans them
and computes velocities.
"""
