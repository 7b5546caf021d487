"""Commands to safe wheel speeds: who drives, how fast, which wheel, and whether it obeys.

`arbiter` chooses the command, `limiter` limits speed and acceleration, `kinematics` turns it into
wheel speeds, `motor_watch` compares them with the counts. Pure: time is an argument.
"""
