from __future__ import annotations

import array
import fcntl
import os
import termios
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st
from zenoh_fixtures import eventually

from yahboomd.tools.screens.keyboard import ESCAPE, UNKNOWN, KeyParser, Keys

TYPED = {
    b"w": ["w"],
    b"wa": ["w", "a"],
    b"\x1b[A": ["up"],
    b"\x1b[B\x1b[D": ["down", "left"],
    b"\x1bOC": ["right"],
    # With shift or control held: the same arrow.
    b"\x1b[1;2A": ["up"],
    b"\x1b[3~": [UNKNOWN],
    b"\x1b[15~w": [UNKNOWN, "w"],
    b"\x1ba": [UNKNOWN],
    b"\x1b\x1b[A": [ESCAPE, "up"],
    "é→w".encode(): ["é", "→", "w"],
    b"\xff\x80w": [UNKNOWN, UNKNOWN, "w"],
    b"\x1b[\x01w": [UNKNOWN, "\x01", "w"],
    # Sequences that no list of keys has, with a letter at their end that would drive.
    b"\x1b[d": [UNKNOWN],
    b"\x1bOw": [UNKNOWN],
    b"\x1b[7;9;1a": [UNKNOWN],
}


@pytest.mark.parametrize(("data", "keys"), TYPED.items())
def test_keys_are_the_same_when_they_come_byte_by_byte(data: bytes, keys: list[str]) -> None:
    parser = KeyParser()
    assert [key for byte in data for key in parser.feed(bytes([byte]))] == keys


@given(st.lists(st.binary(max_size=40)))
def test_no_bytes_raise_and_little_is_held(chunks: list[bytes]) -> None:
    parser = KeyParser()
    for chunk in chunks:
        parser.feed(chunk)
        assert len(parser._text) <= 32
    parser.flush()
    assert not parser.pending


@pytest.fixture
def pty() -> Iterator[tuple[int, int]]:
    master, slave = os.openpty()
    yield master, slave
    for fd in (master, slave):
        try:
            os.close(fd)
        except OSError:
            continue


@pytest.mark.realtime
async def test_what_would_suspend_kill_or_hold_the_output_is_a_key(pty: tuple[int, int]) -> None:
    master, slave = pty
    pressed: list[str] = []
    with Keys(slave, pressed.append, lambda: None):
        os.write(master, b"\x1a\x1c\x13\x11\x16")
        await eventually(lambda: len(pressed) == 5)
    assert pressed == ["\x1a", "\x1c", "\x13", "\x11", "\x16"]


@pytest.mark.realtime
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
    """The bytes that a terminal has ready. A worker of the kernel's hands them over."""
    count = array.array("i", [0])
    fcntl.ioctl(fd, termios.FIONREAD, count)
    return count[0]


@pytest.mark.realtime
async def test_what_was_typed_before_is_not_taken(pty: tuple[int, int]) -> None:
    master, slave = pty
    os.write(master, b"wwww\n")
    await eventually(lambda: waiting(slave) == len(b"wwww\n"))
    pressed: list[str] = []
    with Keys(slave, pressed.append, lambda: None):
        os.write(master, b"x")
        await eventually(lambda: pressed)
    assert pressed == ["x"]
