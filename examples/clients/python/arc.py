import json
import os
import time

import zenoh

config = zenoh.Config()
config.insert_json5("mode", '"client"')
robot = os.environ.get("ROBOT", "tcp/127.0.0.1:7448")
config.insert_json5("connect/endpoints", json.dumps([robot]))

with zenoh.open(config) as session:
    session.declare_subscriber("yahboomd/pose", lambda sample: print(sample.payload.to_string()))
    for _ in range(40):  # 2 s: a command lapses after 0.5 s, so repeat it
        session.put("cmd_vel", json.dumps({"vx": 0.2, "wz": 0.5}))
        time.sleep(0.05)
    session.put("cmd_vel", json.dumps({"vx": 0, "wz": 0}))
