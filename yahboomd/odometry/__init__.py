"""Counts to pose, twist and covariance: see :mod:`yahboomd.odometry.odometer`."""
