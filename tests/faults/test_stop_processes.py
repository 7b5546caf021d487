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
from process_priority import DAEMON_NICE, prefer
from real_robot import DRIVER, Client, Process, RealRobot, free_endpoint, wait_for
from terminal_process import TerminalProcess, terminal

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


@pytest.fixture
def robot(real_robot: Callable[..., RealRobot], client: Callable[..., Client]) -> RealRobot:
    robot = real_robot()
    client("client", robot.endpoint).in_state("standing")
    return robot


UNHURRIED = ("--set", "command.timeout_s=10")
"""For tests in which the wheels must turn all the time, though a busy machine delays the driver."""


def test_a_signal_stops_the_wheels_before_the_daemon_ends_and_impatient_ones_do_not_break_it_off(
    robot: RealRobot,
) -> None:
    with driver(robot.endpoint):
        driven(robot)
        for _ in range(20):
            for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
                with contextlib.suppress(ProcessLookupError):
                    robot.daemon.process.send_signal(number)
            time.sleep(0.005)
        # 75: on a machine that starves the board, the daemon may not see it stand.
        assert robot.daemon.end() in {0, 75}
        robot.settled_truth()
    assert "Traceback" not in robot.daemon.output
    assert ": stopping the wheels, then ending." in robot.daemon.output
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


@pytest.mark.nightly
@pytest.mark.cases(1)
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


@pytest.mark.cases(1)
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
        # A starved board sends no counts, and the stop says that nothing shows standing wheels.
        assert stop.end_by_itself() == 0 or "no counters came" in stop.output, stop.output
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


@pytest.mark.nightly
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


@pytest.mark.nightly
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


@pytest.mark.nightly
@pytest.mark.parametrize(
    "dialect", ["rosmaster", pytest.param("streamed", marks=pytest.mark.nightly)]
)
def test_after_sigkill_a_direct_stop_or_the_next_daemon_stops_the_wheels_and_an_estop_stays_engaged(
    real_robot: Callable[..., RealRobot], client: Callable[..., Client], dialect: str
) -> None:
    robot = real_robot(simulate=["--dialect", dialect, "--start-up", "0.5"], run=UNHURRIED)
    client("client", robot.endpoint).in_state("standing")
    with driver(robot.endpoint):
        driven(robot)
        robot.daemon.end(signal.SIGKILL)
    # The board has no time-out, and nothing else stops them.
    time.sleep(0.3)
    assert turning(robot)
    stop = Process("stop", "--direct", "--port", str(robot.port))
    assert stop.end_by_itself() == 0, stop.output
    assert f"{dialect} board" in stop.output
    robot.settled_truth()
    robot.start_daemon()
    with driver(robot.endpoint):
        driven(robot)
        robot.daemon.end(signal.SIGKILL)
    assert turning(robot)
    robot.start_daemon()
    robot.settled_truth()
    app = client("client", robot.endpoint)
    app.in_state("standing")
    assert app.ask("yahboomd/estop")["success"]
    robot.daemon.end(signal.SIGKILL)
    stood = robot.settled_truth()
    robot.start_daemon()
    app = client("client", robot.endpoint)
    assert "it was engaged when yahboomd last ran" in app.in_state("estopped")["why"]
    app.drive(FAST, 0.5)
    assert robot.settled_truth().ticks == stood.ticks


def silent(app: Client) -> dict[str, Any]:
    """The status of wheels that stand because a source fell silent.

    A starved daemon, or one whose starved board sent no counts, stops them for that reason.
    """

    def found() -> dict[str, Any] | None:
        status = app.in_state("standing")
        starved = {each["kind"] for each in app.samples.get("events", ())} & {
            "disconnected",
            "paused",
        }
        return status if starved or "cmd_vel fell silent" in status["why"] else None

    status: dict[str, Any] = wait_for(found, "it fell silent")
    return status


def test_a_client_that_freezes_or_is_killed_leaves_standing_wheels_and_its_thaw_moves_nothing_old(
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
        process.kill()
        robot.settled_truth()
    wait_for(lambda: app.in_state("standing")["driver"] is None, "it has gone")


def test_a_router_that_is_lost_takes_the_commands_of_its_clients_with_it(
    real_robot: Callable[..., RealRobot], zenoh_router: Any
) -> None:
    zenoh_router.start()
    robot = real_robot(run=["--set", f'zenoh.connect=["{zenoh_router.endpoint}"]', *UNHURRIED])
    robot.daemon.says("Connected")
    with driver(zenoh_router.endpoint):
        driven(robot)
        killed_s = time.monotonic()
        zenoh_router.kill()
        robot.settled_truth()
        # Silence alone would have stopped them after ten.
        assert time.monotonic() - killed_s < 9.0


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


def nowhere() -> tuple[str, ...]:
    """Keep a stop from the machine's own robot at the default endpoint."""
    return "--set", f'zenoh.listen=["{free_endpoint()}"]', "--set", "zenoh.connect=[]"


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
    """A robot whose note of its port is in a folder of the test's."""
    environ = {"RUNTIME_DIRECTORY": str(tmp_path / "run")}
    robot = real_robot(environ=environ, run=UNHURRIED)
    client("client", robot.endpoint).in_state("standing")
    return robot


@pytest.fixture
def guarded_robot(
    tmp_path: Path, real_robot: Callable[..., RealRobot], client: Callable[..., Client]
) -> RealRobot:
    """The same, with a guard, which has the local socket."""
    environ = {"RUNTIME_DIRECTORY": str(tmp_path / "run")}
    robot = real_robot(environ=environ, run=UNHURRIED, guarded=True)
    client("client", robot.endpoint).in_state("standing")
    return robot


@pytest.mark.nightly
def test_a_stop_on_this_machine_needs_no_zenoh_session(guarded_robot: RealRobot) -> None:
    with driver(guarded_robot.endpoint), locked_out(guarded_robot):
        driven(guarded_robot)
        ran = stop(guarded_robot)
        assert ran.process.returncode == 0, ran.output
        # Named by itself, not as a client of the bus.
        assert "yahboomd stop` (" in ran.output
        assert "The wheels stand." in ran.output
        # It is latched: the client goes on commanding.
        guarded_robot.settled_truth()


def named(*robots: RealRobot) -> tuple[str, ...]:
    """Options that mean these robots and no other of the machine, and name no port."""
    listen = ", ".join(f'"{robot.endpoint}"' for robot in robots)
    return ("--set", f"zenoh.listen=[{listen}]", "--set", "zenoh.connect=[]")


@pytest.fixture
def neighbour(
    local_robot: RealRobot, real_robot: Callable[..., RealRobot], client: Callable[..., Client]
) -> RealRobot:
    """Another robot, whose daemon has the same runtime folder."""
    other = real_robot(environ=local_robot.environ, run=["--namespace", "bot1", *UNHURRIED])
    client("client", other.endpoint, "bot1/yahboomd").in_state("standing")
    return other


def test_after_sigkill_a_plain_stop_finds_the_port_that_only_the_daemon_was_given_and_is_latched(
    local_robot: RealRobot, neighbour: RealRobot, client: Callable[..., Client]
) -> None:
    with driver(local_robot.endpoint), driver(neighbour.endpoint, "bot1/cmd_vel"):
        driven(local_robot)
        driven(neighbour)
        local_robot.daemon.end(signal.SIGKILL)
        # The daemon that answers beside it is no reason to forget the killed one's board.
        # Its own endpoint keeps it from the machine's robot at the default one.
        at = ("--set", f'zenoh.listen=["{local_robot.endpoint}"]', "--set", "zenoh.connect=[]")
        ran = Process("stop", *at, environ=local_robot.environ)
        # 1 where this machine has daemons that it does not reach: it names them.
        assert ran.end_by_itself() in {0, 1}, ran.output
        assert f"{local_robot.port} (streamed board): the wheels stand" in ran.output
        local_robot.settled_truth()
        driven(neighbour)
        # A service starts it again by itself, and its client drives on.
        assert "emergency stop engaged" in ran.output
        local_robot.start_daemon()
        client("client", local_robot.endpoint).in_state("estopped")


@pytest.mark.nightly
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


@pytest.mark.nightly
def test_a_daemon_with_a_runtime_folder_of_its_own_is_named_with_the_command_that_reaches_it(
    guarded_robot: RealRobot, tmp_path: Path
) -> None:
    ran = Process("stop", *nowhere(), environ={"RUNTIME_DIRECTORY": str(tmp_path / "other")})
    assert ran.end_by_itself() == 69, ran.output
    port = os.path.realpath(guarded_robot.port)
    assert f"yahboomd (pid {guarded_robot.daemon.process.pid}) holds {port}" in ran.output
    assert f"RUNTIME_DIRECTORY={tmp_path / 'run'} " in ran.output
    # Obey that advice.
    ran = Process("stop", "--port", port, environ=guarded_robot.environ)
    assert ran.end_by_itself() == 0, ran.output
    # And the next advice.
    again = ran.output.partition("To drive again: ")[2].partition("stop ")[2].split()
    ran = Process("stop", *again, environ=guarded_robot.environ)
    assert ran.end_by_itself() == 0, ran.output
