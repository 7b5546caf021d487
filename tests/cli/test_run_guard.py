"""The guard of `yahboomd run`, beside real daemons on a simulated board."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from real_robot import DRIVER, Client, RealRobot, wait_for

from yahboomd.core.link import port_note
from yahboomd.core.link.port_errors import holders
from yahboomd.core.link.port_guard import FAR_MS
from yahboomd.core.link.promise import Promise, memory
from yahboomd.tools.port.charge import Charge
from yahboomd.tools.port.guard import Guard
from yahboomd.tools.port.guard_law import Limits
from yahboomd.tools.stop import last_stop
from yahboomd.tools.stop.stop_local import Talk
from yahboomd.tools.stop.unresponsive import is_guard

KILLED_S = Limits().kill_after / 1000.0


@contextmanager
def driven(robot: RealRobot) -> Iterator[None]:
    """The robot while a program drives it."""
    driver = subprocess.Popen(
        [sys.executable, "-c", DRIVER, robot.endpoint, "cmd_vel"], stdout=subprocess.PIPE
    )
    try:
        assert driver.stdout is not None
        driver.stdout.readline()
        wait_for(lambda: (truth := robot.truth()) and truth[-1].vx > 0.2, "it drives")
        yield
    finally:
        driver.kill()
        driver.communicate()


def guards(daemon: int) -> list[int]:
    """The guards that a process started."""
    found = Path(f"/proc/{daemon}/task/{daemon}/children").read_text().split()
    return [pid for pid in map(int, found) if is_guard(pid)]


@pytest.fixture
def guarded(real_robot: Callable[..., RealRobot], tmp_path: Path) -> RealRobot:
    robot = real_robot(
        guarded=True,
        environ={"RUNTIME_DIRECTORY": str(tmp_path / "run")},
        # A busy machine makes the driving program pause, which must not stop the wheels.
        run=["--set", "command.timeout_s=60"],
    )
    robot.daemon.says("Connected")
    return robot


@pytest.mark.realtime
@pytest.mark.parametrize(
    "name", ["SIGKILL", pytest.param("SIGSEGV", marks=pytest.mark.nightly), "SIGSTOP"]
)
def test_a_daemon_that_is_killed_crashes_or_freezes_in_motion_leaves_standing_wheels(
    guarded: RealRobot, name: str, tmp_path: Path
) -> None:
    daemon = guarded.daemon
    (guard,) = guards(daemon.pid)
    # Whatever is sent to the daemon's job or terminal reaches no process of another session.
    assert os.getsid(guard) == guard
    with driven(guarded):
        memory = Path(f"/proc/{guard}/status").read_text()
        assert int(memory.partition("VmRSS:")[2].split()[0]) * 1024 < 16 * 1024 * 1024
        daemon.process.send_signal(getattr(signal, name))
        # Nothing but the guard ends a daemon that was stopped.
        status = daemon.end_by_itself()
        assert status == -(signal.SIGKILL if name == "SIGSTOP" else getattr(signal, name))
        wait_for(lambda: "the wheels stand, " in daemon.output, "the guard reports them")
        guarded.settled_truth()
    why = "was frozen or starved for 5 s, and was killed" if name == "SIGSTOP" else "ended and left"
    assert f"yahboomd (pid {daemon.pid}) {why}" in daemon.output
    wait_for(lambda: not os.path.exists(f"/proc/{guard}"), "the guard ends")
    assert all(note.ended for note in port_note.read(str(tmp_path / "run")))


HOLD = """
import fcntl, os, sys
port = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
fcntl.flock(port, fcntl.LOCK_EX)
print("held", flush=True)
sys.stdin.read()
"""


def left_without_its_port(robot: RealRobot) -> int:
    """Unplug and kill in motion; the guard, which is suspended once the port is back."""
    (guard,) = guards(robot.daemon.pid)
    with driven(robot):
        assert robot.do("unplug") == "ok"
        robot.daemon.says("went away")
        wait_for(lambda: not holders(str(robot.port)), "guard and daemon have let it go")
        robot.daemon.process.kill()
        os.kill(guard, signal.SIGSTOP)
        robot.daemon.process.wait()
        assert robot.do("replug") == "ok"
    return guard


def left_beside_a_mute_board(robot: RealRobot) -> int:
    """Kill in motion while the board is deaf and mute; the guard, which says so."""
    (guard,) = guards(robot.daemon.pid)
    with driven(robot):
        assert robot.do("loss 1") == "ok"
        robot.daemon.process.kill()
        robot.daemon.process.wait()
    wait_for(lambda: "no board answers" in robot.daemon.output, "the guard says what it sees")
    return guard


@pytest.mark.realtime
def test_no_program_that_has_the_port_of_a_killed_daemon_is_believed_to_stop_its_wheels(
    guarded: RealRobot,
) -> None:
    daemon = guarded.daemon
    guard = left_without_its_port(guarded)
    # As another user's daemon looks.
    with subprocess.Popen(
        ["yahboomd", "-c", HOLD, str(guarded.port)],
        executable=sys.executable,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"held\n"
        os.kill(guard, signal.SIGCONT)
        held = f"the port is held by yahboomd (pid {holder.pid}). The wheels may turn: "
        wait_for(lambda: held in daemon.output, "the guard names the holder")
        assert f"`kill -9 {guard}` ends it now." in daemon.output
        assert not guarded.stands()
        holder.communicate()
    wait_for(lambda: "the wheels stand, " in daemon.output, "the guard reports them")
    guarded.settled_truth()
    wait_for(lambda: not os.path.exists(f"/proc/{guard}"), "the guard ends")


@pytest.mark.realtime
def test_a_board_that_hears_nothing_for_a_while_is_stopped_when_it_hears_again(
    guarded: RealRobot,
) -> None:
    daemon = guarded.daemon
    guard = left_beside_a_mute_board(guarded)
    (holder,) = holders(str(guarded.port))
    assert holder == f"yahboomd-guard (pid {guard})"
    assert not guarded.stands()
    assert guarded.do("clear") == "ok"
    wait_for(lambda: "the wheels stand, " in daemon.output, "the guard reports them")
    guarded.settled_truth()


@pytest.mark.realtime
def test_a_guard_ends_without_the_port_for_the_next_daemon_once_that_is_connected(
    guarded: RealRobot,
) -> None:
    guard = left_without_its_port(guarded)
    killed, daemon = guarded.daemon, guarded.start_daemon()
    daemon.says("Connected")
    os.kill(guard, signal.SIGCONT)
    ended = f"(its guard is pid {guards(daemon.pid)[0]}) has {guarded.port} now, and sent its stop"
    wait_for(lambda: ended in killed.output, "the guard leaves the port to it")
    wait_for(lambda: not os.path.exists(f"/proc/{guard}"), "the guard ends")
    assert "Lost" not in daemon.output


@pytest.mark.realtime
def test_the_guard_of_a_mute_board_lends_the_port_and_ends_once_the_next_owner_sent_its_stop(
    guarded: RealRobot,
) -> None:
    guard = left_beside_a_mute_board(guarded)
    daemon = guarded.start_daemon()
    daemon.says("no board answers")
    # Without a board that answers no stop is known to have been heard.
    assert os.path.exists(f"/proc/{guard}")
    assert guarded.do("clear") == "ok"
    guarded.settled_truth()
    wait_for(lambda: not os.path.exists(f"/proc/{guard}"), "the guard ends")
    daemon.says("Connected")


@contextmanager
def asked(folder: Path, request: bytes = b"stop by yahboomd stop") -> Iterator[Talk]:
    """A request at the guard's socket, whose first line of the answer has come."""
    talk = Talk(str(folder / "run/stop.sock"), request)
    talk.read(1, time.monotonic() + 60.0)
    yield talk
    talk.close()


@pytest.mark.realtime
def test_a_hung_loop_obeys_the_local_stop_and_has_it_latched_when_it_goes_on(
    guarded: RealRobot, tmp_path: Path, client: Callable[..., Client]
) -> None:
    daemon = guarded.daemon
    with asked(tmp_path, b"status") as talk:
        assert (talk.lines[0]["daemon"], talk.lines[0]["pid"]) == ("yahboomd", daemon.pid)
    with driven(guarded):
        daemon.process.send_signal(signal.SIGSTOP)
        with asked(tmp_path) as talk:
            assert talk.lines[0]["engaged"] is talk.lines[0]["sent"] is True
            words = f"yahboomd (pid {daemon.pid}) does not answer: its guard sent the stop."
            assert talk.lines[0]["message"].startswith(words)
        guarded.settled_truth()
        daemon.process.send_signal(signal.SIGCONT)
        app = client("peer", guarded.endpoint)
        why = app.in_state("estopped")["why"]
        assert "engaged by `yahboomd stop` (" in why
        assert guarded.stands()
    assert (guarded.folder / "estop").exists()


@pytest.mark.realtime
def test_a_stop_that_a_daemon_is_killed_before_it_obeys_is_latched_by_its_guard(
    guarded: RealRobot, tmp_path: Path
) -> None:
    daemon = guarded.daemon
    (guard,) = guards(daemon.pid)
    with driven(guarded):
        assert guarded.do("loss 1") == "ok"
        daemon.process.kill()
        daemon.process.wait()
    with asked(tmp_path) as talk:
        assert talk.lines[0]["message"].endswith("has ended; its guard stops the wheels.")
        assert "yahboomd stop" in (guarded.folder / "estop").read_text()
        assert guarded.do("clear") == "ok"
        talk.read(2, time.monotonic() + 60.0)
        assert talk.lines[1]["stood"] is True
    guarded.settled_truth()
    wait_for(lambda: not os.path.exists(f"/proc/{guard}"), "the guard ends")


@pytest.mark.realtime
def test_a_daemon_that_pauses_for_seconds_is_stopped_and_drives_on(guarded: RealRobot) -> None:
    daemon = guarded.daemon
    with driven(guarded):
        daemon.process.send_signal(signal.SIGSTOP)
        guarded.settled_truth()
        daemon.process.send_signal(signal.SIGCONT)
        daemon.says("Its guard stopped the wheels.")
        wait_for(lambda: guarded.truth()[-1].vx > 0.35, "it drives on")
    assert daemon.end() == 0
    assert not {"ERROR", "CRITICAL"} & set(daemon.output.split())


@pytest.mark.nightly
@pytest.mark.realtime
def test_a_pause_of_daemon_and_guard_together_is_no_freeze_of_the_daemon(
    guarded: RealRobot,
) -> None:
    """As when a whole machine, or a control group, stands still."""
    pids = (*guards(guarded.daemon.pid), guarded.daemon.pid)
    for pid in pids:
        os.kill(pid, signal.SIGSTOP)
    until_s = time.monotonic() + KILLED_S + 0.5
    wait_for(lambda: time.monotonic() > until_s, "the time in which a frozen one is killed")
    for pid in reversed(pids):
        os.kill(pid, signal.SIGCONT)
    with driven(guarded):
        assert guarded.daemon.alive
    assert guarded.daemon.end() == 0


@pytest.mark.realtime
def test_a_guard_that_was_killed_is_replaced_and_the_next_one_stops_the_wheels(
    guarded: RealRobot,
) -> None:
    (guard,) = guards(guarded.daemon.pid)
    with driven(guarded):
        os.kill(guard, signal.SIGKILL)
        guarded.daemon.says("The guard has ended, or does not answer: another one was started.")
        assert guarded.daemon.alive
        guarded.daemon.process.kill()
        wait_for(lambda: "the wheels stand, " in guarded.daemon.output, "the next guard reports")
        guarded.settled_truth()


@pytest.mark.nightly
@pytest.mark.realtime
def test_an_end_in_order_needs_no_guard_and_one_that_suspends_with_standing_wheels_is_left_alone(
    guarded: RealRobot,
) -> None:
    daemon = guarded.daemon
    (guard,) = guards(daemon.pid)
    with driven(guarded):
        daemon.process.send_signal(signal.SIGTSTP)
        wait_for(lambda: "State:\tT" in Path(f"/proc/{daemon.pid}/status").read_text(), "suspended")
        until_s = time.monotonic() + KILLED_S + 0.5
        wait_for(lambda: time.monotonic() > until_s, "the time in which a frozen one is killed")
        daemon.process.send_signal(signal.SIGCONT)
        daemon.says("Continued.")
    assert daemon.end() == 0
    wait_for(lambda: not os.path.exists(f"/proc/{guard}"), "the guard ends")
    assert "was killed" not in daemon.output
    assert "a stop was sent" not in daemon.output.lower()


@pytest.mark.realtime
def test_no_guard_is_started_by_an_option(real_robot: Callable[..., RealRobot]) -> None:
    robot = real_robot(guarded=False)
    robot.daemon.says("Connected")
    assert guards(robot.daemon.pid) == []


def test_the_end_of_the_newest_promise_counts_and_standing_wheels_need_none() -> None:
    ours, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    its.setblocking(False)
    promise = Promise(memory())
    guard = Guard(Charge(its.fileno(), 0, 0), its, promise)
    dues = []
    for until_ms in (FAR_MS, FAR_MS - 1, FAR_MS, 0, FAR_MS - 2):
        promise.until_ms = until_ms
        guard._hear(ended=False)
        dues.append(guard._state.due)
    assert dues == [FAR_MS, FAR_MS - 1, FAR_MS, None, FAR_MS - 2]
    ours.close()
    its.close()


def test_a_terminal_that_takes_no_words_holds_up_no_stop(tmp_path: Path) -> None:
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    try:
        while True:
            os.write(writing, bytes(4096))
    except BlockingIOError:
        os.set_blocking(writing, True)
    script = f"import {last_stop.__name__} as stop; stop.say('words')"
    done = subprocess.run([sys.executable, "-c", script], stderr=writing, timeout=60, check=False)
    assert done.returncode == 0
    os.close(reading)
    os.close(writing)
