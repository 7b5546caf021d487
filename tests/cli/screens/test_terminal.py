from __future__ import annotations

import array
import asyncio
import fcntl
import os
import termios
from collections.abc import Iterator

import pytest
from zenoh_fixtures import eventually

from yahboomd.cli.screens.keyboard import ESCAPE
from yahboomd.cli.screens.terminal import Keys

pytestmark = pytest.mark.realtime


@pytest.fixture
def pty() -> Iterator[tuple[int, int]]:
    master, slave = os.openpty()
    yield master, slave
    for fd in (master, slave):
        try:
            os.close(fd)
        except OSError:
            continue


async def test_keys_come_one_by_one_without_enter(pty: tuple[int, int]) -> None:
    master, slave = pty
    pressed: list[str] = []
    with Keys(slave, pressed.append, lambda: None):
        os.write(master, b"w\x1b[A ")
        await eventually(lambda: len(pressed) == 3)
    assert pressed == ["w", "up", " "]


async def test_an_escape_by_itself_is_a_key_after_a_moment(pty: tuple[int, int]) -> None:
    master, slave = pty
    pressed: list[str] = []
    with Keys(slave, pressed.append, lambda: None):
        os.write(master, b"\x1b")
        await eventually(lambda: pressed)
    assert pressed == [ESCAPE]


async def test_what_would_suspend_kill_or_hold_the_output_is_a_key(pty: tuple[int, int]) -> None:
    master, slave = pty
    pressed: list[str] = []
    with Keys(slave, pressed.append, lambda: None):
        os.write(master, b"\x1a\x1c\x13\x11\x16")
        await eventually(lambda: len(pressed) == 5)
    assert pressed == ["\x1a", "\x1c", "\x13", "\x11", "\x16"]


async def test_the_terminal_is_put_back_even_after_a_failure(pty: tuple[int, int]) -> None:
    _, slave = pty
    before = termios.tcgetattr(slave)

    def fail() -> None:
        with Keys(slave, lambda _: None, lambda: None):
            assert not termios.tcgetattr(slave)[3] & termios.ECHO
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert termios.tcgetattr(slave) == before


def waiting(fd: int) -> int:
    """How many bytes a terminal has ready. The kernel hands them over from a worker of its own."""
    count = array.array("i", [0])
    fcntl.ioctl(fd, termios.FIONREAD, count)
    return count[0]


async def test_what_was_typed_before_is_not_taken(pty: tuple[int, int]) -> None:
    master, slave = pty
    os.write(master, b"wwww\n")
    await eventually(lambda: waiting(slave) == len(b"wwww\n"))
    pressed: list[str] = []
    with Keys(slave, pressed.append, lambda: None):
        os.write(master, b"x")
        await eventually(lambda: pressed)
    assert pressed == ["x"]


async def test_a_terminal_that_goes_away_is_reported_once(pty: tuple[int, int]) -> None:
    master, slave = pty
    gone: list[bool] = []
    with Keys(slave, lambda _: None, lambda: gone.append(True)):
        os.close(master)
        await eventually(lambda: gone)
        for _ in range(3):
            await asyncio.sleep(0)
    assert gone == [True]
