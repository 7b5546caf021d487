"""The shortest client: drive a circle for five seconds, and print where the robot is.

    python examples/drive_in_a_circle.py [tcp/127.0.0.1:7448]

It needs `pip install eclipse-zenoh`, and nothing of yahboomd.
"""

import json
import sys
import time

import zenoh

endpoint = sys.argv[1] if len(sys.argv) > 1 else "tcp/127.0.0.1:7448"
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([endpoint]))


def show(sample: zenoh.Sample) -> None:
    pose = json.loads(sample.payload.to_bytes())
    print(f"x {pose['x']:6.3f} m   y {pose['y']:6.3f} m   theta {pose['theta']:6.3f} rad", end="\r")


with zenoh.open(config) as session:
    session.declare_subscriber("yahboomd/pose", show)
    for _ in range(100):
        # Said again and again: half a second of silence stops the wheels.
        session.put("cmd_vel", json.dumps({"vx": 0.25, "wz": 1.0}))
        time.sleep(0.05)
    time.sleep(1.0)
    print()
