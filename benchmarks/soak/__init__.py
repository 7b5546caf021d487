"""The soak: daemon and simulated board as processes, through every fault, for as long as told.

    python -m benchmarks.soak --minutes 60 --seed 1

An application drives; a seeded schedule injects faults; after each one the ground truth tells
whether the wheels stopped where they must, and within which time, whether the robot drives again,
and where the pose is. It ends with a table and a status, and ends everything that it started.
"""
