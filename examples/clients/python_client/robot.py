"""Reads and drives a robot through yahboomd.client: ``python robot.py square``.

The contract of its commands and exit codes is in examples/clients/README.md.
"""

import json
import math
import os
import sys

import msgspec

from yahboomd.client import (
    Move,
    MoveEnded,
    NoDaemon,
    PoseSample,
    Refused,
    Robot,
    ServiceReply,
    StatusSample,
)

ROBOT = os.environ.get("ROBOT", "tcp/127.0.0.1:7448")
NAMESPACE = os.environ.get("NAMESPACE", "")
USAGE = """usage: robot.py pose | status | estop | release | set-pose X Y THETA | config
                | square [SIDE] | moves [SIDE] | decode PoseSample|StatusSample|ServiceReply"""

STALE_S = 0.3  # A command lasts no longer: without poses the robot stops.
PATIENCE_S = 30.0

# Anything else, a state of a later version too, is one in which the robot may not drive.
DRIVABLE = {"waiting", "standing", "driving", "stopping"}

MESSAGES = {each.__name__: each for each in (PoseSample, StatusSample, ServiceReply)}
NUMBERS = {
    **dict.fromkeys(("pose", "status", "estop", "release", "config"), (0,)),
    "set-pose": (3,),
    "square": (0, 1),
    "moves": (0, 1),
}
SERVICES = {
    "estop": "yahboomd/estop",
    "release": "yahboomd/estop/reset",
    "set-pose": "yahboomd/odometry/set_pose",
    "config": "yahboomd/config",
}


class Failure(Exception):
    """An end with an exit code and a sentence."""


def show(message: msgspec.Struct) -> None:
    print(msgspec.json.encode(message).decode(), flush=True)


def call(robot: Robot, command: str, numbers: list[float]) -> int:
    request = json.dumps(dict(zip(("x", "y", "theta"), numbers, strict=False))).encode()
    answer = robot.request(SERVICES[command], request, urgent=command == "estop")
    if not answer.answered:
        raise Failure(69, f"Nothing at {ROBOT} answers. Start it: yahboomd run")
    show(ServiceReply(success=answer.success, message=answer.message, data=answer.data))
    return 0 if answer.success else 1


class Square:
    """Drives to four corners, in a frame that begins where the robot stands."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.poses = robot.samples(PoseSample, depth=1, timeout_s=PATIENCE_S)
        self.x = self.y = self.theta = 0.0
        self.pose: PoseSample | None = None

    def drive(self, side: float = 1.0) -> None:
        for x, y in ((side, 0.0), (side, side), (0.0, side), (0.0, 0.0)):
            print(f"driving to {x:.2f}, {y:.2f}", flush=True)
            self.drive_to(x, y)
            self.rest()
        self.turn_to(0.0)
        print(json.dumps({"x": self.x, "y": self.y, "theta": self.theta}))

    def drive_to(self, x: float, y: float) -> None:
        self.turn_to(math.atan2(y - self.y, x - self.x))
        while (distance := math.hypot(x - self.x, y - self.y)) > 0.01:
            error = wrap(math.atan2(y - self.y, x - self.x) - self.theta)
            if abs(error) > 1.0:  # The corner is behind us.
                break
            self.step(min(0.25, 0.02 + 0.7 * distance), max(-1.0, min(1.0, 2 * error)))

    def turn_to(self, theta: float) -> None:
        while abs(error := wrap(theta - self.theta)) > 0.02:
            self.step(0.0, math.copysign(min(1.2, 0.1 + abs(error)), error))
            if abs(wrap(theta - self.theta)) <= 0.02:
                self.rest()

    def rest(self) -> None:
        """Stop, and learn where that was."""
        self.robot.stop()
        while self.robot.commanded is not None:
            self.receive()

    def step(self, vx: float, wz: float) -> None:
        """Command a velocity for the time that a pose is good for, and wait for the next pose."""
        status = self.robot.status
        if status is not None and status.state not in DRIVABLE:
            raise Failure(75, f"The robot will not move. It is {status.state}: {status.why}")
        if self.pose is not None:
            self.robot.drive(vx, wz, for_s=STALE_S)
        self.receive()

    def receive(self) -> None:
        """Wait for the next pose, and add up the way since the one before."""
        new = next(self.poses, None)
        if new is None:
            raise Failure(75, f"No pose came from {ROBOT} for {PATIENCE_S:.0f} s.")
        old, self.pose = self.pose, new
        if old is None or new.seq <= old.seq:  # The daemon was restarted.
            return
        dx, dy, turned = new.x - old.x, new.y - old.y, new.theta - old.theta
        if math.hypot(dx, dy) > 0.5 or abs(turned) > 0.5:  # The pose was set or reset.
            return
        cos, sin = math.cos(self.theta - old.theta), math.sin(self.theta - old.theta)
        self.x += cos * dx - sin * dy
        self.y += sin * dx + cos * dy
        self.theta += turned


def drive_moves(robot: Robot, side: float = 1.0) -> None:
    """Drive the square by `yahboomd moves`; leaving the block early ends them."""
    corner = (Move(kind="straight", distance_m=side), Move(kind="turn", angle_rad=math.pi / 2))
    try:
        with robot.moves(*corner * 4) as run:
            for progress in run:
                print(f"{progress.done:.0%}, {progress.left_s:.1f} s are left", flush=True)
            show(run.finished())
    except (MoveEnded, Refused) as ended:
        raise Failure(75, str(ended)) from ended


def wrap(angle: float) -> float:
    return math.remainder(angle, math.tau)


def decode(name: str) -> None:
    try:
        show(msgspec.json.decode(sys.stdin.buffer.read(), type=MESSAGES[name]))
    except msgspec.MsgspecError as error:
        raise Failure(65, f"This is no {name}: {error}") from error


def main(command: str = "", *words: str) -> int:
    if command == "decode" and len(words) == 1 and words[0] in MESSAGES:
        decode(words[0])
        return 0
    try:
        numbers = [float(word) for word in words]
    except ValueError as error:
        raise Failure(64, USAGE) from error
    if len(numbers) not in NUMBERS.get(command, ()):
        raise Failure(64, USAGE)
    with Robot(ROBOT, namespace=NAMESPACE, label="square", wait_s=2.0) as robot:
        if command in SERVICES:
            return call(robot, command, numbers)
        if command == "square":
            Square(robot).drive(*numbers)
            return 0
        if command == "moves":
            drive_moves(robot, *numbers)
            return 0
        sample = robot.get(PoseSample if command == "pose" else StatusSample)
        if sample is None:
            raise Failure(69, "The daemon has no pose yet: it waits for its board.")
        show(sample)
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main(*sys.argv[1:]))
    except Failure as failure:
        code, sentence = failure.args
        print(sentence, file=sys.stderr)
        sys.exit(code)
    except NoDaemon as error:
        print(error, file=sys.stderr)
        sys.exit(69)
    except KeyboardInterrupt:
        sys.exit(130)
