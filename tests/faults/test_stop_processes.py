"""Faults of processes happen to real ones: signals, kills, freezes, clients that die.

The board is simulated on a real pty, everything speaks a real Zenoh. Outcomes are asserted, never
times; those are printed.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import resource
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from real_robot import DRIVER, Client, Process, RealRobot, free_endpoint, wait_for
from terminal_process import TerminalProcess, terminal

from benchmarks.soak.processes import DAEMON_NICE, prefer

pytestmark = pytest.mark.realtime

__all__ = ["terminal"]

FAST = b'{"vx": 0.4}'


@contextlib.contextmanager
def driver(endpoint: str, key: str = "cmd_vel") -> Iterator[subprocess.Popen[bytes]]:
    """A process that commands motion for as long as it lives."""
    process = subprocess.Popen(
        [sys.executable, "-c", DRIVER, endpoint, key],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    # It has to be in time, like the daemon.
    prefer(process, DAEMON_NICE)
    assert process.stdout is not None
    try:
        assert process.stdout.readline() == b"driving\n"
        yield process
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def turning(robot: RealRobot, since_ns: int = 0, above_m_s: float = 0.3) -> bool:
    samples = [each for each in robot.truth()[-5:] if each.t_ns >= since_ns]
    return len(samples) == 5 and all(min(each.speed_m_s) > above_m_s for each in samples)


def driven(robot: RealRobot, since_ns: int = 0) -> None:
    """Wait until the wheels have their speed: a daemon frozen in its ramp keeps a lower one."""
    wait_for(lambda: turning(robot, since_ns, above_m_s=0.37), "the wheels turn at 0.4 m/s")


def stands(robot: RealRobot) -> bool:
    """Whether the wheels stand now: the truth of this moment is written a while after it."""
    now_ns = time.monotonic_ns()
    wait_for(lambda: robot.truth()[-1].t_ns >= now_ns, "the truth of this moment")
    now = next(each for each in robot.truth() if each.t_ns >= now_ns)
    return max(map(abs, now.speed_m_s)) < 0.03


def report(robot: RealRobot, what: str, since_ns: int) -> None:
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


UNHURRIED = ("--set", "command.timeout_s=10")
"""For tests in which the wheels must turn all the time, though a busy machine delays the driver."""


@pytest.fixture
def unhurried(real_robot: Callable[..., RealRobot], client: Callable[..., Client]) -> RealRobot:
    robot = real_robot(run=UNHURRIED)
    client("client", robot.endpoint).in_state("standing")
    return robot


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_stops_the_wheels_before_the_daemon_ends(
    robot: RealRobot, number: signal.Signals
) -> None:
    with driver(robot.endpoint):
        driven(robot)
        now_ns = time.monotonic_ns()
        assert robot.daemon.end(number) == 0
        assert max(map(abs, robot.settled_truth().speed_m_s)) < 0.03
        report(robot, number.name, now_ns)
    assert "Traceback" not in robot.daemon.output
    assert f"{number.name}: stopping the wheels" in robot.daemon.output
    # They stand because they were commanded to: no wheel is accused of it.
    assert "are commanded" not in robot.daemon.output
    assert "is commanded" not in robot.daemon.output


@pytest.fixture
def no_core() -> Iterator[None]:
    """Signals that dump a core end processes here."""
    limits = resource.getrlimit(resource.RLIMIT_CORE)
    resource.setrlimit(resource.RLIMIT_CORE, (0, limits[1]))
    yield
    resource.setrlimit(resource.RLIMIT_CORE, limits)


@pytest.mark.usefixtures("no_core")
@pytest.mark.parametrize("name", ["SIGQUIT", "SIGRTMAX"])
def test_any_signal_that_kills_stops_the_wheels_first_and_kills_then(
    robot: RealRobot, name: str
) -> None:
    number = getattr(signal, name)
    with driver(robot.endpoint):
        driven(robot)
        assert robot.daemon.end(number) == -number
        assert max(map(abs, robot.settled_truth().speed_m_s)) < 0.03
    assert f"{name}: stopping the wheels" in robot.daemon.output
    assert "Traceback" not in robot.daemon.output


def stopped(robot: RealRobot) -> bool:
    stat = Path(f"/proc/{robot.daemon.process.pid}/stat").read_text()
    return stat.rpartition(")")[2].split()[0] == "T"


@pytest.mark.parametrize("name", ["SIGTSTP", "SIGTTOU"])
def test_a_signal_that_suspends_stops_the_wheels_first_and_old_commands_stay_without_effect(
    robot: RealRobot, client: Callable[..., Client], name: str
) -> None:
    process = robot.daemon.process
    with driver(robot.endpoint):
        driven(robot)
        # An impatient person presses it several times.
        for _ in range(3):
            process.send_signal(getattr(signal, name))
        wait_for(lambda: stopped(robot), "it is suspended")
        assert stands(robot)
        # While it sleeps the port is free: the wheels can be stopped by others.
        stop = Process("stop", "--direct", "--port", str(robot.port))
        assert stop.end_by_itself() == 0, stop.output
    before = robot.settled_truth()
    # Written while it could still write.
    robot.daemon.says("Suspended. SIGCONT (fg, bg) continues it.")
    process.send_signal(signal.SIGCONT)
    robot.daemon.says("Continued")
    app = client("client", robot.endpoint)
    app.in_state("standing")
    assert robot.settled_truth().ticks == before.ticks
    # And it drives again, by new commands.
    with driver(robot.endpoint):
        driven(robot)
    assert robot.daemon.output.count(f"{name}: stopping the wheels") == 1
    assert "Traceback" not in robot.daemon.output


@pytest.mark.usefixtures("no_core")
@pytest.mark.parametrize(("key", "then"), [("\x1a", "stopped"), ("\x1c", "3")])
async def test_ctrl_z_and_ctrl_backslash_at_a_real_terminal_stop_the_wheels_first(
    robot: RealRobot, terminal: Callable[..., TerminalProcess], tmp_path: Path, key: str, then: str
) -> None:
    assert await asyncio.to_thread(robot.daemon.end) == 0
    shell = terminal(
        code=f"""
import os, signal, subprocess, sys
# A shell with job control, and one job.
signal.signal(signal.SIGTTOU, signal.SIG_IGN)
job = subprocess.Popen([sys.executable, "-m", "yahboomd", "run", "--port", {str(robot.port)!r},
    "--set", 'zenoh.listen=["{robot.endpoint}"]', "--set", "zenoh.connect=[]",
    "--set", "estop.latch_file={tmp_path / "estop"}"], process_group=0,
    preexec_fn=lambda: signal.signal(signal.SIGTTOU, signal.SIG_DFL))
os.tcsetpgrp(0, job.pid)
print("its turn", flush=True)
_, status = os.waitpid(job.pid, os.WUNTRACED)
os.tcsetpgrp(0, os.getpgrp())
print("job", "stopped" if os.WIFSTOPPED(status) else os.WTERMSIG(status), flush=True)
job.kill()
"""
    )
    await shell.shows("its turn")
    await shell.shows("Connected")
    with driver(robot.endpoint):
        await asyncio.to_thread(driven, robot)
        shell.type(key)
        # Its last words may come after its end.
        await shell.ended()
        assert await asyncio.to_thread(stands, robot)
    assert f"job {then}" in shell.screen


def test_a_daemon_that_is_continued_before_it_was_suspended_goes_on(
    robot: RealRobot, client: Callable[..., Client]
) -> None:
    with driver(robot.endpoint):
        driven(robot)
        # It takes that long to stop the wheels, so that the signals come in this order.
        robot.do("stall 2")
        robot.daemon.process.send_signal(signal.SIGTSTP)
        robot.daemon.says("then suspending")
        robot.daemon.process.send_signal(signal.SIGCONT)
        robot.daemon.says("Continued before it was suspended")
        driven(robot, time.monotonic_ns())
    assert not stopped(robot)


def test_a_daemon_that_cannot_see_the_wheels_stand_is_not_suspended_and_ends_with_75(
    robot: RealRobot,
) -> None:
    with driver(robot.endpoint):
        driven(robot)
        robot.do("unplug")
        robot.daemon.says("went away")
        robot.daemon.process.send_signal(signal.SIGTSTP)
        robot.daemon.says("Not suspended")
        assert not stopped(robot)
        assert robot.daemon.end() == os.EX_TEMPFAIL
    assert "did not see the wheels stand" in robot.daemon.output


@pytest.mark.parametrize("stall_s", [1.0, 2.0])
def test_an_end_while_the_port_takes_no_output_says_whether_the_wheels_stood(
    robot: RealRobot, stall_s: float
) -> None:
    with driver(robot.endpoint):
        driven(robot)
        robot.do(f"stall {stall_s}")
        over_s = time.monotonic() + stall_s
        status = robot.daemon.end()
    # A pseudo-terminal does not report the bytes that it holds back, so the counters decide.
    assert status in {0, os.EX_TEMPFAIL}
    if status == os.EX_TEMPFAIL:
        assert "did not see the wheels stand" in robot.daemon.output
        # Until then a stop can no more be obeyed than the daemon's was.
        wait_for(lambda: time.monotonic() > over_s, "the port takes output again")
        stop = Process("stop", "--direct", "--port", str(robot.port))
        assert stop.end_by_itself() == 0, stop.output
    robot.settled_truth()


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


def test_a_signal_is_obeyed_though_the_log_is_not_read(
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


def test_after_sigkill_a_direct_stop_brings_the_wheels_to_rest(unhurried: RealRobot) -> None:
    robot = unhurried
    with driver(robot.endpoint):
        driven(robot)
        now_ns = time.monotonic_ns()
        robot.daemon.end(signal.SIGKILL)
        # Nothing else stops them.
        time.sleep(0.3)
        assert turning(robot)
        stop = Process("stop", "--direct", "--port", str(robot.port))
        assert stop.end_by_itself() == 0, stop.output
        report(robot, "SIGKILL, 0.3 s of nothing, yahboomd stop --direct", now_ns)


def test_a_daemon_that_starts_after_a_crash_stops_the_wheels_first(
    unhurried: RealRobot, client: Callable[..., Client]
) -> None:
    robot = unhurried
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
    robot = real_robot(run=UNHURRIED)
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
            wait_for(lambda: stopped(robot), "it is frozen")
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
            report(robot, "the watchdog's kill, then yahboomd stop --direct", now_ns)


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
        report(robot, "the only client killed", now_ns)


def silent(app: Client) -> dict[str, Any]:
    """The status of wheels that stand because a source fell silent."""

    def found() -> dict[str, Any] | None:
        status = app.in_state("standing")
        return status if "cmd_vel fell silent" in status["why"] else None

    status: dict[str, Any] = wait_for(found, "it fell silent")
    return status


def test_a_client_that_is_killed_while_another_watches_runs_into_its_timeout(
    robot: RealRobot, client: Callable[..., Client]
) -> None:
    app = client("client", robot.endpoint)
    with driver(robot.endpoint) as process:
        driven(robot)
        now_ns = time.monotonic_ns()
        process.kill()
        report(robot, "a client of two killed", now_ns)
    assert silent(app)["driver"] is None


def test_a_client_that_freezes_leaves_standing_wheels_and_its_thaw_moves_nothing_old(
    robot: RealRobot, client: Callable[..., Client]
) -> None:
    app = client("client", robot.endpoint)
    with driver(robot.endpoint) as process:
        driven(robot)
        process.send_signal(signal.SIGSTOP)
        robot.settled_truth()
        silent(app)
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
        report(robot, "the router killed", now_ns)


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


def stop(robot: RealRobot, *options: str) -> Process:
    """`yahboomd stop` for this robot, to its end."""
    ran = Process(
        "stop",
        *("--port", str(robot.port)),
        *("--set", f'zenoh.listen=["{robot.endpoint}"]', "--set", "zenoh.connect=[]", *options),
        environ=robot.environ,
    )
    ran.end_by_itself()
    return ran


@contextlib.contextmanager
def locked_out(robot: RealRobot) -> Iterator[None]:
    """150 silent connections, so that no other Zenoh session opens."""
    host, _, port = robot.endpoint.removeprefix("tcp/").rpartition(":")
    silent = []
    try:
        for _ in range(150):
            silent.append(socket.socket())
            silent[-1].setblocking(False)
            silent[-1].connect_ex((host, int(port)))
        yield
    finally:
        for each in silent:
            each.close()


@pytest.fixture
def local_robot(
    tmp_path: Path, real_robot: Callable[..., RealRobot], client: Callable[..., Client]
) -> RealRobot:
    """A robot whose local socket is in a folder of the test's."""
    robot = real_robot(environ={"RUNTIME_DIRECTORY": str(tmp_path / "run")}, run=UNHURRIED)
    client("client", robot.endpoint).in_state("standing")
    return robot


def test_a_stop_on_this_machine_needs_no_zenoh_session(local_robot: RealRobot) -> None:
    with driver(local_robot.endpoint), locked_out(local_robot):
        driven(local_robot)
        ran = stop(local_robot)
        assert ran.process.returncode == 0, ran.output
        # Named by itself, not as a client of the bus.
        assert "yahboomd stop` (" in ran.output
        assert "The wheels stand." in ran.output
        # It is latched: the client goes on commanding.
        local_robot.settled_truth()


def test_a_frozen_daemon_is_named_with_what_ends_it(local_robot: RealRobot) -> None:
    pid = local_robot.daemon.process.pid
    with driver(local_robot.endpoint):
        driven(local_robot)
        local_robot.daemon.process.send_signal(signal.SIGSTOP)
        ran = stop(local_robot)
        assert ran.process.returncode == 69, ran.output
        assert f"yahboomd (pid {pid}) is frozen (stopped by a signal, state T)" in ran.output
        assert f"kill -9 {pid}; " in ran.output
        assert f"stop --port {local_robot.port}" in ran.output
        # Obey that advice.
        local_robot.daemon.end(signal.SIGKILL)
        ran = stop(local_robot)
        assert ran.process.returncode == 0, ran.output
        local_robot.settled_truth()


def test_a_frozen_daemon_that_goes_on_obeys_the_stop_that_it_was_sent(
    local_robot: RealRobot, client: Callable[..., Client]
) -> None:
    app = client("client", local_robot.endpoint)
    with driver(local_robot.endpoint):
        driven(local_robot)
        local_robot.daemon.process.send_signal(signal.SIGSTOP)
        assert stop(local_robot).process.returncode == 69
        local_robot.daemon.process.send_signal(signal.SIGCONT)
        assert "`yahboomd stop` (" in app.in_state("estopped")["why"]
        local_robot.settled_truth()


def test_a_frozen_daemon_without_its_socket_is_named_by_the_port_that_it_holds(
    local_robot: RealRobot, tmp_path: Path
) -> None:
    pid = local_robot.daemon.process.pid
    (tmp_path / "run" / "stop.sock").unlink()
    local_robot.daemon.process.send_signal(signal.SIGSTOP)
    ran = stop(local_robot)
    local_robot.daemon.process.send_signal(signal.SIGCONT)
    assert ran.process.returncode == 69, ran.output
    assert f"(pid {pid}) is frozen (stopped by a signal, state T)" in ran.output
    assert f"kill -9 {pid}; " in ran.output


def test_the_socket_of_a_killed_daemon_is_taken_over_and_a_living_ones_is_not(
    local_robot: RealRobot, real_robot: Callable[..., RealRobot], tmp_path: Path
) -> None:
    run = tmp_path / "run"
    other = real_robot(environ=local_robot.environ, run=["--namespace", "bot1"])
    other.daemon.says("Connected")
    names = {"stop.sock", f"stop-{other.daemon.process.pid}.sock"}
    assert {path.name for path in run.glob("stop*")} == names
    # The name of each reaches it.
    assert stop(other, "--namespace", "bot1").process.returncode == 0
    assert "Emergency stop engaged" not in local_robot.daemon.output
    local_robot.daemon.end(signal.SIGKILL)
    local_robot.start_daemon().says("Connected")
    assert {path.name for path in run.glob("stop*")} == names
    ran = stop(local_robot)
    assert ran.process.returncode == 0, ran.output


def test_a_daemon_of_another_namespace_is_named_where_none_answers(
    real_robot: Callable[..., RealRobot], tmp_path: Path
) -> None:
    environ = {"RUNTIME_DIRECTORY": str(tmp_path / "run")}
    robot = real_robot(environ=environ, run=["--namespace", "bot1"])
    robot.daemon.says("Connected")
    nowhere = ("--set", "zenoh.connect=[]", "--set", f'zenoh.listen=["{robot.endpoint}"]')
    ran = Process("stop", "--namespace", "bot2", *nowhere, environ=environ)
    assert ran.end_by_itself() == 69
    pid = robot.daemon.process.pid
    assert f"bot1 (pid {pid}, {robot.port}) runs here: " in ran.output
    assert "stop --namespace bot1`" in ran.output
    assert "Plug the board in" not in ran.output
    ran = Process("stop", "--release", "--namespace", "bot2", *nowhere, environ=environ)
    assert ran.end_by_itself() == 69
    assert f"stop --release --namespace bot1 --connect {robot.endpoint}`" in ran.output


def named(*robots: RealRobot) -> tuple[str, ...]:
    """Options that mean these robots and no other of the machine, and name no port."""
    listen = ", ".join(f'"{robot.endpoint}"' for robot in robots)
    return ("--set", f"zenoh.listen=[{listen}]", "--set", "zenoh.connect=[]")


def test_after_sigkill_a_plain_stop_finds_the_port_that_only_the_daemon_was_given(
    local_robot: RealRobot,
) -> None:
    with driver(local_robot.endpoint):
        driven(local_robot)
        local_robot.daemon.end(signal.SIGKILL)
    ran = Process("stop", *named(local_robot), environ=local_robot.environ)
    assert ran.end_by_itself() == 0, ran.output
    assert f"{local_robot.port} (streamed board): the wheels stand" in ran.output
    local_robot.settled_truth()


def test_an_end_in_order_leaves_nothing_to_stop(local_robot: RealRobot) -> None:
    assert local_robot.daemon.end() == 0
    ran = Process("stop", *named(local_robot), environ=local_robot.environ)
    assert ran.end_by_itself() == 69, ran.output
    # ExecStopPost= finds its port all the same.
    ran = Process("stop", "--direct", environ=local_robot.environ)
    assert ran.end_by_itself() == 0, ran.output
    assert str(local_robot.port) in ran.output


@pytest.fixture
def neighbour(
    local_robot: RealRobot, real_robot: Callable[..., RealRobot], client: Callable[..., Client]
) -> RealRobot:
    """Another robot, whose daemon has the same runtime folder."""
    other = real_robot(environ=local_robot.environ, run=["--namespace", "bot1", *UNHURRIED])
    client("client", other.endpoint, "bot1/yahboomd").in_state("standing")
    return other


def test_a_plain_stop_covers_the_board_of_a_killed_daemon_beside_a_living_one(
    local_robot: RealRobot, real_robot: Callable[..., RealRobot], client: Callable[..., Client]
) -> None:
    other = real_robot(environ=local_robot.environ)
    client("client", other.endpoint).in_state("standing")
    with driver(local_robot.endpoint), driver(other.endpoint):
        driven(local_robot)
        driven(other)
        local_robot.daemon.end(signal.SIGKILL)
        assert turning(local_robot)
        ran = Process("stop", *named(local_robot, other), environ=local_robot.environ)
        assert ran.end_by_itself() == 0, ran.output
        assert "yahboomd stop` (" in ran.output
        assert f"{local_robot.port} (streamed board): the wheels stand" in ran.output
        local_robot.settled_truth()
        other.settled_truth()


def test_a_direct_stop_stops_the_killed_daemons_board_and_leaves_a_living_neighbours_alone(
    local_robot: RealRobot, neighbour: RealRobot
) -> None:
    with driver(local_robot.endpoint), driver(neighbour.endpoint, "bot1/cmd_vel"):
        driven(local_robot)
        driven(neighbour)
        local_robot.daemon.end(signal.SIGKILL)
        ran = Process("stop", "--direct", environ=local_robot.environ)
        assert ran.end_by_itself() == 0, ran.output
        assert str(local_robot.port) in ran.output
        assert str(neighbour.port) not in ran.output
        local_robot.settled_truth()
        # A busy machine may have starved it for a moment; an emergency stop would have kept it.
        driven(neighbour)


def test_a_daemon_that_waits_for_the_port_of_another_need_not_show_standing_wheels(
    local_robot: RealRobot,
) -> None:
    waiting = Process(
        "run",
        *("--port", str(local_robot.port), "--set", f'zenoh.listen=["{free_endpoint()}"]'),
        *("--set", "zenoh.connect=[]"),
        environ=local_robot.environ,
    )
    try:
        waiting.says("the port is held")
        with driver(local_robot.endpoint):
            driven(local_robot)
            ran = stop(local_robot)
            assert ran.process.returncode == 0, ran.output
            assert (
                f"yahboomd (pid {waiting.process.pid}, {local_robot.port}) does not" in ran.output
            )
            local_robot.settled_truth()
    finally:
        waiting.end()


def test_a_named_port_stops_no_daemon_on_another_port(local_robot: RealRobot) -> None:
    board, port = os.openpty()
    try:
        with driver(local_robot.endpoint):
            driven(local_robot)
            arguments = ("stop", *named(local_robot), "--port", os.ttyname(port))
            ran = Process(*arguments, environ=local_robot.environ)
            # It takes that port, and no board answers there.
            assert ran.end_by_itself() == 1, ran.output
            driven(local_robot)
    finally:
        os.close(board)
        os.close(port)
    assert "Emergency stop engaged" not in local_robot.daemon.output


def test_a_release_that_names_a_port_releases_no_daemon_on_another_port(
    local_robot: RealRobot,
) -> None:
    assert stop(local_robot).process.returncode == 0
    board, port = os.openpty()
    try:
        release = ("stop", "--release", *named(local_robot), "--port")
        ran = Process(*release, os.ttyname(port), environ=local_robot.environ)
        assert ran.end_by_itself() == 69, ran.output
        assert f"is not on {os.ttyname(port)}: nothing was released" in ran.output
    finally:
        os.close(board)
        os.close(port)
    assert "released" not in local_robot.daemon.output
    ran = Process(*release, str(local_robot.port), environ=local_robot.environ)
    assert ran.end_by_itself() == 0, ran.output


def test_a_frozen_daemon_is_named_where_its_address_was_asked(local_robot: RealRobot) -> None:
    pid = local_robot.daemon.process.pid
    local_robot.daemon.process.send_signal(signal.SIGSTOP)
    ran = Process("stop", "--connect", local_robot.endpoint, environ=local_robot.environ)
    status = ran.end_by_itself()
    local_robot.daemon.process.send_signal(signal.SIGCONT)
    assert status == 69, ran.output
    assert f"yahboomd (pid {pid}) is frozen (stopped by a signal, state T)" in ran.output
    assert f"stop --port {os.path.realpath(local_robot.port)}" in ran.output


def test_a_daemon_with_a_runtime_folder_of_its_own_is_named_with_the_command_that_reaches_it(
    local_robot: RealRobot, tmp_path: Path
) -> None:
    nowhere = ("--set", f'zenoh.listen=["{free_endpoint()}"]', "--set", "zenoh.connect=[]")
    ran = Process("stop", *nowhere, environ={"RUNTIME_DIRECTORY": str(tmp_path / "other")})
    assert ran.end_by_itself() == 69, ran.output
    port = os.path.realpath(local_robot.port)
    assert f"yahboomd (pid {local_robot.daemon.process.pid}) holds {port}" in ran.output
    assert f"RUNTIME_DIRECTORY={tmp_path / 'run'} " in ran.output
    # Obey that advice.
    ran = Process("stop", "--port", port, environ=local_robot.environ)
    assert ran.end_by_itself() == 0, ran.output
    # And the next advice.
    again = ran.output.partition("To drive again: ")[2].partition("stop ")[2].split()
    ran = Process("stop", *again, environ=local_robot.environ)
    assert ran.end_by_itself() == 0, ran.output
