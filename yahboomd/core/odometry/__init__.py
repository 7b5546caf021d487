"""Encoder counts to pose, twist and covariance, with the time at which the board sampled them.

:class:`~yahboomd.core.odometry.odometer.Odometer` takes readings and returns estimates and events;
`docs/odometry.md` has the formulas. Pure: time is an argument.
"""
