"""The Python client, a real daemon, a simulated board: whatever ends a program stops the wheels."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import pytest
from real_robot import RealRobot, wait_for

from yahboomd.client import NoDaemon, PoseSample, Refused, Robot
from yahboomd.core.standstill import STANDING_M_S

pytestmark = pytest.mark.realtime


PLAIN = """
import sys, time
from yahboomd.client import Robot
with Robot(sys.argv[1], source=sys.argv[2]) as robot:
    robot.drive(0.3, for_s=3600)
    if sys.argv[3:]:
        sys.stdin.read()
        raise LookupError
    time.sleep(3600)
"""

ASYNC = """
import asyncio, sys
from yahboomd.client import connect
async def main():
    async with connect(sys.argv[1], source=sys.argv[2]) as robot:
        robot.drive(0.3, for_s=3600)
        await asyncio.sleep(3600)
asyncio.run(main())
"""


STOOD_STILL = """
import sys
from yahboomd.client import CommandEnded, Robot
with Robot(sys.argv[1]) as robot:
    robot.drive(0.3, for_s=3600)
    try:
        robot.finished()
    except CommandEnded as error:
        print(error, flush=True)
        sys.stdin.read()
"""


def speed_m_s(robot: RealRobot) -> float:
    return max(map(abs, robot.truth()[-1].speed_m_s))


def ends(robot: RealRobot, code: str, number: int | None, source: str = "cmd_vel") -> int:
    """Drive until something ends the program; its status, once the wheels stand."""
    arguments = [robot.endpoint, source, *(["raise"] if number is None else [])]
    with subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        stdin=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    ) as program:
        wait_for(lambda: speed_m_s(robot) > 0.2, "it drives")
        assert program.stdin is not None
        program.stdin.close()
        if number is not None:
            program.send_signal(number)
        status = program.wait(60)
    wait_for(robot.stands, "the wheels stand", 30.0)
    return status


@pytest.mark.nightly
def test_whatever_ends_a_program_the_wheels_stand(real_robot: Callable[..., RealRobot]) -> None:
    # Silence on cmd_vel stops nothing here for a minute: it is the client that stops the robot.
    robot = real_robot(run=["--set", "command.sources.cmd_vel.timeout_s=60"])
    robot.daemon.says("Connected")
    assert ends(robot, PLAIN, None) == 1
    assert ends(robot, ASYNC, signal.SIGTERM) == 128 + signal.SIGTERM
    # What cannot be caught is the daemon's to notice.
    assert ends(robot, PLAIN, signal.SIGKILL, "cmd_vel/teleop") == -signal.SIGKILL


@pytest.mark.nightly
@pytest.mark.parametrize("command", ["a program", "send"])
def test_a_program_that_stood_still_does_not_start_its_robot_again(
    real_robot: Callable[..., RealRobot], command: str
) -> None:
    robot = real_robot(run=["--set", "command.timeout_s=1"])
    robot.daemon.says("Connected")
    arguments = ["-c", STOOD_STILL, robot.endpoint]
    if command == "send":
        there = ["--connect", robot.endpoint]
        arguments = ["-m", "yahboomd", "send", "--vx", "0.3", "--for", "3600", *there]
    with subprocess.Popen(
        [sys.executable, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as program:
        assert program.stdin is not None
        assert program.stdout is not None
        wait_for(lambda: speed_m_s(robot) > 0.2, "it drives")
        program.send_signal(signal.SIGSTOP)
        wait_for(robot.stands, "the daemon stops the robot")
        stood = len(robot.truth()) - 1
        program.send_signal(signal.SIGCONT)
        wait_for(lambda: robot.truth()[-1].t_ns - robot.truth()[stood].t_ns > 1e9, "a second")
        fastest = max(max(map(abs, each.speed_m_s)) for each in robot.truth()[stood:])
        if fastest >= STANDING_M_S:
            program.kill()
        program.stdin.close()
        assert "This program did not run for" in program.stdout.read()
        assert program.wait(60) == (0 if command == "a program" else 1)
    assert fastest < STANDING_M_S


@pytest.mark.nightly
def test_a_program_reads_asks_and_survives_a_restart(real_robot: Callable[..., RealRobot]) -> None:
    robot = real_robot(run=["--set", "zenoh.namespace=bot1", "--set", "command.timeout_s=5"])
    robot.daemon.says("Connected")
    wait_for(lambda: "'bot1'" in refusal(robot), "the namespaces there are named")
    with Robot(robot.endpoint, namespace="bot1") as program:
        assert program.set_pose(1.5, -2.25, 0.5)
        pose: Any = wait_for(
            lambda: (found := program.pose) and found.x == 1.5 and found, "the new pose"
        )
        assert (pose.y, pose.theta) == (-2.25, 0.5)
        with pytest.raises(Refused, match="stays as it is"):
            program.set_pose(1e9, 0.0, 0.0)
        assert program.config()["zenoh"]["namespace"] == "bot1"
        assert program.board()["dialect"] == "streamed"
        program.drive(0.3, for_s=60.0)
        wait_for(lambda: speed_m_s(robot) > 0.2, "it drives")
        assert program.estop("the red button")
        assert program.standing(within_s=30.0)
        status: Any = wait_for(
            lambda: (s := program.status) and s.state == "estopped" and s, "the e-stop"
        )
        assert "the red button" in status.why
        wait_for(lambda: released(program), "the release")
        poses = program.samples(PoseSample)
        before = next(poses)
        program.drive(0.3, for_s=60.0)
        wait_for(lambda: speed_m_s(robot) > 0.2, "it drives again")
        assert robot.daemon.end() == 0
        wait_for(lambda: not program.alive, "the loss is known")
        assert not program.finished()
        assert not program.drive(0.3)
        robot.start_daemon()
        program.wait_alive(60.0)
        wait_for(lambda: next(poses).seq < before.seq, "poses of the new daemon")
        # Nothing drives that was commanded before.
        assert speed_m_s(robot) < STANDING_M_S
        wait_for(lambda: program.drive(0.2) and speed_m_s(robot) > 0.1, "a new command drives")
        counters = program.counters
    assert (counters.losses, counters.interrupted, counters.dropped) == (1, 1, 1)
    wait_for(robot.stands, "the wheels stand")


def refusal(robot: RealRobot) -> str:
    """The words to a program that names no namespace; of a busy machine others may not be known."""
    with pytest.raises(NoDaemon) as refused:
        Robot(robot.endpoint, wait_s=0.5).open()
    return str(refused.value)


def released(program: Robot) -> bool:
    try:
        program.release()
    except Refused:
        return False
    return True
