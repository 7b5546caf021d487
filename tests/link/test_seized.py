"""A seized descriptor as a port, on a real pty."""

from __future__ import annotations

import asyncio
import errno
import os
import pty
import termios
import tty
from collections.abc import Callable, Iterator

import pytest

from yahboomd.clock import SystemClock
from yahboomd.link.port import MAX_PENDING
from yahboomd.link.seize import seize
from yahboomd.link.seized import SeizedPort

pytestmark = pytest.mark.realtime


class Line:
    """A pty and the port on it."""

    def __init__(self) -> None:
        self.master, slave = pty.openpty()
        tty.setraw(slave)
        self.path = os.ttyname(slave)
        os.close(slave)
        self.seized = seize(self.path)
        os.read(self.master, 4096)
        self.heard = b""
        self.lost: list[Exception | None] = []

    def port(self) -> SeizedPort:
        port = SeizedPort(self.seized, SystemClock())
        port.listen(self.hear, self.lost.append)
        return port

    def hear(self, data: bytes) -> None:
        self.heard += data

    def hang_up(self) -> None:
        os.close(self.master)
        self.master = -1


@pytest.fixture
def line() -> Iterator[Line]:
    line = Line()
    yield line
    if line.master >= 0:
        os.close(line.master)


async def eventually(condition: Callable[[], object]) -> None:
    async with asyncio.timeout(20.0):
        while not condition():
            await asyncio.sleep(0.001)


async def test_bytes_pass_both_ways(line: Line) -> None:
    port = line.port()
    port.write(b"$read_flash#")
    assert await port.drain(5.0)
    assert os.read(line.master, 100) == b"$read_flash#"
    os.write(line.master, b"read_flash:OK!\r\n")
    await eventually(lambda: line.heard == b"read_flash:OK!\r\n")
    port.close()
    assert line.lost == []


async def test_a_hang_up_is_reported_once(line: Line) -> None:
    port = line.port()
    line.hang_up()
    await eventually(lambda: line.lost)
    port.write(b"$pwm:0,0,0,0#")
    assert not await port.drain(0.1)
    port.close()
    assert len(line.lost) == 1


async def test_what_the_system_does_not_take_waits_and_then_goes(line: Line) -> None:
    port = line.port()
    termios.tcflow(line.seized.fd, termios.TCOOFF)
    port.write(b"$pwm:0,0,0,0#")
    assert port.pending == 13
    assert not await port.drain(0.05)
    termios.tcflow(line.seized.fd, termios.TCOON)
    assert await port.drain(5.0)
    assert os.read(line.master, 100) == b"$pwm:0,0,0,0#"
    port.close()


async def test_a_port_that_takes_nothing_for_long_is_given_up(line: Line) -> None:
    port = line.port()
    termios.tcflow(line.seized.fd, termios.TCOOFF)
    for _ in range(MAX_PENDING // 64 + 2):
        port.write(bytes(64))
    assert len(line.lost) == 1
    assert isinstance(line.lost[0], OSError)
    assert line.lost[0].errno == errno.ETIMEDOUT


async def test_closing_lets_the_next_one_in(line: Line) -> None:
    port = line.port()
    port.close()
    port.close()
    again = seize(line.path, patience_s=0.0)
    os.close(again.fd)
