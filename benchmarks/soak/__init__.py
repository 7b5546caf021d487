"""The soak: daemon and simulated board as processes, through every fault, for a chosen time.

    python -m benchmarks.soak --minutes 60 --seed 1

`application` drives, and a seeded `schedule` injects faults (`injections`, `delays`, `attacks`).
After each fault the ground truth shows whether the wheels stopped in time, whether the robot drives
again, and how far the pose is off. `page` prints the tables. Every started process is ended.
"""
