"""The shortest client: drive a circle for five seconds, and print where the robot is.

python examples/drive_in_a_circle.py [tcp/127.0.0.1:7448]
"""

import sys
import time

from yahboomd.client import NoDaemon, PoseSample, Robot

endpoint = sys.argv[1] if len(sys.argv) > 1 else "tcp/127.0.0.1:7448"

try:
    with Robot(endpoint) as robot:  # However this block ends, the robot stops.
        status = robot.status
        if status is not None and status.state not in {"standing", "driving", "stopping"}:
            sys.exit(f"The robot will not move. {status.why}")
        robot.drive(0.25, 1.0, for_s=5.0)  # m/s forward, rad/s to the left
        end = time.monotonic() + 6.0
        for pose in robot.samples(PoseSample):
            print(f"x {pose.x:6.3f} m   y {pose.y:6.3f} m   theta {pose.theta:6.3f} rad", end="\r")
            if time.monotonic() > end:
                break
        print()
except NoDaemon as error:
    sys.exit(str(error))
