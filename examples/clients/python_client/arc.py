import os

from yahboomd.client import PoseSample, Robot

with Robot(os.environ.get("ROBOT", "tcp/127.0.0.1:7448")) as robot:
    robot.drive(0.2, 0.5, for_s=2.0)  # m/s forward, rad/s to the left; repeated by itself
    for pose in robot.samples(PoseSample):
        print(f"x {pose.x:.3f} m, y {pose.y:.3f} m, theta {pose.theta:.3f} rad")
        if robot.commanded is None:
            break
