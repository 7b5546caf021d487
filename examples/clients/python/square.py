"""Drives a square on odometry, with a deadman of its own."""

import json
import math
import time

import msgspec
import zenoh
from messages import DRIVABLE, ROBOT, PoseSample, StatusSample, fail, key

PERIOD_S = 0.05
STALE_S = 0.3  # Older than this, a pose says nothing about where the robot is now.
PATIENCE_S = 30.0


class Square:
    """Drives to four corners, in a frame that begins where the robot stands."""

    def __init__(self, session: zenoh.Session) -> None:
        self.x = self.y = self.theta = 0.0
        self.pose: PoseSample | None = None
        self.arrived = time.monotonic()
        self.why = ""
        self.commands = session.declare_publisher(key("cmd_vel"))
        session.declare_subscriber(key("yahboomd/pose"), self.on_pose)
        session.declare_subscriber(key("yahboomd/status"), self.on_status)

    def on_pose(self, sample: zenoh.Sample) -> None:
        try:
            new = msgspec.json.decode(sample.payload.to_bytes(), type=PoseSample)
        except msgspec.MsgspecError:
            return  # A pose that cannot be read is none: the deadman below stops the robot.
        old, self.pose, self.arrived = self.pose, new, time.monotonic()
        if old is None or new.seq <= old.seq:  # The daemon was restarted.
            return
        dx, dy, turned = new.x - old.x, new.y - old.y, new.theta - old.theta
        if math.hypot(dx, dy) > 0.5 or abs(turned) > 0.5:  # The pose was set or reset.
            return
        cos, sin = math.cos(self.theta - old.theta), math.sin(self.theta - old.theta)
        self.x += cos * dx - sin * dy
        self.y += sin * dx + cos * dy
        self.theta += turned

    def on_status(self, sample: zenoh.Sample) -> None:
        try:
            status = msgspec.json.decode(sample.payload.to_bytes(), type=StatusSample)
        except msgspec.MsgspecError:
            return
        self.why = "" if status.state in DRIVABLE else f"It is {status.state}: {status.why}"

    def send(self, vx: float, wz: float) -> None:
        command = {"vx": vx, "wz": wz, "stamp_ns": time.time_ns(), "source": "square"}
        self.commands.put(json.dumps(command))

    def step(self, vx: float, wz: float) -> None:
        """Send one command, or zero where the newest pose is too old; then wait for the period."""
        silent_s = time.monotonic() - self.arrived
        if self.why:
            fail(75, f"The robot will not move. {self.why}")
        if silent_s > PATIENCE_S:
            fail(75, f"No pose came from {ROBOT} for {PATIENCE_S:.0f} s; the square is given up.")
        stale = self.pose is None or silent_s > STALE_S
        self.send(*(0.0, 0.0) if stale else (vx, wz))
        time.sleep(PERIOD_S)

    def turn_to(self, theta: float) -> None:
        while abs(error := wrap(theta - self.theta)) > 0.02:
            self.step(0.0, math.copysign(min(1.2, 0.2 + 3 * abs(error)), error))

    def drive_to(self, x: float, y: float) -> None:
        self.turn_to(math.atan2(y - self.y, x - self.x))
        while (distance := math.hypot(x - self.x, y - self.y)) > 0.01:
            error = wrap(math.atan2(y - self.y, x - self.x) - self.theta)
            if abs(error) > 1.0:  # The corner is behind us.
                break
            self.step(min(0.25, 0.05 + 2.5 * distance), max(-1.0, min(1.0, 2 * error)))

    def drive(self, side: float = 1.0) -> None:
        try:
            for x, y in ((side, 0.0), (side, side), (0.0, side), (0.0, 0.0)):
                print(f"driving to {x:.2f}, {y:.2f}", flush=True)
                self.drive_to(x, y)
            self.turn_to(0.0)
        finally:
            self.send(0.0, 0.0)
        print(json.dumps({"x": self.x, "y": self.y, "theta": self.theta}))


def wrap(angle: float) -> float:
    return math.remainder(angle, math.tau)
