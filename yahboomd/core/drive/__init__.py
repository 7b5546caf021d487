"""Turns commands into safe wheel speeds, and checks that the wheels obey.

`arbiter` chooses the command, `limiter` limits speed and acceleration, `kinematics` turns the
command into wheel speeds, `follow_check` compares them with the counts. Pure: time is an argument.
"""
