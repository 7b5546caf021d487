"""A port taken, and the first stop sent on it, with nothing but the operating system.

After a daemon was killed its board drives on, and every millisecond until the first stop is
distance. asyncio and pyserial take several times as long to import as Python itself takes to start,
so the first frames are sent before either is there: this file imports what Python has loaded
anyway, or nearly so. (That is also why it reads the time itself.)

:func:`yahboomd.core.link.port.adopt` takes the descriptor over: the port is opened once,
because opening it toggles lines that the board wires to its reset.
"""

from __future__ import annotations

import errno
import fcntl
import os
import struct
import termios
import time
from typing import NamedTuple

from yahboomd.core.link.port_identity import Device, identify, is_pseudo, same
from yahboomd.core.protocol.first_words import FIRST_WORDS, SPACING_S

PATIENCE_S = 1.0
"""The time for which a held port is retried: a killed process holds it for a moment."""

RETRY_S = 0.02
WRITE_WITHIN_S = 0.1
SENT_WITHIN_S = 3.0

_HELD = (errno.EBUSY, errno.EAGAIN)


class OtherDevice(OSError):
    """The path leads to another device than the one to be stopped; nothing was sent."""


class Seized(NamedTuple):
    """A port that is ours, with the stop on its way.

    Attributes:
        fd: The descriptor: exclusive, raw, not blocking.
        spoken_ns: When the first stop was written; monotonic nanoseconds.
    """

    fd: int
    path: str
    baudrate: int
    spoken_ns: int


def seize(
    path: str,
    *,
    baudrate: int = 115200,
    dtr: bool = True,
    rts: bool = False,
    hangup_on_close: bool = False,
    device: Device | None = None,
    patience_s: float = PATIENCE_S,
) -> Seized:
    """Take the port for this process alone, and stop any board on it.

    Args:
        device: Send to this one only; None for the one that the path leads to.
        patience_s: How long to retry while another process holds it.

    Raises:
        OtherDevice: The path leads to another one than ``device``.
        OSError: It cannot be opened; ``errno`` has the reason.
    """
    deadline = time.monotonic() + patience_s
    while True:
        try:
            fd = take(path, dtr=dtr, rts=rts, device=device)
            break
        except OSError as error:
            if error.errno not in _HELD or time.monotonic() >= deadline:
                raise
        time.sleep(RETRY_S)
    try:
        _make_raw(fd, baudrate, hangup_on_close=hangup_on_close)
        seized = Seized(fd, path, baudrate, time.monotonic_ns())
        stop_again(seized)
    except BaseException:
        os.close(fd)
        raise
    return seized


def stop_again(seized: Seized) -> None:
    """Stop any board on a port that is ours.

    Raises:
        OSError: It went away, or takes no output (``ETIMEDOUT``).
    """
    if _speak(seized.fd, seized.baudrate):
        _speak(seized.fd, seized.baudrate)


def take(path: str, *, dtr: bool, rts: bool, device: Device | None = None) -> int:
    """Open a port for this process alone; nothing is sent on it.

    Args:
        device: Open this one only; None for the one that the path leads to.

    Raises:
        OtherDevice: The path leads to another one than ``device``.
        OSError: It cannot be opened; ``errno`` has the reason.
    """
    # Opening alone may reset the board.
    _check(path, os.stat(path), device)
    fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        _check(path, os.fstat(fd), device)
        # The kernel raises both lines at every open: set them at once.
        for line, raised in ((termios.TIOCM_DTR, dtr), (termios.TIOCM_RTS, rts)):
            _set_line(fd, line, raised=raised)
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        keep_out(fd)
        # Any program may have suspended its output.
        fcntl.ioctl(fd, termios.TCXONC, termios.TCOON)
    except BaseException:
        os.close(fd)
        raise
    return fd


def _check(path: str, status: os.stat_result, device: Device | None) -> None:
    if device is not None and not same(device, identify(status)):
        raise OtherDevice(errno.ENXIO, "another device has this name now", path)


def keep_out(fd: int) -> None:
    """Lock out processes that ask for no lock, until the port is closed.

    Not on a pseudo-terminal: there it lasts as long as the far end, so that a killed owner
    would lock out every user but root, who alone could stop the (simulated) wheels.
    """
    if not is_pseudo(os.fstat(fd).st_rdev):
        fcntl.ioctl(fd, termios.TIOCEXCL)


def _set_line(fd: int, line: int, *, raised: bool) -> None:
    request = termios.TIOCMBIS if raised else termios.TIOCMBIC
    try:
        fcntl.ioctl(fd, request, struct.pack("I", line))
    except OSError as error:
        # A pseudo-terminal has no such lines.
        if error.errno not in {errno.EINVAL, errno.ENOTTY}:
            raise


def _make_raw(fd: int, baudrate: int, *, hangup_on_close: bool) -> None:
    speed = getattr(termios, f"B{baudrate}", None)
    if speed is None:
        raise OSError(errno.EINVAL, f"{baudrate} is no baud rate of this system")
    control = termios.CS8 | termios.CREAD | termios.CLOCAL
    if hangup_on_close:
        control |= termios.HUPCL
    characters: list[bytes | int] = [b"\0"] * termios.NCCS
    # A read that brings nothing must differ from a port that hung up.
    characters[termios.VMIN], characters[termios.VTIME] = 1, 0
    try:
        termios.tcsetattr(fd, termios.TCSANOW, [0, 0, control, 0, speed, speed, characters])
        # Bytes that others left are neither ours to send nor new.
        termios.tcflush(fd, termios.TCIOFLUSH)
    except termios.error as error:
        raise OSError(*error.args) from error


def _speak(fd: int, baudrate: int) -> bool:
    """Send the first words one by one; return whether the port held them up.

    Of a burst the board keeps the last frame only, which may be another dialect's.
    """
    held = False
    for words in FIRST_WORDS.values():
        _send(fd, words)
        time.sleep(len(words) * 10 / baudrate + SPACING_S)
        deadline = time.monotonic() + SENT_WITHIN_S
        while struct.unpack("i", fcntl.ioctl(fd, termios.TIOCOUTQ, b"\0\0\0\0"))[0]:
            held = True
            if time.monotonic() >= deadline:
                raise OSError(errno.ETIMEDOUT, "the port takes no output")
            time.sleep(RETRY_S / 10)
    return held


def _send(fd: int, data: bytes) -> None:
    deadline = time.monotonic() + WRITE_WITHIN_S
    while data:
        try:
            data = data[os.write(fd, data) :]
        except BlockingIOError:
            if time.monotonic() >= deadline:
                raise OSError(errno.ETIMEDOUT, "the port takes no output") from None
            time.sleep(RETRY_S / 10)
