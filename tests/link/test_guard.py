"""The guard lets the motors go if the process that it watches dies, or hangs, in a pulse."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest

from yahboomd.core.errors import BoardError
from yahboomd.tools.port.guard import Guard

pytestmark = pytest.mark.realtime

STOP = b"$pwm:0,0,0,0#"

WATCHED = """
import sys, time
from yahboomd.tools.port.guard import Guard
guard = Guard.start(int(sys.argv[1]), b"$pwm:0,0,0,0#")
for mark in sys.argv[2]:
    guard.mark(mark == "+")
print("marked", flush=True)
time.sleep(60)
"""


@pytest.fixture
def port() -> Iterator[tuple[int, int]]:
    """The far end, and the port."""
    ends = os.pipe()
    os.set_blocking(ends[1], False)
    yield ends
    os.close(ends[0])


def watched(fd: int, marks: str) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-c", WATCHED, str(fd), marks],
        stdout=subprocess.PIPE,
        pass_fds=(fd,),
        text=True,
    )
    os.close(fd)
    assert process.stdout is not None
    assert process.stdout.readline() == "marked\n"
    return process


def written(far: int) -> bytes:
    """All that was written until every process has let go of the port."""
    found = b""
    while data := os.read(far, 4096):
        found += data
    return found


def test_a_process_that_is_killed_in_a_pulse_has_its_motors_let_go(port: tuple[int, int]) -> None:
    process = watched(port[1], "+-+")
    process.kill()
    process.communicate()
    found = written(port[0])
    assert found.count(STOP) >= 10
    assert found.replace(STOP, b"") == b""


def test_a_process_that_hangs_in_a_pulse_has_its_motors_let_go(port: tuple[int, int]) -> None:
    process = watched(port[1], "+")
    process.send_signal(signal.SIGSTOP)
    assert select.select([port[0]], [], [], 30.0)[0]
    assert os.read(port[0], 4096).startswith(STOP)
    process.kill()
    process.communicate()


def test_a_process_that_dies_between_pulses_is_let_alone(port: tuple[int, int]) -> None:
    process = watched(port[1], "+-")
    process.kill()
    process.communicate()
    assert written(port[0]) == b""


@pytest.mark.nightly
def test_a_guard_that_is_closed_in_order_writes_nothing_and_ends(port: tuple[int, int]) -> None:
    guard = Guard.start(port[1], STOP)
    guard.mark(True)
    guard.mark(False)
    guard.close()
    os.close(port[1])
    assert written(port[0]) == b""


@pytest.mark.nightly
def test_signals_of_the_terminal_do_not_end_it(port: tuple[int, int]) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", WATCHED, str(port[1]), "+"],
        stdout=subprocess.PIPE,
        pass_fds=(port[1],),
        start_new_session=True,
        text=True,
    )
    os.close(port[1])
    assert process.stdout is not None
    assert process.stdout.readline() == "marked\n"
    os.killpg(process.pid, signal.SIGINT)
    process.communicate()
    assert written(port[0]).startswith(STOP)


@pytest.mark.nightly
def test_without_the_guard_there_is_no_pulse(port: tuple[int, int]) -> None:
    closed = Guard.start(port[1], STOP)
    closed.close()
    with pytest.raises(BoardError, match="no motor is turned"):
        closed.mark(True)
    killed = Guard.start(port[1], STOP)
    os.kill(killed._process.pid, signal.SIGKILL)
    killed._process.wait()
    with pytest.raises(BoardError, match="no motor is turned"):
        killed.mark(True)
    killed.close()
    os.close(port[1])


@pytest.mark.nightly
def test_a_port_that_is_gone_is_no_error(port: tuple[int, int]) -> None:
    far, fd = os.pipe()
    os.close(far)
    process = watched(fd, "+")
    process.kill()
    process.communicate()
    os.close(port[1])
    assert process.returncode == -signal.SIGKILL


@pytest.mark.nightly
def test_a_guard_whose_port_went_away_lets_it_go_and_stops_nothing_that_is_seen_to(
    port: tuple[int, int],
) -> None:
    guard = Guard.start(port[1], STOP)
    guard.mark(True)
    guard.lose_port()
    os.close(port[1])
    # The pipe ends only if no process has it open.
    assert written(port[0]) == b""
    guard.dismiss()
    assert guard._process.returncode == 0
