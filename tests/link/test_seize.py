"""The port taken by the operating system alone, and the first stop on it."""

from __future__ import annotations

import errno
import fcntl
import os
import pty
import select
import subprocess
import sys
import termios
import threading
import time
import tty
from collections.abc import Iterator

import pytest

from yahboomd.core.link import seize as seizing
from yahboomd.core.link.seize import FIRST_WORDS, SPACING_S, seize
from yahboomd.core.protocol.registry import connect_spacing_ns, connect_stop


class Device:
    """The far side of a pty."""

    def __init__(self) -> None:
        self.master, slave = pty.openpty()
        tty.setraw(slave)
        self.path = os.ttyname(slave)
        os.close(slave)

    def read_first_words(self) -> bytes:
        """As many bytes as the first words have: a worker of the kernel's hands them over."""
        found = b""
        while len(found) < len(b"".join(FIRST_WORDS.values())):
            found += os.read(self.master, 4096)
        return found


@pytest.fixture
def device() -> Iterator[Device]:
    device = Device()
    yield device
    os.close(device.master)


def test_the_first_words_are_those_of_the_protocol() -> None:
    assert [resync + stop for resync, stop in connect_stop()] == list(FIRST_WORDS.values())
    assert connect_spacing_ns() == SPACING_S * 1e9


def test_nothing_that_takes_long_is_imported_before_the_first_stop() -> None:
    script = (
        "import sys, yahboomd.cli.main, yahboomd.cli.stop\n"
        "slow = {'asyncio', 'serial', 'msgspec', 'pydantic', 'zenoh', 'ctypes', 'tomllib'}\n"
        "print(sorted(slow & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout == "[]\n"


@pytest.mark.realtime
def test_both_stops_are_on_the_line_when_it_returns(device: Device) -> None:
    before_ns = time.monotonic_ns()
    seized = seize(device.path)
    assert device.read_first_words() == b"".join(FIRST_WORDS.values())
    assert before_ns <= seized.spoken_ns <= time.monotonic_ns() - 20_000_000
    os.close(seized.fd)


@pytest.mark.realtime
def test_output_that_another_program_suspended_goes_on(device: Device) -> None:
    other = os.open(device.path, os.O_RDWR | os.O_NOCTTY)
    termios.tcflow(other, termios.TCOOFF)
    seized = seize(device.path)
    assert device.read_first_words() == b"".join(FIRST_WORDS.values())
    os.close(seized.fd)
    os.close(other)


@pytest.mark.realtime
def test_the_port_is_raw_so_that_bytes_pass_as_they_are(device: Device) -> None:
    slave = os.open(device.path, os.O_RDWR | os.O_NOCTTY)
    termios.tcsetattr(slave, termios.TCSANOW, _cooked(slave))
    seized = seize(device.path)
    assert device.read_first_words() == b"".join(FIRST_WORDS.values())
    os.write(device.master, b"\r\n\x03\x11\x13\x00")
    assert os.read(seized.fd, 100) == b"\r\n\x03\x11\x13\x00"
    with pytest.raises(BlockingIOError):
        os.read(seized.fd, 100)
    for fd in (seized.fd, slave):
        os.close(fd)


def _cooked(fd: int) -> list[object]:
    attributes = termios.tcgetattr(fd)
    attributes[0] |= termios.ICRNL | termios.IXON
    attributes[1] |= termios.OPOST | termios.ONLCR
    attributes[3] |= termios.ICANON | termios.ECHO | termios.ISIG
    return attributes


@pytest.mark.realtime
def test_closing_drops_dtr_only_where_it_is_wanted(device: Device) -> None:
    for wanted in (False, True):
        seized = seize(device.path, hangup_on_close=wanted)
        assert bool(termios.tcgetattr(seized.fd)[2] & termios.HUPCL) == wanted
        fcntl.ioctl(seized.fd, termios.TIOCNXCL)
        os.close(seized.fd)


@pytest.mark.realtime
def test_a_port_that_is_held_is_refused_when_the_patience_ends(device: Device) -> None:
    seized = seize(device.path)
    with pytest.raises(OSError, match=r"busy|unavailable"):
        seize(device.path, patience_s=0.05)
    os.close(seized.fd)


@pytest.mark.realtime
def test_a_port_that_its_holder_lets_go_of_is_taken(device: Device) -> None:
    holder = os.open(device.path, os.O_RDWR | os.O_NOCTTY)
    fcntl.flock(holder, fcntl.LOCK_EX)
    dying = threading.Timer(0.1, os.close, [holder])
    dying.start()
    seized = seize(device.path, patience_s=30.0)
    dying.join()
    os.close(seized.fd)


@pytest.mark.realtime
@pytest.mark.parametrize(
    ("path", "code"), [("/dev/null", errno.ENOTTY), ("/nonexistent/port", errno.ENOENT)]
)
def test_what_is_no_port_is_refused_at_once(path: str, code: int) -> None:
    with pytest.raises(OSError, match=os.strerror(code)):
        seize(path, patience_s=30.0)


@pytest.mark.realtime
def test_a_baud_rate_that_the_system_does_not_have_leaves_the_port_free(device: Device) -> None:
    with pytest.raises(OSError, match="12345 is no baud rate"):
        seize(device.path, baudrate=12345)
    seized = seize(device.path, patience_s=0.0)
    os.close(seized.fd)


@pytest.mark.realtime
def test_a_port_that_takes_no_output_does_not_hold_us_for_ever(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    def write(_fd: int, _data: bytes) -> int:
        raise BlockingIOError(errno.EAGAIN, "full")

    monkeypatch.setattr(os, "write", write)
    with pytest.raises(OSError, match="takes no output"):
        seize(device.path)


@pytest.mark.nightly
@pytest.mark.realtime
def test_a_pseudo_terminal_whose_owner_was_killed_can_be_taken_without_being_root() -> None:
    script = (
        "import asyncio, os, signal, sys\n"
        "from yahboomd.core.clock import SystemClock\n"
        "from yahboomd.core.link.port import PortOptions, open_port\n"
        "from yahboomd.core.link.seize import seize\n"
        "if os.geteuid() == 0:\n"
        "    os.setgid(65534)\n"
        "    os.setuid(65534)\n"
        "master, slave = os.openpty()\n"
        "path = os.ttyname(slave)\n"
        "os.close(slave)\n"
        "for own in (seize, lambda path: open_port(PortOptions(path=path), SystemClock())):\n"
        "    child = os.fork()\n"
        "    if child == 0:\n"
        "        owned = own(path)\n"
        "        if asyncio.iscoroutine(owned):\n"
        "            asyncio.run(owned)\n"
        "        os.kill(os.getpid(), signal.SIGKILL)\n"
        "    os.waitpid(child, 0)\n"
        "    os.close(seize(path, patience_s=0.0).fd)\n"
        "    print('taken')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert done.stdout == "taken\ntaken\n", done.stderr


@pytest.fixture
def held(device: Device, monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    """The pty reports its queue, as a serial port does; set once it was asked."""
    ioctl = fcntl.ioctl
    asked = threading.Event()

    def telling(fd: int, request: int, argument: bytes | int = 0) -> object:
        if request != termios.TIOCOUTQ:
            return ioctl(fd, request, argument)
        # To look for input has a worker of the kernel's hand it over.
        select.select([device.master], [], [], 0)
        answer = ioctl(device.master, termios.FIONREAD, argument)
        if any(answer):  # type: ignore[arg-type]
            asked.set()
        return answer

    monkeypatch.setattr(fcntl, "ioctl", telling)
    return asked


@pytest.mark.realtime
def test_first_words_that_the_port_held_up_are_said_again_each_by_itself(
    device: Device, held: threading.Event
) -> None:
    said: list[bytes] = []

    def line() -> None:
        held.wait()
        while sum(map(len, said)) < 2 * len(b"".join(FIRST_WORDS.values())):
            said.append(os.read(device.master, 4096))

    reader = threading.Thread(target=line)
    reader.start()
    os.close(seize(device.path).fd)
    reader.join()
    assert tuple(said) == tuple(FIRST_WORDS.values()) * 2


@pytest.mark.realtime
def test_a_port_that_never_sends_the_first_words_is_given_up(
    device: Device, held: threading.Event, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(seizing, "SENT_WITHIN_S", 0.05)
    with pytest.raises(OSError, match="takes no output") as caught:
        seize(device.path)
    assert caught.value.errno == errno.ETIMEDOUT
    assert held.is_set()
