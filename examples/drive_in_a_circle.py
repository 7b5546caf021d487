"""The shortest client: drive most of a circle, and print where the robot is.

python examples/drive_in_a_circle.py [tcp/127.0.0.1:7448]
"""

import sys

from yahboomd.client import Move, MoveEnded, NoDaemon, PoseSample, Refused, Robot

endpoint = sys.argv[1] if len(sys.argv) > 1 else "tcp/127.0.0.1:7448"
arc = Move(kind="arc", radius_m=0.25, angle_rad=5.0)

try:
    with Robot(endpoint) as robot:  # However this block ends, the robot stops.
        status = robot.status
        if status is not None and status.state not in {"standing", "driving", "stopping"}:
            sys.exit(f"The robot will not move. {status.why}")
        with robot.moves(arc) as run:
            for progress in run:
                print(f"{progress.done:4.0%} of the arc", end="\r")
            run.finished()
        pose = next(iter(robot.samples(PoseSample)))
        print(f"x {pose.x:6.3f} m   y {pose.y:6.3f} m   theta {pose.theta:6.3f} rad")
except (NoDaemon, Refused, MoveEnded) as error:
    sys.exit(str(error))
