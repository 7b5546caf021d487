"""`yahboomd send` to a real daemon on a simulated board."""

from __future__ import annotations

import functools
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator

import pytest
from real_robot import RealRobot, free_endpoint, wait_for

from yahboomd.cli.main import main

pytestmark = [pytest.mark.realtime, pytest.mark.xdist_group("one_robot")]

LONG = ("send", "--vx", "0.2", "--for", "300")


def fast(robot: RealRobot) -> bool:
    """Whether it truly drives."""
    return max(map(abs, robot.truth()[-1].speed_m_s)) > 0.1


class Sending:
    """Starts the command in a process, and waits until the robot drives.

    If a busy machine held the board up and the daemon stopped, it is started again.
    """

    def __init__(self) -> None:
        self._processes: list[subprocess.Popen[str]] = []

    def start(self, robot: RealRobot, *arguments: str, **streams: int) -> subprocess.Popen[str]:
        command = [*(arguments or LONG), "--connect", robot.endpoint]
        process: subprocess.Popen[str] | None = None

        def driving() -> bool:
            nonlocal process
            if process is None or process.poll() is not None:
                process = subprocess.Popen(
                    [sys.executable, "-m", "yahboomd", *command],
                    text=True,
                    **{"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **streams},
                )
                self._processes.append(process)
            return fast(robot)

        wait_for(driving, "the robot drives")
        assert process is not None
        return process

    def close(self) -> None:
        for each in self._processes:
            each.kill()
            each.communicate()


@pytest.fixture
def sender() -> Iterator[Sending]:
    made = Sending()
    yield made
    made.close()


@pytest.fixture
def sending(
    one_robot: RealRobot, sender: Sending
) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Starts it for the robot of these tests, which stands afterwards."""
    yield functools.partial(sender.start, one_robot)
    sender.close()
    one_robot.settled_truth()


def test_it_drives_for_its_time_then_stands_and_prints_nothing(
    one_robot: RealRobot, on_robot: Callable[..., int], capsys
) -> None:
    def obeyed() -> bool:
        nonlocal before_m
        before_m = sum(one_robot.settled_truth().travel_m)
        capsys.readouterr()
        return on_robot("send", "--vx", "0.2", "--wz", "-0.5", "--for", "1") == 0

    before_m = 0.0
    wait_for(obeyed, "it drives to the end, on a machine that is not too busy")
    assert capsys.readouterr() == ("", "")
    # Two wheels, a second at 0.2 m/s in the middle, with ramps at both ends; a busy machine adds
    # the daemon's timeout of half a second, or stops the robot for a part of it.
    assert 0.1 < sum(one_robot.settled_truth().travel_m) - before_m < 0.75


@pytest.mark.cases(1)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGTSTP])
def test_a_signal_stops_the_robot_before_its_time(
    one_robot: RealRobot, sending: Callable[..., subprocess.Popen[str]], number: int
) -> None:
    process = sending()
    process.send_signal(number)
    assert process.communicate(timeout=60) == ("", "")
    assert process.returncode == 128 + number
    one_robot.settled_truth()


@pytest.mark.nightly
def test_an_emergency_stop_ends_it_with_the_daemons_reason(
    one_robot: RealRobot,
    sending: Callable[..., subprocess.Popen[str]],
    on_robot: Callable[..., int],
    capsys,
) -> None:
    process = sending()
    on_robot("call", "estop", '{"by": "the test"}')
    try:
        out, err = process.communicate(timeout=60)
        assert (process.returncode, out) == (1, "")
        assert err.startswith(
            "yahboomd: The robot does not obey. Emergency stop, engaged by the test"
        )
        # Engaged already: nothing is sent at all.
        assert on_robot("send", "--vx", "0.2", "--for", "1") == 1
        assert "Nothing was sent. Emergency stop" in capsys.readouterr().err
    finally:
        wait_for(lambda: on_robot("call", "estop/reset") == 0, "the release")


@pytest.mark.parametrize(
    "arguments",
    [
        ["--vx", "0.1"],
        ["--vx", "0.1", "--for", "0"],
        ["--vx", "0.1", "--for", "-1"],
        ["--vx", "0.1", "--for", "nan"],
        ["--vx", "0.1", "--for", "1e9"],
        ["--vx", "inf", "--for", "1"],
        ["--vx", "1e39", "--for", "1"],
        ["--wz", "-1001", "--for", "1"],
        ["--vx", "fast", "--for", "1"],
    ],
)
def test_a_time_and_velocities_of_a_robot_are_required(arguments: list[str], capsys) -> None:
    with pytest.raises(SystemExit) as left:
        main(["send", *arguments])
    assert left.value.code == 2
    assert capsys.readouterr().out == ""


def test_without_a_daemon_it_ends_with_69(capsys) -> None:
    arguments = ["--for", "1", "--timeout", "0", "--connect", free_endpoint()]
    assert main(["send", "--vx", "-1e-3", *arguments]) == 69
    assert "No yahboomd answers" in capsys.readouterr().err
