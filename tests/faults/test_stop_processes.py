"""What happens to a process, happens to real ones: signals, kills, freezes, clients that die.

The board is simulated on a real pty, everything speaks a real Zenoh. Outcomes are asserted, never
times; those are printed.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from real_robot import DRIVER, Client, Process, RealRobot, wait_for

pytestmark = pytest.mark.realtime

FAST = b'{"vx": 0.4}'


@contextlib.contextmanager
def driver(endpoint: str) -> Iterator[subprocess.Popen[bytes]]:
    """A process that commands motion for as long as it lives."""
    process = subprocess.Popen(
        [sys.executable, "-c", DRIVER, endpoint, "cmd_vel"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    assert process.stdout is not None
    try:
        assert process.stdout.readline() == b"driving\n"
        yield process
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def turning(robot: RealRobot) -> bool:
    samples = robot.truth()[-5:]
    return len(samples) == 5 and all(min(each.speed_m_s) > 0.3 for each in samples)


def driven(robot: RealRobot) -> None:
    wait_for(lambda: turning(robot), "the wheels turn")


def told(robot: RealRobot, what: str, since_ns: int) -> None:
    """Print how long after a moment the wheels began to slow down, and stood."""
    robot.settled_truth()
    samples = [each for each in robot.truth() if each.t_ns >= since_ns]
    slowing = next(each for each in samples if min(each.speed_m_s) < 0.32)
    standing = next(each for each in samples if max(map(abs, each.speed_m_s)) < 0.03)
    after = [(each.t_ns - since_ns) / 1e6 for each in (slowing, standing)]
    print(f"{what}: slower after {after[0]:.0f} ms, standing after {after[1]:.0f} ms")


@pytest.fixture
def robot(real_robot: Callable[..., RealRobot], client: Callable[..., Client]) -> RealRobot:
    robot = real_robot()
    client("client", robot.endpoint).in_state("standing")
    return robot


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_signal_stops_the_wheels_before_the_daemon_ends(
    robot: RealRobot, number: signal.Signals
) -> None:
    with driver(robot.endpoint):
        driven(robot)
        now_ns = time.monotonic_ns()
        assert robot.daemon.end(number) == 0
        assert max(map(abs, robot.settled_truth().speed_m_s)) < 0.03
        told(robot, number.name, now_ns)
    assert "Traceback" not in robot.daemon.output
    assert f"{number.name}: stopping the wheels" in robot.daemon.output
    # They stand because they were told to: no wheel is accused of it.
    assert "are commanded" not in robot.daemon.output
    assert "is commanded" not in robot.daemon.output


def test_impatient_signals_do_not_break_the_stop_off(robot: RealRobot) -> None:
    with driver(robot.endpoint):
        driven(robot)
        for _ in range(20):
            for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
                with contextlib.suppress(ProcessLookupError):
                    robot.daemon.process.send_signal(number)
            time.sleep(0.005)
        assert robot.daemon.end() == 0
        robot.settled_truth()
    assert "Traceback" not in robot.daemon.output


def test_a_signal_is_obeyed_though_nobody_reads_the_log(
    tmp_path: Path, real_robot: Callable[..., RealRobot], client: Callable[..., Client]
) -> None:
    robot = real_robot()
    robot.daemon.says("Connected")
    assert robot.daemon.end() == 0
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(writing, b"." * 4096)
    os.set_blocking(writing, True)
    arguments = [
        *(sys.executable, "-m", "yahboomd", "run", "--port", str(robot.port)),
        *("--set", f'zenoh.listen=["{robot.endpoint}"]', "--set", "zenoh.connect=[]"),
        *("--set", f"estop.latch_file={tmp_path / 'estop'}"),
    ]
    daemon = subprocess.Popen(arguments, stderr=writing)
    try:
        client("client", robot.endpoint).in_state("standing")
        with driver(robot.endpoint):
            driven(robot)
            daemon.terminate()
            assert daemon.wait(60) == 0
            robot.settled_truth()
    finally:
        daemon.kill()
        daemon.wait()
        os.close(writing)
        os.close(reading)


def test_after_sigkill_a_direct_stop_brings_the_wheels_to_rest(robot: RealRobot) -> None:
    with driver(robot.endpoint):
        driven(robot)
        now_ns = time.monotonic_ns()
        robot.daemon.end(signal.SIGKILL)
        # Nobody stops them otherwise.
        time.sleep(0.3)
        assert turning(robot)
        stop = Process("stop", "--direct", "--port", str(robot.port))
        assert stop.end_by_itself() == 0, stop.output
        told(robot, "SIGKILL, 0.3 s of nothing, yahboomd stop --direct", now_ns)


def test_a_daemon_that_starts_after_a_crash_stops_the_wheels_first(
    robot: RealRobot, client: Callable[..., Client]
) -> None:
    with driver(robot.endpoint):
        driven(robot)
        robot.daemon.end(signal.SIGKILL)
    assert turning(robot)
    robot.start_daemon()
    robot.settled_truth()
    client("client", robot.endpoint).in_state("standing")


def test_a_frozen_daemon_feeds_no_watchdog_and_the_manager_stops_the_wheels(
    tmp_path: Path, real_robot: Callable[..., RealRobot], client: Callable[..., Client]
) -> None:
    """The test is the service manager: it waits for the watchdog's words, kills, and stops."""
    robot = real_robot()
    robot.daemon.says("Connected")
    assert robot.daemon.end() == 0
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        robot.environ = {"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "300000"}
        robot.start_daemon()
        client("client", robot.endpoint).in_state("standing")
        with driver(robot.endpoint):
            driven(robot)
            manager.settimeout(60.0)
            while b"WATCHDOG=1" not in manager.recv(4096):
                pass
            robot.daemon.process.send_signal(signal.SIGSTOP)
            time.sleep(0.1)
            manager.setblocking(False)
            with contextlib.suppress(BlockingIOError):
                while True:
                    manager.recv(4096)
            manager.settimeout(1.0)
            with pytest.raises(TimeoutError):
                manager.recv(4096)
            assert turning(robot)
            now_ns = time.monotonic_ns()
            robot.daemon.process.kill()
            stop = Process("stop", "--direct", "--port", str(robot.port))
            assert stop.end_by_itself() == 0, stop.output
            told(robot, "the watchdog's kill, then yahboomd stop --direct", now_ns)


def test_a_daemon_that_was_frozen_obeys_no_command_of_the_meantime(
    robot: RealRobot, client: Callable[..., Client]
) -> None:
    app = client("client", robot.endpoint)
    app.in_state("standing")
    robot.daemon.process.send_signal(signal.SIGSTOP)
    for _ in range(200):
        app.session.put("cmd_vel", FAST)
        time.sleep(0.01)
    before = robot.settled_truth()
    robot.daemon.process.send_signal(signal.SIGCONT)
    # As many of them as the connection kept.
    wait_for(lambda: app.latest("status")["command"].get("backlog", 0) >= 40, "they arrived")
    after = robot.settled_truth()
    assert after.ticks == before.ticks


def test_a_client_that_is_killed_in_mid_motion_leaves_standing_wheels(
    real_robot: Callable[..., RealRobot],
) -> None:
    robot = real_robot()
    robot.daemon.says("Connected")
    with driver(robot.endpoint) as process:
        driven(robot)
        now_ns = time.monotonic_ns()
        process.kill()
        told(robot, "the only client killed", now_ns)


def test_a_client_that_is_killed_while_another_watches_runs_into_its_timeout(
    robot: RealRobot, client: Callable[..., Client]
) -> None:
    app = client("client", robot.endpoint)
    with driver(robot.endpoint) as process:
        driven(robot)
        now_ns = time.monotonic_ns()
        process.kill()
        told(robot, "a client of two killed", now_ns)
    status = app.in_state("standing")
    assert "cmd_vel fell silent" in status["why"]
    assert status["driver"] is None


def test_a_client_that_freezes_leaves_standing_wheels_and_its_thaw_moves_nothing_old(
    robot: RealRobot, client: Callable[..., Client]
) -> None:
    app = client("client", robot.endpoint)
    with driver(robot.endpoint) as process:
        driven(robot)
        process.send_signal(signal.SIGSTOP)
        robot.settled_truth()
        assert "fell silent" in app.in_state("standing")["why"]
        # It goes on commanding, with fresh commands: those it may.
        process.send_signal(signal.SIGCONT)
        driven(robot)


def test_a_router_that_is_lost_takes_the_commands_of_its_clients_with_it(
    real_robot: Callable[..., RealRobot], zenoh_router: Any
) -> None:
    zenoh_router.start()
    robot = real_robot(run=["--set", f'zenoh.connect=["{zenoh_router.endpoint}"]'])
    robot.daemon.says("Connected")
    with driver(zenoh_router.endpoint):
        driven(robot)
        now_ns = time.monotonic_ns()
        zenoh_router.kill()
        told(robot, "the router killed", now_ns)


def test_an_engaged_estop_outlives_a_kill(robot: RealRobot, client: Callable[..., Client]) -> None:
    client("client", robot.endpoint).ask("yahboomd/estop")
    robot.daemon.end(signal.SIGKILL)
    robot.start_daemon()
    app = client("client", robot.endpoint)
    status = app.in_state("estopped")
    assert "it was engaged when yahboomd last ran" in status["why"]
    with driver(robot.endpoint):
        time.sleep(0.5)
    assert max(robot.settled_truth().travel_m) == pytest.approx(0.0, abs=1e-6)
