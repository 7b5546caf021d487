"""The guard stops the wheels if the process that it watches dies, or hangs, in a pulse."""

from __future__ import annotations

import asyncio
import os
import select
import signal
import subprocess
import sys
import tty
from collections.abc import Iterator
from typing import NamedTuple

import pytest

from yahboomd.core.errors import BoardError
from yahboomd.core.link import port_note
from yahboomd.core.link.port_identity import identify
from yahboomd.core.link.port_note import PortNote
from yahboomd.tools.port.tool_guard import ToolGuard

pytestmark = pytest.mark.realtime

STOP = b"$pwm:0,0,0,0#"

WATCHED = f"""
import sys, time
from yahboomd.core.link.port_note import note_of
from yahboomd.tools.port.tool_guard import ToolGuard
guard = ToolGuard.start(int(sys.argv[1]), {STOP!r}, note_of(sys.argv[2]))
for mark in sys.argv[3]:
    guard.mark(mark == "+")
print(guard._process.pid, flush=True)
time.sleep(60)
"""


class Ends(NamedTuple):
    """A port without a board: its far end, its descriptor here, and its note."""

    far: int
    fd: int
    note: PortNote


@pytest.fixture
def port() -> Iterator[Ends]:
    far, fd = os.openpty()
    tty.setraw(fd)
    os.set_blocking(fd, False)
    path = os.ttyname(fd)
    yield Ends(far, fd, PortNote(path, 115200, True, False, False, identify(os.stat(path))))
    os.close(far)


class Watched:
    """A process with a guard, whose pulses were marked."""

    def __init__(self, port: Ends, marks: str) -> None:
        words = (str(port.fd), port_note.text_of(port.note), marks)
        self.process = subprocess.Popen(
            [sys.executable, "-c", WATCHED, *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            pass_fds=(port.fd,),
            start_new_session=True,
            text=True,
        )
        os.close(port.fd)
        assert self.process.stdout is not None
        self.guard = int(self.process.stdout.readline())

    def kill(self) -> None:
        self.process.kill()
        self.process.communicate()


def stops(far: int) -> None:
    """See ten stops."""
    found = b""
    while found.count(STOP) < 10:
        found += os.read(far, 4096)


def written(far: int) -> bytes:
    """All that was written until every process has let go of the port."""
    found = b""
    os.set_blocking(far, False)
    while True:
        try:
            found += os.read(far, 4096)
        except BlockingIOError:
            select.select([far], [], [], 0.05)
        except OSError:
            return found


def test_after_a_kill_in_a_pulse_stops_are_sent_until_the_wheels_are_seen(port: Ends) -> None:
    watched = Watched(port, "+-+")
    os.kill(watched.guard, signal.SIGTERM)
    watched.kill()
    stops(port.far)
    # No board answers, so nothing else ends it.
    os.kill(watched.guard, signal.SIGKILL)


def test_a_process_that_hangs_in_a_pulse_has_its_motors_let_go(port: Ends) -> None:
    watched = Watched(port, "+")
    watched.process.send_signal(signal.SIGSTOP)
    assert select.select([port.far], [], [], 30.0)[0]
    assert os.read(port.far, 4096).startswith(STOP)
    os.kill(watched.guard, signal.SIGKILL)
    watched.kill()


def test_a_process_that_dies_between_pulses_is_let_alone(port: Ends) -> None:
    Watched(port, "+-").kill()
    assert written(port.far) == b""


@pytest.mark.nightly
def test_a_guard_that_is_closed_in_order_writes_nothing_and_ends(port: Ends) -> None:
    guard = ToolGuard.start(port.fd, STOP, port.note)
    guard.mark(True)
    guard.mark(False)
    guard.close()
    os.close(port.fd)
    assert written(port.far) == b""


@pytest.mark.nightly
def test_signals_of_the_terminal_do_not_end_it(port: Ends) -> None:
    watched = Watched(port, "+")
    os.killpg(watched.process.pid, signal.SIGINT)
    watched.process.communicate()
    stops(port.far)
    os.kill(watched.guard, signal.SIGKILL)


@pytest.mark.nightly
def test_without_the_guard_there_is_no_pulse(port: Ends) -> None:
    closed = ToolGuard.start(port.fd, STOP, port.note)
    closed.close()
    with pytest.raises(BoardError, match="no motor is turned"):
        closed.mark(True)
    killed = ToolGuard.start(port.fd, STOP, port.note)
    os.kill(killed._process.pid, signal.SIGKILL)
    killed._process.wait()
    with pytest.raises(BoardError, match="no motor is turned"):
        killed.mark(True)
    killed.close()
    os.close(port.fd)


@pytest.mark.nightly
async def test_a_port_that_went_away_is_let_go_and_a_dismissed_guard_ends(port: Ends) -> None:
    assert port.note.device is not None
    away = port.note._replace(device=port.note.device._replace(node="gone"))
    guard = ToolGuard.start(port.fd, STOP, away)
    guard.mark(True)
    waiting = asyncio.create_task(guard.stopped_after_loss())
    os.close(port.fd)
    # The port ends only if no process has it open.
    assert await asyncio.to_thread(written, port.far) == b""
    waiting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await waiting
    guard.dismiss()
    assert not os.path.exists(f"/proc/{guard._process.pid}")
